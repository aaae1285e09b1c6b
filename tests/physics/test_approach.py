"""Conservative advancement: within a step no hull penetrates another by more than the limit, at any spin."""

import math

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference
from vibgym.physics.contacts.certified import approach
from vibgym.physics.contacts.certified.coupling import Island
from vibgym.physics.contacts.hulls import wall_gap
from vibgym.physics.core.drive import polar_drive
from vibgym.physics.core.records import new_state
from vibgym.physics.planar.workspace import Scene
from vibgym.scene.hulls import gaps_between
from vibgym.scene.kinds import Kinds
from vibgym.simulation.contacts.base import SLOP
from vibgym.simulation.contacts.certified import CertifiedContacts
from vibgym.simulation.model import Setup
from vibgym.simulation.schemes import PlanarSettings

SURFACE = Surface(16, 16, 0.05, 0.0)
LONGEST, SHORTEST, OVERLAP = 4e-3, 1e-7, 5e-6
"""s, s, m."""

SAMPLES = 80


@jit(allocates=True)
def placed_step(island, pairs, h):
    """Return the step of parts without earlier tests, and whether anything may touch in it."""
    island = reference(island)
    approach.invalidate_placement(island)
    island.contacts.separation[:] = -math.inf
    step = approach.conservative_step(island, pairs, pairs.shape[0], h, SHORTEST)
    return step.h, step.touching


def island_of(parts, walls):
    """Return an island of these parts, none of them fallen; :func:`enter` sets poses and velocities."""
    setup = Setup(SURFACE, Kinds.of(parts), tuple(walls), 1)
    fixed = CertifiedContacts(setup, PlanarSettings()).scene.record
    table, bodies, scheme, workspace = fixed.friction
    workspace.part[: len(parts)] = np.arange(len(parts))
    drive = polar_drive(np.zeros((1, 1, 1)), np.zeros((1, 1, 1)), SURFACE.angular_frequency)
    scene = Scene(table, bodies, scheme, drive, new_state(1, len(parts)), workspace, 1)
    return Island(scene, *fixed[1:5], 0, len(parts), 1, OVERLAP, SLOP, fixed.walls)


def enter(island, pose, velocity):
    lanes = island.scene.workspace.pose.shape[1] // 3
    for p in range(len(pose)):
        for k in range(3):
            island.scene.workspace.pose[0, k * lanes + p] = pose[p, k]
            island.scene.workspace.velocity[0, k * lanes + p] = velocity[p, k]


SHAPES = {
    "blocks": [Part.rectangle(0.05, 0.04, friction=0.0), Part.rectangle(0.1, 0.004, friction=0.0)],
    "triangle and disc": [
        Part.polygon([[0, 0], [0.06, 0], [0.01, 0.03]], friction=0.0), Part.disc(0.02, friction=0.0),
    ],
    "angles": [
        Part.polygon(scale * np.array([[0, 0], [2, 0], [2, 0.4], [0.4, 0.4], [0.4, 2], [0, 2]]), friction=0.0)
        for scale in (0.02, 0.01)
    ],
}  # fmt: skip


@pytest.mark.parametrize("shapes", SHAPES)
@pytest.mark.parametrize("spin", [5.0, 60.0, 300.0, 1500.0])
def test_overlap_within_the_step(shapes, spin):
    """Check gaps at many instants of straight motion and steady spin: the limit, six times larger for rotation."""
    parts = SHAPES[shapes]
    island = island_of(parts, ())
    rng, seen = np.random.default_rng(int(spin)), 0
    for _ in range(500):
        pose = np.array([[0.4, 0.4, 0.0], [0.4, 0.4, 0.0]]) + rng.uniform(-1, 1, (2, 3)) * [0.05, 0.05, 4.0]
        velocity = rng.uniform(-1, 1, (2, 3)) * [2.0, 2.0, spin]
        if gaps_between(parts, pose[None])[0, 0, 1] < 0.0:
            continue
        enter(island, pose, velocity)
        h, touching = placed_step(island, np.array([[0, 1]]), LONGEST)
        path = pose + np.linspace(0.0, h, SAMPLES)[:, None, None] * velocity
        deepest = gaps_between(parts, path)[:, 0, 1].min()
        assert deepest >= -(approach.SLOWLY * OVERLAP + 1e-9)
        assert touching or deepest > 0.0
        seen += touching
    assert seen > 10


@pytest.mark.parametrize("spin", [5.0, 60.0, 300.0, 1500.0])
def test_overlap_with_a_wall_within_the_step(spin):
    """Check also a centre that moves away from the wall, since a corner may turn into it."""
    part = Part.rectangle(0.06, 0.01, friction=0.0)
    island = island_of([part], ("left",))
    rng, seen, away = np.random.default_rng(int(spin)), 0, 0
    for _ in range(600):
        pose = np.array([[rng.uniform(0.005, 0.04), 0.4, rng.uniform(-4, 4)]])
        velocity = rng.uniform(-1, 1, (1, 3)) * [2.0, 2.0, spin]
        if gap_to_the_left(part, *pose[0]) < 0.0:
            continue
        enter(island, pose, velocity)
        h, touching = placed_step(island, np.array([[0, -1]]), LONGEST)
        deepest = min(
            gap_to_the_left(part, *place[0]) for place in pose + np.linspace(0, h, 50)[:, None, None] * velocity
        )
        assert deepest >= -(approach.SLOWLY * OVERLAP + 1e-9)
        assert touching or deepest > 0.0
        seen += touching
        away += touching and velocity[0, 0] > 0.0
    assert seen > 10 and (away > 0 or spin < 100.0)


def gap_to_the_left(part, x, y, turn):
    """Gap to the wall along the left border, m."""
    corners = part.outline @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    return float(corners[:, 0].min() + x)


def test_gaps_of_the_test():
    """The test's gap to a wall equals the kernel's."""
    part = Part.rectangle(0.06, 0.01, friction=0.0)
    island = island_of([part], ("left",))
    enter(island, np.array([[0.02, 0.4, 0.7]]), np.zeros((1, 3)))
    placed_step(island, np.array([[0, -1]]), LONGEST)
    width, height = SURFACE.width, SURFACE.depth
    gap = wall_gap(island.hulls, island.contacts.placed, 0, 0, width, height)
    assert gap == pytest.approx(gap_to_the_left(part, 0.02, 0.4, 0.7), abs=1e-15)
