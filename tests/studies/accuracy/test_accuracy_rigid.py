"""The rigid reference on compliant contact points against closed forms, and against the planar model where both must agree."""

import math

import numpy as np
import pytest

from studies.accuracy.rigid import housner, motion
from studies.accuracy.rigid.body import Body, disc, prism
from studies.accuracy.rigid.motion import Plates, Start, attitude_of, axes_of, level, simulate, touching, under
from studies.accuracy.rigid.studies import uniform_gap
from vibgym.scene.parts import shipped_part

G = 9.81
W = 2 * math.pi * 25.0
RECTANGLE = np.array([[-0.025, -0.0175], [0.025, -0.0175], [0.025, 0.0175], [-0.025, 0.0175]])
BLOCK = prism(RECTANGLE, 0.02, 0.58)
STILL = level(1, 1, size=4.0, amplitude=0.0)


def momentum(body, track, k):
    axes = axes_of(track.attitude[k])
    return axes @ body.inertia @ axes.T @ track.spin[k]


def energy(body, track):
    """Of motion and height; the contact points hold microjoules per kg."""
    turning = [0.5 * momentum(body, track, k) @ track.spin[k] for k in range(len(track.time))]
    return np.array(turning) + body.mass * (0.5 * (track.velocity**2).sum(axis=1) + G * track.position[:, 2])


@pytest.mark.parametrize(("body", "spread", "height"), [
    (prism(RECTANGLE, 0.02, 0.5, mass=3.0), [0.05**2 / 12, 0.035**2 / 12], 0.02),
    (disc(0.02, 0.01, 0.5, mass=3.0), [0.02**2 / 4, 0.02**2 / 4], 0.01),
], ids=["block", "disc"])  # fmt: skip
def test_inertia_and_foot(body, spread, height):
    moments = [spread[1] + height**2 / 12, spread[0] + height**2 / 12, sum(spread)]
    np.testing.assert_allclose(body.inertia, 3.0 * np.diag(moments), atol=1e-18)
    assert 96 <= len(body.points) <= 143
    assert body.shares.sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(body.shares @ body.points, [0.0, 0.0, -body.centre_height], atol=1e-15)
    np.testing.assert_allclose(body.shares @ body.points[:, :2] ** 2, spread, rtol=0.025)


def test_a_free_body_falls_and_precesses():
    """The axis of a symmetric body goes round its momentum at ``|L|/I``, and the centre of mass falls freely."""
    body = disc(0.02, 0.05, 0.5)
    spin = np.array([3.0, 0.0, 12.0])
    start = Start(np.array([2.0, 2.0, 5.0]), attitude_of(0.3), np.array([0.1, 0.2, 0.3]), spin)
    track = simulate(body, STILL, start, 0.2, interval=0.1)
    fall = start.position + np.outer(track.time, start.velocity) - np.outer(track.time**2 / 2, [0, 0, G])
    np.testing.assert_allclose(track.position, fall, atol=1e-9)
    whole = momentum(body, track, 0)
    np.testing.assert_allclose(momentum(body, track, 2), whole, rtol=1e-9, atol=1e-15)
    rate, along = np.linalg.norm(whole) / body.inertia[0, 0], whole / np.linalg.norm(whole)
    axis = np.array([0.0, 0.0, 1.0])
    for k, time in enumerate(track.time):
        angle = rate * time
        wanted = (
            axis * math.cos(angle)
            + np.cross(along, axis) * math.sin(angle)
            + along * (along @ axis) * (1 - math.cos(angle))
        )
        np.testing.assert_allclose(axes_of(track.attitude[k])[:, 2], wanted, atol=1e-8)


@pytest.mark.parametrize("restitution", [0.2, 0.6])
def test_one_contact_point_bounces_as_asked(restitution):
    body = Body(1.0, 1e-4 * np.eye(3), np.array([[0.0, 0.0, -0.01]]), np.ones(1), 0.5)
    start = Start(np.array([2.0, 2.0, 0.01 + 1e-12]), attitude_of(0.0), np.array([0.0, 0.0, -0.2]), np.zeros(3))
    track = simulate(body, STILL, start, 0.002, interval=0.002, step=1e-7, restitution=restitution)
    leaves = track.velocity[-1, 2] + 0.002 * G  # it falls again before and after the 0.1 ms of contact
    assert leaves == pytest.approx(0.2 * restitution, rel=0.05)


def test_a_part_at_rest_sags_evenly():
    track = simulate(BLOCK, STILL, touching(BLOCK, STILL, 2.0, 2.0, 0.4, sag=0.0), 0.08)
    assert track.position[-1, 2] == pytest.approx(0.01 - motion.SAG, abs=1e-3 * motion.SAG)
    assert track.largest_tilt < 1e-6
    assert track.landing == 0.0


def test_sliding_friction_stops_a_part():
    """``v^2 / (2 mu g)``."""
    start = touching(BLOCK, STILL, 2.0, 2.0, 0.4, velocity=(0.3, 0.0))
    track = simulate(BLOCK, STILL, start, 0.1, interval=0.02)
    assert track.position[-1, 0] - 2.0 == pytest.approx(0.09 / (2 * 0.58 * G), rel=1e-3)
    assert np.abs(track.velocity[-1]).max() < 1e-6


