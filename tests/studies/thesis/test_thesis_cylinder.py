"""A cylinder on its rim: closed forms, conservation laws, and the same motion by other equations and another integrator."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from studies.thesis.cylinder import (
    FREQUENCY,
    REVOLUTION,
    STILL,
    Cylinder,
    Start,
    from_five_degrees,
    height_of_constant_tilt,
    of_constant_tilt,
    release,
)
from studies.thesis.rim import AZIMUTH, LEANING, NODDING, SPIN, TILT, V_X, V_Y, X, Y, follow
from vibgym import Surface

TALL, FLAT, THIN = Cylinder(0.020, 0.033), Cylinder(0.025, 0.0055), Cylinder(0.025, 0.0)
TABLE = Surface()


@pytest.mark.parametrize("cylinder", [TALL, FLAT, THIN])
@pytest.mark.parametrize("tilt", [2.0, 20.0])
@pytest.mark.parametrize("friction", [math.inf, 0.0])
def test_steady_precession(cylinder, tilt, friction):
    """The centre of mass rests at constant tilt, at the closed form's rate, without friction."""
    cylinder, tilt = replace(cylinder, friction=friction), math.radians(tilt)
    r, h, (j1, j3) = cylinder.radius, cylinder.centre_height, cylinder.inertia
    rho = r * math.cos(tilt) - h * math.sin(tilt)
    square = r * STILL.gravity * rho / (math.sin(tilt) * (j1 * rho - (j3 - j1) * h * math.sin(tilt)))
    lean = -math.sqrt(square) * math.sin(tilt)
    start = cylinder.released(tilt, lean=lean, spin=-lean * h / r)
    start[NODDING] = 1e-9  # any disturbance
    run = follow(cylinder.rim(), start, 0.5)
    assert run.states[-1, AZIMUTH] / 0.5 == pytest.approx(math.sqrt(square), rel=1e-6)
    assert run.tilt == pytest.approx(tilt, rel=1e-6) and run.needed_friction.max() < 1e-6
    assert np.abs(run.states[:, [X, Y]]).max() < 1e-6 * r
    if cylinder is THIN:
        assert square == pytest.approx(4.0 * STILL.gravity / (r * math.sin(tilt)), rel=1e-12)


@pytest.mark.parametrize("cylinder, start", [
    (TALL, Start(math.radians(5.0), phi_rate=-2.5 * REVOLUTION)),
    (FLAT, Start(math.radians(16.0), phi_rate=-2.5 * REVOLUTION)),
    (FLAT, Start(math.radians(5.0), phi_rate=-2.5 * REVOLUTION, theta_rate=math.radians(100.0))),
])  # fmt: skip
def test_rolling_keeps_its_energy_and_does_not_slip(cylinder, start):
    run = follow(cylinder.rim(), cylinder.released_as(start), 1.0)
    assert run.energy_error < 1e-6 and run.slip.max() < 1e-9
    assert run.tilt.min() < math.radians(4.5) and run.phi_rate[0] == pytest.approx(start.phi_rate, rel=1e-12)


def test_the_error_falls_with_the_fourth_power_of_the_step():
    start = FLAT.released(math.radians(16.0), spin=-2.5 * REVOLUTION)
    ends = [follow(FLAT.rim(), start, 0.1, sampled=4e-4, step=step, arc=9.0).states[-1] for step in (4e-4, 2e-4, 1e-4)]
    errors = [float(np.abs(one - other).max()) for one, other in zip(ends, ends[1:])]
    assert 12.0 < errors[0] / errors[1] < 20.0


@pytest.mark.parametrize("cylinder", [TALL, FLAT])
@pytest.mark.parametrize("friction", [math.inf, 0.6])
def test_on_the_drive_against_vectors_in_the_room(cylinder, friction):
    """Newton-Euler equations with vectors in a fixed frame, by an integrator of SciPy; and energy, with the work."""
    cylinder, duration = replace(cylinder, friction=friction), 0.03
    start = cylinder.idling(TABLE, math.radians(5.0), -2.5 * REVOLUTION, 0.4)
    if math.isinf(friction):
        start = cylinder.released(math.radians(5.0), 1.0, -2.0, -2.5 * REVOLUTION, 0.4)
    run = follow(cylinder.rim(TABLE), start, duration, step=5e-6)
    assert run.energy_error < 1e-6
    k, u, v, omega, place = _in_the_room(run.states[0])
    v[2] = start[NODDING] * (cylinder.radius * math.cos(start[TILT]) - cylinder.centre_height * math.sin(start[TILT]))
    peer = solve_ivp(
        lambda t, y: _vector_rates(cylinder, t, y), (0.0, duration), np.concatenate([k, omega, v, place]),
        method="DOP853", rtol=1e-11, atol=1e-13,
    )  # fmt: skip
    k, u, v, omega, place = _in_the_room(run.states[-1])
    assert peer.y[:3, -1] == pytest.approx(k, abs=1e-6) and peer.y[3:6, -1] == pytest.approx(omega, rel=1e-6, abs=1e-5)
    assert peer.y[6:8, -1] == pytest.approx(v[:2], abs=1e-6) and peer.y[9:11, -1] == pytest.approx(place[:2], abs=1e-8)


