"""The simulator: shapes, independence of worlds, state, falling, refusals, divergence."""

import math

import numpy as np
import pytest
from shapely.geometry import Point, Polygon, box

from tests.simulation.helpers import same, snapshot
from vibgym import Part, Simulator, Surface
from vibgym.physics.core.records import State
from vibgym.simulation.threads import Blocks

BLOCK = Part.rectangle(0.050, 0.035, friction=0.6)
C_SHAPE = Part.polygon(
    np.array([[0, 0], [80, 0], [80, 20], [20, 20], [20, 60], [80, 60], [80, 80], [0, 80]]) * 1e-3, friction=0.6
)
SURFACE = Surface()
WORLDS = 253  # not a multiple of the block size; enough for two threads


def scene(seed=0, worlds=WORLDS):
    rng = np.random.default_rng(seed)
    pose = rng.uniform([0.05, 0.03, -3], [0.78, 0.18, 3], (worlds, 3))[:, None]
    velocity = rng.uniform([-0.1, -0.1, -8], [0.1, 0.1, 8], (worlds, 3))[:, None]
    shape = (worlds, 8, 32)
    return pose, velocity, rng.uniform(0, SURFACE.max_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)


def run(part, given, periods=12, worlds=None, **keywords):
    pose, velocity, amplitude, phase = given
    simulator = Simulator(SURFACE, part, worlds=len(pose) if worlds is None else worlds, **keywords)
    simulator.reset(pose, velocity)
    simulator.advance(amplitude, phase, periods)
    return simulator


# -- shapes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("worlds", [1, 3, 40])
def test_shapes(worlds):
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


def test_properties_are_copies():
    simulator = run(BLOCK, scene())
    before = snapshot(simulator)
    for name in ("pose", "velocity", "mean_velocity", "fallen", "sticking", "doubtful", "diverged"):
        getattr(simulator, name)[:] = 7
    state = simulator.get_state()
    state["pose"][:] = 7
    assert same(before, snapshot(simulator))


def test_mean_velocity_is_that_of_the_last_period():
    given = scene(1)
    simulator = run(BLOCK, given, 4)
    before = simulator.pose
    simulator.advance(given[2], given[3])
    moving = ~simulator.fallen[:, 0]
    assert moving.sum() > 20
    expected = (simulator.pose - before) / SURFACE.period
    assert np.allclose(simulator.mean_velocity[moving], expected[moving], rtol=0, atol=1e-12)
    longer = run(BLOCK, given, 5)
    assert same(snapshot(longer), snapshot(simulator))


@pytest.mark.parametrize("amplitude, phase", [
    (1e-4, 0.3),
    (np.full((32,), 1e-4), np.full((8, 1), 0.3)),
    (np.full((WORLDS, 1, 1), 1e-4), np.full((1, 8, 32), 0.3)),
    (np.full((8, 32), 1e-4)[::-1, ::-1], np.asfortranarray(np.full((8, 32), 0.3))),
])  # fmt: skip
def test_broadcasting(amplitude, phase):
    pose, velocity = [0.4, 0.1, 0.2], [0.01, 0.0, 1.0]
    full = (WORLDS, 8, 32)
    expected = run(
        BLOCK,
        (np.tile(pose, (WORLDS, 1, 1)), np.tile(velocity, (WORLDS, 1, 1)), np.full(full, 1e-4), np.full(full, 0.3)),
    )
    got = run(BLOCK, (pose, velocity, amplitude, phase), worlds=WORLDS)
    assert same(snapshot(expected), snapshot(got))
    assert np.ptp(got.pose, axis=0).max() == 0.0


# -- worlds are independent --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", [BLOCK, C_SHAPE, Part.disc(0.02, friction=0.6)], ids=["block", "C", "disc"])
def test_bit_for_bit_alone_or_together_in_any_order_on_any_threads(part):
    given = scene(2)
    together = run(part, given, threads=1)
    expected = snapshot(together)
    assert np.abs(expected["pose"] - given[0]).max() > 0.01
    in_threads = run(part, given, threads=2)
    assert len(in_threads.blocks.edges) > 1 and same(expected, snapshot(in_threads))
    assert same(expected, snapshot(run(part, given, threads=7)))
    assert same(expected, snapshot(run(part, given)))
    order = np.random.default_rng(0).permutation(WORLDS)
    permuted = snapshot(run(part, tuple(values[order] for values in given), threads=2))
    for name in State._fields:
        assert np.array_equal(permuted[name], expected[name][order])
    for k in range(0, WORLDS, 16):
        alone = snapshot(run(part, tuple(values[k : k + 1] for values in given)))
        for name in State._fields:
            assert np.array_equal(alone[name][0], expected[name][k])


def test_a_bad_neighbour_changes_nothing():
    """A diverging world and one with a falling part do not change the others."""
    given = scene(3)
    expected = snapshot(run(BLOCK, given))
    spoiled = tuple(values.copy() for values in given)
    spoiled[1][4], spoiled[1][30] = [0, 0, 1.7e308], [1e300, 0, 0]
    simulator = run(BLOCK, spoiled, threads=2)
    assert simulator.diverged[4] and simulator.fallen[30, 0]
    others = np.delete(np.arange(WORLDS), [4, 30])
    for name in State._fields:
        assert np.array_equal(snapshot(simulator)[name][others], expected[name][others])


