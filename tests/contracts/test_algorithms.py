"""What holds of every algorithm: a tiny training runs, goes on bit for bit wherever it was stopped, and acts by name."""

import gymnasium as gym
import pytest
import yaml

from agents.training.algorithms import ALGORITHMS
from agents.training.train import train
from agents.training.training_file import load_settings
from tests.agents.training.test_training_resume import assert_same, everything, stopped_and_unbroken
from tests.contracts.entries import ONE, is_one_line
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo

TINY = {"worlds": 4, "steps": 320, "checkpoint_steps": 96, "judging": {"episodes": 3, "every": 100}}
RUNS = {
    "sac": {
        "environment": {"action": "field", "max_episode_steps": 20}, "steps": 640,
        "sac": {"buffer_size": 400, "learning_starts": 200, "batch_size": 16, "gradient_steps": 2, "net": [8, 8]},
    },
    "offline": {
        "worlds": 1,
        "offline": {"dataset": "vibgym/align/pose-v0", "method": "iql", "batch_size": 32, "net": [8], "critic_net": [8],
                    "remembers": True},
    },
    "ppo": {"ppo": {"n_steps": 16, "batch_size": 64, "n_epochs": 2, "net": [8], "critic_net": [8], "target_kl": 0.02}},
}  # fmt: skip
"""What makes it tiny, by name; one that is not here runs as it comes."""

pytestmark = [pytest.mark.usefixtures("one_thread"), pytest.mark.parametrize("algorithm", tuple(ALGORITHMS))]


def settings_of(algorithm, recorded):
    settings = {"task": "Align", "environment": {"action": "wrench"}, "algorithm": algorithm, **TINY}
    settings |= RUNS.get(algorithm, {})
    if "offline" in settings:
        settings["offline"] = {**settings["offline"], "directory": str(recorded)}
    return settings


def test_stopped_runs_end_as_unbroken_ones(algorithm, tmp_path, monkeypatch, recorded):
    """And what they write acts in an environment that is made as it says."""
    settings = settings_of(algorithm, recorded)
    broken, whole = stopped_and_unbroken(settings, tmp_path, monkeypatch, algorithm)
    assert_same(everything(broken), everything(whole))
    env = gym.make_vec(ONE, num_envs=3, action=settings["environment"]["action"])
    policy = make_policy(str(whole / "policy.json"), TaskInfo.of(env))
    assert policy.action == settings["environment"]["action"]
    acting = gym.make_vec(ONE, num_envs=3, action=policy.action, observation=policy.observation)
    seen, _ = acting.reset(seed=0)
    assert acting.action_space.contains(policy.predict(seen)[0])


@pytest.mark.parametrize("bad", ["colour", "learning_rate"])
def test_bad_settings_are_refused_by_name_before_anything_is_written(algorithm, bad, tmp_path, recorded):
    settings = settings_of(algorithm, recorded)
    settings[algorithm] = {**settings.get(algorithm, {}), bad: -1}
    config = tmp_path / "run.yaml"
    config.write_text(yaml.safe_dump(settings))
    for load in (load_settings, lambda path: train(path, tmp_path / "run", quiet=True)):
        with pytest.raises(ValueError) as error:
            load(config)
        assert is_one_line(str(error.value), str(config), f"{algorithm}.{bad}")
    assert not (tmp_path / "run").exists()
