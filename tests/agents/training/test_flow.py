"""Flow matching: both of two modes are sampled, NumPy acts as torch has learned, sequences end with their episodes."""

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml

from agents.flow import Flow, FlowActor
from agents.train import train
from agents.training_file import settings_from
from agents.transitions import Transitions
from vibgym.policies import make_policy
from vibgym.policies.trained.flow import rate
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import CODINGS

pytestmark = pytest.mark.usefixtures("one_thread")

DATA = "vibgym/align/pose-v0"
SMALL = {"network": "parts", "net": [32, 32], "batch_size": 256, "horizon": 3, "executed": 2, "learning_rate": 5e-3}


def settings_of(directory, steps, **changes):
    own = {"dataset": DATA, "directory": str(directory), **SMALL, **changes}
    return settings_from(
        {"task": "Align", "environment": {"action": "wrench"}, "algorithm": "flow", "steps": steps, "flow": own}
    )


def test_both_modes_are_sampled_and_none_between(recorded):
    """From one state, actions of 0.5 and -0.5 are equally frequent; their mean, 0, is what regression would learn."""
    learner = Flow(settings_of(recorded, 600))
    data, samples = learner.data, 2000
    action = torch.where(torch.arange(samples)[:, None, None] % 2 == 0, 0.5, -0.5) * torch.ones(1, 1, 3)
    rows, mask = data.rows[:1].expand(2 * samples, -1, -1), data.mask[:1].expand(2 * samples, -1)
    at = 2 * torch.arange(samples)  # episodes of one step, whose action is repeated
    learner.data = Transitions(rows, mask, at, action, torch.zeros(samples), torch.ones(samples), data.facts)
    learner.make_networks(learner.policy.coding)
    torch.manual_seed(0)
    for step in range(600):
        learner._update(step)
    policy = learner.acting()
    noise = np.random.default_rng(0).standard_normal((500, 1, 9), dtype=np.float32)
    found = policy.plan(np.repeat(rows[:1].numpy(), 500, axis=0), noise)[:, 0]
    learner.close()
    share = (found.mean(axis=1) > 0.0).mean()
    assert 0.35 < share < 0.65
    assert np.quantile(np.abs(np.abs(found) - 0.5), 0.9) < 0.15


def test_sequences_repeat_the_last_action_of_their_episode(recorded):
    learner = Flow(settings_of(recorded, 10))
    data = learner.data
    learner.close()
    ends = learner._end.numpy()
    steps = np.arange(len(ends))
    new = np.concatenate([[True], np.diff(data.at.numpy()) > 1])  # first steps of episodes
    episode = np.cumsum(new)
    assert (episode[ends] == episode).all() and (ends >= steps).all()
    assert (ends[np.flatnonzero(new)[1:] - 1] == np.flatnonzero(new)[1:] - 1).all() and ends[-1] == steps[-1]


def test_numpy_acts_as_torch_has_learned():
    env = gym.make("vibgym/Push-v0", action="velocity", observation="parts").unwrapped
    for network in ("parts", "joint"):
        settings = Flow.Settings(dataset="a/b-v0", network=network, net=[16, 16])
        coding = CODINGS[network](env.surface, env.parts, env.parts_layout, "velocity")
        torch.manual_seed(0)
        actor = FlowActor(coding, settings)
        torch.nn.init.normal_(actor.last.weight)
        rows = torch.rand(4, 1, coding.shape.columns)
        sample, t = torch.randn(4, 1, 8 * coding.shape.action), torch.full((4, 1, 1), 0.3)
        with torch.no_grad():
            wanted = actor(rows, sample, t).numpy()
            code = actor.eyes(rows).numpy()
        tensors = {name: each.numpy() for name, each in actor.state_dict().items()}
        assert np.abs(wanted).max() > 0.5
        np.testing.assert_allclose(rate(tensors, code, sample.numpy(), 0.3), wanted, rtol=1e-4, atol=1e-5)


@pytest.fixture(scope="module")
def trained(recorded, tmp_path_factory):
    """Policy file after a few updates."""
    folder = tmp_path_factory.mktemp("flow")
    config = folder / "run.yaml"
    config.write_text(yaml.safe_dump(settings_of(recorded, 20, net=[8]).model_dump(exclude_none=True)))
    return train(config, folder / "run", quiet=True)


def test_it_acts_the_same_alone_and_in_batches(trained):
    """Noise depends only on the number of plans in the episode, two actions of each of which are executed."""
    batch = gym.make_vec("vibgym/Align-v0", num_envs=3, action="wrench", observation="parts", autoreset_mode="Disabled")
    alone = gym.make("vibgym/Align-v0", action="wrench", observation="parts")
    several, one = (make_policy(str(trained), env) for env in (batch, alone))
    calls = []
    plan = one.plan
    one.plan = lambda *given: calls.append(len(calls)) or plan(*given)
    seen, own = batch.reset(seed=5)[0], alone.reset(seed=6)[0]
    states = state = first = None
    for step in range(6):
        if step == 4:  # the world begins again, and so do its plans
            seen, own = batch.reset(seed=5)[0], alone.reset(seed=6)[0]
        start = np.full(3, step == 4)
        actions, states = several.predict(seen, states, start)
        action, state = one.predict(own, state, start[:1])
        np.testing.assert_allclose(action, actions[1], rtol=1e-4, atol=1e-5)
        if step == 0:
            first = action
        elif step == 4:
            np.testing.assert_array_equal(action, first)
        seen, own = batch.step(actions)[0], alone.step(action)[0]
    assert len(calls) == 3
    again, _ = one.predict(own, None, deterministic=False)
    assert not np.array_equal(again, one.predict(own, None, deterministic=False)[0])
    with pytest.raises(ValueError, match="state"):
        one.predict(own, states)
    with pytest.raises(ValueError, match="state"):
        one.predict(own, (1,))


def test_damaged_files_are_refused(trained, tmp_path):
    tensors, record = load_set(trained, "vibgym-policy", 2)
    env = gym.make("vibgym/Align-v0", action="wrench", observation="parts")
    keep = {name: each for name, each in record.items() if name not in ("format", "version", "tensors", "sha256")}
    for change, said in (
        ({"executed": 4}, "flow.executed"), ({"horizon": 2}, "tensors"), ({"scale": 0.0}, "flow.scale"),
        ({"steps": "a"}, "flow.steps"),
    ):  # fmt: skip
        other = tmp_path / "other.json"
        save_set(other, "vibgym-policy", tensors, {**keep, "flow": {**record["flow"], **change}}, 2)
        with pytest.raises(ValueError, match=said):
            make_policy(str(other), env)
    save_set(tmp_path / "other.json", "vibgym-policy", tensors, {**keep, "flow": 1}, 2)
    with pytest.raises(ValueError, match="flow"):
        make_policy(str(tmp_path / "other.json"), env)


@pytest.mark.parametrize(("changes", "said"), [
    ({"net": [8, 16]}, "net"), ({"executed": 9}, "executed"),
    ({"dataset": "vibgym/none-v0"}, "flow.dataset"),
    ({"network": "elements"}, "network"),
    ({"network": "joint"}, "velocity"), ({"network": "pixels"}, "observation: parts"), ({"episodes": 10**6}, "flow.episodes"),
])  # fmt: skip
def test_bad_settings(recorded, changes, said):
    with pytest.raises(ValueError, match=said):
        Flow(settings_of(recorded, 10, **changes))
