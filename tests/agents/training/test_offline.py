"""Offline learning: cloning succeeds on unseen episodes, and IQL's values are those of the paper."""

import json
import math

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml

from agents.offline import DataLearner, Offline
from agents.recording.record import RecordSettings, record
from agents.recording.storage import SCENE
from agents.train import Training, train
from agents.training_file import settings_from
from agents.transitions import Transitions
from tests.agents.training.checkpoints import same
from tests.commands import files_in
from vibgym import checks
from vibgym.policies.trained.storage import load_set

pytestmark = pytest.mark.usefixtures("one_thread")

DATA = "vibgym/align/pose-v0"
RATES = {"learning_rate": 5e-3, "final_learning_rate": 5e-5, "tau": 0.05}
NETWORK = {"turned": True, "remembers": True, "blind": ["position"], "activation": "relu"}


def settings_of(directory, **changes):
    own = {"dataset": DATA, "directory": str(directory), "batch_size": 256, **NETWORK, **changes.pop("offline", {})}
    given = {"task": "Align", "environment": {"action": "wrench"}, "algorithm": "offline", "steps": 200, "offline": own}
    return settings_from({**given, **changes})


def test_cloning_succeeds_on_unseen_episodes(recorded, tmp_path):
    config = tmp_path / "run.yaml"
    network = {"batch_size": 512, "learning_rate": 2e-3}
    given = settings_of(recorded, steps=900, judging={"episodes": 50, "every": 10_000}, offline=network)
    config.write_text(yaml.safe_dump(given.model_dump(exclude_none=True)))
    path = train(config, tmp_path / "run", quiet=True)
    assert float((tmp_path / "run" / "curve.csv").read_text().splitlines()[-1].split(",")[3]) > 0.7
    _, written = load_set(path, "vibgym-policy", 2)
    assert written["training"]["data"]["dataset"] == DATA and len(written["training"]["data"]["sha256"]) == 64


@pytest.mark.parametrize(("algorithm", "own"), [
    ("offline", {"method": "cloning", "critic_net": [8]}), ("offline", {"method": "iql", "critic_net": [8]}),
    ("flow", {"network": "parts"}),
])  # fmt: skip
def test_a_stopped_run_ends_with_the_same_weights(recorded, tmp_path, algorithm, own):
    config = tmp_path / "run.yaml"
    data = {"dataset": DATA, "directory": str(recorded), "batch_size": 32, "net": [8], **NETWORK}
    given = {"task": "Align", "environment": {"action": "wrench"}, "algorithm": algorithm, algorithm: {**data, **own}}
    config.write_text(yaml.safe_dump({**given, "steps": 300, "checkpoint_steps": 100}))

    def weights(name, stop=False):
        update = DataLearner._update

        def stopping(self, step):
            if step == 250:
                raise KeyboardInterrupt
            return update(self, step)

        if stop:
            with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
                patch.setattr(DataLearner, "_update", stopping)
                train(config, tmp_path / name, quiet=True)
        train(config, tmp_path / name, quiet=True)

    weights("whole"), weights("stopped", stop=True)
    assert same(tmp_path / "whole", tmp_path / "stopped")


def learned(recorded, updates=1200, samples=4000, **changes):
    """Learn from one state with two equally frequent actions, one of which is worth 1 more; episodes end at once.

    Returns:
        The action, the state's value and the actions' values.
    """
    own = {"method": "iql", "batch_size": 128, "net": [16], "critic_net": [16], "floor": 10.0, **RATES, **changes}
    learner = Offline(settings_of(recorded, steps=updates, offline=own))
    data, good = learner.data, torch.arange(samples) % 2 == 0
    action = torch.where(good[:, None, None], 0.5, -0.5) * torch.ones(1, 1, 3)
    rows, mask = data.rows[:1].expand(samples + 1, -1, -1), data.mask[:1].expand(samples + 1, -1)
    learner.data = Transitions(rows, mask, torch.arange(samples), action, good.float(), torch.ones(samples), data.facts)
    torch.manual_seed(0)
    for step in range(updates):
        learner._update(step)
    with torch.no_grad():
        mean, value = learner.policy.actor(rows[:1])[0].mean(), learner.policy.critic(rows[:1], mask[:1]).item()
        worth = None if learner.values is None else learner.values(rows[:2], mask[:2], action[:2]).mean(0)[:, 0]
    learner.close()
    return float(mean), value, worth


