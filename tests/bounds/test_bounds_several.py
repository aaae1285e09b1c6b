"""Bounds for several parts, pushed parts and flows: closed forms, and simulations within the bounds."""

import itertools
import math

import numpy as np
import pytest

from tests.policies.helpers import ALUMINIUM, FRESH, STEEL, SURFACE
from vibgym import Part, Surface
from vibgym.bounds import FlowBound, PushBound, SeveralBound, TimeBound
from vibgym.bounds.programme import moves
from vibgym.bounds.several import MARGIN, _fitting, bottleneck, most_power
from vibgym.bounds.tables import FREE_END, Hold, displacement_reach, fewest_periods
from vibgym.policies.measures import Measures
from vibgym.policies.rollout import rollout

MAX = SURFACE.full_scale / SURFACE.angular_frequency**2
ASKED = {"position_tolerance": 0.002, "heading_tolerance": math.radians(3.0), "heading_period": math.pi}
DISC = Part.disc(0.015, friction=0.58)


@pytest.fixture(scope="module")
def bounds():
    return [TimeBound(SURFACE, part, **ASKED) for part in (ALUMINIUM, STEEL, ALUMINIUM)]


def poses(seed, worlds=6, parts=3):
    random = np.random.default_rng(seed)
    return random.uniform([0.05, 0.05, -3.0], [0.75, 0.15, 3.0], (worlds, parts, 3))


def test_the_slowest_present_part_is_the_bound(bounds):
    start, goal, several = poses(0), poses(1), SeveralBound(bounds)
    alone = np.stack([bound.steps(start[:, k], goal[:, k]) for k, bound in enumerate(bounds)], axis=1)
    np.testing.assert_array_equal(several.steps(start, goal), alone.max(axis=1))
    some = np.array([True, False, True])
    np.testing.assert_array_equal(several.steps(start, goal, np.tile(some, (6, 1))), alone[:, some].max(axis=1))
    assert (several.steps(start, goal, np.zeros((6, 3), dtype=bool)) == 10).all()  # the hold's


def test_the_bottleneck_is_the_best_of_all_assignments():
    random = np.random.default_rng(2)
    for size in (1, 2, 4, 5):
        for _ in range(20):
            cost = random.integers(0, 9, (size, size))
            every = (max(cost[k, c] for k, c in enumerate(order)) for order in itertools.permutations(range(size)))
            assert bottleneck(cost) == min(every)


def test_free_goals_take_no_longer_and_stay_within_their_group(bounds):
    start, goal, several = poses(3), poses(4), SeveralBound(bounds)
    own, free = several.steps(start, goal), several.free_steps(start, goal, [0, 1, 0])
    swapped = several.steps(start, goal[:, [2, 1, 0]])
    np.testing.assert_array_equal(free, np.minimum(own, swapped))
    np.testing.assert_array_equal(several.free_steps(start, goal, [0, 1, 2]), own)


def test_power_is_what_a_part_gains_in_a_period():
    # Independent: gain of a free part within one period at its best phase, over directions.
    steps, at = 24, math.pi / 24 * np.arange(49)
    phases = SURFACE.full_scale * np.exp(2j * np.pi * np.arange(96) / 96)
    phasor, idle = np.column_stack([phases.real, phases.imag]), SURFACE.idle_velocity(0.58)
    gains = []
    for direction in 2.0 * math.pi * np.arange(8) / 8:
        velocity = np.linspace(0.0, 0.4, 41)[:, None] * [math.cos(direction), math.sin(direction)]
        way, after = np.empty((2, 41, 96, 2))
        drive = 0.58, SURFACE.gravity, SURFACE.table_speed, SURFACE.period
        moves(*drive, np.cos(at), np.sin(at), velocity + idle, phasor, way, after)
        gained = ((after - idle) ** 2).sum(axis=-1) - (velocity**2).sum(axis=-1)[:, None]
        gains.append(gained.max() / (2.0 * SURFACE.period))
    power = most_power(SURFACE, 0.58, MAX)
    assert steps == 24 and np.mean(gains) == pytest.approx(power, rel=0.02)
    assert max(gains) <= (1.0 + MARGIN) * power


def test_pushing_is_bounded_by_energy():
    bound = PushBound(SURFACE, ALUMINIUM, [DISC, DISC], **ASKED)
    speed = bound.top_speed
    drag = ALUMINIUM.friction * SURFACE.gravity / (2.0 * SURFACE.table_speed)
    power = 2.0 * DISC.mass * (1.0 + MARGIN) * most_power(SURFACE, DISC.friction, MAX)
    assert drag * ALUMINIUM.mass * speed**2 == pytest.approx(power)  # dissipation at this speed
    start, touching = np.zeros((1, 3)), np.zeros((1, 2))
    far = start + [[0.002 + 1.0, 0.0, 0.0]]
    assert bound.steps(start, far, touching)[0] == math.ceil(1.0 / speed / 0.04) + 9
    turned = start + [[0.0, 0.0, 1.0 + math.radians(3.0)]]
    assert bound.steps(start, turned, touching)[0] == math.ceil(math.sqrt(ALUMINIUM.gyration) / speed / 0.04) + 9
    assert bound.steps(start, far, touching + 0.1)[0] > bound.steps(start, far, touching)[0]
    assert bound.steps(start, start, touching + 0.1)[0] == 10


