"""Pack and Swap: patterns of goals, starts, and the assignment of goals."""

import itertools
import math

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.tasks.helpers import Scorer, made
from tests.tasks.test_tasks_starts import ALUMINIUM, DISC, STEEL, SURFACE
from vibgym.scene.hulls import gaps_between
from vibgym.tasks import Pack, Pattern, Swap
from vibgym.tasks.assignment import EXCHANGE, exchange_goals
from vibgym.tasks.starts import STARTS

SIX, MIXED = [ALUMINIUM] * 6, [STEEL, ALUMINIUM] * 3
TWELVE, TWENTY = [ALUMINIUM] * 12, [ALUMINIUM] * 20


def drawn(task, worlds=50, seed=0, present=None):
    return task.start(np.random.default_rng(seed).random((worlds, task.draws)), present)


def corners(parts, pose):
    """Return the corners (n, 2) m of all parts at poses (parts, 3)."""
    turned = [part.outline @ np.array([[math.cos(h), math.sin(h)], [-math.sin(h), math.cos(h)]]) + [x, y]
              for part, (x, y, h) in zip(parts, pose, strict=True)]  # fmt: skip
    return np.concatenate(turned)


@pytest.mark.parametrize("parts", [SIX, MIXED, TWELVE, TWENTY], ids=["six", "mixed", "twelve", "twenty"])
@pytest.mark.parametrize(
    "settings", [{}, {"gap_mm": 7}, {"heading_deg": 5, "rows": 2}, {"heading": math.pi / 2, "columns": 3}]
)
def test_lattices_are_on_the_surface_with_their_gap(parts, settings):
    pattern = made(Pattern, SURFACE, parts, **settings)
    goals = pattern.draw(np.random.default_rng(1).random((40, pattern.draws)))
    gap = settings.get("gap_mm", 2.0) * 1e-3
    for goal in goals:
        of = [parts[int(np.flatnonzero(pattern._kind == kind)[0])] for kind in pattern.of_kind]
        least = gaps_between(of, goal[None])[0].min()
        assert gap - 1e-9 <= least  # equal to the gap for equal parts
        assert len({part.name for part in parts}) > 1 or least == pytest.approx(gap)
        reach = corners(of, goal)
        assert (reach > -1e-9).all() and (reach < np.array([SURFACE.width, SURFACE.depth]) + 1e-9).all()
    assert np.ptp(goals[:, 0, 0]) > 0.25  # drawn along the table


def test_the_position_may_be_given():
    pattern = made(Pattern, SURFACE, SIX, place_mm=[400, 100], rows=2, heading_deg=90)
    assert pattern.draws == 0
    goals = pattern.draw(np.zeros((2, 0)))
    assert goals[..., :2].mean(axis=1) == pytest.approx(np.tile([0.4, 0.1], (2, 1)))
    assert len(np.unique(goals[0, :, 0].round(9))) == 2 and len(np.unique(goals[0, :, 1].round(9))) == 3


def test_free_goals_are_assigned_at_the_least_cubed_distance():
    """Compare with all permutations within kinds."""
    task = Pack(SURFACE, MIXED)
    for k in range(10):
        start = drawn(task, 1, k)
        cost = lambda goal: (np.hypot(*(goal - start.pose[0])[:, :2].T) ** 3).sum()  # noqa: E731, B023
        own = [np.flatnonzero(task.kind == kind) for kind in range(2)]
        least = math.inf
        for first, second in itertools.product(*(itertools.permutations(group) for group in own)):
            goal = start.goal[0].copy()
            goal[own[0]], goal[own[1]] = start.goal[0][list(first)], start.goal[0][list(second)]
            least = min(least, cost(goal))
        assert cost(start.goal[0]) == pytest.approx(least)


def test_assigned_goals_are_fixed():
    poses = [[0.1 + 0.06 * k, 0.1, 0.0] for k in range(6)]
    start = drawn(made(Pack, SURFACE, MIXED, free=False, pattern=poses), 3)
    assert start.goal == pytest.approx(np.tile(poses, (3, 1, 1)))
    by_kind = {"aluminium": poses[3:], "steel": poses[:3]}
    start = drawn(made(Pack, SURFACE, MIXED, free=False, pattern=by_kind), 1)
    assert start.goal[0, 0::2] == pytest.approx(np.array(poses[:3]))  # steel, which is listed first
    assert start.goal[0, 1::2] == pytest.approx(np.array(poses[3:]))


def test_with_fewer_parts_the_last_goals_stay_open():
    task = made(Pack, SURFACE, TWELVE, place_mm=[416, 104])
    present = np.zeros((1, 12), dtype=bool)
    present[0, [1, 4, 7, 11]] = True
    start = drawn(task, 1, present=present)
    first = task.pattern.draw(np.zeros((1, 0)))[0, :4]
    assert sorted(map(tuple, start.goal[0, present[0]])) == sorted(map(tuple, first))
    assert (start.goal[~present] == 0.0).all()


