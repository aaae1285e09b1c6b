"""The bound on time to goal: closed forms, symmetries, and attempts to beat it in the planar simulator."""

import math

import numpy as np
import pytest

from tests.policies.helpers import ALUMINIUM, SURFACE
from vibgym import Simulator
from vibgym.bounds import TimeBound
from vibgym.bounds.programme import turns
from vibgym.bounds.tables import (
    PRICE,
    SHARES,
    WEIGHTS,
    Hold,
    displacement_reach,
    displacement_values,
    sample,
    scratch_for,
    turn_values,
    turner_for,
)
from vibgym.physics.core.drive import cartesian_drive, polar_drive

MAX = SURFACE.max_amplitude
HOLD = Hold(10, 1)
ALIGN = {
    "position_tolerance": 0.002, "heading_tolerance": math.radians(3.0), "heading_period": math.pi
}  # fmt: skip
START = np.array([[0.3, 0.1, 0.4]])


def bound(**settings):
    return TimeBound(SURFACE, ALUMINIUM, **{**ALIGN, **settings})


def test_every_period_of_a_long_way_adds_the_top_speed():
    # 0.30438 m/s: the steady velocity at full amplitude, known from an independent integration (docs/accuracy.md).
    pace = displacement_reach(SURFACE, 0.6, MAX, 0.005, HOLD).pace / SURFACE.period
    assert 0.30438 * 0.9995 <= pace <= 0.30438 * 1.002


def test_at_the_goal_only_the_hold_counts():
    inside = START + [[0.001, 0.001, math.radians(2.9)]]
    for stride, steps in ((1, 10), (4, 3), (10, 2), (50, 2)):
        assert bound(periods_per_step=stride).steps(START, inside).tolist() == [steps]
    assert bound(latency=3).steps(START, inside).tolist() == [10]  # nothing has to move