@pytest.mark.parametrize("expectile", [0.6, 0.9])
def test_values_are_those_of_the_paper(recorded, expectile):
    """Kostrikov et al. 2021: a state's value is an expectile of its actions' values; of 1 and 0, equally frequent, it is the
    expectile itself. Cloning gives the mean of the two actions; weights exp(advantage / temperature) are Boltzmann's.
    """
    action, value, worth = learned(recorded, expectile=expectile, temperature=2.0)
    assert worth == pytest.approx([1.0, 0.0], abs=0.02) and value == pytest.approx(expectile, abs=0.02)
    # Advantages differ by 1, whose standard deviation over both actions is 1/2: weights differ by a factor of e.
    share = math.e / (1.0 + math.e)
    assert action == pytest.approx(0.5 * (2.0 * share - 1.0), abs=0.02)
    assert learned(recorded, method="cloning", updates=500)[0] == pytest.approx(0.0, abs=0.02)


# -- data sets ---------------------------------------------------------------------------------------------------------


def transitions(settings):
    learner = Offline(settings)
    learner.close()
    return learner.data, learner.policy.coding


@pytest.mark.parametrize("memory", [{}, {"remembers": 3, "recalls": ["velocity", "heading"]}])
def test_transitions_are_those_of_an_acting_network(recorded, memory):
    """Step by step in a single environment, turned and with memory; every step leads to the next observation."""
    data, coding = transitions(settings_of(recorded, offline=memory))
    env = gym.make("vibgym/Align-v0", action="wrench", observation="parts")
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


def test_images_are_learned_from(tmp_path):
    """Rows are the planes that an acting network sees; cloning, and flow matching, reduce the error of the actions."""
    made = {"dataset": "vibgym/transport/image-v0", "task": "Transport", "observation": "image", "episodes": 4,
            "first_seed": 1_000_300, "policy": {"kind": "pose", "action": "velocity"}, "directory": str(tmp_path)}  # fmt: skip
    record(RecordSettings.model_validate(made), quiet=True)
    own = {"dataset": made["dataset"], "network": "pixels", "turned": False, "remembers": False, "blind": []}
    given = settings_of(tmp_path, task="Transport", environment={"action": "velocity"}, steps=40, offline=own)
    data, coding = transitions(given)
    assert data.rows.dtype == torch.uint8 and len(data.rows) == len(data.at) + 4
    env = gym.make("vibgym/Transport-v0", action="velocity", observation="image")
    observation, _ = env.reset(seed=1_000_300)
    seen, ended, step = None, False, 0
    while not ended:
        seen = coding.encode(observation, seen)
        assert np.array_equal(data.rows[step], seen.rows[0])
        observation, _, ended, _, _ = env.step(coding.decode(seen, data.action[step].numpy()[None])[0])
        step += 1
    for algorithm, more in (("offline", {}), ("flow", {"net": [32, 32]})):
        plain = {"dataset": made["dataset"], "directory": str(tmp_path), "network": "pixels", "batch_size": 64, **more}
        settings = settings_from(
            {
                "task": "Transport",
                "environment": {"action": "velocity"},
                "algorithm": algorithm,
                "steps": 40,
                algorithm: plain,
            }
        )
        with Training(settings, tmp_path / algorithm, quiet=True) as training:
            errors = [training.learner._update(step)["error"] for step in range(40)]
            assert np.mean(errors[-10:]) < 0.9 * np.mean(errors[:5])
            action, _ = training.learner.acting().predict(observation)
            assert action.shape == (3,) and np.isfinite(action).all()


def test_transitions_do_not_depend_on_the_group_size(recorded, monkeypatch):
    whole, _ = transitions(settings_of(recorded))
    assert whole.facts["episodes"] == 200 and len(whole.at) == whole.facts["steps"] == len(whole.reward)
    assert len(whole.rows) == len(whole.at) + 200 and whole.ended.sum() == 200
    monkeypatch.setattr("agents.transitions.AT_ONCE", 30)
    some, _ = transitions(settings_of(recorded))
    for name in set(Transitions._fields) - {"facts"}:
        assert torch.equal(getattr(whole, name), getattr(some, name)), name


