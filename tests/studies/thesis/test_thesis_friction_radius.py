"""The friction experiment: two branches, the window between them, and the coefficient that a fit gets back."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from studies.thesis.friction_radius import (
    FREQUENCIES,
    GRAVITY,
    HORIZONTAL_AMPLITUDE,
    NOISE,
    STATIC_RATIO,
    closed_form_radius,
    experiment,
    fit_friction,
    sliding_circles,
    sweep,
    transition_frequency,
)
from studies.thesis.machine import Machine
from vibgym import Part, Surface
from vibgym.scene.parts import SHIPPED

MU = {name: properties["friction"] for name, properties in SHIPPED.items()}
FINE = np.linspace(1.0, 10.0, 91)


def block(name, ratio=1.0):
    return Part.rectangle(**SHIPPED[name], static_friction=ratio * MU[name], name=name)


def test_the_experiment_follows_the_closed_forms_and_recovers_both_coefficients():
    """Radii within 0.1 % away from the transitions, which are at 7.67 and 7.31 Hz in the thesis."""
    blocks = experiment(FINE, static_ratio=1.15)
    assert [one.name for one in blocks] == list(MU)
    for one, hertz in zip(blocks, (7.67, 7.31), strict=True):
        assert one.window[0] == pytest.approx(hertz, abs=0.005)
        assert one.window[1] == pytest.approx(one.window[0] * math.sqrt(1.15), rel=1e-12)
        away = np.abs(FINE[:, None] - one.window).min(axis=1) > 0.02
        assert away.sum() >= 88
        assert np.abs(one.up / one.expected_up - 1.0)[away].max() < 1e-3
        assert np.abs(one.down / one.expected_down - 1.0)[away].max() < 1e-3
        assert abs(one.fitted - MU[one.name]) < 4 * one.standard_error and 0.001 < one.standard_error < 0.006
        assert np.std(one.measured - one.down) == pytest.approx(NOISE, rel=0.3)
        measured = transition_frequency(STATIC_RATIO * one.friction) - transition_frequency(one.friction)
        assert 0.0 < measured < 0.5 * np.diff(FREQUENCIES).min()  # the window of the figure is not resolved


@pytest.mark.parametrize("name, ratio", [("steel_block", 1.05), ("aluminium_block", 1.3)])
def test_hysteresis_is_the_window(name, ratio):
    """Going up it sticks up to sqrt(mu_0 g / a_h), going down it slides down to sqrt(mu g / a_h): to 0.2 % in frequency."""
    low, high = transition_frequency(MU[name]), transition_frequency(ratio * MU[name])
    around = 1 + 1e-3 * np.array([-2, -1, 1, 2])
    frequencies = np.concatenate([low * around, np.linspace(low * 1.01, high * 0.99, 9), high * around, [5.0, 10.0]])
    frequencies = np.sort(frequencies)
    up, down = (sweep(block(name, ratio), frequencies, up=rising) for rising in (True, False))
    sticks_up, sticks_down = up > HORIZONTAL_AMPLITUDE * (1 - 1e-9), down > HORIZONTAL_AMPLITUDE * (1 - 1e-9)
    assert (sticks_up == (frequencies < high)).all()
    assert (sticks_down == (frequencies < low)).all()
    window = (frequencies > low) & (frequencies < high)
    assert ((up > 1.001 * down) == window)[np.abs(frequencies / low - 1) > 1.5e-3].all()


def test_the_radius_is_that_of_the_path():
    """Instead of the velocity at the period's start: SciPy integrates slip for two periods, and the path is measured."""
    frequency, part = 7.9, block("steel_block")
    surface = Surface(frequency=frequency)
    w, held = surface.angular_frequency, part.friction * GRAVITY

    def slope(t, y):
        slip = 1j * surface.table_speed * np.exp(1j * w * t) - y[1]
        return [y[1], held * slip / abs(slip)]

    settled = solve_ivp(slope, (0, 60 / frequency), [0j, 0j], rtol=1e-10, atol=1e-12, method="DOP853").y[:, -1]
    times = np.arange(200) / 200 / frequency
    path = solve_ivp(slope, (0, 1 / frequency), settled, t_eval=times, rtol=1e-10, atol=1e-12, method="DOP853").y[0]
    radii = np.abs(path - path.mean())
    assert radii.max() / radii.min() - 1 < 1e-4
    for up, frequencies in ((True, np.array([3.0, frequency])), (False, np.array([frequency, 12.0]))):
        assert sweep(part, frequencies, up=up)[1 if up else 0] == pytest.approx(radii.mean(), rel=1e-3)


def test_fit_recovers_friction():
    """Noise of 0.05 mm: errors as large as the standard error says, over many experiments; exact without noise."""
    mu, rng, n, scores = 0.64, np.random.default_rng(1), 100, []
    exact = closed_form_radius(FINE, mu)
    for _ in range(n):
        got, error = fit_friction(FINE, exact + NOISE * rng.standard_normal(len(FINE)))
        scores.append((got - mu) / error)
    assert abs(np.mean(scores)) < 4.0 / math.sqrt(n)  # no bias beyond chance, at four standard deviations
    assert 1 - 4 / math.sqrt(2 * n) < np.std(scores) < 1 + 4 / math.sqrt(2 * n)
    slope = GRAVITY / (2 * math.pi * FINE) ** 2
    assert error == pytest.approx(NOISE / np.sqrt((slope[exact < HORIZONTAL_AMPLITUDE] ** 2).sum()), rel=0.35)
    for mu in (0.05, 0.58, 0.9):
        assert fit_friction(FINE, closed_form_radius(FINE, mu))[0] == pytest.approx(mu, rel=1e-9)
    with pytest.raises(ValueError, match="radii"):
        fit_friction(np.array([1.0, 2.0, 3.0]), np.full(3, HORIZONTAL_AMPLITUDE))


@pytest.mark.parametrize("law", [None, {"rise": 0.5, "speed": 0.3}, {"rise": 1.0, "speed": 0.1}])
def test_circles_of_sliding_parts_are_those_of_the_simulator(law):
    part = (Machine() if law is None else Machine(**law)).part
    frequencies = np.array([5.0, 8.5, 9.0, 10.0])
    circles = sliding_circles(frequencies, part)
    assert circles.radius == pytest.approx(sweep(part, frequencies, up=False), rel=2e-3)
    # Friction that falls within the slip of the experiment keeps a part sliding at frequencies at which it would stick.
    down, up = circles.window
    assert down <= up and (up - down > 0.1) == (law is not None and law["speed"] < 0.2)
