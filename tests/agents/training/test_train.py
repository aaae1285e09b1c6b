"""Training runs: exact resume, Stable-Baselines3 by name, user-registered actions, observations, networks and algorithms."""

import json

import numpy as np
import pytest
import yaml
from gymnasium import spaces

from agents import networks, ppo, train
from agents.algorithms import ALGORITHMS
from agents.networks import PartsActor, PartsCritic
from agents.training_envs import make_worlds
from agents.training_file import load_settings
from agents.training_envs import Worlds
from tests.agents.training.checkpoints import same
from vibgym.envs.actions import ACTIONS, Field
from vibgym.policies.trained.networks import ACTING
from vibgym.policies.trained.trained import CODINGS
from vibgym.settings import BaseSettings

PPO = {"n_steps": 16, "batch_size": 64, "n_epochs": 2, "net": [8], "critic_net": [8], "target_kl": 0.02}
BASE = {"task": "Align", "worlds": 8, "steps": 768, "checkpoint_steps": 256, "judging": {"episodes": 3, "every": 200}}
IMITATION = {"expert": {"kind": "pose", "action": "wrench"}, "rounds": 2, "steps": 20, "epochs": 2}
RUNS = {
    "field": {"environment": {"action": "field"}, "ppo": PPO},
    "imitation": {
        "environment": {"action": "wrench"}, "imitation": IMITATION, "ppo": {**PPO, "remembers": True, "turned": True},
    },
    "memory": {
        "environment": {"action": "field", "sensor": {"delay": 2, "dropout": 0.3, "kind": "ideal", "tell": ["age"]}},
        "ppo": {**PPO, "turned": True, "remembers": 3, "recalls": ["velocity", "age"]},
    },
    "noise": {"environment": {"action": "field"}, "ppo": {**PPO, "noise_correlation": 0.9}},
    "curriculum": {
        "environment": {"action": "field"}, "ppo": PPO,
        "curriculum": [{"environment": {"max_episode_steps": 20}, "until": {"steps": 384}}],
    },
    "residual": {"environment": {"action": "wrench"}, "residual": {"base": {"kind": "pose"}}, "ppo": PPO},
}  # fmt: skip

pytestmark = pytest.mark.usefixtures("one_thread")


def run(folder, settings, name="run"):
    config = folder / "config.yaml"
    config.write_text(yaml.safe_dump({**BASE, **settings}))
    return train.train(config, folder / name, quiet=True)


@pytest.mark.parametrize("name", RUNS)
def test_interrupted_runs_end_with_the_same_weights(tmp_path, monkeypatch, name):
    run(tmp_path, RUNS[name], "whole")
    collect, stops = ppo.PPO.collect, [300, 500]

    def interrupted(self):
        steps = collect(self)
        if stops and self.steps >= stops[0]:
            stops.pop(0)
            raise KeyboardInterrupt
        return steps

    monkeypatch.setattr(ppo.PPO, "collect", interrupted)
    while not (tmp_path / "broken" / "policy.json").exists():
        try:
            run(tmp_path, RUNS[name], "broken")
        except KeyboardInterrupt:
            pass
    assert not stops
    assert same(tmp_path / "whole", tmp_path / "broken")


def test_a_stage_ends_with_its_success_or_its_steps_and_changes_the_environment(tmp_path):
    stages = [
        {"environment": {"task_settings": {"hold": 3}}, "until": {"success": 0.9}},
        {"environment": {"max_episode_steps": 7}, "until": {"success": 1.0, "steps": 100}},
    ]
    config = tmp_path / "config.yaml"
    own = {"action": "field", "task_settings": {"weights": {"fallen": 9.0}}}
    config.write_text(yaml.safe_dump({**BASE, "environment": own, "curriculum": stages}))
    worlds = Worlds(load_settings(config), "parts")
    assert worlds.environment(0)["task_settings"] == {"weights": {"fallen": 9.0}, "hold": 3}
    won, lost = (1.0, 5, True, 0.0), (0.0, 5, False, 0.0)
    whole = 8 * worlds.env.env.unwrapped.max_episode_steps  # steps of an episode that fails in every world
    for steps, episodes, over in (
        (whole, [won] * 80 + [lost] * 20, False), (whole, [won] * 99, False), (whole - 1, [won] * 100, False),
        (whole, [won] * 100, True),
    ):  # fmt: skip
        worlds.episodes.clear()
        worlds.episodes.extend(episodes)
        assert worlds.is_over(steps) is over
    worlds.begin(whole)
    assert worlds.stage == 1 and not worlds.episodes and worlds.env.env.unwrapped.max_episode_steps == 7
    assert not worlds.is_over(whole + 99) and worlds.is_over(whole + 100)
    other = Worlds(load_settings(config), "parts")
    other.set_state(worlds.get_state())
    for each in (worlds, other):
        each.begin(whole + 100)
        assert each.stage == 2 and each.environment(each.stage) == own and not each.is_over(10**6)
        each.env.close()


