"""What is learned from data sets alone, and which data sets are refused."""

import json
import math

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml

from agents.recording.record import SCENE, record
from agents.recording.record_settings import RecordSettings
from agents.training.offline.algorithm import Offline
from agents.training.offline.hyperparameters import OfflineSettings
from agents.training.offline.learner import OfflineLearner
from agents.training.offline.transitions import Transitions, read
from agents.training.parts_policy import PartsPolicy
from agents.training.sac.algorithm import SAC
from agents.training.train import Training, train
from agents.training.training_file import load_settings, settings_from
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.storage import load_set
from vibgym.policies.trained.trained import load_trained

pytestmark = pytest.mark.usefixtures("one_thread")

DATA = "vibgym/align/pose-v0"
RATES = {"learning_rate": 5e-3, "final_learning_rate": 5e-5, "tau": 0.05}
NETWORK = {"turned": True, "remembers": True, "blind": ["position"], "activation": "relu"}


def settings_of(directory, **changes):
    own = {"dataset": DATA, "directory": str(directory), "batch_size": 256, **NETWORK, **changes.pop("offline", {})}
    given = {"task": "Align", "environment": {"action": "wrench"}, "algorithm": "offline", "steps": 200, "offline": own}
    return settings_from({**given, **changes})


def trained(config, directory, changes):
    with Training(load_settings(config, changes=changes), directory, quiet=True) as training:
        return training.run()


def transitions(settings):
    env = Offline(settings).make_env()
    coding = Offline(settings).coding(env.env)
    return read(settings.own, env.env, settings.action, coding), coding


def test_transitions_are_what_an_acting_network_would_have_seen(recorded):
    """Step by step in a single environment, turned and with memory; every step leads to the next observation."""
    data, coding = transitions(settings_of(recorded))
    env = gym.make("vibgym/Align-v0", action="wrench", observation="parts")
    place = 0
    for episode in range(3):
        observation, _ = env.reset(seed=300 + episode)
        seen, ended = None, False
        while not ended:
            seen = coding.see(observation, seen)
            assert data.at[place] == place + episode  # an observation more for every episode before
            assert np.array_equal(data.rows[data.at[place]], seen.rows[0])
            said = data.action[place].numpy()[None]
            action = coding.actions(seen, said)[0]
            assert np.allclose(said, coding.to_rows(seen, action.reshape(1, 1, -1)), atol=1e-7)
            observation, reward, ended, truncated, _ = env.step(action)
            assert data.reward[place] == np.float32(reward) and data.ended[place] == ended and not truncated
            assert np.array_equal(data.rows[data.at[place] + 1], coding.see(observation, seen).rows[0])
            place += 1


def test_as_many_transitions_as_steps(recorded, monkeypatch):
    """Also where they are read a few episodes at a time."""
    whole, _ = transitions(settings_of(recorded))
    assert whole.facts["episodes"] == 200 and len(whole.at) == whole.facts["steps"] == len(whole.reward)
    assert len(whole.rows) == len(whole.at) + 200 and whole.ended.sum() == 200
    monkeypatch.setattr("agents.training.offline.transitions.AT_ONCE", 30)
    some, _ = transitions(settings_of(recorded))
    for name in Transitions._fields:
        mine, theirs = getattr(whole, name), getattr(some, name)
        assert mine == theirs if isinstance(mine, dict) else torch.equal(mine, theirs), name


def test_several_parts(tmp_path):
    made = {"dataset": "vibgym/sort/planner-v0", "task": "Sort", "observation": "parts", "episodes": 3, "worlds": 3,
            "policy": {"kind": "planner", "law": "pose", "action": "wrench"}, "directory": str(tmp_path),
            "environment": {"randomize": {"parts": [2, 4]}}}  # fmt: skip
    record(RecordSettings.model_validate(made), quiet=True)
    config = tmp_path / "sort.yaml"
    environment = {"action": "wrench", "randomize": {"parts": [2, 4]}}
    given = settings_of(tmp_path, task="Sort", environment=environment, offline={"dataset": made["dataset"]})
    data, coding = transitions(given)
    assert data.rows.shape[1] == data.action.shape[1] == len(coding.parts) == 6 and 2 <= data.mask[0].sum() <= 4
    config.write_text(yaml.safe_dump({**given.model_dump(exclude_none=True), "steps": 3}))
    for method in ("cloning", "iql"):
        policy = trained(config, tmp_path / method, {"offline.method": method})
        assert load_set(policy, "vibgym-policy", 2)[1]["training"]["data"]["episodes"] == 3


