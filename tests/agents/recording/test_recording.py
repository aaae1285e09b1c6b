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


def test_a_data_set_holds_what_single_environments_do(recorded):
    """Bit for bit; and its environment comes back from it."""
    data = recorded(episodes=5, worlds=3)
    env = data.recover_environment()
    assert env.spec.id == "vibgym/Align-v0" and env.observation_space["parts"].shape[1] > 20
    alone = gym.make("vibgym/Align-v0", action="wrench", observation="parts")
    policy = make_policy(GIVEN["policy"], TaskInfo.of(alone), 7)
    for number, (episode, kept) in enumerate(contents(data)):
        observation, _ = alone.reset(seed=1_000_007 + number)
        state, ended, step = None, False, 0
        while True:
            assert all(
                np.array_equal(episode.observations[name][step], observation[name]) for name in ("parts", "mask")
            )
            if ended:
                break
            action, state = policy.predict(alone.unwrapped.observed("state"), state)
            assert np.array_equal(episode.actions[step], np.clip(action, -1, 1).astype(np.float32))
            observation, reward, terminated, truncated, info = alone.step(action)
            found = episode.rewards[step], episode.terminations[step], episode.truncations[step]
            assert found == (reward, terminated, truncated)
            step, ended = step + 1, terminated or truncated
        assert step == len(episode.rewards) and (kept["seed"], kept["success"]) == (
            1_000_007 + number,
            info["is_success"],
        )
    assert number == 4


@pytest.mark.parametrize("worlds", [1, 2])
def test_what_is_recorded_does_not_depend_on_how_many_play_at_a_time(recorded, worlds):
    given = {"environment": HARDWARE, "noise": 0.1, "episodes": 4}
    some, all_at_once = recorded(**given, worlds=worlds), recorded(**given, worlds=4, dataset="vibgym/align/other-v0")
    for (one, about), (other, of_other) in zip(contents(some), contents(all_at_once), strict=True):
        assert np.array_equal(one.actions, other.actions) and np.array_equal(one.rewards, other.rewards)
        assert about == of_other and "drawn_dead_zone" in about


def test_several_parts_and_drawn_hardware(recorded):
    randomize = {"parts": [2, 4], **HARDWARE["randomize"]}
    policy = {"kind": "planner", "law": "pose", "action": "wrench"}
    found = contents(recorded(task="Sort", policy=policy, environment={**HARDWARE, "randomize": randomize}))
    drawn = [float(kept["drawn_dead_zone"]) for _, kept in found]
    assert drawn[0] != drawn[1] and all(0.5e-4 <= each <= 1e-4 for each in drawn)
    masks = [episode.observations["mask"] for episode, _ in found]
    assert all(2 <= mask[0].sum() <= 4 and mask.shape[1] == 6 for mask in masks)


def test_a_name_that_is_taken_and_a_full_disk(recorded, tmp_path, monkeypatch):
    recorded()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ValueError, match="dataset"):
        recorded()

    def full(*arguments, **more):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(recording, "create", full)
    with pytest.raises(WriteError, match="No space left"):
        recorded(dataset="vibgym/align/other-v0")
    assert sorted(tmp_path.rglob("*")) == before


def test_two_that_record_the_same(recorded, tmp_path):
    """The second is refused at once; another data set beside it is recorded."""
    with locks.one_run(tmp_path, "dataset", ".vibgym-align-pose-v0.lock"):
        with pytest.raises(ValueError, match="dataset"):
            recorded()
        recorded(dataset="vibgym/align/other-v0")
    assert {path.name for path in tmp_path.iterdir()} == {"vibgym"}


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


def test_nothing_is_stored_if_an_episode_does_not_replay(recorded, tmp_path, monkeypatch):
    played = recording.play
    monkeypatch.setattr(
        recording, "play", lambda *given: (each._replace(rewards=each.rewards + 1e-9) for each in played(*given))
    )
    with pytest.raises(ValueError, match="does not replay"):
        recorded()
    assert not list(tmp_path.rglob("main_data.hdf5"))


def test_a_directory_may_be_relative(settings_of, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    place, _, _ = record(settings_of(directory="data sets", episodes=1), quiet=True)
    assert place == tmp_path / "data sets" / NAME and place.is_dir()


def test_recipes_are_valid(pytestconfig):
    for path in (pytestconfig.rootpath / "configs/recordings").iterdir():
        assert load_settings(path).episodes > 1
