"""Contacts at rest: velocities after a step of the solver, against those of pymunk, which shares nothing with it."""

import math

import numpy as np
import pymunk
import pytest

from tests.physics.test_approach import enter, island_of
from vibgym import Part
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference
from vibgym.physics.contacts.certified.solver import begin_contacts, find_contacts, solve
from vibgym.scene.hulls import gaps_between
from vibgym.simulation.contacts.base import SLOP

DISC = Part.disc(0.02, friction=0.0, contact_friction=0.3, mass=0.05)
BLOCK = Part.rectangle(0.06, 0.04, friction=0.0, contact_friction=0.6, mass=0.2)
OVERLAP, H = 4e-6, 1e-3
SCALE = [1.0, 1.0, 0.02]  # velocities at the discs' rim, m/s


@jit(allocates=True)
def solved(island, pairs, h):
    """Take a step of the solver; return the number of points and the smallest gap."""
    island = reference(island)
    begin_contacts(island)
    island.contacts.close[:] = True
    for pair in range(pairs.shape[0]):
        island.contacts.first_feature[pair] = pair
    count, gap = find_contacts(island, pairs, pairs.shape[0], h)
    solve(island, count, h)
    return count, gap


def by_pymunk(parts, pose, velocity):
    """Return the velocities (parts, 3) after a step of pymunk with many iterations."""
    space = pymunk.Space(threaded=False)
    space.iterations, space.collision_slop = 5000, 1.0
    bodies = []
    for part, (x, y, heading), (vx, vy, spin) in zip(parts, pose, velocity, strict=True):
        body = pymunk.Body(part.mass, part.mass * part.gyration)
        # A step of pymunk starts with a motion by velocity.
        body.position, body.angle = (x - H * vx, y - H * vy), heading - H * spin
        body.velocity, body.angular_velocity = (vx, vy), spin
        round_one = part is DISC
        shape = pymunk.Circle(body, 0.02) if round_one else pymunk.Poly(body, part.outline.tolist())
        shape.friction = math.sqrt(part.contact_friction)
        space.add(body, shape)
        bodies.append(body)
    space.step(H)
    return np.array([[*body.velocity, body.angular_velocity] for body in bodies])


@pytest.mark.parametrize("seed", range(6))
def test_velocities_agree_with_pymunk(seed):
    """A block between three discs, one of which touches another: no rebound, dry friction at every contact."""
    parts = [BLOCK, DISC, DISC, DISC]
    random = np.random.default_rng(seed)
    side, above = 0.03 + 0.02 - OVERLAP, 0.02 + 0.02 - OVERLAP
    across = math.sqrt((0.04 - OVERLAP) ** 2 - (above - 0.01) ** 2)
    pose = np.array([[0, 0, 0], [side, 0.01, 0], [-side, -0.01, 0], [side - across, above, 0]]) + [0.4, 0.4, 0.0]
    velocity = random.uniform(-0.3, 0.3, (4, 3)) * [1.0, 1.0, 5.0]
    velocity[1:, :2] -= 10.0 * (pose[1:, :2] - pose[0, :2])  # towards the block
    island = island_of(parts, ())
    enter(island, pose, velocity)
    pairs = np.array([[0, 1], [0, 2], [0, 3], [1, 3]])
    count, gap = solved(island, pairs, H)
    lanes = island.scene.workspace.pose.shape[1] // 3
    mine = island.scene.workspace.velocity[0].reshape(3, lanes)[:, :4].T
    assert count == 4 and gap == pytest.approx(-OVERLAP, rel=1e-4)
    # pymunk's lever arms end on either surface, 4 um apart, 2e-4 of a radius.
    np.testing.assert_allclose(mine * SCALE, by_pymunk(parts, pose, velocity) * SCALE, atol=1e-4)
    mass = np.array([part.mass for part in parts])
    np.testing.assert_allclose(mass @ mine[:, :2], mass @ velocity[:, :2], atol=1e-15)
    assert not np.allclose(mine, velocity, atol=0.05)