def test_latency_and_longer_steps():
    far = START + [[0.3, 0.05, 0.5]]
    plain, late, long = (bound(**changes) for changes in ({}, {"latency": 2}, {"periods_per_step": 4}))
    assert late.steps(START, far) == plain.steps(START, far) + 2
    arrival = plain.steps(START, far)[0] - 9
    # The last of three samples is eight periods after the first, which is no earlier than with samples at every period:
    # with fewer samples the part may be faster at the first.
    assert long.steps(START, far)[0] <= -(-arrival // 4) + 2
    assert long.seconds(START, far)[0] >= 0.3 / 0.31 - 0.02


def test_bound_is_monotone_in_distance_and_amplitude():
    way, turn = np.linspace(0.0, 0.7, 200), np.linspace(0.0, 0.5 * math.pi, 200)
    by_way = bound().steps(START, START + np.column_stack([way, 0.0 * way, 0.0 * way]))
    by_turn = bound().steps(START, START + np.column_stack([0.0 * turn, 0.0 * turn, turn]))
    both = bound().steps(START, START + np.column_stack([way, 0.0 * way, turn]))
    assert (np.diff(by_way) >= 0).all() and (np.diff(by_turn) >= 0).all()
    np.testing.assert_array_equal(both, np.maximum(by_way, by_turn))
    weak = bound(amplitude=0.5 * MAX).steps(START, START + np.column_stack([way, 0.0 * way, 0.0 * way]))
    assert (weak >= by_way).all() and (weak > by_way).mean() > 0.9


def test_headings_are_wrapped_or_not():
    goal = START + [[0.0, 0.0, math.radians(170.0)]]
    assert bound().steps(START, goal) == bound().steps(START, START + [[0.0, 0.0, math.radians(-10.0)]])
    assert bound(heading_period=0.0).steps(START, goal) > bound().steps(START, goal)
    for free in ({"heading_tolerance": math.inf}, {"heading_period": 1e-9}):
        assert bound(**free).steps(START, goal) == 10


def test_mirror_symmetric_parts_have_symmetric_bounds():
    turn = np.linspace(-6.0, 6.0, 25)
    start = np.tile([0.3, 0.1, 0.0], (25, 1))
    steps = bound(heading_period=0.0).steps(start, start + np.column_stack([0.0 * turn, 0.0 * turn, turn]))
    np.testing.assert_array_equal(steps, steps[::-1])


def test_starts_are_independent():
    random = np.random.default_rng(2)
    start, goal = random.uniform(0.05, 0.15, (2, 30, 3))
    steps = bound().steps(start, goal)
    assert steps.tolist() == [int(bound().steps(a, b)[0]) for a, b in zip(start, goal, strict=True)]


@pytest.mark.parametrize("direction", [0.3, 2.4])
def test_random_search_does_not_exceed_the_bound(direction):
    # Equal elements under one part: random changes of six periods' phases are kept where they help.
    random, worlds, periods, tolerance = np.random.default_rng(1), 160, 6, 0.005
    axes = np.array([[math.cos(direction), math.sin(direction)], [-math.sin(direction), math.cos(direction)]])
    values = displacement_values(SURFACE, ALUMINIUM.friction, MAX, tolerance, HOLD, direction)
    idle = SURFACE.idle_velocity(ALUMINIUM.friction)
    simulator = Simulator(SURFACE, ALUMINIUM, worlds=worlds)

    def way(phases):
        """Return the displacement at the start of the hold, minus the price of excess speed."""
        simulator.reset([0.416, 0.104, 0.0], [*idle, 0.0])
        for phase in phases:
            simulator.advance_drive(polar_drive(np.full((worlds, 8, 32), MAX), phase, SURFACE.angular_frequency), 1)
        speed = (simulator.velocity[:, 0, :2] - idle) @ axes.T
        return (simulator.pose[:, 0, :2] - [0.416, 0.104]) @ axes[0] + values.at(0, speed)

    phases = random.uniform(-math.pi, math.pi, (periods, worlds, 1, 1)) * np.ones((1, 1, 8, 32))
    got = way(phases)
    for k in range(150):
        change = (1.0, 0.3, 0.1)[k % 3] * random.standard_normal((periods, worlds, 1, 1))
        other = phases + change * (random.random((periods, worlds, 1, 1)) < 0.5)
        now = way(other)
        better = now > got
        got[better], phases[:, better] = now[better], other[:, better]
    table = displacement_reach(SURFACE, ALUMINIUM.friction, MAX, tolerance, HOLD)
    assert table.periods(np.array([direction]), got.max(keepdims=True))[0] == periods
    assert table.periods(np.array([direction]), 1.03 * got.max(keepdims=True))[0] == periods + 1


def test_the_programme_s_own_policy_turns_nearly_as_far_in_the_simulator():
    # The policy takes the best control of the table for the part's pose in each period.
    random, worlds, periods = np.random.default_rng(3), 10, 6
    points = sample(ALUMINIUM, SURFACE.element_size)
    known = SURFACE, ALUMINIUM.friction, ALUMINIUM.gyration, True, points.tobytes()
    values = turn_values(*known, MAX, math.radians(2.0), HOLD)
    turner = turner_for(SURFACE, ALUMINIUM.friction, ALUMINIUM.gyration, MAX, points)
    scratch, side = scratch_for(turner), 2 * turner.reach + 1
    pose = np.column_stack([random.uniform(0.40, 0.426, worlds), random.uniform(0.09, 0.116, worlds)])
    pose = np.column_stack([pose, random.uniform(0.0, math.pi / 2, worlds)])
    simulator = Simulator(SURFACE, ALUMINIUM, worlds=worlds)
    simulator.reset(pose[:, None], [*turner.idle, 0.0])
    for k in range(periods):
        c, s = np.zeros((2, worlds, 8, 32))
        for world, (here, fast) in enumerate(zip(simulator.pose[:, 0], simulator.velocity[:, 0], strict=True)):
            cell = np.floor(here[:2] / SURFACE.element_size).astype(int)
            most = -math.inf
            for weight, share in zip(WEIGHTS, SHARES, strict=True):
                gain, after = np.empty((2, 1, 1, 1))
                place = (here[:2] - SURFACE.element_size * cell)[None]
                turns(turner, scratch, place, weight[None], np.array([share]), here[2:], fast[2:], gain, after)
                worth = (
                    gain[0, 0, 0] + values.at(periods - k - 1, np.array([[here[2] + gain[0, 0, 0], after[0, 0, 0]]]))[0]
                )
                if worth > most:
                    most, chosen = worth, share * np.array([scratch.c, scratch.s]).reshape(2, side, side)
            around = [(cell[j] - turner.reach + np.arange(side)) for j in (1, 0)]
            there = [(indices >= 0) & (indices < most_of) for indices, most_of in zip(around, (8, 32), strict=True)]
            where = np.ix_(around[0][there[0]], around[1][there[1]])
            c[world][where], s[world][where] = chosen[:, there[0]][:, :, there[1]]
        simulator.advance_drive(cartesian_drive(c, s), 1)
    end = np.column_stack([simulator.pose[:, 0, 2], simulator.velocity[:, 0, 2]])
    turned = end[:, 0] - pose[:, 2] + values.at(0, end)
    limit = values.at(periods, np.column_stack([pose[:, 2], np.zeros(worlds)]))
    assert (turned <= limit).all() and np.median(turned / limit) > 0.85
    assert PRICE > 1.0  # else excess speed would have paid off
