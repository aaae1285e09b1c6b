"""Learning from a data set: cloning and flow matching act as recorded, and IQL's values are those of the paper."""

import json
import math
import shutil

import gymnasium as gym
import numpy as np
import pytest
import torch

from agents.flow import Flow, FlowActor
from agents.offline import Offline
from agents.recording.episodes import SCENE
from agents.recording.record import RecordSettings, record
from agents.train import Training
from agents.training_file import settings_from
from agents.transitions import Transitions
from tests.agents.training.helpers import DATA, trained
from tests.commands import files_in, rows_of
from vibgym import checks
from vibgym.policies import make_policy
from vibgym.policies.trained.flow import rate
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import CODINGS, KIND, VERSION

CLONE = {"batch_size": 256, "turned": True, "history": True, "dropped_columns": ["position"], "activation": "relu"}
FLOW = {"network": "parts", "net": [32, 32], "batch_size": 256, "horizon": 3, "executed": 2, "learning_rate": 5e-3}
WRENCH = {"action": "wrench"}


def setup(directory, algorithm="offline", steps=200, **own):
    defaults = CLONE if algorithm == "offline" else FLOW
    data = {"dataset": DATA, "directory": str(directory), **defaults, **own}
    return {"task": "Align", "environment": WRENCH, "algorithm": algorithm, "steps": steps, algorithm: data}


def test_cloning_succeeds_on_unseen_episodes(recorded, tmp_path):
    settings = setup(recorded, steps=900, batch_size=512, learning_rate=2e-3)
    path = trained(tmp_path, **settings, selection={"episodes": 50, "every": 10_000})
    assert float(rows_of(path.parent / "curve.csv")[-1]["success"]) > 0.7
    data = load_set(path, KIND, VERSION)[1]["training"]["data"]
    assert data["dataset"] == DATA and len(data["sha256"]) == 64


def two_actions(learner, samples, spacing):
    """Replace the data by one state with two equally frequent actions, of which one is worth 1 more; episodes end at once."""
    data, good = learner.data, torch.arange(samples) % 2 == 0
    action = torch.where(good[:, None, None], 0.5, -0.5) * torch.ones(1, 1, 3)
    rows, mask = data.rows[:1].expand(spacing * samples + 1, -1, -1), data.mask[:1].expand(spacing * samples + 1, -1)
    at = spacing * torch.arange(samples)
    learner.data = Transitions(rows, mask, at, action, good.float(), torch.ones(samples), data.info)
    learner.make_networks(learner.policy.coding)
    torch.manual_seed(0)
    for step in range(learner.settings.steps):
        learner._update(step)
    learner.close()
    return rows, mask, action


def offline_values(recorded, updates=1200, **changes):
    """Return the mean action, the state's value and the actions' values (None of cloning)."""
    rates = {"learning_rate": 5e-3, "final_learning_rate": 5e-5, "tau": 0.05}
    own = {"method": "iql", "batch_size": 128, "net": [16], "critic_net": [16], "floor": 10.0, **rates, **changes}
    learner = Offline(settings_from(setup(recorded, steps=updates, **own)))
    rows, mask, action = two_actions(learner, 4000, 1)
    with torch.no_grad():
        mean, value = learner.policy.actor(rows[:1])[0].mean(), learner.policy.critic(rows[:1], mask[:1]).item()
        worth = None if learner.values is None else learner.values(rows[:2], mask[:2], action[:2]).mean(0)[:, 0]
    return float(mean), value, worth


@pytest.mark.parametrize("expectile", [0.6, 0.9])
def test_values_are_those_of_the_paper(recorded, expectile):
    """Kostrikov et al. 2021: a state's value is an expectile of its actions' values; of 1 and 0, equally frequent, it is the
    expectile itself. Cloning gives the mean of the two actions; weights exp(advantage / temperature) are Boltzmann's.
    """
    action, value, worth = offline_values(recorded, expectile=expectile, temperature=2.0)
    assert worth == pytest.approx([1.0, 0.0], abs=0.02) and value == pytest.approx(expectile, abs=0.02)
    # Advantages differ by 1, whose standard deviation over both actions is 1/2: weights differ by a factor of e.
    share = math.e / (1.0 + math.e)
    assert action == pytest.approx(0.5 * (2.0 * share - 1.0), abs=0.02)
    assert offline_values(recorded, method="cloning", updates=500)[0] == pytest.approx(0.0, abs=0.02)


