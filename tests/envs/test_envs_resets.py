"""Resets: seeds, starts that a caller sets, masks, and the order of calls."""

import copy

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import assert_same, batch, single
from vibgym.simulation import threads as workers

MANY = [[100 + 20 * k, 60 + 30 * (k % 2)] for k in range(20)]
LINE = {"shape": "polyline", "points_mm": [[300, 60], [380, 60], [380, 140]], "speed": 0.1}
OTHER = {"shape": "circle", "centre_mm": [150, 100], "radius_mm": 50}


def test_seeds():
    def start(seed, env=None):
        return (env or batch("Align", 3)).reset(seed=seed)[0]

    assert_same(start(5), start([5, 6, 7]))
    assert_same(start(np.int64(5)), start(5))
    assert_same(start((7, 5, 6)), start(5)[[2, 0, 1]])
    assert not (start(None) == start(None)).all(axis=1).any()  # seeded by the operating system
    one, other = batch("Align", 3), batch("Align", 3)
    start(5, one), start(5, other)
    assert_same(start(None, one), start(None, other))  # continues the generators
    mixed = start([9, None, 9], one)
    later = start(None, other)
    assert_same(mixed[1], later[1])
    assert_same(mixed[0], start(9)[0])
    assert_same(mixed[2], mixed[0])
    assert (start(5) != start(6)).any()


@pytest.mark.parametrize("seed", [-1, 1.5, "1", True, [1, 2], [1, 2, -3], [1, 2, "x"]])
@pytest.mark.parametrize("make", [single, lambda task: batch(task, 3)], ids=["single", "batch"])
def test_bad_seeds_change_nothing(make, seed):
    env, other = make("Align"), make("Align")
    env.reset(seed=5), other.reset(seed=5)
    with pytest.raises(ValueError, match="seed"):
        env.reset(seed=seed)
    assert_same(env.reset()[0], other.reset()[0])


def test_pose_and_goal_of_a_start():
    env, drawn = (single("Align", action="field").unwrapped for _ in range(2))
    env.reset(seed=3, options={"pose": [0.2, 0.1, 0.5], "goal": [0.6, 0.05, -1.0]})
    truth = env.truth
    assert truth.pose[0, 0].tolist() == [0.2, 0.1, 0.5] and truth.goal[0, 0].tolist() == [0.6, 0.05, -1.0]
    drawn.reset(seed=3)
    env.reset(seed=3, options={"pose": [0.2, 0.1, 0.5]})  # the rest is drawn as before
    assert (env.truth.goal == drawn.truth.goal).all()
    assert_same(env.reset(), drawn.reset())
    env = single("Transport", action="field").unwrapped
    env.reset(seed=3, options={"goal": [0.6, 0.05]})  # a position
    assert env.truth.goal[0, 0, :2].tolist() == [0.6, 0.05]


def test_rotate_turns_in_place_at_any_start():
    env, drawn = (single("Rotate", action="field").unwrapped for _ in range(2))
    drawn.reset(seed=3)
    _, info = env.reset(seed=3, options={"pose": [0.2, 0.1, 0.5]})
    assert info["position_error"] == 0.0
    assert info["heading_error"] == pytest.approx(abs((drawn.truth.goal - drawn.truth.pose)[0, 0, 2]), abs=1e-12)


def test_parts_of_a_start():
    env = single("Sort", action="field").unwrapped
    env.reset(seed=3, options={"parts": [1, 4]})
    assert env.truth.present[0].tolist() == [False, True, False, False, True, False]
    pose = env.truth.pose[0, [1, 4]]
    assert (pose[:, :2] > 0.0).all() and (pose[:, :2] < [0.832, 0.208]).all()
    poses = [[0.1 + 0.1 * k, 0.1, 0.3] for k in range(6)]
    env.reset(seed=3, options={"parts": [0, 5], "pose": poses})
    assert env.truth.pose[0, [0, 5]].tolist() == [poses[0], poses[5]] and env.truth.present[0].sum() == 2


def test_starts_of_a_batch():
    env = batch("Align", 3, action="field", autoreset_mode="Disabled")
    pose = np.array([[[0.1, 0.1, 0.0]], [[0.2, 0.1, 0.0]], [[0.3, 0.1, 0.0]]])
    env.reset(seed=1, options={"pose": pose})
    assert (env.truth.pose == pose).all()
    env.reset(options={"reset_mask": np.array([False, True, False]), "pose": [0.5, 0.1, 0.0]})
    assert env.truth.pose[:, 0, 0].tolist() == [0.1, 0.5, 0.3]
    many = batch("Sort", 2, action="field")
    many.reset(seed=1, options={"parts": np.array([[True] * 6, [True, False] * 3])})
    assert many.truth.present.sum(axis=1).tolist() == [6, 3]


