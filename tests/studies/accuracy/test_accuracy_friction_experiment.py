"""The friction experiment: two branches, the window between them, and the coefficient that a fit gets back."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from studies.accuracy.friction_experiment import (
    GRAVITY,
    HORIZONTAL_AMPLITUDE,
    closed_form_radius,
    experiment,
    fit_friction,
    sweep,
    transition_frequency,
)
from vibgym import Part, Surface
from vibgym.scene.parts import SHIPPED

MU = {name: properties["friction"] for name, properties in SHIPPED.items()}
FREQUENCIES = np.linspace(1.0, 10.0, 91)


def block(name, ratio=1.0):
    return Part.rectangle(**SHIPPED[name], static_friction=ratio * MU[name], name=name)


@pytest.fixture(scope="module")
def both():
    return experiment(frequencies=FREQUENCIES, static_ratio=1.15)


def test_the_thesis_transitions():
    """a_h w^2 = mu g at 7.67 and 7.31 Hz."""
    for name, hertz in (("steel_block", 7.67), ("aluminium_block", 7.31)):
        at = transition_frequency(MU[name])
        assert at == pytest.approx(hertz, abs=0.005)
        assert (2 * math.pi * at) ** 2 * HORIZONTAL_AMPLITUDE == pytest.approx(MU[name] * GRAVITY, rel=1e-14)
        assert closed_form_radius([at * 0.99, at * 1.01], MU[name])[0] == HORIZONTAL_AMPLITUDE
        assert closed_form_radius(at * 1.01, MU[name]) == pytest.approx(HORIZONTAL_AMPLITUDE / 1.01**2)


@pytest.mark.parametrize("k", [0, 1], ids=list(MU))
@pytest.mark.parametrize("direction", ["up", "down"])
def test_radius_equals_the_closed_form(both, k, direction):
    """Within 0.1 % away from the transition (nearer than one step of the frequencies is not away)."""
    one = both.blocks[k]
    got, expected = getattr(one, direction), getattr(one, f"expected_{direction}")
    near = min(np.abs(FREQUENCIES - at).min() for at in one.window)
    assert near < 0.05
    away = np.abs(FREQUENCIES[:, None] - one.window).min(axis=1) > 0.02
    assert away.sum() >= 88
    assert np.abs(got / expected - 1.0)[away].max() < 1e-3


@pytest.mark.parametrize("name", list(MU))
@pytest.mark.parametrize("ratio", [1.05, 1.3])
def test_hysteresis_is_the_window(name, ratio):
    """Going up it sticks up to sqrt(mu_0 g / a_h), going down it slides down to sqrt(mu g / a_h): to 0.2 % in frequency."""
    low, high = transition_frequency(MU[name]), transition_frequency(ratio * MU[name])
    around = 1 + 1e-3 * np.array([-2, -1, 1, 2])
    frequencies = np.concatenate([low * around, np.linspace(low * 1.01, high * 0.99, 9), high * around, [5.0, 10.0]])
    frequencies = np.sort(frequencies)
    up, down = (sweep(block(name, ratio), frequencies, direction=each) for each in ("up", "down"))
    sticks_up, sticks_down = up > HORIZONTAL_AMPLITUDE * (1 - 1e-9), down > HORIZONTAL_AMPLITUDE * (1 - 1e-9)
    assert (sticks_up == (frequencies < high)).all()
    assert (sticks_down == (frequencies < low)).all()
    window = (frequencies > low) & (frequencies < high)
    assert ((up > 1.001 * down) == window)[np.abs(frequencies / low - 1) > 1.5e-3].all()


@pytest.mark.parametrize("frequency", [7.9, 10.0])
def test_the_radius_is_that_of_the_path(frequency):
    """Instead of the velocity at the period's start: SciPy integrates slip for two periods, and the path is measured."""
    part, surface = block("steel_block"), Surface(frequency=frequency)
    w, held = surface.angular_frequency, part.friction * GRAVITY

    def slope(t, y):
        slip = 1j * surface.table_speed * np.exp(1j * w * t) - y[1]
        return [y[1], held * slip / abs(slip)]

    settled = solve_ivp(slope, (0, 60 / frequency), [0j, 0j], rtol=1e-10, atol=1e-12, method="DOP853").y[:, -1]
    times = np.arange(200) / 200 / frequency
    path = solve_ivp(slope, (0, 1 / frequency), settled, t_eval=times, rtol=1e-10, atol=1e-12, method="DOP853").y[0]
    radii = np.abs(path - path.mean())
    assert radii.max() / radii.min() - 1 < 1e-4
    for direction, frequencies in (("up", [3.0, frequency]), ("down", [frequency, 12.0])):
        got = sweep(part, frequencies, direction=direction)[frequencies.index(frequency)]
        assert got == pytest.approx(radii.mean(), rel=1e-3)


def test_fit_recovers_friction():
    """Noise of 0.05 mm: errors as large as the standard error says, over many experiments."""
    mu, rng, n, scores = 0.64, np.random.default_rng(1), 100, []
    exact = closed_form_radius(FREQUENCIES, mu)
    for _ in range(n):
        got, error = fit_friction(FREQUENCIES, exact + 5e-5 * rng.standard_normal(len(FREQUENCIES)))
        scores.append((got - mu) / error)
    assert abs(np.mean(scores)) < 4.0 / math.sqrt(n)  # no bias beyond chance, at four standard deviations
    assert 1 - 4 / math.sqrt(2 * n) < np.std(scores) < 1 + 4 / math.sqrt(2 * n)
    assert np.abs(scores).max() < 5.0
    slope = GRAVITY / (2 * math.pi * FREQUENCIES) ** 2
    assert error == pytest.approx(5e-5 / np.sqrt((slope[exact < HORIZONTAL_AMPLITUDE] ** 2).sum()), rel=0.35)


def test_fit_is_exact_without_noise():
    for mu in (0.05, 0.58, 0.64, 0.9):
        assert fit_friction(FREQUENCIES, closed_form_radius(FREQUENCIES, mu))[0] == pytest.approx(mu, rel=1e-9)


def test_experiment_recovers_both_blocks(both):
    assert [one.name for one in both.blocks] == list(MU)
    for one in both.blocks:
        assert one.up.shape == one.down.shape == one.measured.shape == FREQUENCIES.shape
        assert 0.001 < one.standard_error < 0.006
        assert abs(one.fitted - MU[one.name]) < 4 * one.standard_error
        assert np.std(one.measured - one.down) == pytest.approx(both.noise, rel=0.3)


@pytest.mark.parametrize("call, message", [
    (lambda: sweep(block("steel_block"), [3.0, 2.0]), "frequencies"),
    (lambda: sweep(block("steel_block"), []), "frequencies"),
    (lambda: sweep(block("steel_block"), [2.0, math.nan]), "frequencies"),
    (lambda: sweep(block("steel_block"), [2.0], direction="sideways"), "direction"),
    (lambda: fit_friction([1.0, 2.0, 3.0], [2.7e-3] * 3), "radii"),
    (lambda: fit_friction([1.0, 2.0], [2.7e-3]), "radii"),
    (lambda: fit_friction([1.0], [2.7e-3]), "frequencies"),
    (lambda: experiment(FREQUENCIES, static_ratio=0.9), "static_ratio"),
])  # fmt: skip
def test_bad_arguments(call, message):
    with pytest.raises(ValueError, match=message):
        call()