def test_parts_with_given_poses_get_other_goals():
    task = Pack(SURFACE, SIX)
    start = drawn(task, 1)
    other = start.pose[:, ::-1].copy()
    moved = task.place(start, other)
    assert (moved.goal[:, ::-1] == start.goal).all()
    fixed = made(Pack, SURFACE, SIX, free=False)
    start = drawn(fixed, 1)
    assert (fixed.place(start, other).goal == start.goal).all()


def test_success_is_all_in_place_at_once_and_the_error_is_the_rms():
    task = Pack(SURFACE, SIX)
    scorer = Scorer(task, 2)
    scorer.scoring = task.scoring(scorer.state, 1)
    scorer.episode = scorer.scoring.episode
    start = drawn(task, 2)
    scorer.begin(start)
    within, goal = scorer.scoring.info()["pattern_error"], start.goal.copy()
    assert within == pytest.approx(np.sqrt(((start.goal - start.pose)[..., :2] ** 2).sum(axis=-1).mean(axis=1)))
    pose = goal + [0.0006, 0.0006, math.radians(2.9)]
    pose[:, 0, 2] += math.pi  # a rectangle looks the same
    for _ in range(9):
        scorer.score(pose)
    assert not scorer.episode.success.any() and (scorer.episode.parts_done == 6).all()
    assert within == pytest.approx(0.0006 * math.sqrt(2.0))
    pose[1, 3, 0] += 0.0004  # beyond a millimetre
    scorer.score(pose)
    assert scorer.episode.success.tolist() == [True, False] and scorer.episode.parts_done[1] == 5
    assert scorer.episode.heading_error == pytest.approx(math.radians(2.9))


@pytest.mark.parametrize("parts", [MIXED, TWELVE], ids=["mixed", "twelve"])
def test_starts_in_a_pattern(parts):
    """In a lattice any part may be in any cell; the number of parts is as requested."""
    starts = STARTS.make("start", {"kind": "pattern", "gap_mm": 5}, SURFACE, parts, (2, len(parts)))
    uniform = np.random.default_rng(2).random((200, starts.draws))
    pose, there = starts.draw(uniform)
    assert set(there.sum(axis=1).tolist()) == set(range(2, len(parts) + 1))
    for k in range(40):
        lying = [part for part, here in zip(parts, there[k], strict=True) if here]
        assert gaps_between(lying, pose[k, there[k]][None])[0].min() >= 0.005 - 1e-9
        assert (pose[k, ~there[k]] == [-SURFACE.width, -SURFACE.depth, 0.0]).all()
    whole = there.all(axis=1)
    assert len(np.unique((pose[whole, 0] - pose[whole].min(axis=1)).round(6), axis=0)) > 3
    assert (starts.draw(uniform, np.ones_like(there))[1]).all()
    poses = {"kind": "pattern", "pattern": [[0.1, 0.1, 1.0], [0.3, 0.1, 0.0]]}
    fixed = STARTS.make("start", poses, SURFACE, [STEEL, DISC])
    assert fixed.draw(np.random.default_rng(0).random((1, fixed.draws)))[0][0] == pytest.approx(
        np.array([[0.1, 0.1, 1.0], [0.3, 0.1, 0.0]])
    )


@pytest.mark.parametrize("pairs, settings, apart", [(8, {}, 0.005), (12, {}, 0.005), (4, {"apart_mm": 20.0}, 0.020)])
def test_kinds_start_at_one_end_and_have_their_goals_at_the_other(pairs, settings, apart):
    task = made(Swap, SURFACE, [STEEL, ALUMINIUM] * pairs, **settings)
    start = task.start(np.random.default_rng(1).random((200, task.draws)))
    for k in range(2):
        own = task.kind == k
        for places, left in ((start.pose, k == 0), (start.goal, k == 1)):
            x = places[:, own, 0] if left else SURFACE.width - places[:, own, 0]
            assert (x > 0.0).all() and (x < 13 * 0.026).all()
    for places in (start.pose, start.goal):
        assert gaps_between(task.parts, places).min() >= apart - 1e-9
        assert np.ptp(places[..., 2]) > 6.0  # at any heading


def test_free_goals_are_a_permutation_with_least_cubed_distances():
    uniform = np.random.default_rng(2).random((50, Swap(SURFACE, MIXED + MIXED[:2]).draws))
    free, own = (made(Swap, SURFACE, MIXED + MIXED[:2], free=free).start(uniform) for free in (True, False))
    assert (free.pose == own.pose).all()
    assert (np.sort(free.goal, axis=1) == np.sort(own.goal, axis=1)).all() and (free.goal != own.goal).any()
    ways = [(np.hypot(*np.moveaxis(start.goal - start.pose, -1, 0)[:2]) ** 3).sum(axis=1) for start in (free, own)]
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
