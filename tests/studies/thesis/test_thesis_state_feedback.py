"""Gains from poles and weights, observer and state feedback, with python-control as the judge."""

import dataclasses
import math

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from studies.thesis.state_feedback import (
    DOUBLE_INTEGRATOR,
    Estimate,
    Observer,
    StateFeedback,
    StateSpaceLaw,
    ackermann,
    riccati,
)
from tests.policies.helpers import info_of
from vibgym.policies.classical.lqr import discrete_lqr, discretize
from vibgym.policies.classical.measured import Measured
from vibgym.policies.classical.pid import polynomial

A, B = DOUBLE_INTEGRATOR
T = 0.04
RATES = st.floats(0.1, 20.0)


@settings(max_examples=30)
@given(real=RATES, imaginary=RATES)
def test_poles_are_placed_as_the_judge_places_them(real, imaginary):
    for poles in ([-real, -imaginary], [complex(-real, imaginary), complex(-real, -imaginary)]):
        assert ackermann(A, B, poles) == pytest.approx(control.acker(A, B, poles).ravel(), rel=1e-9)
    assert ackermann(A, B, [[-real, imaginary], [-real, -imaginary]]) == pytest.approx(
        [real**2 + imaginary**2, 2.0 * real]
    )


def test_the_thesiss_gains():
    """R = [4, 4] puts both poles at -2 rad/s; L = [10, 25] both of the observer at -5 rad/s."""
    assert StateFeedback().gains == pytest.approx([4.0, 4.0])
    assert np.linalg.eigvals(A - B @ StateFeedback().gains[None]) == pytest.approx(-2.0, abs=1e-7)
    assert Observer(T).gains == pytest.approx([10.0, 25.0]) == Observer(T, poles=[-5.0, -5.0]).gains


@settings(max_examples=30)
@given(q=st.floats(1e-2, 1e4), v=st.floats(1e-2, 1e2), s=st.floats(1e-2, 1e2), drag=st.floats(0.0, 10.0))
def test_riccati_gains_are_the_judges(q, v, s, drag):
    braked = np.array([[0.0, 1.0], [0.0, -drag]])
    assert riccati(braked, B, [q, v], s) == pytest.approx(
        control.lqr(braked, B, np.diag([q, v]), s)[0].ravel(), rel=1e-6
    )
    f, g = discretize(braked, B, T)
    judged = control.c2d(control.ss(braked, B, np.eye(2), 0), T)
    assert f == pytest.approx(judged.A, abs=1e-12) and g == pytest.approx(judged.B, abs=1e-12)
    assert discrete_lqr(f, g, [q, v], s) == pytest.approx(control.dlqr(f, g, np.diag([q, v]), s)[0].ravel(), rel=1e-6)


def test_riccati_of_the_double_integrator_in_closed_form():
    assert StateFeedback(state_weights=[9.0, 2.0], control_weight=4.0).gains == pytest.approx(
        [1.5, math.sqrt(2.0 * 1.5 + 0.5)]
    )


def test_the_observer_is_the_judges_observer():
    """Its discrete form, driven by any accelerations and positions, against python-control's simulation of A - L C."""
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(2, 60))
    gains = np.array([[7.0], [12.0]])
    judge = control.c2d(control.ss(A - gains @ [[1.0, 0.0]], np.hstack([B, gains]), np.eye(2), 0), T)
    _, states = control.forced_response(judge, T * np.arange(60), inputs)
    observer, estimate = Observer(T, gains=[7.0, 12.0]), Estimate(np.zeros((2, 1, 3)), np.zeros((2, 1, 3)))
    for k in range(60):
        assert estimate.position == pytest.approx(states[0, k], abs=1e-12)
        assert estimate.velocity == pytest.approx(states[1, k], abs=1e-12)
        estimate = observer.update(estimate, np.full((2, 1, 3), inputs[1, k]), np.full((2, 1, 3), inputs[0, k]))


def test_the_observers_error_dies_out_with_its_poles():
    """What is left at a steady speed is what it costs to hold positions for a period: l2 T^2 / 12 of the speed."""
    observer, error = Observer(T, poles=[-3.0, -8.0]), []
    assert sorted(np.linalg.eigvals(observer.f)) == pytest.approx(np.exp([-8.0 * T, -3.0 * T]))
    p, v = 0.2, -0.1
    estimate = Estimate(np.zeros(1), np.zeros(1))
    for _ in range(200):
        error.append(float(estimate.velocity[0]) / v - 1.0)
        estimate, p = observer.update(estimate, np.array([p]), np.zeros(1)), p + T * v
    assert error[-1] == pytest.approx(-24.0 * T**2 / 12.0, rel=0.1)
    left = np.array(error) - error[-1]
    assert left[75] / left[50] == pytest.approx(math.exp(-3.0 * 25 * T), rel=0.02)


@pytest.mark.parametrize(
    "poles",
    [[-1.0, 2.0], [-1.0, 0.0], [-1.0], [complex(-1, 1), -1.0], [-1.0, math.nan], "ab", [[-1, 1], [-1, 1]], None],
)
def test_poles_that_no_controller_can_have_are_refused(poles):
    told = r"{}"
    with pytest.raises(ValueError, match=told.format("poles")):
        polynomial("poles", poles, 2)
    if poles is not None:
        with pytest.raises(ValueError, match=told.format("poles")):
            StateFeedback(poles=poles)
        with pytest.raises(ValueError, match=told.format("observer poles")):
            Observer(T, poles=poles)


@pytest.mark.parametrize("arguments, told", [
    ({"state_weights": [0.0, 1.0]}, r"state_weights\[0\]"),
    ({"state_weights": [1.0, -1.0]}, r"state_weights\[1\]"),
    ({"state_weights": [1.0]}, r"state_weights"),
    ({"state_weights": [1.0, 1.0], "control_weight": 0.0}, r"control_weight"),
    ({"state_weights": [1.0, 1.0], "poles": [-1.0, -1.0]}, r"poles"),
])  # fmt: skip
def test_weights_that_are_not_positive_are_refused(arguments, told):
    with pytest.raises(ValueError, match=f"^{told}"):
        StateFeedback(**arguments)


def test_observers_that_do_not_converge_are_refused():
    with pytest.raises(ValueError, match=r"observer gains\[1\]"):
        Observer(T, gains=[10.0, 0.0])
    with pytest.raises(ValueError, match="observer poles"):
        Observer(T, gains=[10.0, 25.0], poles=[-5.0, -5.0])
    with pytest.raises(ValueError, match="period"):
        Observer(0.0)


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
