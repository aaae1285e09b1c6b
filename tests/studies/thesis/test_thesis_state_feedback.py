"""Observer and state feedback, compared with python-control."""

import dataclasses
import math

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from studies.thesis.state_feedback import (
    DOUBLE_INTEGRATOR,
    FEEDBACK_GAINS,
    OBSERVER_GAINS,
    Estimate,
    Observer,
    StateSpaceLaw,
)
from tests.policies.helpers import info_of
from vibgym.policies.classical.linear_laws import discrete_lqr, discretize, polynomial
from vibgym.policies.classical.measured import Measured

A, B = DOUBLE_INTEGRATOR
T = 0.04


def test_the_gains_of_the_thesis():
    """R = [4, 4] puts both poles at -2 rad/s; L = [10, 25] both of the observer at -5 rad/s."""
    assert pytest.approx(control.acker(A, B, [-2.0, -2.0]).ravel()) == FEEDBACK_GAINS
    assert pytest.approx(polynomial("poles", [-5.0, -5.0], 2)[1:]) == OBSERVER_GAINS


@settings(max_examples=30)
@given(q=st.floats(1e-2, 1e4), v=st.floats(1e-2, 1e2), s=st.floats(1e-2, 1e2), drag=st.floats(0.0, 10.0))
def test_discrete_gains_are_those_of_python_control(q, v, s, drag):
    braked = np.array([[0.0, 1.0], [0.0, -drag]])
    f, g = discretize(braked, B, T)
    expected = control.c2d(control.ss(braked, B, np.eye(2), 0), T)
    assert f == pytest.approx(expected.A, abs=1e-12) and g == pytest.approx(expected.B, abs=1e-12)
    assert discrete_lqr(f, g, [q, v], s) == pytest.approx(control.dlqr(f, g, np.diag([q, v]), s)[0].ravel(), rel=1e-6)


def test_the_observer_is_that_of_python_control():
    """Discrete form, with random accelerations and positions, against python-control's simulation of A - L C."""
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(2, 60))
    gains = np.array([[7.0], [12.0]])
    expected = control.c2d(control.ss(A - gains @ [[1.0, 0.0]], np.hstack([B, gains]), np.eye(2), 0), T)
    _, states = control.forced_response(expected, T * np.arange(60), inputs)
    observer, estimate = Observer(T, gains=[7.0, 12.0]), Estimate(np.zeros((2, 1, 3)), np.zeros((2, 1, 3)))
    for k in range(60):
        assert estimate.position == pytest.approx(states[0, k], abs=1e-12)
        assert estimate.velocity == pytest.approx(states[1, k], abs=1e-12)
        estimate = observer.update(estimate, np.full((2, 1, 3), inputs[1, k]), np.full((2, 1, 3), inputs[0, k]))


@pytest.mark.parametrize(
    "poles",
    [[-1.0, 2.0], [-1.0, 0.0], [-1.0], [complex(-1, 1), -1.0], [-1.0, math.nan], "ab", [[-1, 1], [-1, 1]], None],
)
def test_invalid_poles_are_refused(poles):
    with pytest.raises(ValueError, match="poles"):
        polynomial("poles", poles, 2)


def test_state_space_controller_brings_parts_to_a_target_and_stops_them():
    info = info_of("Transport")
    law, measured = StateSpaceLaw(info), Measured.of(np.zeros((1, info.layout.size)), info)
    position, velocity, memory = np.array([[[0.0, 0.0]]]), np.zeros((1, 1, 2)), law.initial(1)
    for _ in range(int(6.0 / info.step_time)):
        now = dataclasses.replace(measured, centre=position)
        wanted, memory = law.wanted(now, 0.2 - position, np.zeros((1, 1)), memory)
        memory = law.applied(now, wanted, memory)
        velocity = velocity + info.step_time * wanted[..., :2]
        position = position + info.step_time * velocity
    assert position == pytest.approx(0.2, abs=2e-3) and velocity == pytest.approx(0.0, abs=2e-3)