def flow(parts=4, **settings):
    arguments = {
        "kind": [0, 1] * (parts // 2),
        "displacement": [0.7] * parts,
        "headway": 7,
        "periods": 1200,
        **settings,
    }
    return FlowBound(SURFACE, [STEEL, ALUMINIUM] * (parts // 2), **arguments)


def test_flow_is_limited_by_slots_and_gates():
    assert [_fitting(n, 7) for n in (0, 1, 7, 8, 14, 15)] == [0, 1, 1, 2, 2, 3]
    transits = [
        int(fewest_periods(displacement_reach(SURFACE, part.friction, MAX, FREE_END, Hold(1, 1)), np.array([0.7]))[0])
        for part in (STEEL, ALUMINIUM)
    ]
    assert 0.7 / 0.31 < 0.04 * min(transits) < 0.7 / 0.29
    passes = [1 + 1199 // (transit + 1) for transit in transits]
    assert flow().transit == pytest.approx(0.04 * np.array(transits * 2))
    assert flow().most == 2 * sum(passes) and flow(8).most == 4 * sum(passes)
    assert flow().per_minute == pytest.approx(60.0 * flow().most / 48.0)
    assert flow(100).most == 2 * (1 + 1199 // 7)  # the gates'
    assert flow(amplitude=0.5 * MAX).most < flow().most and math.isnan(flow(periods=0).per_minute)
    assert flow(displacement=[0.1]).most > flow().most  # one distance for all parts


@pytest.mark.parametrize(("task", "policy"), [("Feed", "lanes"), ("Feed", "random"), ("FeedHeaps", "lanes")])
def test_no_policy_exceeds_the_flow_bound(task, policy):
    result = rollout(policy, task, seeds=range(FRESH, FRESH + 2), keep=Measures, max_episode_steps=700)
    assert np.isfinite(result.rate_bound).all() and (result.rate_over_bound <= 1.0).all()
    assert np.isnan(result.bound).all()


@pytest.mark.parametrize("task", ["Swap", "Pack"])
def test_goals_that_parts_may_exchange_are_bounded_by_the_best_assignment(task):
    seeds = range(FRESH, FRESH + 4)
    fixed, free = (
        rollout("zero", task, seeds=seeds, keep=Measures, max_episode_steps=1, task_settings={"free": exchange})
        for exchange in (False, True)
    )
    assert (free.bound <= fixed.bound).all() and (free.bound < fixed.bound).any()


@pytest.mark.parametrize(("task", "policy"), [("Pack", "two_phases"), ("Swap", "lanes")])
def test_no_policy_is_faster(task, policy):
    result = rollout(policy, task, seeds=range(FRESH, FRESH + 8), keep=Measures)
    assert result.success.any() and (result.time_over_bound[result.success] >= 1.0).all()
    assert np.isnan(result.rate_bound).all()


def time_bound(**arguments):
    return TimeBound(**{"surface": SURFACE, "part": ALUMINIUM, **ASKED, **arguments})


def push_bound(**arguments):
    return PushBound(**{"surface": SURFACE, "part": ALUMINIUM, "pushers": [DISC], **ASKED, **arguments})


def flow_bound(**arguments):
    return FlowBound(**{
        "surface": SURFACE, "parts": [STEEL], "kind": [0], "displacement": [0.1], "headway": 7, "periods": 100, **arguments,
    })  # fmt: skip


REFUSED = [
    *((make, {name: value}, name) for make in (time_bound, push_bound) for name, value in (
        ("position_tolerance", 0.0), ("heading_tolerance", -1.0), ("heading_tolerance", math.nan), ("heading_period", -1.0),
        ("heading_period", math.nan), ("hold", 0), ("periods_per_step", 0), ("periods_per_step", 0.5),
        ("amplitude", 2.0 * MAX), ("latency", -1), ("surface", None), ("part", Part.disc(0.02, friction=0.0)),
    )),
    (time_bound, {"surface": Surface(horizontal_amplitude=1e-4)}, "part"),
    (push_bound, {"pushers": []}, "pushers"),
    (push_bound, {"pushers": [DISC, "disc"]}, r"pushers\[1\]"),
    (flow_bound, {"parts": [], "kind": [], "displacement": []}, "parts"),
    (flow_bound, {"surface": "prototype"}, "surface"),
    (flow_bound, {"parts": [3]}, r"parts\[0\]"),
    (flow_bound, {"periods_per_step": 0}, "periods_per_step"),
    (flow_bound, {"headway": -1}, "headway"),
    (flow_bound, {"kind": [0, 1]}, "kind"),
    (SeveralBound, {"bounds": []}, "bounds"),
    (SeveralBound, {"bounds": [time_bound(), 3]}, r"bounds\[1\]"),
    (lambda **poses: time_bound().steps(**poses), {"start": [[0.3, 0.1, 0.4]], "goal": [[0.1, 0.2]]}, "goal"),
    (lambda **poses: time_bound().steps(**poses), {"start": [[math.nan, 0.0, 0.0]], "goal": [[0.3, 0.1, 0.4]]}, "start"),
]  # fmt: skip


@pytest.mark.parametrize("make, arguments, named", REFUSED)
def test_bad_arguments(make, arguments, named):
    with pytest.raises(ValueError, match=named):
        make(**arguments)