def test_cloning_does_what_was_done(recorded, tmp_path):
    """From 200 episodes: most of those that it never saw succeed; the policy tells what it was learned from."""
    config = tmp_path / "run.yaml"
    network = {"batch_size": 512, "learning_rate": 2e-3}
    given = settings_of(recorded, steps=900, judging={"episodes": 50, "every": 10_000}, offline=network)
    config.write_text(yaml.safe_dump(given.model_dump(exclude_none=True)))
    path = train(config, tmp_path / "run", quiet=True)
    assert float((tmp_path / "run" / "curve.csv").read_text().splitlines()[-1].split(",")[3]) > 0.7
    env = gym.make_vec("vibgym/Align-v0", num_envs=1, action="wrench", observation="parts")
    assert load_trained(path, TaskInfo.of(env)).action == "wrench"
    _, written = load_set(path, "vibgym-policy", 2)
    assert written["training"]["data"]["dataset"] == DATA and len(written["training"]["data"]["sha256"]) == 64


class Bandit:
    """One state in which two actions were done as often, one of which is worth 1 more; episodes end at once."""

    def __init__(self, recorded, samples=4000):
        self.settings = settings_of(
            recorded,
            offline={"method": "iql", "batch_size": 128, "net": [16], "critic_net": [16], "floor": 10.0, **RATES},
        )
        self.env = Offline(self.settings).make_env()
        data, self.coding = transitions(self.settings)
        good = torch.arange(samples) % 2 == 0
        action = torch.where(good[:, None, None], 0.5, -0.5) * torch.ones(1, 1, 3)
        rows, mask = data.rows[:1].expand(samples + 1, -1, -1), data.mask[:1].expand(samples + 1, -1)
        self.data = Transitions(
            rows, mask, torch.arange(samples), action, good.float(), torch.ones(samples), data.facts
        )

    def learned(self, updates=1200, **changes):
        own = OfflineSettings.model_validate({**self.settings.own.model_dump(), **changes})
        torch.manual_seed(0)
        policy = PartsPolicy(
            self.env.observation_space,
            self.env.action_space,
            lambda _: 1e-3,
            coding=self.coding,
            network=own,
            log_std=-3.0,
        )
        learner = OfflineLearner(policy, self.env, self.data, own, updates)
        for step in range(updates):
            learner._update(step)
        rows, mask = self.data.rows[:2], self.data.mask[:2]
        with torch.no_grad():
            action = policy.actor(rows[:1])[0].mean()
            value = policy.critic(rows[:1], mask[:1]).item()
            worth = None if learner.values is None else learner.values(rows, mask, self.data.action[:2]).mean(0)[:, 0]
        return float(action), value, worth


@pytest.mark.parametrize("expectile", [0.6, 0.9])
def test_values_are_those_of_the_paper(recorded, expectile):
    """Kostrikov et al. 2021: the value of a state is an expectile of its actions' values; of 1 and 0, each done as often, it
    is the expectile itself. Cloning goes between the two actions; a weight of exp(advantage / temperature) is Boltzmann's.
    """
    bandit = Bandit(recorded)
    action, value, worth = bandit.learned(expectile=expectile, temperature=2.0)
    assert worth == pytest.approx([1.0, 0.0], abs=0.02) and value == pytest.approx(expectile, abs=0.02)
    # Advantages differ by 1, whose standard deviation over both actions is 1/2: weights differ by a factor of e.
    share = math.e / (1.0 + math.e)
    assert action == pytest.approx(0.5 * (2.0 * share - 1.0), abs=0.02)
    cloned, _, _ = bandit.learned(method="cloning", updates=500)
    assert cloned == pytest.approx(0.0, abs=0.02)


