"""The planner: its targets, its motions, and distances; and patterns drawn apart for two phases."""

import itertools
import math

import numpy as np
import pytest

from tests.policies.helpers import ALUMINIUM, DISC, STEEL, SURFACE, info_of, measurement
from tests.tasks.helpers import made
from vibgym import Part
from vibgym.policies.classical.motion_choice import (
    FIRST_AISLE,
    FIRST_ASIDE,
    FIRST_WAIT,
    INSTANTS,
    INTERVAL,
    MOTIONS,
    STAY,
    distance_at_least,
    follow,
    least_price_beside,
    price_of_place,
    set_velocity,
    with_price_beside,
)
from vibgym.policies.classical.planner import PlannerPolicy, Targets, assign, places
from vibgym.policies.classical.two_phases import EDGE, drawn_apart
from vibgym.scene.hulls import gaps_between, hulls_of
from vibgym.tasks import Pattern
from vibgym.tasks.assignment import exchange_goals

RULE = math.sqrt(2) * 0.026


def planner(name="Sort"):
    return PlannerPolicy(info_of(name))


def block(x, y, velocity=(0.0, 0.0), kind=0):
    """Return the features of the state observation that the planner reads, for one straight block."""
    values = np.zeros(20)
    values[0] = values[1 + kind] = values[6] = 1.0
    values[8:10] = 2 * x / SURFACE.width - 1, 2 * y / SURFACE.depth - 1
    values[14:16] = np.array(velocity) / SURFACE.table_speed
    values[17] = 1.0
    return values


def test_assignment_is_the_best_of_all():
    generator = np.random.default_rng(0)
    for _ in range(10):
        centre, free = generator.random((4, 2)), generator.random((6, 2))
        cost = lambda chosen: (np.hypot(*(centre - chosen).T) ** 3).sum()  # noqa: E731, B023
        best = min(cost(free[list(order)]) for order in itertools.permutations(range(6), 4))
        assert cost(assign(centre, free)) == pytest.approx(best)


def test_swaps_shorten_distances_within_a_kind_only():
    kind = np.array([0, 1, 0])
    centre = np.array([[[0.1, 0.1], [0.2, 0.1], [0.3, 0.1]]] * 3)
    target = centre[:, ::-1].copy()
    target[1] = centre[1] + [0.0, 0.01]
    present = np.array([[True, True, True], [True, True, True], [True, True, False]])
    before = target.copy()
    exchange_goals(kind, present, centre, target, 0.01, np.arange(len(target)))
    assert (target[0] == centre[0]).all()  # the outer two, of one kind, have swapped
    assert (target[1:] == before[1:]).all()  # nothing to gain; one of them is absent
    close = centre[:1] + [[[0.004, 0.0]], [[0.0, 0.0]]][0]
    again = target[:1].copy()
    exchange_goals(kind, present[:1], close, again, 0.01, np.arange(1))
    assert (again == target[:1]).all()


@pytest.mark.parametrize("name", ["Sort", "SortThreeKinds", "SortTwelve", "Singulate"])
def test_targets_keep_the_spacing_rule(name):
    """Aligned parts at their targets satisfy the spacing rule."""
    known = info_of(name)
    targets = Targets(known, 0.026, 0.02)
    generator = np.random.default_rng(1)
    parts, present = len(known.parts), np.ones(len(known.parts), dtype=bool)
    for _ in range(10):
        centre = generator.random((parts, 2)) * [0.83, 0.2]
        target = targets.give(centre, present)
        assert gaps_between(known.parts, np.c_[target, np.zeros(parts)][None]).min() > RULE
        assert (target >= 0.026 - 1e-9).all() and (target <= np.array([0.832, 0.208]) - 0.026 + 1e-9).all()
        if known.zones is not None:
            zone = known.zones[list(known.kind)]
            assert (target >= zone[:, :2] + 0.019).all() and (target <= zone[:, 2:] - 0.019).all()


def test_absent_parts_keep_their_place():
    targets, centre = Targets(info_of("Sort"), 0.026, 0.02), np.full((6, 2), 0.1)
    target = targets.give(centre, np.array([True, True, False, False, False, False]))
    assert (target[2:] == centre[2:]).all() and (target[:2] != centre[:2]).any(axis=1).all()


