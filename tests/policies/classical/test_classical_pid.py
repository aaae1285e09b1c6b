"""The PID controller: its gains, eq. 5.81, the closed loop's step response, and windup."""

import math

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as runs
from hypothesis import strategies as st

from vibgym.policies.classical.linear_laws import Pid, gains_for

T = 0.04


def run(pid, errors):
    """Return the outputs for a sequence of errors (n,)."""
    memory, outputs = pid.initial((1,)), []
    for error in errors:
        wanted, memory = pid.output(np.array([error]), memory)
        outputs.append(wanted[0])
    return np.array(outputs)


def step(pid, period, seconds, limit=math.inf):
    """Positions of the reduced plant after a step of 1 m in the set value, its acceleration limited."""
    memory, p, v, seen = pid.initial((1,)), 0.0, 0.0, []
    for _ in range(round(seconds / period)):
        wanted, memory = pid.output(np.array([1.0 - p]), memory)
        a = min(max(wanted[0], -limit), limit)
        memory = pid.applied(np.array([a]), memory)
        p, v = p + period * v + 0.5 * period**2 * a, v + period * a
        seen.append(p)
    return np.array(seen)


def test_the_thesiss_gains():
    assert gains_for() == pytest.approx((12.0, 8.0, 6.0))


@runs(max_examples=30)
@given(b1=st.floats(-9, -0.1), b2=st.floats(-9, -0.1), b3=st.floats(0, 9))
def test_the_closed_loop_has_the_poles(b1, b2, b3):
    gains = gains_for([b1, complex(b2, b3), complex(b2, -b3)])
    loop = control.feedback(control.tf([gains.derivative, gains.proportional, gains.integral], [1, 0, 0, 0]), 1)
    assert np.polyval(loop.den[0][0], [b1, complex(b2, b3)]) == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("settings, below", [({"late": False}, [1.0, -1.0, 0.0]), ({}, [1.0, -1.0, 0.0, 0.0])])
def test_it_is_equation_5_81(settings, below):
    """Against python-control's simulation of the transfer function, with and without the extra period."""
    kp, ki, kd = gains_for()
    above = [kd / T + kp + ki * T, -(2.0 * kd / T + kp), kd / T]
    errors = np.random.default_rng(0).normal(size=50)
    _, expected = control.forced_response(control.tf(above, below, T), T * np.arange(50), errors)
    assert run(Pid(T, **settings), errors) == pytest.approx(expected, rel=1e-9, abs=1e-8)


def test_the_reduced_plant_overshoots_by_a_fifth():
    """Fig. 5.19: 1 - exp(-2 t) (1 - 4 t + 2 t^2), which is 20.6 % too far at (3 - sqrt(3)) / 2 s."""
    t = np.arange(1, 5001) * 1e-3
    assert step(Pid(1e-3, late=False), 1e-3, 5.0) == pytest.approx(
        1.0 - np.exp(-2.0 * t) * (1.0 - 4.0 * t + 2.0 * t**2), abs=0.01
    )
    assert step(Pid(1e-4, late=False), 1e-4, 1.0).max() == pytest.approx(1.206, abs=0.001)


def test_windup_and_what_prevents_it():
    """Under limited acceleration the integral of the error causes overshoot, unless it is frozen."""
    wound, plain = step(Pid(T), T, 8.0, limit=3.0), step(Pid(T, anti_windup=True), T, 8.0, limit=3.0)
    assert wound.max() > 1.3 and plain.max() < 1.15
    free = step(Pid(T), T, 8.0)
    assert (step(Pid(T, anti_windup=True), T, 8.0) == free).all()  # no effect without a limit


def test_axes_are_independent():
    errors = np.random.default_rng(1).normal(size=(20, 3, 2, 3))
    pid = Pid(T, anti_windup=True)
    memory = pid.initial((3, 2, 3))
    for k in range(20):
        wanted, memory = pid.output(errors[k], memory)
        assert wanted[1, 0, 2] == run(pid, errors[: k + 1, 1, 0, 2])[-1]


@pytest.mark.parametrize("poles", [[-2.0, -2.0, 0.1], [-2.0, complex(-1, 1), complex(-1, 2)], [-2.0, -2.0]])
def test_poles_are_three_stable_and_conjugate(poles):
    with pytest.raises(ValueError, match="^poles"):
        Pid(T, poles=poles)
