"""Routes against closed forms, against their own derivatives, and against plain integration of the direction."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibgym.tasks import paths as route

WINDOW = 0.06


def made(start, lengths, curvatures, speed=0.15, acceleration=0.7, heading=0.0, along=0.0):
    rows = (start, lengths, curvatures, [0.0, speed, acceleration, WINDOW, heading, along])
    return route.routes(*(np.array([each], dtype=float) for each in rows))[0]


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