def test_a_tight_lattice_has_room_for_all():
    low, high = np.array([0.03, 0.03]), np.array([0.15, 0.18])
    for least in (1, 3, 7, 12, 30):
        spots = places(low, high, np.array([0.05, 0.04]), RULE, least)
        assert len(spots) >= least and (spots >= low - 1e-9).all() and (spots <= high + 1e-9).all()
    line = places(np.array([0.03, 0.1]), np.array([0.2, 0.1]), np.array([0.05, 0.04]), RULE, 5)
    assert len(line) >= 5 and (line[:, 1] == pytest.approx(0.1)) and len(np.unique(line[:, 0])) == len(line)


def all_paths(here, velocity=(0.0, 0.0), target=(0.7, 0.1)):
    result = np.empty((MOTIONS, 2, INSTANTS))
    arrays = (np.array(values, dtype=float) for values in (here, velocity, target))
    follow(planner().preferences, *arrays, np.empty((4, MOTIONS)), result)
    return result.swapaxes(1, 2)


def path(motion, here, velocity=(0.0, 0.0), target=(0.7, 0.1)):
    return all_paths(here, velocity, target)[motion]


def test_motions_agree_with_their_names():
    here = (0.2, 0.12)
    straight = path(0, here, target=(0.5, 0.15))
    assert straight[-1] == pytest.approx([0.5, 0.15], abs=0.005)  # arrives, and stays
    assert np.hypot(*(straight[1:] - straight[:-1]).T).max() <= planner().preferences.top_speed * INTERVAL + 1e-9
    away = (straight - here) @ np.array([-0.03, 0.3])
    assert away == pytest.approx(0.0, abs=1e-9)
    assert np.hypot(*(path(STAY, here) - here).T).max() == 0.0
    wait = path(FIRST_WAIT, here)
    assert (wait[:3] == here).all() and wait[-1, 0] > 0.4
    aisles = [path(FIRST_AISLE + k, here)[10, 1] for k in range(6)]
    assert (np.diff(aisles) > 0).all() and aisles[0] == pytest.approx(0.026, abs=0.02)
    aside = [path(FIRST_ASIDE + k, here)[4] - here for k in range(12)]
    assert [round(math.degrees(math.atan2(y, x))) % 360 for x, y in aside] == list(range(0, 360, 30))
    for motion in range(MOTIONS):
        assert np.hypot(*set_velocity(planner().preferences, motion, 0.0, *here, 0.7, 0.1)) <= 0.302


def test_all_motions_together_equal_each_alone():
    wants, generator = planner().preferences, np.random.default_rng(3)
    for _ in range(10):
        here, target = generator.random((2, 2)) * [0.8, 0.2]
        velocity = generator.normal(size=2) * 0.15
        together = all_paths(here, velocity, target)
        for motion in range(MOTIONS):
            place, speed = here, velocity
            for k in range(INSTANTS):
                change = np.array(set_velocity(wants, motion, k * INTERVAL, *place, *target)) - speed
                then = speed + change * min(wants.acceleration * INTERVAL / max(np.hypot(*change), 1e-12), 1.0)
                place, speed = place + 0.5 * INTERVAL * (speed + then), then
                assert together[motion, k] == pytest.approx(place, abs=1e-12)


def test_least_cost_is_a_lower_bound():
    policy, generator = planner(), np.random.default_rng(4)
    parts = len(policy.info.parts)
    rank, above = np.arange(parts), 0
    for _ in range(300):
        centre = generator.random((1, parts, 2)) * [0.15, 0.1] + [0.3, 0.05]
        seen = measurement(policy.info, centre=centre, heading=generator.uniform(-3.0, 3.0, (1, parts)))
        scene = policy.scene(seen, centre, np.full((1, parts, parts), np.inf), np.zeros((1, parts)))
        paths = np.ascontiguousarray(np.repeat(centre[0][:, :, None], INSTANTS, axis=2))
        beside = (policy.preferences, scene, 0, 0, 1, rank, paths[1], paths[0])
        least = least_price_beside(*beside)
        price = with_price_beside(policy.preferences, policy.hulls, *beside[1:6], paths, paths[0], 0.0, math.inf)
        assert least <= price + 1e-12
        above += least > 0.0
    assert above > 50


def test_a_moving_part_needs_time_to_stop():
    rolling = path(STAY, (0.2, 0.1), velocity=(0.3, 0.0))
    assert 0.01 < rolling[-1, 0] - 0.2 < 0.04 and rolling[-1, 0] == rolling[-2, 0]


