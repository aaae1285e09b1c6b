"""Friction of the contact area: single points in closed form, and coefficients that depend on speed."""

import math
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.simulation.helpers import SURFACE, random_scene, simulated
from vibgym import Part, Simulator, Surface
from vibgym.bounds.time_bound import TimeBound
from vibgym.physics.core.records import LAW_SPEED
from vibgym.physics.planar.wrench import sliding_wrench, varying_wrench
from vibgym.policies import rollout
from vibgym.scene.friction_laws import FRICTION_LAWS, Stribeck, law_table
from vibgym.scene.parts import part_from

G, OMEGA = 9.81, 2 * math.pi * 25.0
ONE = Surface(rows=1, columns=1, element_size=8.0)  # everything happens on one element
STRIBECK = {"kind": "stribeck", "rise": 0.5, "speed": 0.3, "shape": 2.0, "viscous": 0.1}
FALLING = {"kind": "stribeck", "rise": 1.0, "speed": 0.4}


def wrench(x, y, c, s, gravity, phase, slip, spin):
    """Return force and torque of one point, padded like the kernel's arguments."""
    rows = np.zeros((5, 8))
    rows[:, 0] = 1.0, x, y, c, s
    return sliding_wrench(*rows, 8, gravity, math.cos(phase), math.sin(phase), *slip, spin)


@pytest.mark.parametrize("decade", range(-12, 16))
def test_stress_has_unit_direction_at_any_speed(decade):
    # Single-precision estimate 6e-8 and one Newton step, 1.5 (6e-8)^2, and rounding.
    for angle in np.linspace(0.0, 2.0 * math.pi, 40):
        slip = 10.0**decade * math.cos(angle), 10.0**decade * math.sin(angle)
        fx, fy, torque = wrench(0.0, 0.0, 0.0, 0.0, 9.81, 0.3, slip, 0.0)
        # Below 1e-11 m/s the floor that avoids 0/0 becomes visible.
        size = 1.0 / math.sqrt(1.0 + 1e-30 / 10.0 ** (2 * decade))
        assert math.hypot(fx - 9.81 * size * math.cos(angle), fy - 9.81 * size * math.sin(angle)) < 1e-12
        assert torque == 0.0


def test_a_point_at_rest_on_the_table_has_no_direction():
    assert wrench(0.01, 0.02, 0.0, 0.0, 9.81, 0.3, (0.0, 0.0), 0.0) == (0.0, 0.0, 0.0)


def test_normal_load_and_lever():
    x, y, c, s, phase, slip, spin = 0.012, -0.007, 3.0, -2.0, 0.8, (0.3, -0.1), 5.0
    normal = 9.81 - c * math.cos(phase) + s * math.sin(phase)
    u = np.array([slip[0] + spin * y, slip[1] - spin * x])
    force = normal * u / np.hypot(*u)
    expected = (*force, x * force[1] - y * force[0])
    assert wrench(x, y, c, s, 9.81, phase, slip, spin) == pytest.approx(expected, rel=1e-13)


# -- coefficients that depend on speed -----------------------------------------------------------------------------------


def test_stress_follows_the_law():
    table, law = law_table(STRIBECK), Stribeck(Stribeck.Settings(rise=0.5, speed=0.3, viscous=0.1))
    for speed in (0.0005, 0.013, 0.31, 1.7):
        rows = np.zeros((5, 8))
        rows[0, 0] = 1.0
        fx, fy, _ = varying_wrench(*rows, 8, G, 1.0, 0.0, 0.6 * speed, 0.8 * speed, 0.0, table)
        assert math.hypot(fx, fy) / G == pytest.approx(law(np.array(speed)), rel=1e-4)
        assert fy / fx == pytest.approx(0.8 / 0.6)


def test_factors_are_constant_beyond_the_table():
    table, rows = law_table(STRIBECK), np.zeros((5, 8))
    rows[0, 0] = 1.0
    fast = [varying_wrench(*rows, 8, G, 1.0, 0.0, speed, 0.0, 0.0, table)[0] for speed in (LAW_SPEED * 1023, 5.0, 1e3)]
    assert fast == pytest.approx([G * table[-1]] * 3)


