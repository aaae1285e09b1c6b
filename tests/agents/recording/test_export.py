"""Data sets in LeRobot's format, up to its writer; tests/learners/test_learners_lerobot.py tests the files."""

import errno
import json
import os

import gymnasium as gym
import h5py
import minari
import numpy as np
import pytest

import gym_vibgym  # noqa: F401  registers its environments
from agents.__main__ import main
from agents.recording import export as exporting
from agents.recording.export import ORIGIN, export
from agents.recording.record import RecordSettings, record
from agents.recording.storage import kept_in
from vibgym.adapters.lerobot import names_of, observation_from, text_of
from vibgym.envs import VibgymEnv
from vibgym.files import WriteError
from vibgym.tasks import TASKS

NAME = "vibgym/align/pose-v0"


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


def recorded(directory, **changes):
    given = {"dataset": NAME, "task": "Align", "policy": {"kind": "pose", "action": "wrench"}, "observation": "parts",
             "episodes": 2, "worlds": 2, "first_seed": 1_000_007, "directory": str(directory)}  # fmt: skip
    settings = RecordSettings.model_validate({**given, **changes})
    record(settings, quiet=True)
    with kept_in(settings.directory):
        return minari.load_dataset(settings.dataset)


@pytest.mark.parametrize("kind", ["parts", "state"])
def test_episodes_are_those_of_the_recording(tmp_path, kind):
    """Bit for bit, with empty slots; and names and shapes fit the values."""
    changes = {"task": "Sort", "policy": {"kind": "planner", "law": "pose", "action": "wrench"}}
    data = recorded(tmp_path, observation=kind, environment={"randomize": {"parts": [2, 4]}}, **changes)
    episodes, frames = export(NAME, tmp_path / "out", tmp_path, quiet=True)
    assert (episodes, frames) == (2, data.total_steps) and Writer.last.finalized and Writer.last.fps == 25
    features = Writer.last.features
    for key, feature in features.items():
        assert feature["names"] is None or len(set(feature["names"])) == len(feature["names"]) == feature["shape"][0], (
            key
        )
    for own, episode, about in zip(
        Writer.last.episodes, data.iterate_episodes(), data.storage.get_episode_metadata([0, 1]), strict=True
    ):
        steps, seen = len(episode.rewards), episode.observations
        assert own["size"] == steps and set(own["task"]) == {text_of(TASKS["Sort"])}
        if kind == "parts":
            mask = seen["mask"][:-1]
            state = np.concatenate([seen["parts"][:-1, slot] for slot in range(mask.shape[1])], axis=1)
            world = np.concatenate((state, mask.astype(np.float32)), axis=1)
            assert not mask.all() and not state.reshape(steps, mask.shape[1], -1)[mask == 0].any()
        else:
            state = world = seen[:-1]
        for key, values in (("observation.state", state), ("observation.environment_state", world)):
            assert own[key].dtype == np.float32 and np.array_equal(own[key], values)
            assert features[key]["shape"] == own[key].shape[1:]
        assert np.array_equal(own["action"], episode.actions) and np.array_equal(own["next.reward"], episode.rewards)
        assert own["next.done"].tolist() == [False] * (steps - 1) + [True]
        assert own["next.success"].tolist() == [False] * (steps - 1) + [bool(about["success"])]
        assert np.array_equal(own["timestamp"], np.arange(steps) / 25)
    origin = json.loads((tmp_path / "out" / ORIGIN).read_text())
    assert (
        origin["dataset"] == NAME
        and origin["seeds"] == [1_000_007, 1_000_008]
        and origin["vibgym_scene"]["observation"] == kind
    )


def test_names_of_the_state_follow_its_layout():
    env = VibgymEnv("Sort", action="wrench")
    names = names_of(env, "state")["agent_pos"]
    for row in env.observation_layout:
        own = names[row.start : row.start + row.width]
        assert all(name.split(".")[1] == row.name for name in own)
        assert row.part is None or {name.split(".")[0] for name in own} == {f"part_{row.part}"}


@pytest.mark.parametrize("case, named", [
    ("differs", "seed 1000008 does not replay"), ("exists", "output"), ("image", "observation"), ("rate", "12.5"),
    ("name", "no/such-v0"),
])  # fmt: skip
def test_refusals_leave_nothing_behind(tmp_path, capsys, case, named):
    """An episode that does not replay, a directory that exists, images, 12.5 steps per second, an unknown name."""
    changes = {"image": {"observation": "image"}, "rate": {"environment": {"periods_per_step": 2}}}.get(case, {})
    recorded(tmp_path, **changes)
    output = tmp_path / "some" / "out"
    if case == "differs":
        with h5py.File(tmp_path / NAME / "data" / "main_data.hdf5", "r+") as file:
            rewards = file["episode_1/rewards"][()]
            del file["episode_1/rewards"]
            file["episode_1/rewards"] = rewards + 1e-9
    output.parent.mkdir()
    if case == "exists":
        output.mkdir()
    before = sorted(tmp_path.rglob("*"))
    name = "no/such-v0" if case == "name" else NAME
    assert main(["export", name, "--datasets", str(tmp_path), "--output", str(output), "--quiet"]) == 2
    error = capsys.readouterr().err
    assert named in error and error.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_a_full_disk_leaves_nothing_behind(tmp_path, monkeypatch):
    recorded(tmp_path)
    before = sorted(tmp_path.rglob("*"))

    def full(self, episode):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Writer, "save_episode", full)
    with pytest.raises(WriteError, match="No space left"):
        export(NAME, tmp_path / "out", tmp_path, quiet=True)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("kind", ["parts", "state"])
def test_environments_have_the_observations_of_the_data_sets(kind):
    env = gym.make("gym_vibgym/Swap-v0", action="velocity", observation=kind)
    alone = gym.make("vibgym/Swap-v0", action="velocity", observation=kind)
    assert env.task_description == text_of(TASKS["Swap"]) and env._max_episode_steps == alone.spec.max_episode_steps
    seen, _ = env.reset(seed=3)
    other, _ = alone.reset(seed=3)
    action = np.full(alone.action_space.shape, 0.3, dtype=np.float32)
    for _ in range(3):
        expected = observation_from(kind, other)
        assert seen.keys() == expected.keys() and env.observation_space.contains(seen)
        assert all(np.array_equal(seen[key], expected[key]) for key in seen)
        seen, reward, *ends, info = env.step(action)
        other, same, *own, about = alone.step(action)
        assert reward == same and ends == own and info["is_success"] == about["is_success"]
    with pytest.raises(ValueError, match="observation"):
        gym.make("gym_vibgym/Swap-v0", observation="image")
