"""Recorded episodes are those that were played, and go to disk whole or not at all."""

import errno
import json
import os

import gymnasium as gym
import h5py
import minari
import numpy as np
import pytest

from agents import locks
from agents.__main__ import main
from agents.recording import record as recording
from agents.recording.play import Recorder
from agents.recording.record import RecordSettings, load_settings, record
from agents.recording.storage import kept_in
from vibgym.files import WriteError
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo

MACHINE = {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"},
           "randomize": {"dead_zone": [0.5e-4, 1.0e-4]}}  # fmt: skip


def settings_of(directory, **changes):
    given = {"dataset": "vibgym/align/pose-v0", "task": "Align", "policy": {"kind": "pose", "action": "wrench"},
             "observation": "parts", "episodes": 5, "worlds": 3, "first_seed": 1_000_007,
             "directory": str(directory)}  # fmt: skip
    return RecordSettings.model_validate({**given, **changes})


def loaded(settings):
    with kept_in(settings.directory):
        return minari.load_dataset(settings.dataset)


def test_a_data_set_holds_what_single_environments_do(tmp_path):
    """Bit for bit; and its environment comes back from it."""
    settings = settings_of(tmp_path)
    place, steps, _ = record(settings, quiet=True)
    data = loaded(settings)
    assert place.is_dir() and data.total_episodes == 5 and data.total_steps == steps
    env = data.recover_environment()
    assert env.spec.id == "vibgym/Align-v0" and env.observation_space["parts"].shape[1] > 20
    alone = gym.make("vibgym/Align-v0", action="wrench", observation="parts")
    policy = make_policy(settings.policy, TaskInfo.of(alone), 7)
    for number, episode in enumerate(data.iterate_episodes()):
        observation, _ = alone.reset(seed=1_000_007 + number)
        state, ended, step = None, False, 0
        while not ended:
            for name in ("parts", "mask"):
                assert np.array_equal(episode.observations[name][step], observation[name])
            action, state = policy.predict(alone.unwrapped.observed("state"), state)
            assert np.array_equal(episode.actions[step], np.clip(action, -1, 1).astype(np.float32))
            observation, reward, terminated, truncated, info = alone.step(action)
            assert episode.rewards[step] == reward
            assert (episode.terminations[step], episode.truncations[step]) == (terminated, truncated)
            step, ended = step + 1, terminated or truncated
        assert step == len(episode.rewards) and np.array_equal(
            episode.observations["parts"][step], observation["parts"]
        )
        (kept,) = data.storage.get_episode_metadata([number])
        assert kept["seed"] == 1_000_007 + number and kept["success"] == info["is_success"]


@pytest.mark.parametrize("worlds", [1, 2])
def test_what_is_recorded_does_not_depend_on_how_many_play_at_a_time(tmp_path, worlds):
    some = settings_of(tmp_path, worlds=worlds, environment=MACHINE, noise=0.1, episodes=4)
    for one, other in zip(
        Recorder(some).episodes(), Recorder(some.model_copy(update={"worlds": 4})).episodes(), strict=True
    ):
        assert np.array_equal(one.actions, other.actions) and np.array_equal(one.rewards, other.rewards)
        assert one[4:7] == other[4:7] and one.drawn.keys() == other.drawn.keys() == {"dead_zone"}
        assert all(np.array_equal(one.drawn[name], other.drawn[name]) for name in one.drawn)


def test_several_parts_and_drawn_hardware(tmp_path):
    changes = {"task": "Sort", "policy": {"kind": "planner", "law": "pose", "action": "wrench"}, "episodes": 2}
    settings = settings_of(
        tmp_path, environment={**MACHINE, "randomize": {"parts": [2, 4], **MACHINE["randomize"]}}, **changes
    )
    record(settings, quiet=True)
    data = loaded(settings)
    drawn = [float(kept["drawn_dead_zone"]) for kept in data.storage.get_episode_metadata([0, 1])]
    assert drawn[0] != drawn[1] and all(0.5e-4 <= each <= 1e-4 for each in drawn)
    masks = [episode.observations["mask"] for episode in data.iterate_episodes()]
    assert all(2 <= mask[0].sum() <= 4 and mask.shape[1] == 6 for mask in masks)


def test_a_name_that_is_taken_and_a_full_disk(tmp_path, monkeypatch):
    settings = settings_of(tmp_path, episodes=2)
    record(settings, quiet=True)
    before = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*"))
    with pytest.raises(ValueError, match="dataset"):
        record(settings, quiet=True)

    def full(*arguments, **more):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(recording.minari, "create_dataset_from_buffers", full)
    with pytest.raises(WriteError, match="No space left"):
        record(settings_of(tmp_path, dataset="vibgym/align/other-v0"), quiet=True)
    assert sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*")) == before