def test_networks_that_do_not_fit_are_refused_by_their_name(recorded):
    for changes, _named in (
        ({"offline": {"network": "pixels"}, "environment": {"action": "wrench", "observation": "image"}}, "'pixels'"),
        ({"offline": {"network": "elements"}}, "'elements'.*this action has no elements"),
    ):
        settings = settings_of(recorded, **changes)
        with pytest.raises(ValueError, match="offline.network"):
            Offline(settings).make_model(Offline(settings).make_env())


def test_a_data_set_that_is_not_there_is_refused(recorded):
    with pytest.raises(ValueError, match="offline.dataset"):
        transitions(settings_of(recorded, offline={"dataset": "vibgym/none-v0"}))


@pytest.mark.parametrize("changes, named", [
    ({"task": "Rotate"}, "task: Align.*a data set with Rotate"),
    ({"environment": {"action": "wrench", "surface": {"rows": 8, "columns": 8}}}, "surface"),
    ({"environment": {"action": "field"}}, "action: wrench"),
    ({"environment": {"action": "element"}}, "environment.action"),
])  # fmt: skip
def test_data_of_another_scene_is_refused(recorded, changes, named):
    with pytest.raises(ValueError, match=named):
        transitions(settings_of(recorded, **changes))


def changed(path, **changes):
    metadata = json.loads(path.read_text())
    metadata[SCENE] = json.dumps({**json.loads(metadata[SCENE]), **changes})
    path.write_text(json.dumps(metadata))


def test_data_of_another_version_or_another_maker_or_damaged_is_refused(tmp_path, copied):
    directory, place = copied
    metadata = place / "data" / "metadata.json"
    whole = metadata.read_text()
    for other, named in (({"vibgym": "0.0.1"}, "its vibgym: 0.0.1"), ({"columns": [["way", 2]]}, "its columns: ")):
        changed(metadata, **other)
        with pytest.raises(ValueError, match=named):
            transitions(settings_of(directory))
        metadata.write_text(whole)
    metadata.write_text(json.dumps({key: value for key, value in json.loads(whole).items() if key != SCENE}))
    with pytest.raises(ValueError, match="a data set that 'python -m agents record' has made"):
        transitions(settings_of(directory))
    metadata.write_text(whole)
    file = place / "data" / "main_data.hdf5"
    file.write_bytes(file.read_bytes()[:5000])
    with pytest.raises(ValueError, match="offline.dataset"):
        transitions(settings_of(directory))


def test_a_run_goes_on_with_its_own_data_alone(tmp_path, copied):
    """Recorded anew under the same name, it is another one."""
    directory, place = copied
    config = tmp_path / "run.yaml"
    given = settings_of(directory, steps=100, checkpoint_steps=100).model_dump(exclude_none=True)
    config.write_text(yaml.safe_dump(given))
    train(config, tmp_path / "run", quiet=True)
    file = place / "data" / "main_data.hdf5"
    file.write_bytes(file.read_bytes() + b"x")
    config.write_text(yaml.safe_dump({**given, "steps": 200}))
    with pytest.raises(ValueError, match="vibgym/align/pose-v0 is another one by now"):
        train(config, tmp_path / "run", quiet=True)


@pytest.mark.parametrize("algorithm, own", [(Offline, {"dataset": DATA}), (SAC, {})])
def test_what_goes_before_ppo_alone_is_refused(algorithm, own):
    lessons, name = {"expert": {"kind": "pose", "action": "wrench"}}, algorithm.phase
    settings = settings_from({"task": "Align", "steps": 9, "imitation": lessons, "algorithm": name, name: own})
    with pytest.raises(ValueError, match="imitation"):
        algorithm(settings).make_env()


def test_a_data_set_must_be_named():
    with pytest.raises(ValueError, match="training: offline.dataset"):
        settings_from({"task": "Align", "steps": 9, "algorithm": "offline"})
