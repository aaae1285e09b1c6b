"""The friction experiment of the thesis (section 7.1, figs. 7.1 and 7.2): a part's radius of motion over frequency.

The elements rest, the table circles with ``a_h``. A part that sticks moves with radius ``a_h``; one that slides with
``mu g / w^2`` (eqs. 3.30 and 3.37), whichever ``a_h`` is. Going up in frequency the part sticks until ``a_h w^2`` exceeds
``mu_0 g``; going down it slides until ``a_h w^2`` falls below ``mu g``. In the window between, the radius has two values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from vibgym import checks
from vibgym.scene.parts import SHIPPED, Part
from vibgym.scene.surface import Surface
from vibgym.simulation.simulator import Simulator

HORIZONTAL_AMPLITUDE = 2.7e-3
"""a_h of the prototype, m."""

GRAVITY = 9.81
"""m/s^2."""

NOISE = 5e-5
"""m, standard deviation of a radius measured by the prototype's camera: a twentieth of a pixel, the mean over many images."""

SETTLE_PERIODS = 60
"""At each frequency, before the radius is read. Slip settles within w^2 |u| / (mu g) seconds, which is slowest just above the
limit; there 60 periods are 8 s."""


def closed_form_radius(
    frequencies: Any,
    friction: float,
    *,
    sticking: Any = False,
    horizontal_amplitude: float = HORIZONTAL_AMPLITUDE,
    gravity: float = GRAVITY,
) -> np.ndarray:
    """Radius of motion, m: ``min(a_h, mu g / w^2)``; with friction ``mu_0`` and ``sticking``, ``a_h`` up to its limit.

    Args:
        frequencies: Hz, any shape.
        friction: coefficient of sliding friction.
        sticking: where the part sticks (broadcast with ``frequencies``); it then moves with ``a_h``.
        horizontal_amplitude: m.
        gravity: m/s^2.
    """
    w = 2.0 * math.pi * np.asarray(frequencies, dtype=float)
    radius = np.minimum(horizontal_amplitude, friction * gravity / w**2)
    return np.where(sticking, horizontal_amplitude, radius)


def transition_frequency(
    friction: float, *, horizontal_amplitude: float = HORIZONTAL_AMPLITUDE, gravity: float = GRAVITY
) -> float:
    """Frequency (Hz) at which ``a_h w^2 = friction g``: with mu_0 where sticking ends, with mu where sliding ends."""
    return math.sqrt(friction * gravity / horizontal_amplitude) / (2.0 * math.pi)


def sweep(
    part: Part,
    frequencies: Any,
    *,
    direction: str = "up",
    horizontal_amplitude: float = HORIZONTAL_AMPLITUDE,
    gravity: float = GRAVITY,
    settle_periods: int = SETTLE_PERIODS,
    **knobs: Any,
) -> np.ndarray:
    """Radius of the part's motion at every frequency, each reached from the one before.

    Upwards the part starts stuck to the table, downwards from rest, sliding. Frequency changes at the start of a period: a
    part that sticks has followed the table there and goes on with the new table's velocity; one that slides keeps its own
    velocity, as its inertia would have it.

    Instead of the path, of which the simulator shows one point a period, the velocity is read: a circle has radius
    ``|v| / w``, as long as the part has no mean velocity, which is taken off.

    Args:
        part: with ``friction`` and ``static_friction``.
        frequencies: (n,) Hz, rising; a downward sweep takes them from the last to the first.
        direction: ``"up"`` or ``"down"``.
        horizontal_amplitude: a_h, m.
        gravity: m/s^2.
        settle_periods: at each frequency.
        knobs: of the planar model.

    Returns:
        (n,) m, in the order of ``frequencies``.

    Raises:
        ValueError: a bad argument.
    """
    frequencies = rising("frequencies", frequencies)
    checks.choice("direction", direction, ("up", "down"))
    settle_periods = checks.count("settle_periods", settle_periods)
    order = range(len(frequencies)) if direction == "up" else range(len(frequencies) - 1, -1, -1)
    radii = np.empty(len(frequencies))
    velocity, stuck = np.zeros(3), direction == "up"
    for k in order:
        surface = Surface(
            rows=1, columns=1, element_size=20.0 * part.radius + 40.0 * horizontal_amplitude,
            horizontal_amplitude=horizontal_amplitude, frequency=float(frequencies[k]), gravity=gravity,
        )  # fmt: skip
        sim = Simulator(surface, part, **{"model": "planar", "threads": 1, **knobs})
        if stuck:
            velocity = np.array([0.0, surface.table_speed, 0.0])
        sim.reset([0.5 * surface.width, 0.5 * surface.depth, 0.0], velocity)
        sim.advance(0.0, 0.0, settle_periods)
        velocity, stuck = sim.velocity[0, 0], bool(sim.sticking[0, 0])
        circling = (velocity - sim.mean_velocity[0, 0])[:2]
        radii[k] = math.hypot(*circling) / surface.angular_frequency
    return radii


def rising(name: str, values: Any) -> np.ndarray:
    """Checked (n,) array of positive numbers that rise."""
    shape = np.shape(values)
    if len(shape) != 1 or not shape[0]:
        raise checks.refuse(name, values, "a sequence of at least one number")
    values = checks.array(name, values, shape, least=1e-3, most=1e6)
    if (np.diff(values) <= 0).any():
        raise checks.refuse(name, values.tolist(), "numbers that rise")
    return values


