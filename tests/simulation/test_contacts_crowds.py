"""Many parts in a world: independence of distant parts, snapshots, walls, rest and push on the vibrating table."""

import copy
import math
import pickle

import numpy as np
import pytest

from tests.simulation.helpers import random_fields, same, snapshot
from vibgym import Part, Simulator, Surface
from vibgym.fields import uniform
from vibgym.scene.hulls import WALLS, gaps_between

SURFACE = Surface()
STEEL = Part.rectangle(0.05, 0.04, friction=0.64, height=0.004, name="steel")
ALUMINIUM = Part.rectangle(0.05, 0.035, friction=0.58, height=0.02, mass=0.0945, name="aluminium")
DISC = Part.disc(0.02, friction=0.6, name="disc")
L_SHAPE = Part.polygon(
    np.array([(0, 0), (50, 0), (50, 20), (20, 20), (20, 50), (0, 50)]) * 1e-3, friction=0.6, name="L"
)
SMALL = Part.disc(0.005, friction=0.6, name="small")
MIXED = [STEEL, ALUMINIUM, DISC, L_SHAPE]
CORNER = uniform(math.radians(225)).drive(SURFACE)


def grid(parts):
    """Poses of up to 33 parts without contacts."""
    columns = math.ceil(len(parts) / 3)
    k = np.arange(len(parts))
    return np.column_stack([0.05 + (k % columns) * 0.072, 0.035 + (k // columns) * 0.068, np.zeros(len(parts))])


def pushed(parts, worlds=1, periods=0, **keywords):
    """Return adjacent parts under random fields, with contacts in most worlds."""
    simulator = Simulator(SURFACE, parts, worlds=worlds, **keywords)
    rng = np.random.default_rng(4)
    pose = np.tile(grid(parts), (worlds, 1, 1))
    pose[..., 2] += rng.choice([0.0, math.pi], (worlds, len(parts)))
    simulator.reset(pose, rng.uniform(-1, 1, pose.shape) * [0.1, 0.1, 1.0])
    if periods:
        simulator.advance(*random_fields(SURFACE, worlds), periods)
    return simulator


# -- parts without contacts --------------------------------------------------------------------------------------------


def test_distant_parts_are_independent():
    """Every part moves as in a separate world, bit for bit, also with kinds of different step counts."""
    parts = [STEEL, SMALL, L_SHAPE, ALUMINIUM, SMALL, DISC]
    rng, worlds = np.random.default_rng(1), 24
    pose = np.zeros((worlds, 6, 3))
    pose[..., 0] = np.linspace(0.08, 0.75, 6) + rng.uniform(-0.003, 0.003, (worlds, 6))
    pose[..., 1], pose[..., 2] = rng.uniform(0.08, 0.12, (worlds, 6)), rng.uniform(-3, 3, (worlds, 6))
    velocity = rng.uniform(-1, 1, pose.shape) * [0.05, 0.05, 5.0]
    fields = random_fields(SURFACE, worlds)
    together = Simulator(SURFACE, parts, worlds=worlds)
    together.reset(pose, velocity)
    together.advance(*fields, 3)
    assert together.statistics == {"free": 3 * worlds, "near": 0, "contact": 0, "contact_steps": 0}
    for k, part in enumerate(parts):
        alone = Simulator(SURFACE, part, worlds=worlds)
        alone.reset(pose[:, k : k + 1], velocity[:, k : k + 1])
        alone.advance(*fields, 3)
        for name in ("pose", "velocity", "mean_velocity", "fallen", "sticking"):
            assert (getattr(alone, name)[:, 0] == getattr(together, name)[:, k]).all(), (k, name)


def test_passing_parts_are_independent():
    """Near parts without contact move as in separate worlds, bit for bit."""
    parts = [STEEL, STEEL, SMALL]
    pose = np.array([[0.3, 0.1, 0.0], [0.3, 0.143, 0.0], [0.348, 0.1, 0.0]])
    velocity = np.array([[0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.0, 0.0]])
    fields = uniform(0.0).drive(SURFACE)
    together = Simulator(SURFACE, parts)
    together.reset(pose, velocity)
    together.advance(*fields, 4)
    assert together.statistics["near"] >= 2 and together.statistics["contact"] == 0
    for k, part in enumerate(parts):
        alone = Simulator(SURFACE, part)
        alone.reset(pose[k], velocity[k])
        alone.advance(*fields, 4)
        assert (alone.pose[:, 0] == together.pose[:, k]).all() and (
            alone.velocity[:, 0] == together.velocity[:, k]
        ).all()


# -- bits do not depend on other worlds --------------------------------------------------------------------------------

WORLDS = 64


@pytest.fixture(scope="module")
def crowd():
    """64 worlds of mixed parts after 6 periods with contacts."""
    simulator = pushed(MIXED * 2, WORLDS, 6, walls=["left", "bottom"], threads=1)
    counts = simulator.statistics
    assert counts["contact"] > 3 * WORLDS and counts["contact"] < 6 * WORLDS
    return snapshot(simulator)


def of(found, worlds):
    """Return some worlds of a snapshot."""
    return {name: value[worlds] if value.ndim else value for name, value in found.items()}


def again(index, threads=1):
    """Return a separate simulator with the worlds ``index`` of the crowd, in that order."""
    index = np.asarray(index)
    whole = pushed(MIXED * 2, WORLDS, walls=["left", "bottom"])
    amplitude, phase = random_fields(SURFACE, WORLDS)
    simulator = Simulator(SURFACE, MIXED * 2, worlds=len(index), walls=["left", "bottom"], threads=threads)
    simulator.reset(whole.pose[index], whole.velocity[index])
    simulator.advance(amplitude[index], phase[index], 6)
    return snapshot(simulator)


ORDER = np.random.default_rng(5).permutation(WORLDS)
COMPANY = {
    **{f"world {world} alone": ([world], 1) for world in (0, 1, 17, 63)}, "another order": (ORDER, 1),
    "many times": ([7] * 20, 1), "two threads": (range(WORLDS), 2), "four threads": (range(WORLDS), 4),
}  # fmt: skip


@pytest.mark.parametrize("case", COMPANY)
def test_worlds_in_other_batches(crowd, case):
    index, threads = COMPANY[case]
    assert same(again(index, threads), of(crowd, list(index)))


def test_periods_one_by_one():
    at_once, one_by_one = pushed(MIXED * 2, 16), pushed(MIXED * 2, 16)
    fields = random_fields(SURFACE, 16)
    at_once.advance(*fields, 5)
    for _ in range(5):
        one_by_one.advance(*fields)
    assert same(snapshot(at_once), snapshot(one_by_one))
    assert at_once.statistics == one_by_one.statistics and at_once.statistics["contact"] > 0


def test_statistics_add_up():
    simulator = pushed(MIXED * 2, 9, 7, threads=2)
    counts = simulator.statistics
    assert counts["free"] + counts["near"] + counts["contact"] == 9 * 7
    assert counts["contact_steps"] > 0
    simulator.reset(np.tile(grid(MIXED * 2), (9, 1, 1)))
    assert set(simulator.statistics.values()) == {0}
    alone = Simulator(SURFACE, STEEL, worlds=3)
    alone.advance(0.0, 0.0, 4)
    assert alone.statistics == {"free": 12, "near": 0, "contact": 0, "contact_steps": 0}


# -- states ------------------------------------------------------------------------------------------------------------


def heap(count=12, periods=40):
    """Return a simulator with a pile of parts in the corner."""
    parts = [MIXED[k % 4] for k in range(count)]
    simulator = Simulator(SURFACE, parts, walls=WALLS)
    simulator.reset(grid(parts))
    simulator.advance(*CORNER, periods)
    return simulator


def test_states_in_the_middle_of_a_pile():
    """Restored into the same simulator, a new one, one with another history, and copies: the same bits."""
    original = heap()
    touching = gaps_between(original.parts, original.pose)[0] < 1e-4
    assert touching.sum() >= 2 * 6
    state = original.get_state()
    copies = {"deepcopy": copy.deepcopy(original), "pickle": pickle.loads(pickle.dumps(original))}
    original.advance(*CORNER, 8)
    after = snapshot(original)
    copies["fresh"] = Simulator(SURFACE, original.parts, walls=WALLS)
    copies["used"] = heap(periods=3)
    copies["itself"] = original
    for name in ("fresh", "used", "itself"):
        copies[name].set_state(state)
    for name, each in copies.items():
        assert each.time == pytest.approx(40 / 25.0)
        each.advance(*CORNER, 8)
        assert same(snapshot(each), after), name


# -- falling, and walls ------------------------------------------------------------------------------------------------


def test_fallen_parts_have_no_contacts():
    """Others move as without the fallen part, also through its position, bit for bit."""
    fields = uniform(math.pi).drive(SURFACE)
    pose = np.array([[0.7, 0.1, 0.0], [0.08, 0.1, 0.1], [0.15, 0.1, 0.0]])
    far, fell = (Simulator(SURFACE, [STEEL, DISC, STEEL]) for _ in range(2))
    far.reset(pose)
    state = far.get_state()
    state["pose"][0, 0], state["fallen"][0, 0] = [0.02, 0.1, 0.0], True
    fell.set_state(state)
    for _ in range(30):
        for simulator in (far, fell):
            simulator.advance(*fields)
        assert (fell.pose[0, 0] == [0.02, 0.1, 0.0]).all() and (fell.velocity[0, 0] == 0.0).all()
        for name in ("pose", "velocity", "fallen", "sticking"):
            assert (getattr(fell, name)[:, 1:] == getattr(far, name)[:, 1:]).all()
    assert fell.statistics == far.statistics and fell.statistics["contact"] > 0  # the two have collided
    assert fell.fallen[0, 1] and not far.fallen[0, 0]  # over the border, through the position of the first one


@pytest.mark.parametrize("direction", [0.0, 90.0, 180.0, 270.0, 45.0])
def test_walls_hold_parts(direction):
    """Under full push towards every wall for two seconds no part falls or overlaps a wall."""
    simulator = Simulator(SURFACE, MIXED, walls=WALLS)
    simulator.reset([[0.2, 0.05, 0.3], [0.4, 0.1, 0.2], [0.6, 0.15, 0.0], [0.7, 0.06, 2.0]])
    fields = uniform(math.radians(direction)).drive(SURFACE)
    for _ in range(10):
        simulator.advance(*fields, 5)
        assert not simulator.fallen.any() and not simulator.diverged.any()
        assert deepest(simulator) > -0.3e-3
    # Without that wall they do fall.
    way = {0.0: "right", 90.0: "top", 180.0: "left", 270.0: "bottom", 45.0: "right"}[direction]
    others = [wall for wall in WALLS if wall != way]
    open_side = Simulator(SURFACE, MIXED, walls=others)
    open_side.reset([[0.2, 0.05, 0.3], [0.4, 0.1, 0.2], [0.6, 0.15, 0.0], [0.7, 0.06, 2.0]])
    open_side.advance(*fields, 60)
    assert open_side.fallen.any()


# -- rest and push on the vibrating table ------------------------------------------------------------------------------


def in_walls(simulator):
    """Return the gap of all parts to the nearest wall, (parts,) m."""
    gaps = np.full(len(simulator.parts), math.inf)
    for k, part in enumerate(simulator.parts):
        x, y, turn = simulator.pose[0, k]
        c, s = math.cos(turn), math.sin(turn)
        corners = part.outline @ np.array([[c, s], [-s, c]]) + [x, y]
        low, high = corners.min(axis=0), corners.max(axis=0)
        table = np.array([SURFACE.width, SURFACE.depth])
        for name, gap in zip(("left", "bottom", "right", "top"), (*low, *(table - high))):
            if name in simulator.walls:
                gaps[k] = min(gaps[k], gap)
    return gaps


def deepest(simulator):
    """Return the smallest gap between two parts, or a part and a wall, m."""
    between = gaps_between(simulator.parts, simulator.pose) if len(simulator.parts) > 1 else np.array(math.inf)
    return min(between.min(), in_walls(simulator).min())


def test_a_pile_in_a_corner():
    """30 parts of four kinds, 12 s of full push. The long run is ``python -m studies.benchmarks.pile``."""
    parts = [MIXED[k % 4] for k in range(30)]
    simulator = Simulator(SURFACE, parts, walls=WALLS)
    simulator.reset(grid(parts))
    for _ in range(60):
        simulator.advance(*CORNER, 5)
        assert deepest(simulator) > -0.3e-3
        assert not simulator.fallen.any() and not simulator.diverged.any()
        assert np.hypot(*simulator.velocity[0, :, :2].T).max() < 2.0 * SURFACE.table_speed
    assert simulator.statistics["contact"] > 250