# -- flow matching -----------------------------------------------------------------------------------------------------


def test_flow_matching_samples_both_modes_and_none_between(recorded):
    """From one state, actions of 0.5 and -0.5 are equally frequent; their mean, 0, is what regression would learn."""
    learner = Flow(settings_from(setup(recorded, "flow", 600)))
    rows, *_ = two_actions(learner, 2000, 2)  # the action is repeated to the end of the plan
    noise = np.random.default_rng(0).standard_normal((500, 1, 9), dtype=np.float32)
    samples = learner.acting().plan(np.repeat(rows[:1].numpy(), 500, axis=0), noise)[:, 0]
    assert 0.35 < (samples.mean(axis=1) > 0.0).mean() < 0.65
    assert np.quantile(np.abs(np.abs(samples) - 0.5), 0.9) < 0.15


def test_sequences_repeat_the_last_action_of_their_episode(recorded):
    learner = Flow(settings_from(setup(recorded, "flow")))
    learner.close()
    ends, at = learner._end.numpy(), learner.data.at.numpy()
    steps = np.arange(len(ends))
    first = np.flatnonzero(np.concatenate([[True], np.diff(at) > 1]))  # steps of episodes
    episode = np.searchsorted(first, steps, side="right")
    assert (episode[ends] == episode).all() and (ends >= steps).all()
    assert (ends[first[1:] - 1] == first[1:] - 1).all() and ends[-1] == steps[-1]


@pytest.mark.parametrize("network", ["parts", "joint"])
def test_numpy_acts_as_torch_has_learned(network):
    env = gym.make("vibgym/Push-v0", action="velocity", observation="parts").unwrapped
    coding = CODINGS[network](env.surface, env.parts, env.parts_layout, "velocity")
    torch.manual_seed(0)
    actor = FlowActor(coding, Flow.Settings(dataset="a/b-v0", network=network, net=[16, 16]))
    torch.nn.init.normal_(actor.last.weight)
    rows = torch.rand(4, 1, coding.shape.columns)
    sample, t = torch.randn(4, 1, 8 * coding.shape.action), torch.full((4, 1, 1), 0.3)
    with torch.no_grad():
        wanted, code = actor(rows, sample, t).numpy(), actor.eyes(rows).numpy()
    tensors = {name: tensor.numpy() for name, tensor in actor.state_dict().items()}
    assert np.abs(wanted).max() > 0.5
    np.testing.assert_allclose(rate(tensors, code, sample.numpy(), 0.3), wanted, rtol=1e-4, atol=1e-5)


@pytest.fixture(scope="module")
def flow(recorded, tmp_path_factory):
    """Policy file after a few updates."""
    return trained(tmp_path_factory.mktemp("flow"), **setup(recorded, "flow", 20, net=[8]))


def test_flow_acts_the_same_alone_and_in_batches(flow):
    """Noise depends only on the number of plans in the episode, two actions of each of which are executed."""
    batch = gym.make_vec("vibgym/Align-v0", num_envs=3, **WRENCH, observation="parts", autoreset_mode="Disabled")
    alone = gym.make("vibgym/Align-v0", **WRENCH, observation="parts")
    several, one = (make_policy(str(flow), env) for env in (batch, alone))
    calls, plan = [], one.plan
    one.plan = lambda *args: calls.append(len(calls)) or plan(*args)
    seen, own = batch.reset(seed=5)[0], alone.reset(seed=6)[0]
    states = state = first = None
    for step in range(6):
        if step == 4:  # the world begins again, and so do its plans
            seen, own = batch.reset(seed=5)[0], alone.reset(seed=6)[0]
        start = np.full(3, step == 4)
        actions, states = several.predict(seen, states, start)
        action, state = one.predict(own, state, start[:1])
        np.testing.assert_allclose(action, actions[1], rtol=1e-4, atol=1e-5)
        first = action if step == 0 else first
        assert step != 4 or np.array_equal(action, first)
        seen, own = batch.step(actions)[0], alone.step(action)[0]
    assert len(calls) == 3
    again, _ = one.predict(own, None, deterministic=False)
    assert not np.array_equal(again, one.predict(own, None, deterministic=False)[0])
    for foreign in (states, (1,)):
        with pytest.raises(ValueError, match="state"):
            one.predict(own, foreign)


