"""The friction experiment of the thesis (section 7.1, figs. 7.1 and 7.2): a part's radius of motion over frequency.

The elements rest, the table circles with ``a_h``. A part that sticks moves with radius ``a_h``; one that slides with
``mu g / w^2`` (eqs. 3.30 and 3.37), for any ``a_h``. Going up in frequency the part sticks until ``a_h w^2`` exceeds
``mu_0 g``; going down it slides until ``a_h w^2`` falls below ``mu g``. In the window between, the radius has two values.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from vibgym import checks
from vibgym.physics.core.records import LAW_SPEED
from vibgym.scene.friction_laws import ENTRIES, law_table
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


def closed_form_radius(frequencies: Any, friction: float, *, sticking: Any = False) -> np.ndarray:
    """Return the radius of motion, m: ``min(a_h, mu g / w^2)``, and ``a_h`` where the part sticks.

    Args:
        frequencies: Hz, any shape.
        friction: coefficient of sliding friction.
        sticking: bool, broadcast with ``frequencies``.
    """
    w = 2.0 * math.pi * np.asarray(frequencies, dtype=float)
    radius = np.minimum(HORIZONTAL_AMPLITUDE, friction * GRAVITY / w**2)
    return np.where(sticking, HORIZONTAL_AMPLITUDE, radius)


class Sliding(NamedTuple):
    """Closed form of a sliding part's circle for any friction law, see :func:`sliding_circles`.

    Attributes:
        radius: (n,) m, ``a_h`` where the part cannot slide.
        window: frequencies (Hz) where sliding ends, going down, and where sticking ends, going up.
    """

    radius: np.ndarray
    window: tuple[float, float]


def sliding_circles(frequencies: Any, part: Part, horizontal_amplitude: float = HORIZONTAL_AMPLITUDE) -> Sliding:
    """Return the radius of a sliding part's motion at frequencies (Hz) for its friction law.

    In the steady state all points slip at one speed ``u``, so that ``r = mu(u) g / w^2`` and ``r^2 + (u / w)^2 = a_h^2``. Where
    friction falls with speed there may be several such circles; that of the largest slip is stable and the one reached from
    above.

    Args:
        frequencies: (n,) Hz.
        part: its static friction is not used: sticking ends at the coefficient of the law at rest.
        horizontal_amplitude: a_h, m.
    """
    table = law_table(part.friction_law)
    slip = np.linspace(0.0, LAW_SPEED * (ENTRIES - 1), 4 * (ENTRIES - 1) + 1)
    pull = part.friction * GRAVITY * np.interp(slip, LAW_SPEED * np.arange(len(table)), table)
    square = horizontal_amplitude**2
    # Frequency by slip: a_h^2 w^4 - u^2 w^2 - (mu g)^2 = 0. The largest slip of a frequency is where the running minimum
    # from above passes it.
    squared = (slip**2 + np.sqrt(slip**4 + 4.0 * square * pull**2)) / (2.0 * square)
    lowest = np.minimum.accumulate(squared[::-1])[::-1]
    asked = (2.0 * math.pi * np.asarray(frequencies, dtype=float)) ** 2
    at = np.interp(asked, lowest, slip)
    radius = np.interp(at, slip, pull) / asked
    stuck = asked <= lowest[0]
    window = math.sqrt(lowest[0]), math.sqrt(squared[0])
    return Sliding(
        np.where(stuck, horizontal_amplitude, radius), (window[0] / (2.0 * math.pi), window[1] / (2.0 * math.pi))
    )


def transition_frequency(friction: float) -> float:
    """Return the frequency (Hz) at which ``a_h w^2 = friction g``: sticking ends with mu_0, sliding with mu."""
    return math.sqrt(friction * GRAVITY / HORIZONTAL_AMPLITUDE) / (2.0 * math.pi)


def sweep(part: Part, frequencies: Any, *, direction: str = "up") -> np.ndarray:
    """Return the radius of the part's motion (n,) m at every frequency, each reached from the one before.

    Upwards the part starts stuck to the table, downwards from rest, sliding. Frequency changes at the start of a period: a
    part that sticks continues with the new table's velocity, one that slides keeps its velocity.

    The simulator returns one point of the path a period, so the radius is computed from the velocity: a circle has radius
    ``|v| / w`` after subtraction of the mean velocity.

    Args:
        part: with ``friction`` and ``static_friction``.
        frequencies: (n,) Hz, rising; a downward sweep takes them from the last to the first.
        direction: ``"up"`` or ``"down"``.

    Raises:
        ValueError: a bad argument.
    """
    frequencies = rising("frequencies", frequencies)
    checks.choice("direction", direction, ("up", "down"))
    order = range(len(frequencies)) if direction == "up" else range(len(frequencies) - 1, -1, -1)
    radii = np.empty(len(frequencies))
    velocity, stuck = np.zeros(3), direction == "up"
    for k in order:
        surface = Surface(
            rows=1, columns=1, element_size=20.0 * part.radius + 40.0 * HORIZONTAL_AMPLITUDE,
            horizontal_amplitude=HORIZONTAL_AMPLITUDE, frequency=float(frequencies[k]), gravity=GRAVITY,
        )  # fmt: skip
        sim = Simulator(surface, part, model="planar", threads=1)
        if stuck:
            velocity = np.array([0.0, surface.table_speed, 0.0])
        sim.reset([0.5 * surface.width, 0.5 * surface.depth, 0.0], velocity)
        sim.advance(0.0, 0.0, SETTLE_PERIODS)
        velocity, stuck = sim.velocity[0, 0], bool(sim.sticking[0, 0])
        circling = (velocity - sim.mean_velocity[0, 0])[:2]
        radii[k] = math.hypot(*circling) / surface.angular_frequency
    return radii


def rising(name: str, values: Any) -> np.ndarray:
    """Return a checked (n,) array of increasing positive numbers."""
    shape = np.shape(values)
    if len(shape) != 1 or not shape[0]:
        raise checks.refuse(name, values, "a sequence of at least one number")
    values = checks.array(name, values, shape, least=1e-3, most=1e6)
    if (np.diff(values) <= 0).any():
        raise checks.refuse(name, values.tolist(), "increasing numbers")
    return values


def fit_friction(frequencies: Any, radii: Any) -> tuple[float, float]:
    """Return the coefficient of sliding friction and its standard error, by least squares on ``min(a_h, mu g / w^2)``.

    Use a downward sweep where mu_0 exceeds mu: going up, the part sticks in a window where this model lets it slide.

    Args:
        frequencies, radii: (n,) Hz and m; n >= 2, and some of the radii below ``a_h``.

    Raises:
        ValueError: bad arguments, or no radius of a sliding part.
    """
    frequencies = rising("frequencies", frequencies)
    if len(frequencies) < 2:
        raise checks.refuse("frequencies", frequencies.tolist(), "at least two numbers")
    radii = checks.array("radii", radii, frequencies.shape, least=-1e3, most=1e3)
    squares = (2.0 * math.pi * frequencies) ** 2

    def misfit(x: np.ndarray) -> np.ndarray:
        return (np.minimum(HORIZONTAL_AMPLITUDE, x[0] * GRAVITY / squares) - radii) / HORIZONTAL_AMPLITUDE

    # The model has a kink at every frequency, and zero slope if all of them stick: start from the best of many.
    highest = HORIZONTAL_AMPLITUDE * float(squares.max()) / GRAVITY
    candidates = np.linspace(0.0, highest, 401)[1:]
    start = min(candidates, key=lambda mu: float((misfit(np.array([mu])) ** 2).sum()))
    found = least_squares(misfit, [start], x_scale=[start], method="trf", bounds=([0.0], [2.0 * highest]), xtol=1e-14)
    slope = float((found.jac**2).sum())
    if not slope > 0.0 or start == candidates[-1]:
        raise checks.refuse("radii", radii.tolist(), "radii of which some are smaller than a_h: none slides")
    variance = 2.0 * found.cost / (len(radii) - 1)
    return float(found.x[0]), math.sqrt(variance / slope)


class Block(NamedTuple):
    """One block's part of the experiment; all radii in m, in the order of the frequencies.

    Attributes:
        name: of the shipped part.
        friction: coefficient of sliding friction.
        up, down: (n,) radii of the simulated sweeps.
        measured: (n,) those of the downward sweep with the camera's noise.
        fitted, standard_error: friction from ``measured``.
        expected_up, expected_down: (n,) closed forms.
        window: frequencies (Hz) where sliding and where sticking ends.
    """

    name: str
    friction: float
    up: np.ndarray
    down: np.ndarray
    measured: np.ndarray
    fitted: float
    standard_error: float
    expected_up: np.ndarray
    expected_down: np.ndarray
    window: tuple[float, float]


class Experiment(NamedTuple):
    """Both blocks over the same frequencies, and the standard deviation (m) of a measured radius."""

    noise: float
    blocks: tuple[Block, ...]


def experiment(frequencies: Any, static_ratio: float) -> Experiment:
    """Return the experiment on both shipped blocks, up and down, with noisy measurements and their fits.

    Args:
        frequencies: (n,) Hz, rising.
        static_ratio: mu_0 over mu, at least 1. The thesis observed no window, so its ratio was close to 1.

    Raises:
        ValueError: a bad argument.
    """
    frequencies = rising("frequencies", frequencies)
    static_ratio = checks.number("static_ratio", static_ratio, least=1.0)
    rng = np.random.default_rng(0)
    blocks = []
    for name, properties in SHIPPED.items():
        friction = properties["friction"]
        static = static_ratio * friction
        part = Part.rectangle(**properties, static_friction=static, name=name)
        up, down = (sweep(part, frequencies, direction=each) for each in ("up", "down"))
        measured = down + NOISE * rng.standard_normal(len(frequencies))
        window = transition_frequency(friction), transition_frequency(static)
        expected_up = closed_form_radius(frequencies, friction, sticking=frequencies <= window[1])
        expected_down = closed_form_radius(frequencies, friction)
        fit = fit_friction(frequencies, measured)
        blocks.append(Block(name, friction, up, down, measured, *fit, expected_up, expected_down, window))
    return Experiment(NOISE, tuple(blocks))
