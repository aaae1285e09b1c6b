"""Exported data sets, read by LeRobot, and environments in its rollouts; in its virtual environment."""

import json
import os
import subprocess
import sys
from pathlib import Path

import minari
import numpy as np
import pytest

from agents.recording.record import RecordSettings, record
from vibgym.datasets import kept_in

ROOT = Path(__file__).parents[2]
NAME = "vibgym/align/pose-v0"
HOME = Path(f"{sys.prefix}-lerobot")

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(not (HOME / ".installed").exists(), reason=f"{HOME} is missing: make learners"),
]

READ = """
import json, sys
import numpy as np, torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset

data = LeRobotDataset("vibgym/exported", root=sys.argv[1])
table = data.hf_dataset.with_format("arrow")[:]  # other formats round to float32
columns = {key: table[key].combine_chunks() for key in data.features}
flat = {key: column.flatten() if hasattr(column, "flatten") else column for key, column in columns.items()}
arrays = {key: column.to_numpy(zero_copy_only=False) for key, column in flat.items()}
count = len(table)
np.savez(sys.argv[2], **{key: each if len(each) == count else each.reshape(count, -1) for key, each in arrays.items()})
item = data[len(data) - 1]
window = LeRobotDataset("vibgym/exported", root=sys.argv[1], delta_timestamps={"action": [k / data.fps for k in range(4)]})[0]
features = {key: [each["dtype"], list(each["shape"]), each["names"]] for key, each in data.features.items()}
print(json.dumps({
    "fps": data.fps, "episodes": data.num_episodes, "tasks": list(data.meta.tasks.index), "features": features,
    "item": {key: list(value.shape) for key, value in item.items() if isinstance(value, torch.Tensor)}, "task": item["task"],
    "window": list(window["action"].shape), "mean": data.meta.stats["action"]["mean"].tolist(),
}))
"""

ROLL = """
import json, sys
import numpy as np, torch
from lerobot.envs.factory import make_env, make_env_pre_post_processors
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.scripts.lerobot_eval import rollout
from gym_vibgym.config import VibgymEnvConfig


class Recorded(torch.nn.Module):
    def __init__(self, actions):
        super().__init__()
        self.actions = actions

    def reset(self):
        self.step, self.tasks = 0, []

    def select_action(self, batch):
        self.tasks.append(batch["task"])
        rows = [each[min(self.step, len(each) - 1)] for each in self.actions]
        self.step += 1
        return torch.from_numpy(np.stack(rows))


with np.load(sys.argv[1]) as columns:
    columns = dict(columns)
starts = np.flatnonzero(columns["frame_index"] == 0)
actions = np.split(columns["action"], starts[1:])
config = VibgymEnvConfig(task="Align-v0", action="wrench")
envs = make_env(config, n_envs=len(actions))["vibgym"][0]
before, after = make_env_pre_post_processors(config, ACTConfig())
policy, seeds = Recorded(actions), json.loads(sys.argv[2])
found = rollout(envs, policy, before, after, lambda each: each, lambda each: each, seeds=seeds, return_observations=True)
same = [
    bool(
        np.array_equal(found["observation"][key][k, : len(each)].numpy(), part)
        and np.array_equal(found["reward"][k, : len(each)].numpy(), reward)
        and found["done"][k].tolist().index(True) == len(each) - 1
        and bool(found["success"][k, len(each) - 1]) == bool(success[-1])
    )
    for key in ("observation.state", "observation.environment_state")
    for k, (each, part, reward, success) in enumerate(
        zip(actions, *(np.split(columns[c], starts[1:]) for c in (key, "next.reward", "next.success")))
    )
]
features = {key: list(each.shape) for key, each in config.features.items()}
print(json.dumps({"same": same, "task": policy.tasks[0], "fps": config.fps, "features": features}))
"""