@pytest.mark.parametrize("change, named", [
    ({"executed": 4}, "flow.executed"), ({"horizon": 2}, "tensors"), ({"scale": 0.0}, "flow.scale"),
    ({"steps": "a"}, "flow.steps"), (None, "flow"),
])  # fmt: skip
def test_damaged_files_of_flow_are_refused(flow, tmp_path, change, named):
    tensors, record = load_set(flow, KIND, VERSION)
    keep = {name: spec for name, spec in record.items() if name not in ("format", "version", "tensors", "sha256")}
    changed = 1 if change is None else {**record["flow"], **change}
    save_set(tmp_path / "other.json", KIND, tensors, {**keep, "flow": changed}, VERSION)
    with pytest.raises(ValueError, match=named):
        make_policy(str(tmp_path / "other.json"), gym.make("vibgym/Align-v0", **WRENCH, observation="parts"))


# -- data sets ---------------------------------------------------------------------------------------------------------


def transitions(settings):
    learner = Offline(settings_from(settings))
    learner.close()
    return learner.data, learner.policy.coding


@pytest.mark.parametrize("memory", [{}, {"history": 3, "history_columns": ["velocity", "heading"]}])
def test_transitions_are_those_of_an_acting_network(recorded, memory):
    """Step by step in a single environment, turned and with memory; every step leads to the next observation."""
    data, coding = transitions(setup(recorded, **memory))
    env = gym.make("vibgym/Align-v0", **WRENCH, observation="parts")
    place = 0
    for episode in range(3):
        observation, _ = env.reset(seed=1_000_300 + episode)
        seen, ended = None, False
        while not ended:
            seen = coding.encode(observation, seen)
            assert data.at[place] == place + episode  # one more observation than steps per episode
            assert np.array_equal(data.rows[data.at[place]], seen.rows[0])
            action = coding.decode(seen, data.action[place].numpy()[None])[0]
            observation, reward, ended, truncated, _ = env.step(action)
            assert data.reward[place] == np.float32(reward) and data.ended[place] == ended and not truncated
            assert np.array_equal(data.rows[data.at[place] + 1], coding.encode(observation, seen).rows[0])
            place += 1


def test_transitions_do_not_depend_on_the_group_size(recorded, monkeypatch):
    whole, _ = transitions(setup(recorded))
    assert whole.info["episodes"] == 200 and len(whole.at) == whole.info["steps"] == len(whole.reward)
    assert len(whole.rows) == len(whole.at) + 200 and whole.ended.sum() == 200
    monkeypatch.setattr("agents.transitions.AT_ONCE", 30)
    some, _ = transitions(setup(recorded))
    for name in set(Transitions._fields) - {"info"}:
        assert torch.equal(getattr(whole, name), getattr(some, name)), name


