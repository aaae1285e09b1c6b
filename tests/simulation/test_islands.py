"""Islands: the motion of a part depends only on parts that it may touch, independent of order."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.simulation.helpers import L_SHAPE, STILL, kinetic_energy, random_fields, simulated
from vibgym import Part, Simulator, Surface
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference
from vibgym.physics.contacts.broad_phase import near_pairs, new_circles, pair_capacity
from vibgym.scene.hulls import WALLS

SURFACE = Surface(24, 40)
KINDS = [
    Part.rectangle(0.05, 0.04, friction=0.64, height=0.004, name="steel"),
    Part.rectangle(0.05, 0.035, friction=0.58, mass=0.0945, contact_friction=0.7, name="aluminium"),
    Part.disc(0.02, friction=0.6, name="disc"),
    Part.polygon(L_SHAPE.outline, friction=0.6, contact_friction=0.1),
    # These require more steps, finer ones, smaller overlaps, and more iterations of the solver.
    Part.disc(0.005, friction=0.9, mass=0.5, name="small and heavy"),
    Part.rectangle(0.03, 0.0004, friction=0.3, mass=0.01, name="thin"),
]
ELASTIC = Part.disc(0.02, friction=0.0, restitution=1.0, contact_friction=0.0)


def state_of(simulator, parts):
    """Return the state of some parts of the first world, as bytes."""
    names = ("pose", "velocity", "mean_velocity", "fallen", "sticking")
    return [np.ascontiguousarray(getattr(simulator, name)[0, parts]).tobytes() for name in names]


def heap(rng, count, corner):
    """Return kinds, poses and velocities (count, 3) of close, approaching parts."""
    kinds = rng.integers(0, len(KINDS), count)
    k = np.arange(count)
    pose = np.column_stack([0.065 * (k % 3), 0.065 * (k // 3), np.zeros(count)]) + [*corner, 0.0]
    pose[:, :2] += rng.uniform(-0.001, 0.001, (count, 2))
    pose[:, 2] = rng.choice([0.0, 0.5 * math.pi, math.pi], count)
    return kinds, pose, rng.uniform(-1, 1, (count, 3)) * [0.1, 0.1, 2.0]


def advanced(kinds, pose, velocity, periods, fields, walls=WALLS):
    return simulated(SURFACE, [KINDS[k] for k in kinds], pose, velocity, *fields, periods, walls=walls)


# -- bits --------------------------------------------------------------------------------------------------------------


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_parts_does_not_matter(seed):
    """One heap, with the parts in another order."""
    rng = np.random.default_rng(seed)
    kinds, pose, velocity = heap(rng, 9, (0.034, 0.034))
    order, fields = rng.permutation(9), random_fields(SURFACE, 1, seed=4)
    one = advanced(kinds, pose, velocity, 4, fields)
    other = advanced(kinds[order], pose[order], velocity[order], 4, fields)
    assert one.statistics == other.statistics
    assert one.deepest_overlap == other.deepest_overlap
    assert state_of(one, order) == state_of(other, np.arange(9))


def test_the_same_bits_among_a_thousand():
    """Five parts in a gap of a crowd on a large table, with one or two threads."""
    surface = Surface(115, 115)
    rng = np.random.default_rng(2)
    k = np.arange(1024)
    crowd = np.column_stack([0.1 + 0.088 * (k % 32), 0.1 + 0.088 * (k // 32), rng.uniform(-3, 3, 1024)])
    crowd = crowd[np.hypot(*(crowd[:, :2] - [1.5, 1.5]).T) > 0.25]
    block = KINDS[1]
    pose = np.array([[1.47, 1.5, 0.0], [1.53, 1.5, 0.5], [1.5, 1.56, 0.0], [1.49, 1.45, 0.0], [1.58, 1.56, 0.0]])
    fields = (rng.uniform(0.0, 3e-4, (115, 115)), rng.uniform(-math.pi, math.pi, (115, 115)))

    def run(more, first):
        everything = np.concatenate([more[:first], pose, more[first:]])
        return simulated(surface, [block] * len(everything), everything, None, *fields, 12, walls=WALLS)

    alone, among = run(crowd[:0], 0), run(crowd, 500)
    assert state_of(among, np.arange(500, 505)) == state_of(alone, np.arange(5))
    assert alone.statistics["contact_steps"] > 0
    assert among.statistics["contact_steps"] > alone.statistics["contact_steps"]
    assert among.deepest_overlap < 0.3e-3


def test_counts_are_those_of_islands():
    """Two independent pairs: the sum of the solver calls of each alone, in the periods of one."""
    pose = np.array([[0.1, 0.1, 0.0], [0.151, 0.1, 0.0], [0.7, 0.4, 0.0], [0.751, 0.4, 0.0]])
    velocity = np.zeros((4, 3))
    velocity[1::2, 0] = -0.1
    fields = random_fields(SURFACE, 1, seed=5)
    kinds = np.zeros(4, np.int64)
    both = advanced(kinds, pose, velocity, 3, fields, []).statistics
    alone = [advanced(kinds[k : k + 2], pose[k : k + 2], velocity[k : k + 2], 3, fields, []).statistics for k in (0, 2)]
    assert both["contact_steps"] == sum(one["contact_steps"] for one in alone)
    assert both["contact"] == max(one["contact"] for one in alone)


# -- islands that meet within a period -------------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", [0.5e-3, 2e-3, 5e-3])
@pytest.mark.parametrize("pairs", [1, 3, 6])
def test_an_impact_propagates_through_separate_pairs(gap, pairs):
    """A row of touching pairs, each an island: within one period the impact passes through all, and the last disc leaves."""
    x = [0.1]
    for k in range(2 * pairs):
        x.append(x[-1] + (0.06 if k == 0 else 0.04 + (1e-6 if k % 2 else gap)))
    simulator = Simulator(STILL, [ELASTIC] * len(x))
    velocity = np.zeros((len(x), 3))
    velocity[0, 0] = 3.0
    simulator.reset(np.column_stack([x, np.full(len(x), 0.5), np.zeros(len(x))]), velocity)
    simulator.advance(0.0, 0.0)
    assert simulator.velocity[0, :, 0] == pytest.approx([0.0] * (len(x) - 1) + [3.0], abs=1e-12)
    way = 3.0 * STILL.period - 0.02 - gap * (pairs - 1)
    assert simulator.pose[0, -1, 0] == pytest.approx(x[-1] + way, abs=1e-5 * len(x))
    assert simulator.deepest_overlap < 1e-5


def test_a_table_smaller_than_a_part_can_reach():
    """One element, two parts, walls all around, and speeds at which each could cross it many times in a period."""
    surface = Surface(1, 1, 0.1, 0.0)
    simulator = Simulator(surface, [ELASTIC, ELASTIC], walls=WALLS, worlds=20)
    rng = np.random.default_rng(1)
    simulator.reset([[0.025, 0.025, 0.0], [0.075, 0.075, 0.0]], rng.uniform(-8, 8, (20, 2, 3)))
    energy = kinetic_energy(simulator)
    simulator.advance(0.0, 0.0, 3)
    assert not simulator.fallen.any() and simulator.deepest_overlap < 60e-6
    assert np.abs(kinetic_energy(simulator) / energy - 1.0).max() < 1e-3


# -- near pairs ------------------------------------------------------------------------------------------------------------


@jit
def found_pairs(table, walls, circles, count, pairs):
    """Return the near pairs."""
    return near_pairs(reference(table), walls, reference(circles), count, pairs)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([0.0, 1.0, 4.0]), st.integers(0, 15))
def test_near_pairs_are_complete(seed, count, spread, walls):
    """Compare with all pairs: circles of equal or very different sizes, some of them huge, at any position."""
    rng = np.random.default_rng(seed)
    circles = new_circles(count)
    circles.part[:] = np.arange(count)
    circles.x[:], circles.y[:] = rng.uniform(-0.2, 1.2, (2, count))
    circles.reach[:] = 0.02 * 10.0 ** rng.uniform(0.0, spread, count)
    circles.reach[rng.random(count) < 0.05 * (spread > 1.0)] = math.inf
    circles.x[rng.random(count) < 0.1] = 0.5
    pairs = np.empty((pair_capacity(count), 2), np.int64)
    n = found_pairs(STILL.table(()), walls, circles, count, pairs)
    near = [tuple(sorted(pair)) if pair[1] >= 0 else tuple(pair) for pair in pairs[:n].tolist()]
    place = np.column_stack([circles.x, circles.y])
    expected = {
        (i, j)
        for i in range(count)
        for j in range(i + 1, count)
        if ((place[i] - place[j]) ** 2).sum() <= (circles.reach[i] + circles.reach[j]) ** 2
    }
    for i, (x, y) in enumerate(place):
        away = (x, 1.0 - x, y, 1.0 - y)
        expected |= {(i, -1 - k) for k in range(4) if walls >> k & 1 and away[k] <= circles.reach[i]}
    assert len(near) == len(set(near)) and set(near) == expected
