"""Routes and limits of motion against closed forms, their own derivatives, plain integration, and the averaged model."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ellipe, ellipk

from tests.allocation.averaged_model import mean_acceleration
from vibgym import Part, Surface
from vibgym.simulation.plant import means
from vibgym.tasks import paths as route
from vibgym.tasks.paths import EFFORT, Reach

WINDOW = 0.06


def made(start, lengths, curvatures, speed=0.15, acceleration=0.7, heading=0.0, along=0.0):
    rows = (start, lengths, curvatures, [0.0, speed, acceleration, WINDOW, heading, along])
    return route.routes(*(np.array([values], dtype=float) for values in rows))[0]


EITHER = st.sampled_from([0.0, 1.0])


@st.composite
def paths(draw, along=EITHER):
    count = draw(st.integers(1, 6))
    lengths = draw(st.lists(st.sampled_from([0.0, 0.02, 0.1]) | st.floats(0.01, 0.3), min_size=count, max_size=count))
    curvatures = draw(st.lists(st.sampled_from([0.0, 0.0, 40.0]) | st.floats(-60, 60), min_size=count, max_size=count))
    if sum(lengths) < 0.01:
        lengths[0] = 0.05
    start = [draw(st.floats(-1, 1)), draw(st.floats(-1, 1)), draw(st.floats(-3, 3))]
    return made(start, lengths, curvatures, draw(st.floats(0.01, 0.3)), draw(st.floats(0.1, 3)), 0.4, draw(along)), (
        start,
        lengths,
        curvatures,
    )


def test_a_circle_is_a_circle():
    path = made([0.4 + 0.06, 0.1, math.pi / 2], [2 * math.pi * 0.06], [1 / 0.06])
    times = np.linspace(0.0, route.duration(path[0]), 300)
    motion = route.sample(path, times)
    assert np.hypot(motion[:, 0] - 0.4, motion[:, 1] - 0.1) == pytest.approx(0.06, abs=1e-14)
    assert motion[-1, :2] == pytest.approx(motion[0, :2], abs=1e-14)
    cruising = (times > 0.15 / 0.7) & (times < times[-1] - 0.15 / 0.7)
    assert motion[cruising, 7] == pytest.approx(0.15**2 / 0.06)
    turned = np.unwrap(np.arctan2(motion[:, 1] - 0.1, motion[:, 0] - 0.4))
    assert turned[-1] - turned[0] == pytest.approx(2 * math.pi)


@pytest.mark.parametrize("length, peak", [(0.3, 0.15), (0.01, math.sqrt(0.7 * 0.01))], ids=["trapezoid", "triangle"])
def test_speed_is_a_trapezoid_over_time(length, peak):
    path = made([0, 0, 0], [length], [0.0])
    assert route.duration(path[0]) == pytest.approx(length / peak + peak / 0.7)
    times = np.linspace(-0.1, route.duration(path[0]) + 0.2, 4001)
    motion = route.sample(path, times)
    expected = np.clip(np.minimum(0.7 * times, 0.7 * (route.duration(path[0]) - times)), 0.0, peak)
    assert motion[:, 3] == pytest.approx(expected, abs=1e-12)
    assert (motion[times < 0, 0] == 0).all() and motion[times > times[-1] - 0.2, 0] == pytest.approx(length, abs=1e-15)


@given(paths())
def test_velocity_is_the_derivative_of_the_pose(made_of):
    path, _ = made_of
    end, h = route.duration(path[0]), 1e-5
    times = np.linspace(0.0, end, 97)[1:-1]
    before, at, after = (route.sample(path, times + k * h) for k in (-1, 0, 1))
    slope = (after[:, :3] - before[:, :3]) / (2 * h)
    assert slope == pytest.approx(at[:, 3:6], abs=5e-3)  # at a joint the spin has a bend
    # Where a line meets an arc the spin has a bend, and there alone.
    turning = (after[:, 5] - before[:, 5]) / (2 * h)
    assert np.median(np.abs(turning - at[:, 8])) < 1e-3
    speed = np.hypot(*at[:, 3:5].T)
    assert (np.hypot(*after[:, 3:5].T) - np.hypot(*before[:, 3:5].T)) / (2 * h) == pytest.approx(at[:, 6], abs=3.0)
    assert (speed <= path[0, route.SPEED] * (1 + 1e-12)).all()


@given(paths())
def test_the_position_is_the_integral_of_the_direction(made_of):
    path, (start, lengths, curvatures) = made_of
    n = 4000
    s = (np.arange(n) + 0.5) * (sum(lengths) / n)
    ends = np.cumsum(lengths)
    piece = np.minimum(np.searchsorted(ends, s), len(lengths) - 1)
    turn = np.concatenate([[0.0], np.cumsum(np.array(lengths) * curvatures)])
    direction = start[2] + turn[piece] + np.array(curvatures)[piece] * (s - np.concatenate([[0.0], ends])[piece])
    last = route.sample(path, np.array([route.duration(path[0])]))[0]
    step = sum(lengths) / n
    assert last[0] == pytest.approx(start[0] + step * np.cos(direction).sum(), abs=1e-4)
    assert last[1] == pytest.approx(start[1] + step * np.sin(direction).sum(), abs=1e-4)
    assert last[3:7] == pytest.approx(0.0, abs=1e-12)


@given(paths(along=st.just(1.0)))
def test_a_heading_along_the_path_is_its_mean_direction(made_of):
    path, (start, lengths, curvatures) = made_of
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    turn = np.concatenate([[0.0], np.cumsum(np.array(lengths) * curvatures)])
    for share in (0.0, 0.3, 0.5, 0.8, 1.0):
        time = share * route.duration(path[0])
        s = route.progress(path[0], time)[0]
        about = s + WINDOW * ((np.arange(6000) + 0.5) / 6000 - 0.5)
        mean = start[2] + np.interp(about, ends, turn).mean()  # constant beyond the ends
        heading = route.sample(path, np.array([time]))[0, 2]
        assert heading == pytest.approx(0.4 + mean, abs=1e-3)


def test_padding_rows_have_no_effect():
    path = made([0.1, 0.2, 0.3], [0.1, 0.05], [0.0, 30.0], along=1.0)
    times = np.linspace(-0.1, 3.0, 200)
    assert (route.sample(route.padded(path, 20), times) == route.sample(path, times)).all()


# -- limits of motion ----------------------------------------------------------------------------------------------------


SURFACE = Surface()
BLOCK = Part.rectangle(0.050, 0.035, friction=0.58)
REACH = Reach(SURFACE, BLOCK)


def test_means_are_the_elliptic_integrals():
    s, drag, across, along = (values[10:900] for values in means())
    m = 4 * s / (1 + s) ** 2
    k, e = ellipk(m), ellipe(m)
    i0, r1 = 2 / np.pi * k / (1 + s), 2 / np.pi * (1 + s) * e
    r3 = 2 / np.pi * (1 + s) ** 3 * (2 * (2 - m) * e - (1 - m) * k) / 3
    s1 = (r1 - (1 + s**2) * i0) / (2 * s)
    s2 = (r3 - 2 * (1 + s**2) * r1 + (1 + s**2) ** 2 * i0) / (4 * s**2)
    assert drag == pytest.approx(s * i0 + s1, abs=1e-9)
    assert across == pytest.approx(i0 - s2, abs=1e-9)
    assert along == pytest.approx(s2 + s * s1, abs=1e-9)


def test_top_speed_is_that_of_the_thesis():
    """Thesis eq. 3.41: 0.70 to 0.72 of the table's speed at any friction."""
    assert REACH.top_speed / SURFACE.table_speed == pytest.approx(0.71917, abs=2e-5)
    assert Reach(SURFACE, Part.disc(0.02, friction=0.3)).top_speed == pytest.approx(REACH.top_speed)
    half = Surface(max_amplitude=0.5 * SURFACE.max_amplitude)
    assert Reach(half, BLOCK).top_speed < 0.7 * REACH.top_speed
    assert REACH.effort(REACH.fastest) == pytest.approx(EFFORT, abs=1e-6)


