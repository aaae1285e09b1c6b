"""Data sets in LeRobot's format, up to its writer; tests/learners/test_learners_lerobot.py tests the files."""

import errno
import json
import os

import gymnasium as gym
import h5py
import numpy as np
import pytest

import gym_vibgym  # noqa: F401  registers its environments
from agents.__main__ import main
from agents.recording import export as exporting
from agents.recording.export import ORIGIN, export
from tests.agents.recording.conftest import NAME
from tests.commands import said_in_one_line
from vibgym.adapters.lerobot import names_of, observation_from, text_of
from vibgym.envs import VibgymEnv
from vibgym.tasks import TASKS


class Writer:
    """Stands for LeRobot's writer: creates the directory, and keeps what it is given."""

    last: "Writer"

    @classmethod
    def create(cls, repo_id, fps, features, root, use_videos, video_backend):
        made = cls.last = cls()
        made.fps, made.features, made.episodes, made.finalized = fps, features, [], False
        (root / "meta").mkdir(parents=True)
        return made

    def create_episode_buffer(self):
        return {"index": [], "task_index": [], "episode_index": len(self.episodes)}

    def save_episode(self, episode):
        self.episodes.append(episode)

    def finalize(self):
        self.finalized = True


@pytest.fixture(autouse=True)
def writer(monkeypatch):
    monkeypatch.setattr(exporting, "_lerobot", lambda: Writer)


@pytest.mark.parametrize("kind", ["parts", "state"])
def test_episodes_are_those_of_the_recording(recorded, tmp_path, kind):
    """Bit for bit, with empty slots; and names and shapes fit the values."""
    policy = {"kind": "planner", "law": "pose", "action": "wrench"}
    data = recorded(observation=kind, environment={"randomize": {"parts": [2, 4]}}, task="Sort", policy=policy)
    episodes, frames = export(NAME, tmp_path / "out", tmp_path, quiet=True)
    assert (episodes, frames) == (2, data.total_steps) and Writer.last.finalized and Writer.last.fps == 25
    features = Writer.last.features
    for key, feature in features.items():
        names = feature["names"]
        assert names is None or len(set(names)) == len(names) == feature["shape"][0], key
    about = data.storage.get_episode_metadata([0, 1])
    for exported, episode, kept in zip(Writer.last.episodes, data.iterate_episodes(), about, strict=True):
        steps, seen = len(episode.rewards), episode.observations
        if kind == "parts":
            mask = seen["mask"][:-1]
            state = seen["parts"][:-1].reshape(steps, -1)
            world = np.concatenate((state, mask.astype(np.float32)), axis=1)
            assert not mask.all() and not seen["parts"][:-1][mask == 0].any()
        else:
            state = world = seen[:-1]
        done = np.arange(steps) == steps - 1
        expected = {
            "observation.state": state, "observation.environment_state": world, "action": episode.actions,
            "next.reward": episode.rewards, "next.done": done, "next.success": done & bool(kept["success"]),
        }  # fmt: skip
        for key, values in expected.items():
            assert exported[key].dtype == features[key]["dtype"] == values.dtype, key
            assert np.array_equal(exported[key], values) and features[key]["shape"] == (values.shape[1:] or (1,)), key
        assert exported["size"] == steps and set(exported["task"]) == {text_of(TASKS["Sort"])}
        assert np.array_equal(exported["timestamp"], np.arange(steps) / 25)
    origin = json.loads((tmp_path / "out" / ORIGIN).read_text())
    assert origin["dataset"] == NAME and origin["seeds"] == [1_000_007, 1_000_008]
    assert origin["vibgym_scene"]["observation"] == kind and origin["ref_min_score"] < origin["ref_max_score"]


def test_names_of_the_state_follow_its_layout():
    env = VibgymEnv("Sort", action="wrench")
    names = names_of(env, "state")["agent_pos"]
    for row in env.observation_layout:
        own = names[row.start : row.start + row.width]
        assert all(name.split(".")[1] == row.name for name in own)
        assert row.part is None or {name.split(".")[0] for name in own} == {f"part_{row.part}"}


@pytest.mark.parametrize("case, changes, named", [
    ("full disk", {}, "No space left"), ("differs", {}, "seed 1000008 does not replay"), ("exists", {}, "output"),
    ("no/such-v0", {}, "no/such-v0"), ("image", {"observation": "image"}, "observation"),
    ("rate", {"environment": {"periods_per_step": 2}}, "12.5"),
])  # fmt: skip
def test_failures_leave_nothing_behind(recorded, tmp_path, monkeypatch, capsys, case, changes, named):
    """A full disk, an episode that does not replay, a directory that exists, images, 12.5 steps per second, an unknown name."""
    data, output = recorded(**changes), tmp_path / "some" / "out"
    if case == "differs":
        with h5py.File(data.storage.data_path / "main_data.hdf5", "r+") as file:
            file["episode_1/rewards"][0] += 1e-9
    if case == "full disk":

        def full(self, episode):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(Writer, "save_episode", full)
    (output if case == "exists" else output.parent).mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    arguments = ["export", case if "/" in case else NAME, "--datasets", str(tmp_path), "--output", str(output)]
    assert main([*arguments, "--quiet"]) == (1 if case == "full disk" else 2)
    assert named in said_in_one_line(capsys)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("kind", ["parts", "state"])
def test_environments_have_the_observations_of_the_data_sets(kind):
    env = gym.make("gym_vibgym/Swap-v0", action="velocity", observation=kind)
    alone = gym.make("vibgym/Swap-v0", action="velocity", observation=kind)
    assert env.task_description == text_of(TASKS["Swap"]) and env._max_episode_steps == alone.spec.max_episode_steps
    observation, other = env.reset(seed=3)[0], alone.reset(seed=3)[0]
    for _ in range(4):
        expected = observation_from(kind, other)
        assert observation.keys() == expected.keys() and env.observation_space.contains(observation)
        assert all(np.array_equal(observation[key], expected[key]) for key in observation)
        action = np.full(alone.action_space.shape, 0.3, dtype=np.float32)
        observation, *outcome, info = env.step(action)
        other, *same, alone_info = alone.step(action)
        assert outcome == same and info["is_success"] == alone_info["is_success"]
    with pytest.raises(ValueError, match="observation"):
        gym.make("gym_vibgym/Swap-v0", observation="image")