@pytest.mark.parametrize("law", [None, STRIBECK, FALLING, {"kind": "stribeck", "rise": 5.0, "speed": 0.4}])
def test_slow_parts_are_braked_by_the_mean_of_both_slopes(law):
    """Friction changes a small velocity v by ``-(g / 2) (mu(U) / U + mu'(U)) v``, U the speed of the table: half of it for the
    direction of the slip, half for its size. Where the coefficient falls fast, the velocity grows."""
    speed, mu, v, periods, step = ONE.table_speed, 0.02, 1e-3, 25, 1e-5
    part = Part.disc(0.02, friction=mu, friction_law=law)
    simulator = Simulator(ONE, part, worlds=2, substeps=16)
    simulator.reset([4.0, 4.0, 0.0], [[[0.0, 0.0, 0.0]], [[v, 0.0, 0.0]]])
    made = FRICTION_LAWS.make("law", law or "stribeck")
    slope = (made(np.array(speed + step)) - made(np.array(speed - step))) / (2.0 * step)
    rate = 0.5 * mu * G * (made(np.array(speed)) / speed + slope)
    assert (rate < 0.0) == (law is not None and law["rise"] == 5.0)
    apart = []
    for _ in range(2):
        simulator.advance(0.0, 0.0, periods)
        apart.append(np.linalg.norm(np.subtract(*simulator.state.mean_velocity[:, 0, :2])))
    assert apart[1] / apart[0] == pytest.approx(math.exp(-rate * periods / 25.0), rel=3e-3)


@pytest.mark.parametrize("law", [STRIBECK, FALLING])
def test_motion_is_that_of_an_independent_integration(law):
    made, mu, amplitude, phase = FRICTION_LAWS.make("law", law), 0.3, 3e-4, 0.7
    part, periods = Part.disc(0.003, friction=mu, friction_law=law), 12

    def rates(t, y):
        ux, uy = -ONE.table_speed * math.sin(OMEGA * t) - y[2], ONE.table_speed * math.cos(OMEGA * t) - y[3]
        size = math.hypot(ux, uy)
        normal = G - amplitude * OMEGA**2 * math.cos(OMEGA * t + phase)
        pull = mu * float(made(np.array(size))) * normal / size
        return [y[2], y[3], pull * ux, pull * uy]

    solution = solve_ivp(rates, (0.0, periods / 25.0), [4.0, 4.0, 0.0, 0.0], rtol=1e-11, atol=1e-13)
    simulator = simulated(ONE, part, [4.0, 4.0, 0.0], None, amplitude, phase, periods, substeps=16)
    moved = solution.y[:2, -1] - 4.0
    assert np.linalg.norm(moved) > 5e-3
    np.testing.assert_allclose(simulator.pose[0, 0, :2] - 4.0, moved, atol=1e-5 * np.linalg.norm(moved) + 1e-8)


def test_a_law_of_ones_changes_nothing():
    FRICTION_LAWS.register("ones", lambda: np.ones_like)
    parts = [Part.rectangle(0.05, 0.035, friction=0.5, friction_law=law) for law in (None, {"kind": "ones"})]
    scene = random_scene(SURFACE, 3)
    plain, lawful = (simulated(SURFACE, part, *scene, 20, pieces=2).pose for part in parts)
    np.testing.assert_allclose(lawful, plain, rtol=0, atol=1e-11)


def test_a_part_sticks_by_the_coefficient_at_rest():
    limit = ONE.horizontal_amplitude * OMEGA**2 / G  # coefficient from which a part sticks
    for rise, sticks in ((1.02, True), (0.97, False)):
        part = Part.disc(0.02, friction=0.5 * limit, friction_law={"kind": "stribeck", "rise": rise, "speed": 0.05})
        assert part.static_friction == pytest.approx(0.5 * limit * (1.0 + rise))
        at_first = [0.0, ONE.table_speed, 0.0]  # the table's velocity
        assert simulated(ONE, part, [4.0, 4.0, 0.0], at_first, periods=3).sticking[0, 0] == sticks


def test_environments_take_laws_and_parts_keep_them():
    values = {"shape": "rectangle", "length_mm": 50, "width_mm": 35, "friction": 0.5, "friction_law": STRIBECK}
    part = part_from(values)
    assert pickle.loads(pickle.dumps(part)).same_as(part)
    assert part_from(part.to_dict()).same_as(part) and not part.same_as(part_from({**values, "friction_law": None}))
    played = rollout({"kind": "pose", "action": "velocity"}, "vibgym/Align-v0", seeds=range(10), parts=[values])
    assert played.success.all()


@pytest.mark.parametrize("law, more, message", [
    ("stribeck", {}, "friction_law"),
    ({"rise": 1.0}, {}, "kind"),
    ({"kind": "unknown"}, {}, "stribeck"),
    (STRIBECK, {"static_friction": 0.6}, "static_friction"),
])  # fmt: skip
def test_invalid_laws_are_refused(law, more, message):
    with pytest.raises(ValueError, match=message):
        Part.disc(0.02, friction=0.5, friction_law=law, **more)


def test_bounds_assume_a_constant_coefficient():
    with pytest.raises(ValueError, match="constant coefficient"):
        TimeBound(SURFACE, Part.disc(0.02, friction=0.3, friction_law=STRIBECK), position_tolerance=1e-3)
