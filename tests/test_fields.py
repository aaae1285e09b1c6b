"""Vector fields: closed forms, and effect on a part."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibgym import Part, Simulator, Surface
from vibgym.fields import Field, MovingSqueeze, lead_angle, radial, squeeze, tangential, uniform
from vibgym.physics.core.drive import all_phasors, polar_drive

SURFACE = Surface()
BLOCK = Part.rectangle(0.050, 0.035, friction=0.58)
near = st.floats(-1.0, 1.0)


@given(direction=st.floats(-10, 10), strength=near, x=near, y=near)
def test_uniform_is_the_same_everywhere(direction, strength, x, y):
    push = uniform(direction, strength).push(np.array([x]), np.array([y]))
    assert np.ravel(push) == pytest.approx([strength * math.cos(direction), strength * math.sin(direction)], abs=1e-15)


@given(x=near, y=near, angle=st.floats(-4, 4), strength=near, along=near, across=near, reach=st.floats(0.001, 0.5))
def test_squeeze_pushes_towards_its_line(x, y, angle, strength, along, across, reach):
    at_x = x + along * math.cos(angle) - across * math.sin(angle)
    at_y = y + along * math.sin(angle) + across * math.cos(angle)
    px, py = squeeze(x, y, angle, strength, reach).push(np.array(at_x), np.array(at_y))
    toward = -strength * min(max(across / reach, -1.0), 1.0)
    assert (float(px), float(py)) == pytest.approx((-toward * math.sin(angle), toward * math.cos(angle)), abs=1e-11)


@given(x=near, y=near, strength=near, distance=st.floats(0, 1), angle=st.floats(-4, 4), reach=st.floats(0.001, 0.5))
def test_radial_and_tangential_are_central(x, y, strength, distance, angle, reach):
    outward = np.array([math.cos(angle), math.sin(angle)])
    at_x, at_y = np.array(x + distance * outward[0]), np.array(y + distance * outward[1])
    size = strength * min(distance / reach, 1.0)
    assert radial(x, y, strength, reach).push(at_x, at_y) == pytest.approx(-size * outward, abs=1e-11)
    left = np.array([-outward[1], outward[0]])
    assert tangential(x, y, strength, reach).push(at_x, at_y) == pytest.approx(size * left, abs=1e-11)


@given(x=near, y=near, factor=st.floats(-3, 3))
def test_sum_and_scale(x, y, factor):
    a, b, at = radial(0.2, 0.1), uniform(0.4, 0.7), (np.array(x), np.array(y))
    first, second = np.ravel(a.push(*at)), np.ravel(b.push(*at))
    assert np.ravel((a + b).push(*at)) == pytest.approx(first + second, abs=1e-14)
    assert np.ravel((factor * a).push(*at)) == pytest.approx(factor * first, abs=1e-14)
    assert np.ravel((a * factor + 2 * b).push(*at)) == pytest.approx(factor * first + 2 * second, abs=1e-14)


def test_around_leaves_the_rest_at_rest():
    x, y = SURFACE.element_centres()
    phasors = uniform(0.3).around(0.4, 0.1, 0.05).phasors(SURFACE)
    moving = np.hypot(phasors[..., 0], phasors[..., 1]) > 0
    assert (moving == (np.hypot(x - 0.4, y - 0.1) <= 0.05)).all()
    assert 0 < moving.sum() < 20
    assert (phasors[moving] == uniform(0.3).phasors(SURFACE)[moving]).all()


def test_one_field_a_world():
    numbers = np.array([[0.1, 0.05, 1.0], [0.4, 0.1, -0.5], [0.7, 0.15, 0.0]])
    fields = {
        "radial": radial,
        "tangential": tangential,
        "squeeze": lambda x, y, strength: squeeze(x, y, 10 * x, strength),
        "around": lambda x, y, strength: (uniform(10 * x) + strength * radial(x, y)).around(x, y, 0.1),
    }
    for name, field in fields.items():
        phasors = field(*numbers.T[:, :, None, None]).phasors(SURFACE, friction=0.5)
        assert phasors.shape == (3, 8, 32, 2), name
        for k in range(3):
            assert phasors[k] == pytest.approx(field(*numbers[k]).phasors(SURFACE, friction=0.5), abs=1e-15), name


@given(seed=st.integers(0, 1000), friction=st.one_of(st.none(), st.floats(0, 1)))
def test_phasors_stay_in_the_unit_disc_and_agree_with_drives(seed, friction):
    a, b, c, d = np.random.default_rng(seed).uniform(-2, 2, 4)
    field = a * radial(0.4, 0.1) + uniform(b, c) + d * squeeze(0.2, 0.1, b)
    phasors = field.phasors(SURFACE, friction=friction)
    length = np.hypot(phasors[..., 0], phasors[..., 1])
    assert phasors.shape == (8, 32, 2) and length.max() <= 1.0 + 1e-12
    amplitude, phase = field.drive(SURFACE, friction=friction)
    assert amplitude.max() <= SURFACE.max_amplitude and amplitude.min() >= 0
    assert np.abs(phase).max() <= math.pi
    dense = np.empty((1, 8, 32, 2))
    all_phasors(polar_drive(amplitude[None], phase[None], SURFACE.angular_frequency), dense)
    assert dense[0] / SURFACE.full_scale == pytest.approx(phasors, abs=1e-12)


def test_pushes_longer_than_full_amplitude_are_shortened_only():
    phasors = uniform(0.7, 5.0).phasors(SURFACE)
    # A push along (cos, sin) is the phasor -(sin, cos): the mean acceleration is -(mu / 2) (S, C) near rest.
    assert phasors.reshape(-1, 2) == pytest.approx(np.tile([-math.sin(0.7), -math.cos(0.7)], (256, 1)))
    weak = uniform(0.7, 0.25).phasors(SURFACE)
    assert np.hypot(weak[..., 0], weak[..., 1]) == pytest.approx(0.25)


def test_friction_correction_rotates_the_push_by_the_lead_angle():
    lead = lead_angle(SURFACE, 0.6)
    assert lead == pytest.approx(1.6 * math.atan(0.6 * 9.81 / (2.7e-3 * (50 * math.pi) ** 2)))
    assert uniform(0.5).phasors(SURFACE, friction=0.6) == pytest.approx(uniform(0.5 - lead).phasors(SURFACE))
    assert lead_angle(SURFACE, 0.0) == 0.0
    assert lead_angle(Surface(horizontal_amplitude=0.0), 0.6) == 0.0


# -- effect on a part --------------------------------------------------------------------------------------------------


def after(field, pose, periods, part=BLOCK, friction=0.58):
    pose = np.atleast_2d(pose)
    simulator = Simulator(SURFACE, part, worlds=len(pose))
    simulator.reset(pose[:, None], [*SURFACE.idle_velocity(part.friction), 0.0])
    simulator.advance(*field.drive(SURFACE, friction=friction), periods=periods)
    assert not simulator.fallen.any() and not simulator.sticking.any()
    return simulator.pose[:, 0], simulator.mean_velocity[:, 0]


def angle_between(a, b):
    return abs((a - b + math.pi) % (2 * math.pi) - math.pi)


@pytest.mark.parametrize("strength", [0.3, 0.6])
@pytest.mark.parametrize("friction", [0.3, 0.58, 0.9])
@pytest.mark.parametrize("direction", [0.0, 0.9, math.pi / 2, 2.5, -2.0, -0.7])
def test_uniform_moves_a_part_along_its_direction(direction, friction, strength):
    part, start = Part.rectangle(0.050, 0.035, friction=friction), np.array([0.416, 0.104, 0.3])
    end, mean = after(uniform(direction, strength), start, 10, part, friction)
    moved = end[0, :2] - start[:2]
    assert np.hypot(*moved) > 0.02
    # Measured error of the direction: mean velocity at most 0.9 degrees, displacement 1.6 (a part starts sideways).
    assert math.degrees(angle_between(math.atan2(mean[0, 1], mean[0, 0]), direction)) < 1.5
    assert math.degrees(angle_between(math.atan2(moved[1], moved[0]), direction)) < 2.5
    assert abs(end[0, 2] - start[2]) < 0.05


def starts(worlds, low, high, seed=0):
    return np.random.default_rng(seed).uniform([*low, -3], [*high, 3], (worlds, 3))


@pytest.mark.parametrize("angle", [0.0, 0.3, math.pi / 2])
def test_squeeze_moves_parts_to_its_line(angle):
    start = starts(8, (0.34, 0.06), (0.46, 0.15))
    across = np.array([-math.sin(angle), math.cos(angle)])
    end, mean = after(squeeze(0.4, 0.104, angle), start, 100)
    assert np.abs((start[:, :2] - [0.4, 0.104]) @ across).max() > 0.03
    assert np.abs((end[:, :2] - [0.4, 0.104]) @ across).max() < 0.0025  # elements of 26 mm make a coarse line
    assert np.abs(mean[:, :2]).max() < 0.01


def test_radial_moves_parts_to_its_centre():
    start = starts(8, (0.1, 0.05), (0.7, 0.16))
    end, mean = after(radial(0.4, 0.104), start, 120)
    assert np.hypot(*(start[:, :2] - [0.4, 0.104]).T).max() > 0.2
    assert np.hypot(*(end[:, :2] - [0.4, 0.104]).T).max() < 0.004
    assert np.abs(mean[:, :2]).max() < 0.01


@pytest.mark.parametrize("strength", [1.0, -1.0])
def test_tangential_turns_counter_clockwise_and_clockwise(strength):
    start = np.column_stack([np.full(6, 0.403), np.full(6, 0.103), np.linspace(-3, 3, 6)])
    end, mean = after(tangential(0.403, 0.103, strength) + radial(0.403, 0.103), start, 15)
    assert (strength * (end[:, 2] - start[:, 2]) > 1.0).all()
    assert (strength * mean[:, 2] > 2.0).all()
    assert np.hypot(*(end[:, :2] - [0.403, 0.103]).T).max() < 0.02


# -- user-defined fields and moving lines ------------------------------------------------------------------------------


def test_a_user_defined_field():
    saddle = Field(lambda x, y: (x - 0.4, 0.1 - y))
    phasors = saddle.phasors(SURFACE)
    x, y = SURFACE.element_centres()
    assert phasors[..., 0] == pytest.approx(y - 0.1) and phasors[..., 1] == pytest.approx(0.4 - x)


@given(x=near, y=near, angle=st.floats(-4, 4), vx=near, vy=near, time=st.floats(0, 10), at_x=near, at_y=near)
def test_a_moving_line_equals_the_displaced_line(x, y, angle, vx, vy, time, at_x, at_y):
    moved = squeeze(x + time * vx, y + time * vy, angle).push(np.array(at_x), np.array(at_y))
    line = MovingSqueeze(x, y, angle, (vx, vy))
    assert np.ravel(line.at(time).push(np.array(at_x), np.array(at_y))) == pytest.approx(np.ravel(moved), abs=1e-9)


def test_a_line_with_a_pitch_is_on_edges_of_elements():
    size = SURFACE.element_size
    line = MovingSqueeze(4 * size, 0.1, math.pi / 2, (0.1, 0.3), pitch=size)
    at = np.array([line.place(time) for time in np.linspace(0.0, 3.0, 200)])
    steps = (at[:, 0] - 4 * size) / size
    assert np.abs(steps - np.round(steps)).max() < 1e-9 and set(np.round(steps)) == set(range(13))
    assert at[:, 1] == pytest.approx(0.1)  # the velocity along the line has no effect
    assert np.abs(at[:, 0] - 4 * size - 0.1 * np.linspace(0.0, 3.0, 200)).max() <= 0.5 * size + 1e-9


def lags(velocity, part=BLOCK, seconds=4.0, pitch=None, reach=0.026):
    """Return the lag (m) of a part behind a line with ``velocity`` (m/s) along the table, for every period."""
    simulator, start = Simulator(SURFACE, (part,)), 4 * SURFACE.element_size
    simulator.reset([[[start, 0.104, 0.0]]])
    line = MovingSqueeze(start, 0.104, math.pi / 2, (velocity, 0.0), pitch=pitch, reach=reach)
    behind = []
    for k in range(int(min(seconds, 0.64 / velocity) / SURFACE.period)):
        field = line.at((k + 0.5) * SURFACE.period)
        simulator.advance(*field.drive(SURFACE, friction=part.friction), periods=1)
        behind.append(start + velocity * (k + 1) * SURFACE.period - simulator.state.pose[0, 0, 0])
    return np.array(behind)


def test_parts_follow_a_slow_line_at_the_distance_of_equilibrium():
    # Two elements wide within the reach: the mean push under it is linear in the distance.
    part = Part.rectangle(0.052, 0.078, friction=0.58)
    slow, fast = (lags(v, part, seconds=9.0, reach=0.078)[100:].mean() for v in (0.03, 0.06))
    # mu a_v w^2 / 2 * lag / reach = mu g v / (2 a_h w); friction cancels. The difference is free of the wobble in a period.
    closed = 0.078 * SURFACE.gravity / (SURFACE.full_scale * SURFACE.table_speed)
    assert (fast - slow) / 0.03 == pytest.approx(closed, rel=0.05)


@pytest.mark.parametrize("steps", [{}, {"pitch": 0.026, "reach": 0.001}])
def test_a_line_transports_parts_up_to_their_speed_at_full_strength(steps):
    simulator = Simulator(SURFACE, (BLOCK,))
    simulator.reset([[[0.1, 0.104, 0.0]]])
    simulator.advance(*uniform(0.0).drive(SURFACE, friction=BLOCK.friction), periods=40)
    most = float(np.hypot(*simulator.state.mean_velocity[0, 0, :2]))
    caught, lost = lags(0.9 * most, **steps), lags(1.1 * most, **steps)
    assert caught.max() < 0.06 and caught[-1] < caught[len(caught) // 2] + 0.013
    late = len(lost) // 2
    rate = np.polyfit(SURFACE.period * np.arange(late, len(lost)), lost[late:], 1)[0]
    assert rate == pytest.approx(0.1 * most, rel=0.25) and lost[-1] > 0.05


LINE = {"x": 0.1, "y": 0.1, "angle": 0.0, "velocity": (0.1, 0.0)}


@pytest.mark.parametrize("name, make", [  # constructors of fields: see tests/fuzz/test_calls.py
    ("strength", lambda: uniform(0.0) * "two"),
    ("velocity", lambda: MovingSqueeze(**LINE | {"velocity": 0.1})),
    ("velocity[1]", lambda: MovingSqueeze(**LINE | {"velocity": (0.1, math.nan)})),
    ("pitch", lambda: MovingSqueeze(**LINE, pitch=0.0)),
    ("reach", lambda: MovingSqueeze(**LINE, reach=-1.0)),
    ("angle", lambda: MovingSqueeze(**LINE | {"angle": "up"})),
])  # fmt: skip
def test_bad_input_is_named(name, make):
    with pytest.raises(ValueError) as error:
        make()
    assert name in str(error.value) and "\n" not in str(error.value)
