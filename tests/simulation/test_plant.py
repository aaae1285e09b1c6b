"""The linear model of a sliding part: its solution against the equation, and the drag."""

import math

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.simulation.plant import drag_of, motion, plant_of, top_slip

SURFACE, PART = Surface(), Part.rectangle(0.05, 0.035, friction=0.58)


@pytest.mark.parametrize("drag", [0.0, 1e-6, 0.3, 6.7])
def test_motion_solves_the_equation(drag):
    """Against many small steps of Heun's method."""
    time, steps = 0.12, 4000
    h, state = time / steps, np.array([[0.0, 1.0], [0.0, 0.0]])  # p, v for a unit of velocity, and of push
    push = np.array([0.0, 1.0])

    def rate(of):
        return np.stack([of[:, 1], -drag * of[:, 1] + push], axis=-1)

    for _ in range(steps):
        state = state + 0.5 * h * (rate(state) + rate(state + h * rate(state)))
    way, fall, left = motion.py_func(drag, time)
    assert [way, left, fall, way] == pytest.approx(state.ravel().tolist(), rel=1e-6)


def test_drag_is_the_closed_form_and_a_still_table_has_one():
    expected = 0.58 * 9.81 / (2.0 * 2.7e-3 * 2.0 * math.pi * 25.0)
    assert drag_of(SURFACE, [PART]) == pytest.approx([expected])
    assert np.isfinite(drag_of(Surface(horizontal_amplitude=0.0), [PART])).all()


def test_top_speed_grows_with_strength_slower_than_it():
    weak, full = plant_of(SURFACE, [PART], 0.5), plant_of(SURFACE, [PART])
    assert 2.0 * weak.push == pytest.approx(full.push) and weak.drag == full.drag
    assert 0.5 * full.top_speed < weak.top_speed < full.top_speed
    assert top_slip(1.0) == pytest.approx(top_slip(1.0 - 1e-12), abs=1e-9)