def test_distances_are_bounded_from_below():
    """Bounds are exact for discs and for blocks that face each other."""
    generator = np.random.default_rng(2)
    parts = (STEEL, ALUMINIUM, DISC, DISC, Part.polygon([[0, 0], [0.06, 0], [0.06, 0.02], [0, 0.05]], friction=0.5))
    hulls = hulls_of(parts)
    for _ in range(50):
        pose = np.c_[generator.random((5, 2)) * 0.3, generator.uniform(-4, 4, 5)]
        turned = np.c_[np.cos(pose[:, 2]), np.sin(pose[:, 2])]
        exact = gaps_between(parts, pose[None])[0]
        for p, q in itertools.combinations(range(5), 2):
            bound = distance_at_least(hulls, p, q, turned, *(pose[q, :2] - pose[p, :2]))
            assert bound <= exact[p, q] + 1e-9
            if (p, q) == (2, 3):
                assert bound == pytest.approx(exact[p, q])
    straight = np.array([[1.0, 0.0]] * 5)
    assert distance_at_least(hulls, 0, 1, straight, 0.1, 0.0) == pytest.approx(0.05)
    assert distance_at_least(hulls, 0, 1, straight, 0.0, 0.0) < 0


def simulate(policy, blocks, seconds, targets=None):
    """Simulate points that follow the planner's set velocities with the lag of a part.

    Returns:
        Smallest distance of straight blocks on the way, final positions, targets.

    Args:
        blocks: x, y and kind of each part.
    """
    place = np.array([row[:2] for row in blocks], dtype=float)
    velocity, state, least = np.zeros_like(place), None, np.inf
    target = place
    requested = []
    # Record the set velocities instead of computing actions.
    policy.steer = lambda seen, displacement, memory: (requested.append(displacement[0] / policy.law.lead), memory)
    parts = policy.info.parts
    for _ in range(round(seconds / 0.04)):
        seen = np.zeros((6, 20))
        for k, (x, y) in enumerate(place):
            seen[k] = block(x, y, velocity[k], blocks[k][2])
        _, state = policy.predict(seen.ravel(), state)
        target = state.own.target[0, : len(place)]
        change = requested[-1][: len(place)] - velocity
        velocity = velocity + np.clip(change, -0.09, 0.09)
        place = place + 0.04 * velocity
        gaps = gaps_between(parts[: len(place)], np.c_[place, np.zeros(len(place))][None])
        least = min(least, gaps.min())
    return least, place, target


@pytest.mark.parametrize("rows", [(0.1, 0.1), (0.1, 0.12), (0.05, 0.05)])
def test_two_approaching_parts_pass_at_a_distance(rows):
    least, place, target = simulate(planner(), [(0.7, rows[0], 0), (0.13, rows[1], 1)], 6.0)
    assert place == pytest.approx(target, abs=0.003)
    assert least > 0.65 * RULE  # it may be broken by a little where that saves time


def test_arrived_parts_make_way():
    """Three arrived parts block a fourth one."""
    wall = [(0.136, 0.026, 0), (0.05, 0.104, 1), (0.136, 0.104, 0), (0.75, 0.1, 1), (0.136, 0.182, 0), (0.75, 0.182, 1)]
    least, place, target = simulate(planner(), wall, 15.0)
    assert np.abs(place - target).max() < 0.02 and place[1, 0] > 0.6
    assert least > 0.0


def test_the_spacing_rule_is_limited_by_the_goals():
    """Parts with goals 2 mm apart keep that distance at the goals, and the spacing rule on the way."""
    policy = planner("Pack")
    room = np.full((1, 12, 12), np.inf)
    room[0, 0, 1] = room[0, 1, 0] = 0.002
    seen = measurement(policy.info)
    there, away = seen.centre, seen.centre + [0.3, 0.0]
    at_goals, on_the_way = (policy.scene(seen, target, room, np.zeros((1, 12))) for target in (there, away))
    assert at_goals.spacing[0, 0, 1] == pytest.approx(0.002) and at_goals.safe[0, 0, 1] == pytest.approx(0.001)
    assert (at_goals.spacing[0, 2:] == RULE).all() and (on_the_way.spacing == RULE).all()
    assert (on_the_way.safe == policy.settings.safe).all()


def test_a_goal_near_the_border_costs_nothing():
    wants, rest = planner().preferences, np.full((2, INSTANTS), [[0.4], [0.018]])
    assert price_of_place(wants, rest, rest[:, 0]) == pytest.approx(0.0, abs=1e-12)
    aside = np.array([[0.0], [0.005]])
    assert price_of_place(wants, rest - aside, rest[:, 0]) > price_of_place(wants, rest + aside, rest[:, 0]) + 1.0


