"""The frictional process inverted: against the averaged model of any field, and against the planar model."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.allocation.averaged_model import mean_acceleration, mean_state
from tests.policies.helpers import ALUMINIUM, DISC, STEEL, SURFACE
from vibgym import Part, Simulator, Surface
from vibgym.allocation.frictional import FrictionalInverse, rim_of
from vibgym.bounds.tables import sample
from vibgym.physics.core.drive import polar_drive

ONE = Surface(rows=1, columns=1, element_size=8.0)
G, TOP = SURFACE.gravity, SURFACE.table_speed


def motion(push, surface=SURFACE):
    """Return amplitude and phase (worlds, 1, 1) of elements with equal pushes."""
    x, y = push[:, 0, None, None], push[:, 1, None, None]
    amplitude = np.minimum(np.hypot(x, y), 1.0) * surface.max_amplitude
    return amplitude, np.arctan2(-x, -y)


def draws(worlds, fastest, seed=0):
    rng = np.random.default_rng(seed)
    speed, angle = fastest * rng.uniform(size=worlds), rng.uniform(-3.2, 3.2, worlds)
    velocity = np.stack([speed * np.cos(angle), speed * np.sin(angle), 0.0 * angle], axis=-1)
    return velocity, rng.uniform(-1.0, 1.0, (worlds, 3)) * [4.0, 4.0, 0.0]


@pytest.mark.parametrize("surface, pose", [(ONE, [4.0, 4.0, 0.3]), (SURFACE, [0.397, 0.101, 0.3])])
@pytest.mark.parametrize("part", [STEEL, DISC])
def test_accelerations_equal_the_averaged_model(surface, pose, part):
    """On one element and under a uniform field on several, slower than the table and, far from it, faster."""
    velocity, wanted = draws(300, 1.0)
    velocity = velocity[abs(np.hypot(*velocity.T[:2]) / TOP - 1.0) > 0.02]  # the tables end at 0.99
    result = FrictionalInverse(surface, part).push(velocity[:, None], wanted[: len(velocity), None])
    simulated = mean_acceleration(surface, part, pose, velocity, *motion(result.push[:, 0], surface))
    assert np.abs(result.acceleration[:, 0, :2] - simulated[:, :2]).max() < 1e-5 * G
    again, holds = FrictionalInverse(surface, part).acceleration(velocity[:, None], result.push)
    assert np.abs(again - result.acceleration).max() < 1e-12 and (holds == result.holds).all()


@settings(max_examples=40)
@given(
    speed=st.floats(0.0, 0.33), heading=st.floats(-4, 4), ax=st.floats(-2, 2), ay=st.floats(-2, 2),
    friction=st.floats(0.05, 0.9), limit=st.floats(0.05e-3, 0.45e-3),
)  # fmt: skip
def test_pushes_are_exact_up_to_the_limit(speed, heading, ax, ay, friction, limit):
    part = Part.rectangle(0.05, 0.035, friction=friction)
    inverse = FrictionalInverse(SURFACE, part, limit=limit)
    velocity = np.array([[[speed * math.cos(heading), speed * math.sin(heading), 0.0]]])
    wanted = np.array([[[ax, ay, 0.0]]])
    result = inverse.push(velocity, wanted)
    length = np.hypot(*result.push[0, 0, :2]) * SURFACE.max_amplitude
    most = min(limit, SURFACE.max_amplitude)
    assert length <= most * (1.0 + 1e-12)
    left = np.abs(result.acceleration - wanted).max()
    assert left < 1e-8 or length == pytest.approx(most, rel=1e-9)
    # Beyond the limit, the change relative to elements at rest keeps its direction.
    idle, _ = inverse.acceleration(velocity, np.zeros((1, 1, 3)))
    requested, got = (wanted - idle)[0, 0, :2], (result.acceleration - idle)[0, 0, :2]
    assert abs(requested[0] * got[1] - requested[1] * got[0]) < 1e-7 * (1.0 + requested @ requested)
    assert -1e-9 <= requested @ got <= requested @ requested + 1e-7


@pytest.mark.parametrize("friction", [0.3, 0.58])
@pytest.mark.parametrize("ahead", [0.0, 0.5])
def test_the_planar_model_has_the_wanted_acceleration(friction, ahead):
    """Mean acceleration over one period, on several elements, up to top speed, some beyond the limit: the period is centred on
    the velocity given, or with ``ahead`` begins with it."""
    part = Part.rectangle(0.050, 0.035, friction=friction)
    period, eps = SURFACE.period, friction * G / (SURFACE.horizontal_amplitude * SURFACE.angular_frequency**2)
    velocity, wanted = draws(60, 0.25, seed=2)
    wanted *= 0.3 * friction / 4.0 * G
    result = FrictionalInverse(SURFACE, part, ahead=ahead * period).push(velocity[:, None], wanted[:, None])
    acceleration = result.acceleration[:, 0]
    amplitude, phase = motion(result.push[:, 0])
    start = velocity - (0.5 - ahead) * period * acceleration
    pose = [0.4, 0.1, 0.2] - 0.5 * period * start
    here, now = pose.copy(), start.copy()
    for _ in range(30):  # the state at the start of the period that has these means
        slow_pose, slow = mean_state(SURFACE, part, here, now, amplitude, phase)
        here, now = here + pose - slow_pose, now + start - slow
    exact = Simulator(SURFACE, part, worlds=len(pose), steps=64, substeps=2, pieces=4)
    exact.reset(here[:, None], now[:, None])
    exact.advance(amplitude, phase)
    end = mean_state(SURFACE, part, exact.pose[:, 0], exact.velocity[:, 0], amplitude, phase)[1]
    error = np.hypot(*((end - start) / period - acceleration).T[:2]) / (friction * G)
    assert error.mean() < eps**2 and error.max() < 4.0 * eps**2, (error.mean(), error.max(), eps**2)


def test_spin_agrees_with_the_averaged_model():
    """Compare for a disc in a field with push and rotation, on small elements, at slow spin."""
    fine, spin = Surface(rows=160, columns=160, element_size=0.001), 0.05
    inverse = FrictionalInverse(fine, DISC)
    velocity = np.array([[0.0, 0.0, spin], [0.2, 0.0, spin], [0.12, -0.2, spin], [-0.1, 0.1, 0.0]])
    push = np.array([[0.0, 0.0, 0.4], [0.3, 0.1, 0.2], [0.1, -0.3, 0.0], [0.0, 0.0, -0.3]])
    x, y = (centres - 0.080 for centres in fine.element_centres())
    gyration = math.sqrt(DISC.gyration)
    field = [push[:, k, None, None] + turn * push[:, 2, None, None] / gyration for k, turn in ((0, -y), (1, x))]
    field = [component / np.maximum(np.hypot(*field), 1.0) for component in field]  # only away from the disc
    amplitude, phase = np.hypot(*field) * fine.max_amplitude, np.arctan2(-field[0], -field[1])
    simulated = mean_acceleration(fine, DISC, [0.080, 0.080, 0.0], velocity, amplitude, phase, order=1)[:, 2]
    stated = inverse.acceleration(velocity[:, None], push[:, None])[0][:, 0, 2]
    assert stated == pytest.approx(simulated, rel=0.01)
    back = inverse.push(velocity[:, None], inverse.acceleration(velocity[:, None], push[:, None])[0]).push[:, 0]
    assert back == pytest.approx(push, abs=1e-9)


@pytest.mark.parametrize("part", [DISC, STEEL, ALUMINIUM], ids=["disc", "steel", "aluminium"])
def test_fast_spin_on_the_planar_model(part):
    """Parts in place on fine elements that push along circles, at up to the fastest spin: spin gained in a period."""
    fine = Surface(rows=80, columns=80, element_size=0.002)
    spin = np.linspace(0.0, 14.0, 8)
    turn = np.repeat([-0.7, 0.0, 0.7], len(spin))
    spin = np.tile(spin, 3)
    x, y = (centres - 0.080 for centres in fine.element_centres())
    lever = np.hypot(x, y) + 1e-12
    # The moment over the radius of gyration of unit pushes along circles is the mean radius over that one.
    radius = _mean_radius(part)
    size = (turn * math.sqrt(part.gyration) / radius)[:, None, None]
    push = size * np.stack([-y / lever, x / lever], axis=0)[:, None]
    amplitude, phase = np.hypot(*push) * fine.max_amplitude, np.arctan2(-push[0], -push[1])
    simulator = Simulator(fine, part, worlds=len(spin))
    idle = np.tile(fine.idle_velocity(part.friction), (len(spin), 1))
    simulator.reset([0.080, 0.080, 0.0], np.column_stack([idle, spin])[:, None])
    simulator.advance_drive(polar_drive(amplitude, phase, fine.angular_frequency), 1)
    gained = simulator.velocity[:, 0, 2] - spin
    inverse = FrictionalInverse(fine, part, ahead=0.5 * fine.period)
    velocity, pushes = np.zeros((2, len(spin), 1, 3))
    velocity[:, 0, 2], pushes[:, 0, 2] = spin, turn
    stated = fine.period * inverse.acceleration(velocity, pushes)[0][:, 0, 2]
    strongest = fine.period * 0.5 * part.friction * fine.full_scale / math.sqrt(part.gyration)
    np.testing.assert_allclose(stated, gained, atol=0.02 * strongest)
    back = inverse.push(velocity, inverse.acceleration(velocity, pushes)[0]).push
    np.testing.assert_allclose(back, pushes, atol=1e-3)


def _mean_radius(part):
    """Of the contact area about its centre, m, on a grid."""
    points = sample(part, 0.004)
    return np.hypot(*points.T).mean()


def test_rim_radius_in_closed_form():
    """Of a disc <r^4> / <r^2> = 2 R^2 / 3; of a square of edge a 7 a^2 / 30."""
    assert rim_of(Part.disc(0.02, friction=0.5)) == pytest.approx(math.sqrt(2.0 / 3.0) * 0.02, rel=2e-3)
    assert rim_of(Part.rectangle(0.03, 0.03, friction=0.5)) == pytest.approx(math.sqrt(7.0 / 30.0) * 0.03, rel=1e-9)


def test_zero_acceleration_needs_zero_push():
    none = np.zeros((2, 1, 3))
    assert not FrictionalInverse(SURFACE, STEEL).push(none, none).push.any()


def test_rows_and_parts_are_independent():
    rng = np.random.default_rng(3)
    velocity, wanted = rng.uniform(-0.3, 0.3, (2, 50, 3, 3)) * [[[1.0]]] * np.array([1.0, 12.0])[:, None, None, None]
    whole = FrictionalInverse(SURFACE, [ALUMINIUM, STEEL, DISC], limit=2.5e-4).push(velocity, wanted)
    for k, part in enumerate((ALUMINIUM, STEEL, DISC)):
        alone = FrictionalInverse(SURFACE, part, limit=2.5e-4)
        for i in (0, 17, 49):
            row = alone.push(velocity[i : i + 1, k : k + 1], wanted[i : i + 1, k : k + 1])
            assert all((a[0, 0] == b[i, k]).all() for a, b in zip(row, whole, strict=True))


def test_ahead_is_consistent():
    """Pushes and accelerations with ``ahead`` equal those without it at the predicted velocity, in both directions."""
    velocity, wanted = draws(100, 0.25, seed=5)
    velocity, wanted = velocity[:, None], wanted[:, None] + [0.0, 0.0, 20.0]
    now, later = FrictionalInverse(SURFACE, STEEL), FrictionalInverse(SURFACE, STEEL, ahead=0.02)
    result = later.push(velocity, wanted)
    at = velocity + 0.02 * result.acceleration
    assert now.acceleration(at, result.push)[0] == pytest.approx(result.acceleration, abs=3e-3)
    assert later.acceleration(velocity, result.push)[0] == pytest.approx(result.acceleration, abs=3e-3)
    assert now.push(at, wanted).push == pytest.approx(result.push, abs=1e-3)
    assert 20 < (np.abs(result.acceleration - wanted).max(axis=(1, 2)) < 1e-6).sum() < 90


def test_possible_zero_slip_is_reported():
    velocity = np.zeros((3, 1, 3))
    velocity[:, 0, 0] = [0.30, TOP, 0.8]
    assert FrictionalInverse(SURFACE, ALUMINIUM).push(velocity, 0.0 * velocity).holds[:, 0].tolist() == [
        True,
        False,
        True,
    ]


@pytest.mark.parametrize("arguments, named", [
    ({"surface": Surface(horizontal_amplitude=3e-4)}, "parts"),
    ({"parts": Part.rectangle(0.05, 0.035, friction=0.0)}, "friction of part "),
    ({"limit": 0.0}, "limit"),
    ({"ahead": 0.05}, "ahead"),
    ({"surface": Surface(max_amplitude=0.0)}, "surface.max_amplitude"),
])  # fmt: skip
def test_scenes_that_it_does_not_cover_are_refused(arguments, named):
    with pytest.raises(ValueError, match=f"^{named}"):
        FrictionalInverse(**{"surface": SURFACE, "parts": ALUMINIUM, **arguments})