@pytest.mark.filterwarnings("ignore:part .* implies a density")
def test_correction_of_overlap_turns_no_corner_into_another_part():
    """A light bar between heavy parts that press on it 1 mm apart: a turn by 2 degrees would separate both of these points."""
    block, disc = Part.rectangle(0.1, 0.04, friction=0.0, mass=10.0), Part.disc(0.02, friction=0.0, mass=10.0)
    bar = Part.rectangle(0.04, 0.01, friction=0.0, mass=0.01)
    overlap, tilt = 5e-5, 2e-3
    pose = np.array([
        [0.4, 0.4 - 0.025 + overlap - 0.02 * tilt, 0.0],  # the bar's left end overlaps
        [0.4, 0.4, tilt],
        [0.4 - 0.019 - 0.025 * tilt, 0.4 + 0.025 - overlap - 0.019 * tilt, 0.0],
    ])  # fmt: skip
    island = island_of([block, bar, disc], ())
    enter(island, pose, np.zeros((3, 3)))
    before = gaps_between([block, bar, disc], pose[None])[0]
    assert before[0, 1] == pytest.approx(-overlap, rel=0.1) and before[1, 2] == pytest.approx(-overlap, rel=0.1)
    solved(island, np.array([[0, 1], [1, 2]]), H)
    lanes = island.scene.workspace.pose.shape[1] // 3
    after = gaps_between(
        [block, bar, disc], island.scene.workspace.pose[0].reshape(3, lanes)[None, :, :3].swapaxes(1, 2)
    )[0]
    assert after.min() > -0.8 * overlap
    assert after[0, 1] > before[0, 1] and after[1, 2] > before[1, 2]


@pytest.mark.filterwarnings("ignore:part .* implies a density")
def test_correction_of_overlap_stays_within_its_linear_range():
    """A light bar between heavy discs that press on it 1 mm apart: the linearised gaps ask for a turn by 10 degrees."""
    disc, bar = Part.disc(0.02, friction=0.0, mass=10.0), Part.rectangle(0.04, 0.01, friction=0.0, mass=0.01)
    overlap, parts = 1.2e-4, [disc, bar, disc]
    away = 0.025 - overlap
    pose = np.array([[0.3995, 0.4 - away, 0.0], [0.4, 0.4, 0.0], [0.4005, 0.4 + away, 0.0]])
    island = island_of(parts, ())
    enter(island, pose, np.zeros((3, 3)))
    solved(island, np.array([[0, 1], [1, 2]]), H)
    lanes = island.scene.workspace.pose.shape[1] // 3
    after = gaps_between(parts, island.scene.workspace.pose[0].reshape(3, lanes)[None, :, :3].swapaxes(1, 2))[0]
    assert min(after[0, 1], after[1, 2]) > -overlap - SLOP


@jit(allocates=True)
def solved_after(island, pairs, h, arms, force):
    """Take a step of the solver after one in which the first point had these arms and this normal force."""
    island = reference(island)
    begin_contacts(island)
    island.contacts.close[:] = True
    count, _ = find_contacts(island, pairs, pairs.shape[0], h)
    solver = island.solver
    solver.last_count[0], solver.last_force[0, 0] = 1, force
    for k in range(2):
        solver.last_body[0, k], solver.last_hull[0, k] = solver.points.body[0, k], solver.hull[0, k]
        solver.last_place[0, k] = solver.place[0, k]
    for k in range(6):
        solver.last_arms[0, k] = arms[k]
    solve(island, count, h)


@pytest.mark.parametrize("turn", [0.0, 0.5 * math.pi])
def test_forces_of_the_last_step_add_no_energy(turn):
    """Two discs in touch at rest, with a last force along the line between them, or across it.

    Along it the impulse is taken back. Half of an impulse across it cannot be: it would leave the discs moving.
    """
    island, force = island_of([DISC, DISC], ()), 20.0
    enter(island, np.array([[0.4, 0.4, 0.0], [0.44 - OVERLAP, 0.4, 0.0]]), np.zeros((2, 3)))
    arms = np.array([math.cos(turn), math.sin(turn), 0.0, 0.0, 0.02, 0.02])
    solved_after(island, np.array([[0, 1]]), H, arms, force)
    assert 0.5 * force * H / DISC.mass > 0.1  # m/s, by half of the impulse
    assert abs(island.scene.workspace.velocity[0]).max() < 1e-3
