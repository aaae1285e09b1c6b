"""The simulator: shapes, means, broadcasting, falling, numbers that stay finite, blocks of worlds."""

import math

import numpy as np
import pytest
from shapely.geometry import Point, Polygon, box

from tests.simulation.helpers import C_SHAPE, SURFACE, random_fields, same, simulated, snapshot
from vibgym import Part, Simulator
from vibgym.scene.hulls import gaps_between
from vibgym.simulation.threads import Blocks

BLOCK = Part.rectangle(0.050, 0.035, friction=0.6)
WORLDS = 40


# -- shapes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("worlds", [1, 40])
def test_shapes_and_copies(worlds):
    simulator = Simulator(SURFACE, [BLOCK], worlds=worlds)
    for _ in range(2):
        for name in ("pose", "velocity", "mean_velocity"):
            value = getattr(simulator, name)
            assert value.shape == (worlds, 1, 3) and value.dtype == np.float64
        for name in ("fallen", "sticking"):
            value = getattr(simulator, name)
            assert value.shape == (worlds, 1) and value.dtype == bool
        assert simulator.diverged.shape == (worlds,) and simulator.diverged.dtype == bool
        simulator.reset([0.1, 0.1, 0.5])
        assert simulator.time == 0.0 and (simulator.pose == [0.1, 0.1, 0.5]).all() and (simulator.velocity == 0).all()
        simulator.advance(1e-4, 0.5, periods=3)
        assert simulator.time == pytest.approx(0.12)
    before = snapshot(simulator)
    for name in ("pose", "velocity", "mean_velocity", "fallen", "sticking", "doubtful", "diverged", "patches", "mass"):
        getattr(simulator, name)[:] = 7
    simulator.get_state()["pose"][:] = 7
    assert same(before, snapshot(simulator))


@pytest.mark.parametrize("count", [1, 2, 7])
def test_parts_rest_apart_before_the_first_reset(count):
    simulator = Simulator(SURFACE, [BLOCK] * count, worlds=2)
    x, y, heading = simulator.pose.transpose(2, 0, 1)
    assert (x > 0.03).all() and (x < SURFACE.width - 0.03).all() and not heading.any() and not simulator.velocity.any()
    assert (
        (y > 0.02).all()
        and (y < SURFACE.depth - 0.02).all()
        and gaps_between(simulator.parts, simulator.pose).min() > 0.0
    )
    simulator.advance(0.0, 0.0)
    assert not simulator.fallen.any()


def test_mean_velocity_is_that_of_the_last_period():
    fields = random_fields(SURFACE, WORLDS, 1)
    simulator = simulated(SURFACE, BLOCK, [0.4, 0.1, 0.5], [0.1, 0.0, 3.0], *fields, 4, worlds=WORLDS)
    before = simulator.pose
    simulator.advance(*fields)
    assert not simulator.fallen.any()
    assert simulator.mean_velocity == pytest.approx((simulator.pose - before) / SURFACE.period, abs=1e-12)


@pytest.mark.parametrize("amplitude, phase", [
    (1e-4, 0.3),
    (np.full((32,), 1e-4), np.full((8, 1), 0.3)),
    (np.full((WORLDS, 1, 1), 1e-4), np.full((1, 8, 32), 0.3)),
    (np.full((8, 32), 1e-4)[::-1, ::-1], np.asfortranarray(np.full((8, 32), 0.3))),
])  # fmt: skip
def test_broadcasting(amplitude, phase):
    pose, velocity, full = [0.4, 0.1, 0.2], [0.01, 0.0, 1.0], (WORLDS, 8, 32)
    results = []
    for arguments in (
        (pose, velocity, amplitude, phase),
        (np.tile(pose, (WORLDS, 1, 1)), np.tile(velocity, (WORLDS, 1, 1)), np.full(full, 1e-4), np.full(full, 0.3)),
    ):
        results.append(snapshot(simulated(SURFACE, BLOCK, *arguments, 3, worlds=WORLDS)))
    assert same(*results) and np.ptp(results[0]["pose"], axis=0).max() == 0.0


