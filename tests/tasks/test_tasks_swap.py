"""Swap: starts and goals, their assignment, and bad input."""

import numpy as np
import pytest

from tests.envs.helpers import batch, single
from tests.tasks.helpers import made
from vibgym import Surface
from vibgym.scene.hulls import gaps_between
from vibgym.scene.parts import shipped_part
from vibgym.tasks import Swap
from vibgym.tasks.assignment import EXCHANGE, exchange_goals

SURFACE = Surface()
BLOCKS = [shipped_part(name) for name in ("steel_block", "aluminium_block")]
END = 13 * 0.026


@pytest.mark.parametrize("pairs, settings, apart", [(8, {}, 0.005), (12, {}, 0.005), (4, {"apart_mm": 20.0}, 0.020)])
def test_kinds_start_at_one_end_and_have_their_goals_at_the_other(pairs, settings, apart):
    task = made(Swap, SURFACE, BLOCKS * pairs, **settings)
    start = task.start(np.random.default_rng(1).random((200, task.draws)))
    for k in range(2):
        own = task.kind == k
        for places, left in ((start.pose, k == 0), (start.goal, k == 1)):
            x = places[:, own, 0] if left else SURFACE.width - places[:, own, 0]
            assert (x > 0.0).all() and (x < END).all()
    for places in (start.pose, start.goal):
        assert gaps_between(task.parts, places).min() >= apart - 1e-9
        assert np.ptp(places[..., 2]) > 6.0  # at any heading


def test_free_goals_are_a_permutation_with_least_cubed_distances():
    uniform = np.random.default_rng(2).random((50, Swap(SURFACE, BLOCKS * 4).draws))
    free, own = (made(Swap, SURFACE, BLOCKS * 4, free=each).start(uniform) for each in (True, False))
    assert (free.pose == own.pose).all()
    assert (np.sort(free.goal, axis=1) == np.sort(own.goal, axis=1)).all() and (free.goal != own.goal).any()
    ways = [(np.hypot(*np.moveaxis(each.goal - each.pose, -1, 0)[:2]) ** 3).sum(axis=1) for each in (free, own)]
    assert (ways[0] <= ways[1] + 1e-12).all()


def test_parts_of_a_kind_exchange_goals_where_both_gain():
    pose = np.zeros((1, 3, 3))
    pose[0, :, 0] = [0.1, 0.2, 0.3]
    goal, kind, there = pose[:, [1, 0, 2]].copy(), np.array([0, 0, 1]), np.ones((1, 3), dtype=bool)
    exchange_goals(kind, there, pose, goal, EXCHANGE, np.arange(1))
    assert (goal == pose).all()
    goal = pose[:, [2, 1, 0]].copy()
    exchange_goals(np.arange(3), there, pose, goal, EXCHANGE, np.arange(1))  # each of another kind
    assert (goal == pose[:, [2, 1, 0]]).all()
    goal = pose + [0.5 * EXCHANGE, 0.0, 0.0]  # nothing to gain
    exchange_goals(np.zeros(3, dtype=np.int64), there, pose, goal, EXCHANGE, np.arange(1))
    assert (goal == pose + [0.5 * EXCHANGE, 0.0, 0.0]).all()


def test_drawn_numbers_of_parts():
    env = batch("Swap", 64, randomize={"parts": [2, 16]})
    env.reset(seed=0)
    number = env.unwrapped.truth.present.sum(axis=1)
    assert number.min() <= 4 and number.max() >= 14 and not env.unwrapped.truth.goal[~env.unwrapped.truth.present].any()


@pytest.mark.parametrize("settings, words", [
    ({"parts": ["steel_block"] * 4}, "parts"),
    ({"task_settings": {"columns": 17}}, r"task_settings\.columns"),
    ({"task_settings": {"columns": 4}}, "parts"),
])  # fmt: skip
def test_bad_settings_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        single("Swap", **settings)
