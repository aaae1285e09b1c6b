"""Networks of pixels: what they see, what they remember, and that they learn and act as the networks of rows do."""

from typing import Any

import numpy as np
import pytest

from tests.envs.helpers import batch, single
from tests.policies.helpers import ALUMINIUM, SURFACE, info_of
from vibgym.policies.trained.coding import FRAMES, ImageCoding
from vibgym.policies.trained.networks import CELL, occupied, pixels
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import KIND, VERSION, load_trained
from vibgym.scene.parts import part_from

torch = pytest.importorskip("torch")

from agents.networks import MAPS, PixelsActor, trained_tensors  # noqa: E402
from agents.ppo import PPO  # noqa: E402
from agents.train import train  # noqa: E402
from agents.training_file import load_settings  # noqa: E402

TEXT = """
task: Transport
environment: {action: wrench, observation: image, surface: {rows: 6, columns: 8}}
worlds: 16
steps: 1
seed: 3
imitation: {expert: {kind: pose, action: wrench}, rounds: 2, steps: 16, epochs: 2, batch_size: 64}
ppo: {network: pixels, net: [16], critic_net: [8], n_steps: 2, batch_size: 32}
"""
SCENE = info_of("Transport", surface={"rows": 6, "columns": 8})


@pytest.fixture(scope="module")
def coding():
    return ImageCoding(SURFACE, [ALUMINIUM], (), "wrench")


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "image.yaml"
    path.write_text(TEXT)
    return path


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A policy file of a run that was much too short."""
    folder = tmp_path_factory.mktemp("image")
    path = folder / "image.yaml"
    path.write_text(TEXT)
    return train(path, folder / "run", quiet=True)


def image(pose, goal, **settings):
    env = single("Transport", action="wrench", observation="image", **settings)
    observation, _ = env.reset(seed=0, options={"pose": pose, "goal": goal})
    return observation


def actor(coding, seed=0):
    torch.manual_seed(seed)
    made = PixelsActor(coding.shape, [16, 16], "tanh", 1, -0.5)
    torch.nn.init.normal_(made.mean.weight)
    return made


def noise(worlds, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (worlds, 48, 192, 3), dtype=np.uint8)


def test_the_newest_images_come_first_and_an_episode_begins_at_rest(coding):
    a, b, c = noise(2, 1), noise(2, 2), noise(2, 3)
    first = coding.encode(a)
    second = coding.encode(b, first, np.array([False, False]))
    third = coding.encode(c, second, np.array([False, True]))
    planes = third.rows.reshape(2, FRAMES + 1, 48, 192)
    for plane, want in zip(planes[0], (c[0, ..., 0], b[0, ..., 0], a[0, ..., 0], c[0, ..., 1]), strict=True):
        assert (plane == want).all()
    assert (planes[1, :-1] == c[1, ..., 0]).all() and (planes[1, -1] == c[1, ..., 1]).all()
    assert (first.rows.reshape(planes.shape)[0, :-1] == a[0, ..., 0]).all()  # a memory is not written to
    assert (coding.encode(a[0]).rows == first.rows[:1]).all() and coding.single(a[0]) and not coding.single(a)
    for other in ("yesterday", coding.encode(noise(3))):
        with pytest.raises(ValueError, match="state"):
            coding.encode(a, other)


@pytest.mark.parametrize(("arguments", "named"), [
    (((ALUMINIUM, ALUMINIUM), "wrench", None), "one part"),
    (((ALUMINIUM,), "element", None), "action"),
    (((ALUMINIUM,), "wrench", [["goal", 1]]), "columns"),
    (((ALUMINIUM,), "wrench", [["part", 0], ["goal", 1]]), "columns: frames"),
])  # fmt: skip
def test_scenes_that_pixels_do_not_serve(arguments, named):
    parts, action, columns = arguments
    with pytest.raises(ValueError, match=named):
        ImageCoding(SURFACE, parts, (), action, columns)


def test_only_squares_with_something_in_them_are_looked_at(coding):
    planes = np.zeros((3, FRAMES + 1, 48, 192), dtype=np.uint8)
    planes[1, 2, 7, 100], planes[1, 2, 8, 101], planes[2, 0, 47, 191] = 51, 102, 255
    squares = occupied(planes.reshape(3, 1, -1), coding.shape)
    assert squares.plane.tolist() == [(FRAMES + 1) + 2, 2 * (FRAMES + 1)]
    assert squares.pixels.reshape(-1, CELL, CELL)[0].tolist() == pytest.approx(
        np.array([[0, 0, 0], [0, 0.2, 0], [0, 0, 0.4]]), abs=1e-7
    )
    edge = CELL * SURFACE.element_size / 6
    assert squares.x == pytest.approx([33 * edge, 63 * edge], rel=1e-6)
    assert squares.y == pytest.approx([-2 * edge, -15 * edge], rel=1e-6)


@pytest.mark.parametrize("part", ["aluminium_block", {"shape": "disc", "radius": 0.03, "friction": 0.4}])
def test_a_way_is_seen_to_within_a_pixel(part):
    generator, worst = np.random.default_rng(0), 0.0
    made = ImageCoding(SURFACE, [part_from(part)], (), "wrench")
    net = actor(made)
    with torch.no_grad():  # masses that are areas, and the first way from the part to its goal
        net.eyes.conv.weight.fill_(1.0 / CELL**2)
        net.eyes.mix.zero_()
        net.eyes.mix[0].view(-1, MAPS)[0], net.eyes.mix[0].view(-1, MAPS)[-1] = -1.0 / MAPS, 1.0 / MAPS
        for _ in range(10):
            pose, goal = generator.uniform((0.1, 0.05, -3), (0.7, 0.15, 3), (2, 3))
            seen = net.eyes(torch.from_numpy(made.encode(image(pose, goal, parts=[part])).rows))
            way = 0.25 * np.arctanh(seen.numpy().ravel()[:2].astype(float))
            worst = max(worst, np.abs(way - (goal - pose)[:2]).max())
    assert worst < made.shape.pixel


def test_it_does_not_matter_where_on_which_surface_it_happens(coding):
    net, edge = actor(coding), SURFACE.element_size
    wide = {"rows": 12, "columns": 40, "element_size": edge}
    other = ImageCoding(single("Transport", surface=wide).unwrapped.surface, [ALUMINIUM], (), "wrench")
    tensors = trained_tensors(net)

    def act(which, shift, **settings):
        pose, goal = np.array([0.11, 0.07, 0.3]) + shift, np.array([0.28, 0.13, 2.0]) + shift
        seen = which.encode(image(pose, goal, **settings))
        return pixels(tensors, which.shape, "tanh", seen.rows)[0].ravel()

    here = act(coding, 0.0)
    assert np.abs(here).max() > 0.1
    assert act(coding, np.array([9 * edge, 0, 0])) == pytest.approx(here, abs=1e-4)
    assert act(other, np.array([20 * edge, 4 * edge, 0]), surface=wide) == pytest.approx(here, abs=1e-4)


def test_torch_and_numpy_see_the_same(coding):
    env = batch("Transport", 40, action="wrench", observation="image")
    seen = coding.encode(env.reset(seed=5)[0])
    rows = seen.rows.copy()
    rows[3] = 0  # a part that is off the picture, and its goal too
    rows[7].reshape(FRAMES + 1, -1)[1] = 0
    rows[39].reshape(FRAMES + 1, -1)[-1] = 0
    net = actor(coding)
    with torch.no_grad():
        mean, log_std = net(torch.from_numpy(rows))
    tensors = trained_tensors(net)
    got, got_std = pixels(tensors, coding.shape, "tanh", rows)
    assert got.shape == (40, 1, 3) and got.dtype == np.float32 and got.std() > 0.1
    assert np.abs(got - mean.numpy()).max() < 2e-5 and np.abs(got_std - log_std.numpy()).max() < 2e-5
    for world in (3, 7, 39):
        assert np.abs(pixels(tensors, coding.shape, "tanh", rows[world : world + 1])[0] - got[world]).max() < 2e-5


def test_a_policy_file_acts_as_the_model_does_and_remembers(config, tmp_path):
    settings = load_settings(config)
    model = PPO(settings)
    env = model.env
    torch.nn.init.normal_(model.policy.actor.mean.weight)
    model.save_policy(tmp_path / "policy.json", {})
    policy = load_trained(tmp_path / "policy.json", SCENE)
    assert policy.observation == "image" and policy.action == "wrench"
    start, mine, theirs, alone, changed = np.ones(16, bool), None, None, None, 0.0
    observation: Any = env.reset()
    for _ in range(6):
        action, mine = policy.predict(observation, mine, start)
        expected, theirs = model.predict(observation, theirs, start)
        one, alone = policy.predict(observation[4], alone, start[4:5])
        assert np.abs(action - expected).max() < 2e-5 and np.abs(one - action[4]).max() < 2e-5
        changed = max(changed, np.abs(policy.predict(observation)[0] - action).max())
        observation, _, start, _ = env.step(action)
    assert changed > 0.01  # the same image means something else after others
    env.close()


def test_demonstrations_that_do_not_fit_are_refused_before_anything_is_written(config, tmp_path, monkeypatch):
    monkeypatch.setattr(PPO, "imitate", lambda *_: pytest.fail("trains, which would fill the memory"))
    config.write_text(TEXT.replace("steps: 16,", "steps: 100_000,"))
    with pytest.raises(ValueError, match=r"imitation\.steps"):
        train(config, tmp_path / "run", quiet=True)
    assert not (tmp_path / "run").exists()


def test_ppo_trains_it_too(config):
    config.write_text("".join(line for line in TEXT.splitlines(True) if not line.startswith("imitation")))
    settings = load_settings(config)
    assert settings.imitation is None  # during its steps the actor would not be trained by PPO
    model = PPO(settings)
    env = model.env
    before = {name: value.clone() for name, value in model.policy.state_dict().items()}
    model.learn(4 * 2 * 16, lambda metrics: None)
    assert model.rollout.rows.dtype == np.uint8
    assert (model.rollout.rows[1, :, 0].reshape(16, FRAMES + 1, -1)[:, 1]
            == model.rollout.rows[0, :, 0].reshape(16, FRAMES + 1, -1)[:, 0]).any()  # fmt: skip
    for name, value in model.policy.state_dict().items():
        assert torch.isfinite(value).all()
        assert "eyes" not in name or (value != before[name]).any(), name
    env.close()


@pytest.mark.parametrize(("key", "value", "named"), [
    ("columns", [["part", 2], ["goal", 1]], "tensors"),
    ("columns", [["part", "many"], ["goal", 1]], "columns: frames"),
    ("action", "phasor", "action"),
    ("network", "parts", "columns"),
])  # fmt: skip
def test_altered_files(trained, tmp_path, key, value, named):
    tensors, record = load_set(trained, KIND, VERSION)
    load_trained(trained, SCENE)
    kept = {name: spec for name, spec in record.items() if name not in ("format", "version", "tensors", "sha256")}
    path = tmp_path / "altered.json"
    save_set(path, KIND, tensors, {**kept, key: value}, VERSION)
    with pytest.raises(ValueError, match=rf"altered\.json.*{named}"):
        load_trained(path, SCENE)