def test_a_data_set_of_several_parts_is_learned_from(tmp_path):
    environment, name = {"randomize": {"parts": [2, 4]}}, "vibgym/sort/planner-v0"
    policy = {"kind": "planner", "law": "pose", "action": "wrench"}
    made = {"dataset": name, "task": "Sort", "observation": "parts", "episodes": 3, "worlds": 3, "policy": policy,
            "directory": str(tmp_path), "environment": environment}  # fmt: skip
    record(RecordSettings.model_validate(made), quiet=True)
    for method in ("cloning", "iql"):
        own = {"dataset": name, "method": method}
        given = settings_of(
            tmp_path, task="Sort", environment={"action": "wrench", **environment}, steps=3, offline=own
        )
        with Training(given, tmp_path / method, quiet=True) as training:
            data = training.learner.data
            assert data.rows.shape[1] == data.action.shape[1] == 6 and 2 <= data.mask[0].sum() <= 4
            assert load_set(training.run(), "vibgym-policy", 2)[1]["training"]["data"]["episodes"] == 3


@pytest.mark.parametrize("changes, named", [
    ({"task": "Rotate"}, "task"), ({"environment": {"action": "field"}}, "action"),
    ({"environment": {"action": "wrench", "surface": {"rows": 8, "columns": 8}}}, "surface"),
    ({"environment": {"action": "element"}}, "environment.action"),
    ({"environment": {"action": "wrench", "observation": "state"}}, "observation"),
    ({"offline": {"dataset": "vibgym/none-v0"}}, "offline.dataset"),
    ({"offline": {"method": "iql", "network": "pixels"}}, "cloning"),
    ({"offline": {"network": "pixels", "turned": False, "remembers": False, "blind": []}}, "observation: parts"),
    ({"offline": {"network": "elements"}}, "elements"), ({"start": "policy.json"}, "start"),
    ({"imitation": {"expert": {"kind": "pose", "action": "wrench"}}}, "imitation"),
])  # fmt: skip
def test_other_settings_and_other_data_are_refused(recorded, changes, named):
    with pytest.raises(ValueError, match=named) as error:
        transitions(settings_of(recorded, **changes))
    assert "\n" not in str(error.value)


def changed(text, **changes):
    metadata = json.loads(text)
    return json.dumps({**metadata, SCENE: json.dumps({**json.loads(metadata[SCENE]), **changes})})


def test_data_of_another_version_or_origin_or_damaged_is_refused(copied):
    directory, place = copied
    metadata, file = place / "data" / "metadata.json", place / "data" / "main_data.hdf5"
    whole, data = metadata.read_text(), file.read_bytes()
    others = {"vibgym": changed(whole, vibgym="0.0.1"), "columns": changed(whole, columns=[["way", 2]])}
    others["record"] = json.dumps({key: value for key, value in json.loads(whole).items() if key != SCENE})
    for named, text in others.items():
        metadata.write_text(text)
        with pytest.raises(ValueError, match=named):
            transitions(settings_of(directory))
    for text in (whole[:40], json.dumps({**json.loads(whole), SCENE: "[]"})):
        metadata.write_text(text)
        with pytest.raises(checks.Refused, match="offline.dataset"):
            transitions(settings_of(directory))
    metadata.write_text(whole)
    file.write_bytes(data[:5000])
    with pytest.raises(checks.Refused, match="offline.dataset"):
        transitions(settings_of(directory))


def test_a_run_continues_only_with_the_same_data(tmp_path, copied):
    directory, place = copied
    config, run = tmp_path / "run.yaml", tmp_path / "run"

    def write(steps):
        given = settings_of(directory, steps=steps, checkpoint_steps=100, offline={"net": [8], "critic_net": [8]})
        config.write_text(yaml.safe_dump(given.model_dump(exclude_none=True)))

    write(100)
    train(config, run, quiet=True)
    before = files_in(run)
    file = place / "data" / "main_data.hdf5"
    file.write_bytes(file.read_bytes() + b"x")
    write(200)
    with pytest.raises(checks.Refused, match=DATA):
        train(config, run, quiet=True)
    assert files_in(run) == before