# -- falling -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pose, velocity", [
    ([0.01, 0.1, 0], [-2, 0, 0]),
    ([0.825, 0.1, 0], [2, 0, 0]),
    ([0.4, 0.005, 0], [0, -2, 0]),
    ([0.4, 0.2, 0], [0, 2, 0]),
])  # fmt: skip
def test_a_part_over_the_border_falls_and_stays(pose, velocity):
    simulator = Simulator(SURFACE, BLOCK)
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
    simulator = Simulator(SURFACE, part)
    simulator.reset(pose, [*SURFACE.idle_velocity(part.friction), 0.0])
    simulator.advance(0.0, 0.0)
    assert simulator.fallen[0, 0] == falls


# -- refusals ----------------------------------------------------------------------------------------------------------

NAN, INF = math.nan, math.inf
JUNK = ["text", object(), [[1, 2], [3]], 1j]
BAD = {
    ("reset", "pose"): [
        [NAN, 0, 0], [0, INF, 0], [0.1, 0.1], np.zeros((3, 1, 3)), None, *JUNK, [-1e-9, 0.1, 0], [0.1, 0.2081, 0],
    ],
    ("reset", "velocity"): [[NAN, 0, 0], [0, 0, -INF], [0.1, 0.1], np.zeros((3, 1, 3)), *JUNK],
    ("advance", "amplitude"): [NAN, INF, -1e-9, SURFACE.max_amplitude * 1.001, np.zeros(31), np.zeros((3, 8, 32)), None, *JUNK],
    ("advance", "phase"): [NAN, INF, np.zeros(31), np.zeros((32, 8)), np.zeros((3, 8, 32)), None, *JUNK],
    ("advance", "periods"): [0, -1, 1.5, NAN, "1", None, True],
    ("set_state", "state"): [None, {}, 3, "pose"],
}  # fmt: skip
BAD_CALLS = [(*call, value) for call, values in BAD.items() for value in values]
GOOD = {
    "reset": {"pose": [0.1, 0.1, 0.0], "velocity": [0, 0, 0]},
    "advance": {"amplitude": 0.0, "phase": 0.0, "periods": 1},
    "set_state": {},
}


@pytest.mark.parametrize("method, argument, value", BAD_CALLS)
def test_a_refused_call_names_the_argument_and_changes_nothing(method, argument, value):
    simulator = run(BLOCK, scene(5, 2), 3)
    before = snapshot(simulator)
    with pytest.raises(ValueError, match=rf"{argument}"):
        getattr(simulator, method)(**{**GOOD[method], argument: value})
    assert same(before, snapshot(simulator))


@pytest.mark.parametrize("name", [*State._fields, "periods"])
def test_bad_states_are_refused(name):
    simulator = run(BLOCK, scene(5, 2), 3)
    before = snapshot(simulator)
    good = run(BLOCK, scene(6, 2), 5).get_state()
    bad = [np.zeros((7, 7)), "text", None, [[1], [1, 2]], -1.0]
    if name in ("pose", "velocity", "mean_velocity"):
        bad += [np.full((2, 1, 3), NAN), np.full((2, 1, 3), INF)]
    for value in bad:
        with pytest.raises(ValueError, match=rf"state\['{name}'\]"):
            simulator.set_state({**good, name: value})
    with pytest.raises(ValueError, match="state"):
        simulator.set_state({key: value for key, value in good.items() if key != name})
    with pytest.raises(ValueError, match="state"):
        simulator.set_state({**good, "more": 1})
    assert same(before, snapshot(simulator))


@pytest.mark.parametrize(
    "argument, value",
    [("surface", v) for v in [None, "prototype", BLOCK]]
    + [("parts", v) for v in [None, "block", 3, [], [BLOCK, None], [SURFACE], {BLOCK: 1}]]
    + [("worlds", v) for v in [0, -1, 1.0, "1", None, True, NAN]]
    + [("model", v) for v in ["", "Planar", "tilted", None, 3, ["planar"]]]
    + [("threads", v) for v in [0, -1, 1.0, "2", True]],
)
def test_bad_construction_is_refused(argument, value):
    with pytest.raises(ValueError, match=rf"{argument}"):
        Simulator(**{"surface": SURFACE, "parts": BLOCK, argument: value})


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


def test_a_diverged_world_is_flagged_and_keeps_its_last_finite_state():
    simulator = Simulator(SURFACE, BLOCK)
    simulator.reset([0.4, 0.1, 1.7e308], [0, 0, 1.7e308])
    for _ in range(3):
        simulator.advance(0.0, 0.0)
        pose = simulator.pose
        if simulator.diverged[0]:
            break
    assert simulator.diverged[0] and not simulator.fallen.any() and np.isfinite(pose).all()
    simulator.advance(0.0, 0.0, 3)
    assert np.array_equal(simulator.pose, pose) and (simulator.mean_velocity == 0).all()
    simulator.reset([0.4, 0.1, 0.0])
    simulator.advance(0.0, 0.0)
    assert not simulator.diverged.any()


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