# -- falling -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pose, velocity", [
    ([0.01, 0.1, 0], [-2, 0, 0]),
    ([0.825, 0.1, 0], [2, 0, 0]),
    ([0.4, 0.005, 0], [0, -2, 0]),
    ([0.4, 0.2, 0], [0, 2, 0]),
])  # fmt: skip
@pytest.mark.parametrize("model", ["planar", "averaged"])
def test_a_part_over_the_border_falls_and_stays(model, pose, velocity):
    simulator = Simulator(SURFACE, BLOCK, model=model)
    simulator.reset(pose, velocity)
    assert not simulator.fallen.any()
    simulator.advance(0.0, 0.0)
    assert simulator.fallen.all() and (simulator.velocity == 0).all() and not simulator.diverged.any()
    there = simulator.pose
    # detected half a step ahead of the border, or up to one step of 6.7 ms at 2 m/s before it
    axis = 0 if velocity[0] else 1
    border = np.array([SURFACE.width, SURFACE.depth])[axis] if velocity[axis] > 0 else 0.0
    assert abs(there[0, 0, axis] - border) < 2 * SURFACE.period / 6
    simulator.advance(SURFACE.max_amplitude, 1.0, 5)
    assert np.array_equal(simulator.pose, there) and (simulator.mean_velocity == 0).all()
    assert simulator.fallen.all()
    simulator.reset([0.4, 0.1, 0])
    assert not simulator.fallen.any()
    simulator.advance(0.0, 0.0)
    assert not simulator.fallen.any()


# Both centroids are outside the material: in the C's gap, in the hook's notch.
HOOK = Part.polygon([[0, 0], [0.1, 0], [0.1, 0.006], [0.006, 0.006], [0.006, 0.1], [0, 0.1]], friction=0.6)
X, Y = SURFACE.width - 0.001, SURFACE.depth - 0.001


@pytest.mark.parametrize("part, pose, falls", [
    (C_SHAPE, [0.001, 0.1, 0.0], False),  # the back beyond the border; both arms hold it
    (C_SHAPE, [X, 0.1, 0.0], False),  # the arms' tips beyond it; the back and the stumps hold it
    (C_SHAPE, [0.4, 0.001, 0.0], True),  # half the back and one arm are left: the hull's edge is 5 mm from the centre
    (C_SHAPE, [0.4, Y, 0.0], True),
    (C_SHAPE, [0.4, 0.001, math.pi / 2], False),
    (C_SHAPE, [X, 0.1, 1.0], False),
    (HOOK, [0.001, 0.001, math.pi], True),  # on a corner of the surface: the middle of the hook is left
    (HOOK, [X, Y, 0.0], True),
    (HOOK, [0.001, 0.001, 0.0], True),  # nothing is left
    (HOOK, [0.4, 0.001, 0.0], True),
    (HOOK, [0.4, 0.001, 1.25 * math.pi], False),  # the corner up, both arms' stumps below
    (HOOK, [0.4, 0.1, 0.7], False),
])  # fmt: skip
def test_a_non_convex_part_falls_when_its_centre_leaves_the_hull_of_what_is_supported(part, pose, falls):
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    on = Polygon(part.outline @ np.array([[c, s], [-s, c]]) + (x, y)).intersection(
        box(0, 0, SURFACE.width, SURFACE.depth)
    )
    hull = on.convex_hull
    assert hull.covers(Point(x, y)) != falls
    # the idle circle has a radius of 0.24 mm: too small to move the centre over the hull's edge
    assert on.is_empty or hull.exterior.distance(Point(x, y)) > 0.0005
    simulator = simulated(SURFACE, part, pose, [*SURFACE.idle_velocity(part.friction), 0.0])
    assert simulator.fallen[0, 0] == falls


# -- divergence --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("huge", [1e10, 1e200, 1.7e308])
@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("part", [BLOCK, C_SHAPE], ids=["block", "C"])
@pytest.mark.parametrize("heading", [0.0, 1.7e308])
def test_numbers_shown_are_always_finite(part, huge, axis, heading):
    simulator = Simulator(SURFACE, part)
    velocity = np.zeros(3)
    velocity[axis] = huge
    simulator.reset([0.4, 0.1, heading], velocity)
    for _ in range(60):
        simulator.advance(1e-4, 0.3)
        for name in ("pose", "velocity", "mean_velocity"):
            assert np.isfinite(getattr(simulator, name)).all(), name
    if axis < 2:  # over the border immediately, unless the heading overflows first
        assert (simulator.fallen[:, 0] | simulator.diverged).all()
        assert heading or not simulator.diverged.any()


def test_every_block_is_run_once_and_its_errors_are_raised():
    blocks = Blocks(4096, 4, cost=100.0)
    for _ in range(200):
        done = []
        blocks.run(done.append)
        assert sorted(done) == list(range(len(blocks.edges)))

    def fail(k):
        if k == 2:
            raise IndexError("of the work, not of the blocks")

    with pytest.raises(IndexError, match="of the work"):
        blocks.run(fail)
