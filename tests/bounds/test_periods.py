"""Predicted effect of one period against the planar simulator, whose contact area is exact."""

import math

import numpy as np
import pytest

from tests.policies.helpers import ALUMINIUM, STEEL, SURFACE
from vibgym import Part, Simulator
from vibgym.bounds.programme import moves, turns
from vibgym.bounds.tables import sample, scratch_for, turner_for
from vibgym.physics.core.drive import cartesian_drive

MAX = SURFACE.max_amplitude


def advanced(part, pose, velocity, c, s):
    """Return changes of poses (n, 3) in a period, and the final velocities."""
    simulator = Simulator(SURFACE, part, worlds=len(pose))
    simulator.reset(pose[:, None], velocity[:, None])
    simulator.advance_drive(cartesian_drive(c, s), 1)
    return simulator.pose[:, 0] - pose, simulator.velocity[:, 0]


def test_displacements_agree_with_the_simulator():
    random = np.random.default_rng(5)
    n, mu = 40, ALUMINIUM.friction
    velocity = np.column_stack([random.uniform(-0.2, 0.2, (n, 2)), np.zeros(n)])
    velocity[:, :2] += SURFACE.idle_velocity(mu)
    angle = random.uniform(-math.pi, math.pi, n)
    phasor = SURFACE.full_scale * random.uniform(0.0, 1.0, (n, 1)) * np.column_stack([np.cos(angle), np.sin(angle)])
    at = math.pi / 24 * np.arange(49)
    travelled, after = np.empty((2, n, n, 2))
    moves(
        mu, SURFACE.gravity, SURFACE.table_speed, SURFACE.period, np.cos(at), np.sin(at), velocity[:, :2].copy(), phasor,
        travelled, after,
    )  # fmt: skip
    here = np.arange(n)
    pose = np.tile([0.4, 0.1, 0.3], (n, 1))
    way, fast = advanced(ALUMINIUM, pose, velocity, *np.broadcast_to(phasor.T[:, :, None, None], (2, n, 8, 32)))
    np.testing.assert_allclose(travelled[here, here], way[:, :2], atol=2e-6)
    np.testing.assert_allclose(after[here, here], fast[:, :2], atol=2e-4)


@pytest.mark.parametrize("part", [ALUMINIUM, STEEL])
def test_rotations_agree_with_the_simulator_and_are_hard_to_beat(part):
    random = np.random.default_rng(6)
    turner = turner_for(SURFACE, part.friction, part.gyration, MAX, sample(part, SURFACE.element_size))
    scratch, side = scratch_for(turner), 2 * turner.reach + 1
    n, tries = 12, 40
    pose = np.column_stack([np.tile([0.416, 0.104], (n, 1)), random.uniform(0.0, math.pi / 2, n)])
    pose[:, :2] += random.uniform(0.0, 0.026, (n, 2))
    velocity = np.column_stack([np.tile(turner.idle, (n, 1)), random.uniform(-3.0, 13.0, n)])
    turned, after = np.empty((2, n))
    c, s = np.zeros((2, n, 8, 32))
    sign = np.where(np.arange(n) % 2, -1.0, 1.0)
    low = np.array([4, 16]) - turner.reach
    for k in range(n):
        gain, spin = np.empty((2, 1, 1, 1))
        turns(
            turner, scratch, pose[k : k + 1, :2] - [0.416, 0.104], sign[k] * np.ones((1, 2)), np.ones(1), pose[k, 2:],
            velocity[k, 2:], gain, spin,
        )  # fmt: skip
        turned[k], after[k] = gain[0, 0, 0], spin[0, 0, 0]
        window = k, slice(low[0], 8), slice(low[1], low[1] + side)
        c[window], s[window] = (grid.reshape(side, side)[: 8 - low[0]] for grid in (scratch.c, scratch.s))
    moved, fast = advanced(part, pose, velocity, c, s)
    strongest = part.friction * SURFACE.gravity * SURFACE.period / (2.0 * math.sqrt(part.gyration))
    np.testing.assert_allclose(after, fast[:, 2], atol=0.02 * strongest)
    np.testing.assert_allclose(turned, moved[:, 2], atol=0.02 * strongest * SURFACE.period)
    angle = np.repeat(0.2 * random.standard_normal((tries, 1, 8, 32)), n, axis=1).reshape(-1, 8, 32)
    cs, ss = np.tile(c, (tries, 1, 1)), np.tile(s, (tries, 1, 1))
    other = advanced(
        part, np.tile(pose, (tries, 1)), np.tile(velocity, (tries, 1)), np.cos(angle) * cs - np.sin(angle) * ss,
        np.sin(angle) * cs + np.cos(angle) * ss,
    )[1]  # fmt: skip
    best = (sign * other[:, 2].reshape(tries, n)).max(axis=0)
    assert (best <= sign * after + 0.02 * strongest).all()


def test_points_have_the_part_s_inertia():
    shape = Part.polygon([[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.05], [0, 0.05]], friction=0.5)
    for part in (ALUMINIUM, shape, Part.disc(0.02, friction=0.5)):
        points = sample(part, 0.026)
        np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-15)
        assert (points**2).sum(axis=1).mean() == pytest.approx(part.gyration, rel=1e-12)
        # The points are coarse, but their scale factor is nearly one.
        assert np.hypot(*points.T).max() <= 1.05 * part.radius