def test_two_that_record_the_same(tmp_path):
    """The second is refused at once; another data set beside it is recorded."""
    settings = settings_of(tmp_path, episodes=2)
    with locks.one_run(tmp_path, "dataset", ".vibgym-align-pose-v0.lock"):
        with pytest.raises(ValueError, match="dataset"):
            record(settings, quiet=True)
        record(settings_of(tmp_path, episodes=2, dataset="vibgym/align/other-v0"), quiet=True)
    assert {path.name for path in tmp_path.iterdir()} == {"vibgym"}


@pytest.mark.parametrize("changes, named", [
    ({"dataset": "no version"}, "dataset"), ({"task": "Juggle"}, "task"),
    ({"observation": "smell"}, "observation"), ({"policy": "juggler"}, "juggler"),
    ({"environment": {"action": "patch"}}, "environment.action"), ({"environment": {"num_envs": 3}}, "environment.num_envs"),
])  # fmt: skip
def test_bad_settings_are_refused_by_name(tmp_path, changes, named):
    with pytest.raises(ValueError, match=named):
        record(settings_of(tmp_path, **changes), quiet=True)
    assert not list(tmp_path.iterdir())


def test_files_are_refused_by_name(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text("dataset: a-v0\ntask: Align\npolicy: pose\nwish: 1\n")
    with pytest.raises(ValueError, match="wish.*bad.yaml"):
        load_settings(path)


def test_episodes_are_replayed_and_have_reference_scores(tmp_path, capsys):
    settings = settings_of(tmp_path, episodes=4, noise=0.1)
    record(settings, quiet=True)
    about = loaded(settings).storage.metadata
    returns = [episode.rewards.sum() for episode in loaded(settings).iterate_episodes()]
    assert about["ref_max_score"] == pytest.approx(np.mean(returns)) and about["ref_min_score"] < np.mean(returns)
    assert main(["replay", settings.dataset, "--output", str(tmp_path), "--quiet"]) == 0
    assert "4 episodes replay" in capsys.readouterr().out


@pytest.mark.parametrize("what", ["actions", "rewards", "observations/parts", "seed", "success"])
def test_a_data_set_that_does_not_replay_is_refused(tmp_path, what, capsys):
    settings = settings_of(tmp_path, episodes=2)
    place, _, _ = record(settings, quiet=True)
    with h5py.File(place / "data" / "main_data.hdf5", "r+") as file:
        episode = file["episode_1"]
        if what in ("seed", "success"):
            episode.attrs[what] = 7 if what == "seed" else not episode.attrs[what]
        else:
            values = episode[what][()]
            values[3] += np.float32(1e-3)
            del episode[what]
            episode[what] = values
    assert main(["replay", settings.dataset, "--output", str(tmp_path), "--quiet"]) == 2
    error = capsys.readouterr().err
    assert "does not replay" in error and error.count("\n") == 1


def test_data_sets_of_another_version_or_origin_are_refused(tmp_path, capsys):
    settings = settings_of(tmp_path, episodes=2)
    record(settings, quiet=True)
    found = loaded(settings)
    scene = json.loads(found.storage.metadata["vibgym_scene"])
    found.storage.update_metadata({"vibgym_scene": json.dumps({**scene, "vibgym": "0.0.1"})})
    assert main(["replay", settings.dataset, "--output", str(tmp_path), "--quiet"]) == 2
    assert "version" in capsys.readouterr().err
    assert main(["replay", "no/such-v0", "--output", str(tmp_path), "--quiet"]) == 2
    assert "no/such-v0" in capsys.readouterr().err


def test_nothing_is_stored_if_an_episode_does_not_replay(tmp_path, monkeypatch):
    played = Recorder.episodes
    monkeypatch.setattr(
        Recorder, "episodes", lambda self: (each._replace(rewards=each.rewards + 1e-9) for each in played(self))
    )
    with pytest.raises(ValueError, match="does not replay"):
        record(settings_of(tmp_path, episodes=2), quiet=True)
    assert not list(tmp_path.rglob("main_data.hdf5"))


def test_a_directory_may_be_relative(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    place, _, _ = record(settings_of("data sets", episodes=1), quiet=True)
    assert place == tmp_path / "data sets" / settings_of("").dataset and place.is_dir()