def run(directory, *arguments):
    """Return the output of LeRobot's interpreter."""
    own = {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "HF_HUB_OFFLINE": "1", "HF_HOME": str(directory / "hf")}
    command = ["timeout", "600", str(HOME / "bin/python"), *map(str, arguments)]
    result = subprocess.run(command, cwd=directory, capture_output=True, text=True, env={**os.environ, **own})
    assert result.returncode == 0, (result.stdout + result.stderr)[-4000:]
    return result.stdout


def reported(directory, *arguments):
    return json.loads(run(directory, *arguments).splitlines()[-1])


def test_frames_are_those_of_the_recording_and_rollouts_repeat_them(tmp_path):
    """Bit for bit: in LeRobot's reader, and in its rollout of the recorded actions from the recorded seeds."""
    settings = {"dataset": NAME, "task": "Align", "policy": {"kind": "pose", "action": "wrench"}, "observation": "parts",
             "episodes": 3, "worlds": 3, "first_seed": 1_000_007, "directory": str(tmp_path)}  # fmt: skip
    record(RecordSettings.model_validate(settings), quiet=True)
    with kept_in(str(tmp_path)):
        data = minari.load_dataset(NAME)
    output = tmp_path / "exported"
    run(tmp_path, "-m", "agents", "export", NAME, "--datasets", tmp_path, "--output", output, "--quiet")
    contents = reported(tmp_path, "-c", READ, output, tmp_path / "columns.npz")
    episodes = list(data.iterate_episodes())
    assert contents["fps"] == 25 and contents["episodes"] == 3 and contents["window"] == [4, 3]
    assert contents["tasks"] == [contents["task"]] and contents["task"].startswith("Align: The centre within 2 mm")
    with np.load(tmp_path / "columns.npz") as columns:
        rows = np.concatenate(
            [episode.observations["parts"][:-1].reshape(len(episode.rewards), -1) for episode in episodes]
        )
        mask = np.concatenate([episode.observations["mask"][:-1] for episode in episodes])
        ends = np.cumsum([len(episode.rewards) for episode in episodes]) - 1
        expected = {
            "observation.state": rows,
            "observation.environment_state": np.hstack((rows, mask)).astype(np.float32),
            "action": np.concatenate([episode.actions for episode in episodes]),
            "next.reward": np.concatenate([episode.rewards for episode in episodes]),
            "next.done": np.isin(np.arange(len(rows)), ends),
            "index": np.arange(len(rows)),
            "timestamp": np.concatenate([np.arange(len(episode.rewards)) / 25 for episode in episodes]).astype(
                np.float32
            ),
        }
        for key, values in expected.items():
            assert columns[key].dtype == values.dtype and np.array_equal(columns[key], values), key
        kept = [bool(episode["success"]) for episode in data.storage.get_episode_metadata(range(3))]
        assert columns["next.success"][ends].tolist() == kept and columns["next.success"].sum() == sum(kept)
        assert np.allclose(contents["mean"], expected["action"].mean(axis=0), atol=1e-6)
    width = rows.shape[1]
    assert contents["item"]["observation.state"] == [width] and contents["item"]["observation.environment_state"] == [
        width + 1
    ]
    dtype, shape, names = contents["features"]["observation.state"]
    assert (dtype, shape, names[0], len(set(names))) == ("float32", [width], "part_0.friction", width)
    origin = json.loads((output / "meta/vibgym.json").read_text())
    assert origin["seeds"] == [1_000_007, 1_000_008, 1_000_009] and origin["ref_max_score"] == pytest.approx(
        data.storage.metadata["ref_max_score"]
    )
    rolled = reported(tmp_path, "-c", ROLL, tmp_path / "columns.npz", json.dumps(origin["seeds"]))
    assert rolled["same"] == [True] * 6 and rolled["task"] == [contents["task"]] * 3 and rolled["fps"] == 25
    assert rolled["features"] == {"action": [3], "agent_pos": [width], "environment_state": [width + 1]}
