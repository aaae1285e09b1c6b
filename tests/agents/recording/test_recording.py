"""Recorded episodes are those that were played, and go to disk whole or not at all."""

import errno
import json
import os

import gymnasium as gym
import h5py
import numpy as np
import pytest

from agents import locks
from agents.__main__ import main
from agents.recording import record as recording
from agents.recording.record import load_settings, record
from tests.agents.recording.conftest import GIVEN, NAME
from tests.commands import refusal, saved
from vibgym.files import WriteError
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo

HARDWARE = {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"},
            "randomize": {"dead_zone": [0.5e-4, 1.0e-4]}}  # fmt: skip


def contents(data):
    """Return all episodes and what is known about each."""
    about = data.storage.get_episode_metadata(range(data.total_episodes))
    return list(zip(data.iterate_episodes(), about, strict=True))


def same_observation(episode, step, observation):
    return all(np.array_equal(episode.observations[name][step], values) for name, values in observation.items())


def test_a_data_set_holds_what_single_environments_do(recorded):
    """Bit for bit; and its environment comes back from it."""
    data = recorded(episodes=5, worlds=3)
    env = data.recover_environment()
    assert env.spec.id == "vibgym/Align-v0" and env.observation_space["parts"].shape[1] > 20
    alone = gym.make("vibgym/Align-v0", action="wrench", observation="parts")
    policy = make_policy(GIVEN["policy"], TaskInfo.of(alone), 7)
    episodes = contents(data)
    assert len(episodes) == 5
    for seed, (episode, kept) in enumerate(episodes, 1_000_007):
        observation, _ = alone.reset(seed=seed)
        state = None
        for step in range(len(episode.rewards)):
            assert same_observation(episode, step, observation)
            action, state = policy.predict(alone.unwrapped.observed("state"), state)
            assert np.array_equal(episode.actions[step], np.clip(action, -1, 1).astype(np.float32))
            observation, *outcome, info = alone.step(action)
            assert outcome == [episode.rewards[step], episode.terminations[step], episode.truncations[step]]
        assert any(outcome[1:]) and same_observation(episode, -1, observation)
        assert (kept["seed"], kept["success"]) == (seed, info["is_success"])


def test_recordings_do_not_depend_on_the_number_of_worlds(recorded):
    data = {"environment": HARDWARE, "noise": 0.1, "episodes": 4}
    some, all_at_once = recorded(**data, worlds=1), recorded(**data, worlds=4, dataset="vibgym/align/other-v0")
    for (one, about), (other, of_other) in zip(contents(some), contents(all_at_once), strict=True):
        assert np.array_equal(one.actions, other.actions) and np.array_equal(one.rewards, other.rewards)
        assert about == of_other and "drawn_dead_zone" in about


def test_several_parts_and_drawn_hardware(recorded):
    randomize = {"parts": [2, 4], **HARDWARE["randomize"]}
    policy = {"kind": "planner", "law": "pose", "action": "wrench"}
    episodes = contents(recorded(task="Sort", policy=policy, environment={**HARDWARE, "randomize": randomize}))
    drawn = [float(kept["drawn_dead_zone"]) for _, kept in episodes]
    assert drawn[0] != drawn[1] and all(0.5e-4 <= width <= 1e-4 for width in drawn)
    masks = [episode.observations["mask"] for episode, _ in episodes]
    assert all(2 <= mask[0].sum() <= 4 and mask.shape[1] == 6 for mask in masks)


def test_failures_leave_what_was_recorded(recorded, tmp_path, monkeypatch):
    """A name that is taken, by a data set or by another process; a full disk; an episode that does not replay."""
    with locks.one_run(tmp_path, "dataset", ".vibgym-align-pose-v0.lock"):
        with pytest.raises(ValueError, match="dataset"):
            recorded()
        recorded(dataset="vibgym/align/first-v0")  # another one can be recorded
    recorded()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ValueError, match="dataset"):
        recorded()

    def full(*arguments, **more):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(recording, "create", full)
        with pytest.raises(WriteError, match="No space left"):
            recorded(dataset="vibgym/align/other-v0")
    assert sorted(tmp_path.rglob("*")) == before
    play = recording.play

    def changed(*arguments):
        return (episode._replace(rewards=episode.rewards + 1e-9) for episode in play(*arguments))

    monkeypatch.setattr(recording, "play", changed)
    with pytest.raises(ValueError, match="does not replay"):
        recorded(dataset="vibgym/align/other-v0")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("changes, named", [
    ({"dataset": "no version"}, "dataset"), ({"dataset": "a/b-v0"}, "dataset"), ({"task": "Juggle"}, "task"),
    ({"observation": "smell"}, "observation"), ({"policy": "juggler"}, "juggler"), ({"wish": 1}, "wish"),
    ({"environment": {"action": "patch"}}, "environment.action"), ({"environment": {"num_envs": 3}}, "num_envs"),
])  # fmt: skip
def test_bad_settings_are_refused_by_name(tmp_path, capsys, changes, named):
    path = saved(tmp_path, {**GIVEN, **changes, "directory": str(tmp_path)}, output=None)
    line = refusal(capsys, main, "record", path)
    assert named in line and str(path) in line and list(tmp_path.iterdir()) == [path]


def test_episodes_are_replayed_and_have_reference_scores(recorded, tmp_path, capsys):
    data = recorded(episodes=4, noise=0.1)
    about, returns = data.storage.metadata, [episode.rewards.sum() for episode in data.iterate_episodes()]
    assert about["ref_max_score"] == pytest.approx(np.mean(returns)) and about["ref_min_score"] < np.mean(returns)
    assert main(["replay", NAME, "--output", str(tmp_path), "--quiet"]) == 0
    assert "4 episodes replay" in capsys.readouterr().out


SPOILT = {"actions": "observations", "rewards": "rewards", "observations/parts": "observations", "seed": "observations",
          "success": "success"}  # fmt: skip


@pytest.mark.parametrize("what, differs", SPOILT.items())
def test_a_data_set_that_does_not_replay_is_refused(recorded, tmp_path, capsys, what, differs):
    with h5py.File(recorded().storage.data_path / "main_data.hdf5", "r+") as file:
        episode = file["episode_1"]
        if what in ("seed", "success"):
            episode.attrs[what] = 7 if what == "seed" else not episode.attrs[what]
        else:
            episode[what][3] += np.float32(1e-3)
    line = refusal(capsys, main, "replay", NAME, "--output", tmp_path)
    assert "does not replay" in line and differs in line


def test_data_sets_of_another_version_or_origin_are_refused(recorded, tmp_path, capsys):
    storage = recorded().storage
    scene = json.loads(storage.metadata["vibgym_scene"])
    storage.update_metadata({"vibgym_scene": json.dumps({**scene, "vibgym": "0.0.1"})})
    for name, named in ((NAME, "version"), ("no/such-v0", "no/such-v0")):
        assert named in refusal(capsys, main, "replay", name, "--output", tmp_path)


def test_a_directory_may_be_relative(settings_of, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    directory, _, _ = record(settings_of(directory="data sets", episodes=1), quiet=True)
    assert directory == tmp_path / "data sets" / NAME and directory.is_dir()


def test_recipes_are_valid(pytestconfig):
    for path in (pytestconfig.rootpath / "configs/recordings").iterdir():
        assert load_settings(path).episodes > 1