@pytest.mark.parametrize("speed, along, across", [
    (0.0, 1.5, 0.0), (0.0, 0.0, -2.0), (0.15, 0.6, 0.0), (0.15, -1.0, 1.2), (0.25, 0.0, 0.5), (0.1, 0.3, -2.0)
])  # fmt: skip
def test_an_effort_gives_its_acceleration(speed, along, across):
    """Elements in unison, with that share of the amplitude and the best phase, give this acceleration in the averaged model."""
    effort = float(REACH.effort(speed, along, across))
    assert 0.0 < effort < 1.0
    phase = np.linspace(-np.pi, np.pi, 721)
    pose, velocity = np.tile([0.4, 0.104, 0.3], (len(phase), 1)), [speed, 0.0, 0.0]

    def missed(share):
        amplitude = share * effort * SURFACE.max_amplitude
        got = mean_acceleration(SURFACE, BLOCK, pose, velocity, amplitude, phase[:, None, None], order=1)
        return np.hypot(got[:, 0] - along, got[:, 1] - across).min()

    assert missed(1.0) < 0.02  # the phases are 0.5 deg apart
    assert missed(0.9) > 3 * missed(1.0)


def test_rotation_and_displacement_share_the_effort():
    assert REACH.effort(0.1, turning=5.0) > REACH.effort(0.1)
    assert REACH.effort(0.1, spin=-2.0) == REACH.effort(0.1, spin=2.0) > REACH.effort(0.1)


def test_corners_leave_amplitude_and_are_larger_where_the_part_turns():
    radii = [REACH.corner(share * REACH.top_speed) for share in (0.2, 0.4, 0.6, 0.8)]
    assert radii == sorted(radii)
    for share, radius in zip((0.2, 0.4, 0.6, 0.8), radii, strict=True):
        speed = share * REACH.top_speed
        effort = REACH.effort(speed, across=speed**2 / radius)
        assert effort == pytest.approx(0.5 * (REACH.effort(speed) + EFFORT), abs=1e-5)
        assert REACH.corner(speed, 2 * BLOCK.radius) > radius
    assert math.isfinite(REACH.corner(REACH.fastest))