def test_images_are_learned_from(tmp_path):
    """Rows are the planes that an acting network sees; cloning and flow matching reduce the error of the actions."""
    made = {"dataset": "vibgym/transport/image-v0", "task": "Transport", "observation": "image", "episodes": 4,
            "first_seed": 1_000_300, "policy": {"kind": "pose", "action": "velocity"}, "directory": str(tmp_path)}  # fmt: skip
    record(RecordSettings.model_validate(made), quiet=True)
    env = gym.make("vibgym/Transport-v0", action="velocity", observation="image")
    for algorithm, own in (("offline", {"turned": False, "history": False, "dropped_columns": []}), ("flow", {})):
        more = {"dataset": made["dataset"], "network": "pixels", "batch_size": 64, **own}
        settings = setup(tmp_path, algorithm, 40, **more) | {"task": "Transport", "environment": {"action": "velocity"}}
        with Training(settings_from(settings), tmp_path / algorithm, quiet=True) as training:
            learner = training.learner
            data, coding = learner.data, learner.policy.coding
            assert data.rows.dtype == torch.uint8 and len(data.rows) == len(data.at) + 4
            observation, _ = env.reset(seed=1_000_300)
            seen, ended, step = None, False, 0
            while not ended:
                seen = coding.encode(observation, seen)
                assert np.array_equal(data.rows[step], seen.rows[0])
                observation, _, ended, _, _ = env.step(coding.decode(seen, data.action[step].numpy()[None])[0])
                step += 1
            errors = [learner._update(step)["error"] for step in range(40)]
            assert np.mean(errors[-10:]) < 0.9 * np.mean(errors[:5])
            assert learner.acting().predict(observation)[0].shape == (3,)


def test_a_data_set_of_several_parts_is_learned_from(tmp_path):
    environment, name = {"randomize": {"parts": [2, 4]}}, "vibgym/sort/planner-v0"
    policy = {"kind": "planner", "law": "pose", "action": "wrench"}
    data = {"dataset": name, "task": "Sort", "observation": "parts", "episodes": 3, "worlds": 3, "policy": policy,
            "directory": str(tmp_path), "environment": environment}  # fmt: skip
    record(RecordSettings.model_validate(data), quiet=True)
    settings = setup(tmp_path, steps=3, dataset=name, method="iql")
    settings |= {"task": "Sort", "environment": {**WRENCH, **environment}}
    with Training(settings_from(settings), tmp_path / "run", quiet=True) as training:
        data = training.learner.data
        assert data.rows.shape[1] == data.action.shape[1] == 6 and 2 <= data.mask[0].sum() <= 4
        assert load_set(training.run(), KIND, VERSION)[1]["training"]["data"]["episodes"] == 3


def with_scene(**changes):
    """Change the description of the scene in the metadata."""
    return lambda metadata: {**metadata, SCENE: json.dumps({**json.loads(metadata[SCENE]), **changes})}


SPOILT = {  # metadata, and what the error names
    "version": (with_scene(vibgym="0.0.1"), "vibgym"),
    "columns": (with_scene(columns=[["way", 2]]), "columns"),
    "origin": (lambda metadata: {key: value for key, value in metadata.items() if key != SCENE}, "record"),
    "scene": (lambda metadata: {**metadata, SCENE: "[]"}, "offline.dataset"),
    "metadata": (lambda metadata: [], "offline.dataset"),
    "data": (None, "offline.dataset"),
}


@pytest.mark.parametrize("case", SPOILT)
def test_data_of_another_version_or_origin_or_damaged_is_refused(recorded, tmp_path, case):
    place = shutil.copytree(recorded, tmp_path / "data sets") / DATA / "data"
    (change, named), path = SPOILT[case], place / "metadata.json"
    if change is None:
        (place / "main_data.hdf5").write_bytes(bytes(5000))
    else:
        path.write_text(json.dumps(change(json.loads(path.read_text()))))
    with pytest.raises(checks.Refused, match=named):
        transitions(setup(tmp_path / "data sets"))


def test_a_run_continues_only_with_the_same_data(recorded, tmp_path):
    directory = shutil.copytree(recorded, tmp_path / "data sets")
    small = {"net": [8], "critic_net": [8]}
    trained(tmp_path, **setup(directory, steps=100, **small))
    before, file = files_in(tmp_path / "run"), directory / DATA / "data" / "main_data.hdf5"
    file.write_bytes(file.read_bytes() + b"x")
    with pytest.raises(checks.Refused, match=DATA):
        trained(tmp_path, **setup(directory, **small))
    assert files_in(tmp_path / "run") == before
