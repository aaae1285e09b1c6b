"""Bitwise equality of the batch with single environments and Gymnasium's SyncVectorEnv."""

import copy

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.envs.helpers import SMALL, TASKS, assert_same, batch, single
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.simulation import threads as workers

WORLDS = 3
MODES = list(AutoresetMode)


def side_by_side(task, mode, settings, choose, steps, seed=11):
    """Run native batch and SyncVectorEnv together; returns how episodes ended."""
    native = batch(task, WORLDS, autoreset_mode=mode, **settings)
    sync = SyncVectorEnv([lambda: single(task, **settings)] * WORLDS, autoreset_mode=mode)
    seen = native.reset(seed=seed)
    assert_same(seen, sync.reset(seed=seed), "reset")
    ends = {"success": 0, "fallen": 0, "truncated": 0}
    observation = seen[0]
    for step in range(steps):
        action = choose(observation)
        got, expected = native.step(action), sync.step(action)
        assert_same(got, expected, f"step {step}")
        observation, _, terminated, truncated, info = got
        done = terminated | truncated
        final = info.get("final_info", info)
        ends["success"] += int(final["is_success"][done].sum())
        ends["fallen"] += int(final["fallen"][done].sum())
        ends["truncated"] += int((truncated & ~terminated).sum())
        if mode is AutoresetMode.DISABLED and done.any():
            # SyncVectorEnv takes the mask out of the mapping it is given.
            got = native.reset(options={"reset_mask": done.copy()})
            assert_same(got, sync.reset(options={"reset_mask": done.copy()}), f"reset after step {step}")
            observation = got[0]
    native.close()
    sync.close()
    return ends


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("task, parts, more", [
    ("Align", 1, {"surface": SMALL}), ("Sort", 6, {"surface": {"rows": 8, "columns": 14}, "randomize": {"parts": [2, 4]}}),
])  # fmt: skip
def test_parts_that_fall(task, parts, more, mode):
    settings = {"action": "field", "max_episode_steps": 60, **more}
    push = np.zeros((WORLDS, parts, 6), dtype=np.float32)
    push[:, :, :2] = np.array([[1, 0], [0, -1], [-0.7, 0.7]])[:, None]
    ends = side_by_side(task, mode, settings, lambda seen: push, 80)
    assert ends["fallen"] >= 2 * WORLDS


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("task", TASKS)
def test_success(task, mode):
    policy = make_policy("local_field", TaskInfo.of(single(task)))
    ends = side_by_side(task, mode, {"action": policy.action}, lambda seen: policy.predict(seen)[0], 260)
    assert ends["success"] >= WORLDS


def trajectory(env, seeds, actions):
    """Return all results of a run."""
    result = [env.reset(seed=seeds)]
    result += [env.step(action) for action in actions]
    return result


def rows(result, chosen):
    """Observation, reward and ends of the chosen worlds."""
    return [result[0][0][chosen]] + [[values[chosen] for values in each[:4]] for each in result[1:]]


@pytest.mark.parametrize("task, worlds, settings", [
    ("Rotate", 250, {"action": "patch"}), ("SortCrowded", 40, {"action": "field", "randomize": {"parts": [2, 6]}}),
    ("SortCrowded", 40, {"action": "velocity"}), ("SortCrowded", 40, {"action": "target"}),
])  # fmt: skip
def test_results_depend_neither_on_batch_size_nor_on_order_nor_on_threads(task, worlds, settings, monkeypatch):
    made = lambda count: batch(task, count, max_episode_steps=4, **settings)  # noqa: E731
    seeds, shape = list(range(300, 300 + worlds)), made(worlds).action_space.shape
    actions = np.random.default_rng(8).uniform(-1, 1, (6, *shape)).astype(np.float32)
    whole = trajectory(made(worlds), seeds, actions)
    for chosen in ([0], [worlds - 1], [worlds - 7, 5], list(range(20))[::-1]):
        part = trajectory(made(len(chosen)), [seeds[k] for k in chosen], actions[:, np.array(chosen)])
        assert_same(rows(part, slice(None)), rows(whole, chosen))
    for threads in (1, 2, 5):
        monkeypatch.setattr(workers, "available_threads", lambda threads=threads: threads)
        env = made(worlds)
        assert (len(env.core.simulator.blocks.edges) > 1) == (threads > 1)
        assert_same(trajectory(env, seeds, actions), whole)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_bad_value_changes_nothing_and_returned_arrays_are_kept(threads, monkeypatch):
    monkeypatch.setattr(workers, "available_threads", lambda: threads)
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