def test_algorithms_of_stable_baselines3_run_by_name(tmp_path):
    """TD3; SAC and PPO are those of test_training_sb3.py."""
    own = {"policy_kwargs": {"net_arch": [8]}, "learning_starts": 100, "buffer_size": 500}
    settings = {"algorithm": "sb3.TD3", "environment": {"action": "field"}, "sb3": own, "steps": 256}
    path = run(tmp_path, settings)
    assert len((path.parent / "curve.csv").read_text().splitlines()) >= 2
    assert path.with_suffix(".zip").exists()
    assert json.loads((path.parent / "run.json").read_text())["settings"]["algorithm"] == "sb3.TD3"
    run(tmp_path, {**settings, "steps": 512})  # continues


def test_a_user_registered_action_is_trained(tmp_path, monkeypatch):
    class Half(Field):
        pass

    monkeypatch.setitem(ACTIONS._items, "half", Half)
    settings = {"algorithm": "sb3.PPO", "environment": {"action": "half"}, "sb3": {"n_steps": 16, "batch_size": 32}}
    assert run(tmp_path, {**settings, "steps": 128}).with_suffix(".zip").exists()


def test_a_user_registered_network_is_trained(tmp_path, monkeypatch):
    for names in (networks.NETWORKS, ACTING, CODINGS):
        monkeypatch.delitem(names, "mine", raising=False)

    class Mine(PartsActor):
        kind = "mine"

    networks.register_network("mine", Mine, PartsCritic, ACTING["parts"])
    path = run(tmp_path, {"environment": {"action": "field"}, "ppo": {**PPO, "network": "mine"}, "steps": 128})
    assert json.loads(path.read_text())["network"] == "mine"


class RandomSearch:
    """An algorithm without torch: it remembers how many steps it made."""

    class Settings(BaseSettings):
        """Settings of the algorithm."""

        scale: float = 1.0

    observation = "state"

    def __init__(self, settings):
        self.action, self.steps = settings.action, 0
        self.env = make_worlds(settings, "state")
        assert isinstance(self.env.action_space, spaces.Box)

    def learn(self, until, report):
        self.env.reset()
        while self.steps < until:
            report({"loss": 0.0})
            self.env.step(np.zeros((self.env.num_envs, *self.env.action_space.shape), np.float32))
            self.steps += self.env.num_envs
        report({})

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), *self.env.action_space.shape), np.float32), state

    def save(self, directory):
        (directory / "mine.txt").write_text(str(self.steps))

    def load(self, directory):
        path = directory / "mine.txt"
        self.steps = int(path.read_text()) if path.exists() else 0
        return path.exists()


def test_a_user_registered_algorithm_is_trained_and_continues(tmp_path, monkeypatch):
    monkeypatch.setitem(ALGORITHMS._items, "mine", RandomSearch)
    settings = {"algorithm": "mine", "environment": {"action": "field"}, "mine": {"scale": 2.0}, "steps": 64}
    run(tmp_path, settings)
    run(tmp_path, {**settings, "steps": 128})
    assert (tmp_path / "run" / "mine.txt").read_text() == "128"


@pytest.mark.parametrize("changes, named", [
    ({"algorithm": "sb3.Nothing"}, "algorithm"), ({"ppo": {"network": "nothing"}}, "network"), ({"steps": 0}, "steps"),
    ({"algorithm": "sb3.SAC", "imitation": IMITATION}, "imitation"), ({"ppo": {"n_steps": 10**6}, "worlds": 1000}, "n_steps"),
    ({"environment": {"num_envs": 3}}, "environment: num_envs"), ({"scenes": [{}, {"num_envs": 3}]}, "scenes\\[1\\]: num_envs"),
    ({"serves": {"frequency": [30.0, 20.0]}}, "frequency"),
    ({"curriculum": [{"environment": {}}]}, "curriculum\\[0\\].until"),
    ({"curriculum": [{"environment": {}, "until": {}}]}, "curriculum\\[0\\].until"),
    ({"curriculum": [{"environment": {"near": 1.0}, "until": {"steps": 9}}]}, "curriculum\\[0\\].environment"),
    ({"curriculum": [{"environment": {"action": "phasor"}, "until": {"steps": 9}}]}, "curriculum\\[0\\].environment"),
    ({"curriculum": [{"environment": {}, "until": {"steps": 9}}], "algorithm": "sb3.SAC"}, "curriculum"),
])  # fmt: skip
def test_invalid_settings_are_refused_by_name(tmp_path, changes, named):
    with pytest.raises(ValueError, match=named):
        run(tmp_path, {"environment": {"action": "field"}, **changes})