BAD_OPTIONS = [
    ("Align", {"reset_maks": [True]}, "options"),
    ("Align", {"reset_mask": [True]}, "options"),  # of batches only
    ("Align", "pose", "options"),
    ("Align", {"pose": [0.2, 0.1, np.nan]}, r"options\['pose'\]"),
    ("Align", {"pose": [2.0, 0.1, 0.0]}, r"options\['pose'\]"),
    ("Align", {"goal": [0.2, -0.1, 0.0]}, r"options\['goal'\]"),
    ("Align", {"goal": [0.2, 0.1]}, r"options\['goal'\]"),
    ("Sort", {"goal": [0.2, 0.1, 0.0]}, r"options\['goal'\]"),
    ("Sort", {"pose": [0.2, 0.1, 0.0]}, r"options\['pose'\]"),  # all six in one place
    ("Sort", {"parts": []}, r"options\['parts'\]"),
    ("Sort", {"parts": [0, 0]}, r"options\['parts'\]"),
    ("Sort", {"parts": [6]}, r"options\['parts'\]"),
    ("Sort", {"parts": [False] * 6}, r"options\['parts'\]"),
    ("Feed", {"pose": [0.4, 0.1, 0.0]}, r"options\['pose'\]"),
    ("Follow", {"pose": [0.4, 0.1, 0.0]}, r"options\['pose'\]"),  # not at the start of the path
    ("Follow", {"goal": [0.4, 0.1, 0.0]}, r"options\['goal'\]"),
    ("Align", {"paths": [LINE]}, r"options\['paths'\]"),
    ("Follow", {"paths": [{**OTHER, "radius_mm": 200}]}, r"options\['paths'\]\[0\].radius"),
    ("Follow", {"paths": [{**LINE, "speed": 0.5}]}, r"options\['paths'\]\[0\]\.speed"),
    ("Follow", {"paths": [LINE, OTHER]}, r"options\['paths'\]"),
    ("Follow", {"paths": {"shapes": ["circle"]}}, r"options\['paths'\]"),
    ("Follow", {"paths": [{"shape": "polyline", "points_mm": MANY, "speed": 0.05}]}, r"options\['paths'\]"),
    ("Follow", {"paths": [{**OTHER, "laps": 10}]}, r"options\['paths'\]"),
]


@pytest.mark.parametrize("task, options, named", BAD_OPTIONS, ids=lambda value: str(value)[:40])
def test_bad_options_are_refused_and_nothing_changes(task, options, named):
    makers = [lambda: single(task, action="field").unwrapped, lambda: batch(task, 2, action="field").unwrapped]
    for make in makers[:1] if options == {"reset_mask": [True]} else makers:
        env = make()
        env.reset(seed=1)
        before = env.get_state()
        with pytest.raises(ValueError, match=named):
            env.reset(seed=2, options=options)
        assert_same(env.get_state(), before)


@pytest.mark.parametrize("mask", [[True, False], np.zeros(3, dtype=bool), np.ones(3), np.ones((3, 1), dtype=bool)])
def test_bad_reset_masks(mask):
    env = batch("Align", 3, autoreset_mode="Disabled")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="reset_mask"):
        env.reset(options={"reset_mask": mask})


def test_disabled_refuses_to_step_over_an_end():
    env = batch("Align", 2, action="field", autoreset_mode="Disabled", max_episode_steps=1)
    env.reset(seed=0)
    env.step(np.zeros((2, 1, 6), dtype=np.float32))
    with pytest.raises(gym.error.ResetNeeded, match="0, 1"):
        env.step(np.zeros((2, 1, 6), dtype=np.float32))
    env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(gym.error.ResetNeeded, match=r"\[1\]"):
        env.step(np.zeros((2, 1, 6), dtype=np.float32))


def test_the_first_reset_must_be_of_all_worlds():
    env = batch("Align", 2)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    with pytest.raises(ValueError, match="reset_mask"):
        env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(gym.error.ResetNeeded):
        single("Align").unwrapped.step(np.zeros((8, 32, 2), dtype=np.float32))


def test_a_bad_value_changes_nothing_and_returned_arrays_are_kept(monkeypatch):
    monkeypatch.setattr(workers, "available_threads", lambda: 2)
    env = batch("Rotate", 600)  # more than a megabyte of actions: checked block by block
    seen, info = env.reset(seed=0)
    action = np.random.default_rng(1).uniform(-1, 1, env.action_space.shape).astype(np.float32)
    kept = copy.deepcopy((seen, info))
    stepped = env.step(action)
    assert_same((seen, info), kept)
    before, kept, bad = env.get_state(), copy.deepcopy(stepped), action.copy()
    bad[-1, -1] = np.nan
    with pytest.raises(ValueError, match=r"action"):
        env.step(bad)
    assert_same(env.get_state()["simulator"], before["simulator"])
    env.step(-action)
    assert_same(stepped, kept)


def test_stepping_after_close_raises():
    one, many = single("Align", action="field"), batch("Align", 2, action="field")
    for env in (one, many):
        env.reset(seed=0)
        env.close()
        with pytest.raises(gym.error.ClosedEnvironmentError, match="closed"):
            env.step(env.action_space.sample())
        env.reset(seed=0)
        env.step(env.action_space.sample())