def test_plates_that_rest_carry_nobody():
    """A part that slides in place goes round a circle of radius ``mu g / w^2`` and is back after a period (eq. 3.30)."""
    table = level(1, 1, size=4.0)
    radius, lag = 0.58 * G / W**2, math.acos(0.58 * G / W**2 / 2.7e-3)
    velocity = (radius * W * math.sin(lag), radius * W * math.cos(lag))
    start = touching(BLOCK, table, 2.0, 2.0, 0.0, velocity=velocity)
    track = simulate(BLOCK, table, start, 0.04, interval=0.005)
    np.testing.assert_allclose(track.position[-1, :2], [2.0, 2.0], atol=2e-7)
    np.testing.assert_allclose(np.hypot(*track.velocity[:, :2].T), radius * W, rtol=1e-3)
    across = track.position[4, :2] - track.position[0, :2]
    assert np.hypot(*across) == pytest.approx(2 * radius, rel=1e-3)


@pytest.mark.parametrize("ramp", [0.0, 3e-3, 13e-3])
def test_heights_are_those_of_the_plates_and_blended_at_borders(ramp):
    rng = np.random.default_rng(1)
    plates = Plates(rng.normal(size=(4, 5)), rng.normal(size=(4, 5)), ramp=ramp)
    a, b = math.cos(0.7), math.sin(0.7)
    heights = (plates.c * a - plates.s * b) / W**2

    def at(x, y):
        return under(plates.c, plates.s, plates.size, ramp, a, b, W, x, y)

    for i in range(4):
        for j in range(5):
            height, rise, *slope = at((j + 0.5) * 0.026, (i + 0.5) * 0.026)
            assert height == pytest.approx(heights[i, j], rel=1e-12)
            assert rise == pytest.approx((-plates.c[i, j] * b - plates.s[i, j] * a) / W, rel=1e-12)
            np.testing.assert_allclose(slope, 0.0, atol=1e-15)
    if ramp:
        corner = at(0.052, 0.078)
        assert corner[0] == pytest.approx(heights[2:4, 1:3].mean(), rel=1e-9)
        assert at(0.052 - 1e-12, 0.078 + 1e-12)[0] == pytest.approx(corner[0], rel=1e-6)
        for x, y in rng.uniform(0.002, 0.1, (50, 2)):
            slopes = [
                (at(x + 1e-8, y)[0] - at(x - 1e-8, y)[0]) / 2e-8,
                (at(x, y + 1e-8)[0] - at(x, y - 1e-8)[0]) / 2e-8,
            ]
            np.testing.assert_allclose(at(x, y)[2:], slopes, atol=1e-8)


def test_a_tilted_start_touches_with_one_corner():
    plates = level(8, 32, 3.0, -4.0)
    start = touching(BLOCK, plates, 0.3, 0.1, 0.4, math.radians(5.0), 1.1)
    low = (BLOCK.points @ axes_of(start.attitude).T)[:, 2].min() + start.position[2]
    assert low == pytest.approx(3.0 / W**2, abs=1e-15)
    assert start.velocity[2] == pytest.approx(4.0 / W, rel=1e-12)
    axis = axes_of(start.attitude)[:, 2]
    assert math.acos(axis[2]) == pytest.approx(math.radians(5.0), rel=1e-9)
    assert math.atan2(axis[1], axis[0]) == pytest.approx(1.1, rel=1e-9)


def test_a_still_table_takes_energy_only():
    start = touching(BLOCK, STILL, 2.0, 2.0, 0.4, math.radians(5.0), 0.8)
    track = simulate(BLOCK, STILL, start, 0.2, interval=1e-3)
    energies = energy(BLOCK, track)
    assert np.diff(energies).max() < 5e-6 * BLOCK.mass * G  # what the springs give back
    assert energies[-1] == pytest.approx(BLOCK.mass * G * 0.01, rel=1e-4)
    assert 0.005 < track.landing < 0.1


@pytest.mark.parametrize("slenderness", [2.0, 3.0])
def test_rocking_block(slenderness):
    assert housner.measured(slenderness) == pytest.approx(housner.expected(slenderness), rel=0.003)


@pytest.mark.parametrize("name", ["aluminium_block", "steel_block"])
def test_uniform_transport_is_that_of_the_planar_model(name):
    gap = uniform_gap(shipped_part(name), periods=5)
    assert gap["gap"] < 2e-4
    assert gap["turned_deg"] < 0.02


@pytest.mark.parametrize("height", [1e-4, 0.01])
def test_how_far_a_spin_turns_a_part_that_slides_in_place(height):
    """Friction under a fast table brakes spin at ``mu g <r^2> / (2 u k^2)``; height takes off a share ``2 (mu h)^2 / <r^2>``.

    The centre of pressure lies ``mu h`` off, against friction, where spin turns slip sideways. That sideways force acts at a
    depth ``h``, so pressure shifts across as well, and friction has a torque about the centre of mass that keeps the spin up.
    """
    body, table, friction = prism(RECTANGLE, height, 0.58), level(1, 1, size=4.0), 0.58
    radius = friction * G / W**2
    lag = math.acos(radius / 2.7e-3)
    velocity = (radius * W * math.sin(lag), radius * W * math.cos(lag))
    start = touching(body, table, 2.0, 2.0, 0.0, velocity=velocity)._replace(spin=np.array([0.0, 0.0, 0.5]))
    track = simulate(body, table, start, 1.0, step=8e-6)
    slip = W * math.sqrt(2.7e-3**2 - radius**2)
    arms = body.shares @ (body.points[:, :2] ** 2).sum(axis=1)
    share = (arms - 2.0 * (friction * height / 2) ** 2) / (body.inertia[2, 2] / body.mass)
    assert track.heading[-1] == pytest.approx(0.5 * 2.0 * slip / (friction * G) / share, rel=0.01)