def _in_the_room(state):
    """Return axis, direction to the lowest point, velocity (vertical zero), spin and position as vectors."""
    nu, alpha = state[TILT], state[AZIMUTH]
    f = np.array([math.cos(alpha), math.sin(alpha), 0.0])
    k, u = math.sin(nu) * f + [0.0, 0.0, math.cos(nu)], math.cos(nu) * f - [0.0, 0.0, math.sin(nu)]
    omega = state[SPIN] * k + state[LEANING] * u + state[NODDING] * np.cross(k, u)
    return k, u, np.array([state[V_X], state[V_Y], 0.0]), omega, np.array([state[X], state[Y], 0.0])


def _vector_rates(cylinder, t, y):
    k, omega, v = y[:3] / np.linalg.norm(y[:3]), y[3:6], y[6:9]
    r, h, (j1, j3), z = cylinder.radius, cylinder.centre_height, cylinder.inertia, np.array([0.0, 0.0, 1.0])
    inertia, w = j1 * np.eye(3) + (j3 - j1) * np.outer(k, k), TABLE.angular_frequency
    g = w * w * TABLE.horizontal_amplitude * np.array([math.cos(w * t), math.sin(w * t), 0.0])
    g[2] = -TABLE.gravity
    across = z - (z @ k) * k  # -u sin(nu)
    arm, k_rate = -h * k - r * across / np.linalg.norm(across), np.cross(omega, k)
    turned = -(z @ k_rate) * k - (z @ k) * k_rate
    unit = across / np.linalg.norm(across)
    arm_rate = -h * k_rate - r * (turned - unit * (unit @ turned)) / np.linalg.norm(across)
    e, tau = np.cross(omega, arm_rate), -np.cross(omega, inertia @ omega)
    if math.isinf(cylinder.friction):
        matrix = inertia + (arm @ arm) * np.eye(3) - np.outer(arm, arm)
        omega_rate = np.linalg.solve(matrix, tau - np.cross(arm, e + g))
        v_rate = -np.cross(omega_rate, arm) - e
    else:
        slip = (v + np.cross(omega, arm))[:2]
        d = np.append(-cylinder.friction * slip / np.hypot(*slip), 1.0)
        answer = np.linalg.solve(inertia, np.column_stack([tau, np.cross(arm, d)]))
        normal = -(g + np.cross(answer[:, 0], arm) + e)[2] / (1.0 + np.cross(answer[:, 1], arm)[2])
        omega_rate, v_rate = answer[:, 0] + normal * answer[:, 1], normal * d + g
    return np.concatenate([k_rate, omega_rate, v_rate, v])


def test_the_height_that_keeps_the_tilt_of_fig_3_19():
    """For any radius; with another height the tilt changes."""
    start = Start(math.radians(5.0), phi_rate=-2.5 * REVOLUTION, psi_rate=-math.radians(270.0))
    for radius in (0.015, 0.025):
        height = height_of_constant_tilt(radius, start.theta, start.psi_rate, start.phi_rate)
        kept, moved = Cylinder(radius, height), Cylinder(radius, 1.2 * height)
        steady = follow(kept.rim(), kept.released_as(start), 0.2).tilt
        assert steady == pytest.approx(start.theta, rel=1e-6)
        assert np.ptp(follow(moved.rim(), moved.released_as(start), 0.2).tilt) > math.radians(0.2)


def test_cylinders_that_fit_the_figures():
    """Heights and tilts of an independent program (vectors in the room, RK4), to its digits."""
    for radius, height in ((0.015, 29.9), (0.020, 33.4), (0.030, 38.0)):
        assert 1e3 * from_five_degrees(radius).cylinder.centre_height == pytest.approx(height, abs=0.06)
    for radius, height, tilt in ((0.015, 6.65, 21.0), (0.020, 6.19, 18.4), (0.030, 4.77, 14.0)):
        candidate = of_constant_tilt(radius)
        assert 1e3 * candidate.cylinder.centre_height == pytest.approx(height, abs=0.006)
        assert math.degrees(candidate.tilt) == pytest.approx(tilt, abs=0.3)
        assert release(candidate.cylinder, candidate.tilt).frequency == pytest.approx(FREQUENCY, abs=0.01)


def test_motions_that_the_equations_do_not_cover_are_refused():
    with pytest.raises(ValueError, match="radius"):
        height_of_constant_tilt(0.5, 0.1, -4.7, -15.7)
    with pytest.raises(ValueError, match="state"):
        follow(replace(FLAT, friction=0.6).rim(), FLAT.released(0.1), 0.1)  # does not slip
    with pytest.raises(ValueError, match="state"):
        follow(FLAT.rim(), FLAT.released(0.1), 0.2)  # falls flat