def test_leaving_parts_have_separate_targets():
    known = info_of("Feed")
    targets, generator = Targets(known, 0.026, 0.02), np.random.default_rng(4)
    centre = generator.random((20, 12, 2)) * [0.83, 0.208]
    target, zone = targets.leaving(centre), known.zones[list(known.kind)]
    right = (centre[..., 1] > zone[:, 1]) & (centre[..., 1] < zone[:, 3])
    assert right.any() and not right.all()
    assert (target[..., 0] == np.where(right, zone[:, 2], target[..., 0])).all()
    assert (target[..., 0] < zone[:, 0])[~right].all()
    assert (target[..., 1] > zone[:, 1]).all() and (target[..., 1] < zone[:, 3]).all()
    policy = PlannerPolicy(known)
    displacement = np.array([[0.1, 0.3, 0.2]])
    assert np.argsort(policy.right_of_way(displacement))[0].tolist() == [0, 2, 1]  # nearest to its gate first
    assert np.argsort(planner().right_of_way(displacement))[0].tolist() == [1, 2, 0]


def test_waiting_is_counted_in_time():
    """A blocked part waits for the same time with any step length."""
    waited = []
    for periods in (1, 4):
        policy = PlannerPolicy(info_of("Sort", periods_per_step=periods))
        seen, state = np.concatenate([block(0.4, 0.1), np.zeros(100)]), None
        for _ in range(24 // periods):
            _, state = policy.predict(seen, state)
        waited.append(state.own.waited[0, 0])
    assert waited == pytest.approx([0.96, 0.96], abs=0.1)  # in its first steps it appears to start moving


@pytest.mark.parametrize("name, reported", [("Pack", True), ("Sort", False), ("Swap", False)])
def test_goals_too_close_together_are_logged(name, reported, caplog):
    planner(name)
    assert any("two_phases" in text for text in caplog.messages) == reported


@pytest.mark.parametrize(
    "parts", [[ALUMINIUM] * 12, [ALUMINIUM] * 20, [STEEL, ALUMINIUM] * 4], ids=["12", "20", "two kinds"]
)
@pytest.mark.parametrize("settings", [{}, {"heading_deg": 8, "rows": 2}, {"gap_mm": 20, "rows": 2}])
def test_patterns_are_expanded_on_the_table(parts, settings):
    """Expanded patterns fit, keep the distance or use the width, and paths to the goals do not cross."""
    pattern = made(Pattern, SURFACE, parts, **settings)
    of = [parts[int(np.flatnonzero(pattern._kind == kind)[0])] for kind in pattern.of_kind]
    for uniform in np.random.default_rng(0).random((10, 2)):
        goal = pattern.draw(uniform[None])[0]
        place = drawn_apart(SURFACE, of, goal[:, :2], goal[:, 2], 0.036)
        away = gaps_between(of, np.c_[place, goal[:, 2]][None])[0].min()
        assert away > (0.0359 if not (len(parts) == 20 or "heading_deg" in settings) else 0.02)
        assert (place > 0.0175 + EDGE - 1e-9).all()
        assert (place < np.array([SURFACE.width, SURFACE.depth]) - 0.0175).all()
        least = gaps_between(of, goal[None])[0].min()
        displacement = np.linspace(0.0, 1.0, 40)[:, None, None]
        poses = np.concatenate(
            [goal[:, :2] + displacement * (place - goal[:, :2]), np.tile(goal[:, 2:], (40, 1, 1))], axis=-1
        )
        assert gaps_between(of, poses).min() > least - 1e-9


def test_a_pattern_that_fills_the_width_is_slanted():
    goal = made(Pattern, SURFACE, [ALUMINIUM] * 12, heading_deg=90, place_mm=[416, 104]).draw(np.zeros((1, 0)))[0]
    place = drawn_apart(SURFACE, [ALUMINIUM] * 12, goal[:, :2], goal[:, 2], 0.036)
    assert gaps_between([ALUMINIUM] * 12, np.c_[place, goal[:, 2]][None])[0].min() > 0.01
    assert drawn_apart(SURFACE, [ALUMINIUM], goal[:1, :2], goal[:1, 2], 0.036) == pytest.approx(goal[:1, :2])