def fit_friction(
    frequencies: Any, radii: Any, horizontal_amplitude: float = HORIZONTAL_AMPLITUDE, *, gravity: float = GRAVITY
) -> tuple[float, float]:
    """Coefficient of sliding friction from measured radii, by least squares on ``min(a_h, mu g / w^2)``.

    Use a downward sweep where mu_0 exceeds mu: going up, the part sticks in a window where this model has it slide.

    Args:
        frequencies, radii: (n,) Hz and m; n >= 2, and some of the radii below ``a_h``.
        horizontal_amplitude: m.
        gravity: m/s^2.

    Returns:
        mu and its standard error.

    Raises:
        ValueError: bad arguments, or no radius that shows sliding.
    """
    frequencies = np.asarray(frequencies, dtype=float)
    shape = frequencies.shape
    if len(shape) != 1 or shape[0] < 2:
        raise checks.refuse("frequencies", frequencies.tolist(), "at least two numbers")
    frequencies = checks.array("frequencies", frequencies, shape, least=1e-3, most=1e6)
    radii = checks.array("radii", radii, shape, least=-1e3, most=1e3)
    squares = (2.0 * math.pi * frequencies) ** 2

    def misfit(x: np.ndarray) -> np.ndarray:
        return (np.minimum(horizontal_amplitude, x[0] * gravity / squares) - radii) / horizontal_amplitude

    # The model has a kink for every frequency, and no slope once all of them stick: start from the best of many.
    highest = horizontal_amplitude * float(squares.max()) / gravity
    candidates = np.linspace(0.0, highest, 401)[1:]
    start = min(candidates, key=lambda mu: float((misfit(np.array([mu])) ** 2).sum()))
    found = least_squares(misfit, [start], x_scale=[start], method="trf", bounds=([0.0], [2.0 * highest]), xtol=1e-14)
    slope = float((found.jac**2).sum())
    if not slope > 0.0 or start == candidates[-1]:
        raise checks.refuse(
            "radii", radii.tolist(), "radii of which some are smaller than horizontal_amplitude: none slides"
        )
    variance = 2.0 * found.cost / (len(radii) - 1)
    return float(found.x[0]), math.sqrt(variance / slope)


@dataclass(frozen=True)
class Block:
    """One block's part of the experiment; all radii in m, in the order of the frequencies.

    Attributes:
        name: of the shipped part.  friction, static_friction: its coefficients.
        up, down: (n,) radii of the simulated sweeps.
        measured: (n,) those of the downward sweep with the camera's noise.
        fitted, standard_error: friction from ``measured``.
        expected_up, expected_down: (n,) closed forms.
        window: frequencies (Hz) where sliding and where sticking ends.
    """

    name: str
    friction: float
    static_friction: float
    up: np.ndarray
    down: np.ndarray
    measured: np.ndarray
    fitted: float
    standard_error: float
    expected_up: np.ndarray
    expected_down: np.ndarray
    window: tuple[float, float]


@dataclass(frozen=True)
class Experiment:
    """Both blocks over the same frequencies (n,), Hz."""

    frequencies: np.ndarray
    horizontal_amplitude: float
    noise: float
    blocks: tuple[Block, ...]


def experiment(
    *,
    frequencies: Any = None,
    static_ratio: float = 1.15,
    noise: float = NOISE,
    seed: int = 0,
    **knobs: Any,
) -> Experiment:
    """The experiment on both shipped blocks, up and down, with noisy measurements and their fits.

    Args:
        frequencies: Hz; None is 1 to 10 in steps of 0.1.
        static_ratio: mu_0 over mu, at least 1. The thesis saw no window, so its ratio was close to 1; more shows it.
        noise: standard deviation of a measured radius, m.
        seed: of the noise.
        knobs: of :func:`sweep`.

    Raises:
        ValueError: a bad argument.
    """
    frequencies = rising("frequencies", np.linspace(1.0, 10.0, 91) if frequencies is None else frequencies)
    static_ratio = checks.number("static_ratio", static_ratio, least=1.0)
    noise = checks.number("noise", noise, least=0.0)
    rng = np.random.default_rng(checks.count("seed", seed, least=0))
    amplitude = knobs.get("horizontal_amplitude", HORIZONTAL_AMPLITUDE)
    gravity = knobs.get("gravity", GRAVITY)
    known = {"horizontal_amplitude": amplitude, "gravity": gravity}
    blocks = []
    for name, properties in SHIPPED.items():
        friction = properties["friction"]
        static = static_ratio * friction
        part = Part.rectangle(**properties, static_friction=static, name=name)
        up, down = (sweep(part, frequencies, direction=each, **knobs) for each in ("up", "down"))
        measured = down + noise * rng.standard_normal(len(frequencies))
        fitted, error = fit_friction(frequencies, measured, amplitude, gravity=gravity)
        window = transition_frequency(friction, **known), transition_frequency(static, **known)
        blocks.append(
            Block(
                name=name,
                friction=friction,
                static_friction=static,
                up=up,
                down=down,
                measured=measured,
                fitted=fitted,
                standard_error=error,
                expected_up=closed_form_radius(frequencies, friction, sticking=frequencies <= window[1], **known),
                expected_down=closed_form_radius(frequencies, friction, **known),
                window=window,
            )
        )
    return Experiment(frequencies, amplitude, noise, tuple(blocks))
