"""Figs. 7.1 and 7.2: the friction experiment of the thesis (section 7.1), a part's radius of motion over frequency.

The elements rest, the table circles with ``a_h``. A part that sticks moves with radius ``a_h``; one that slides with
``mu g / w^2`` (eqs. 3.30 and 3.37), for any ``a_h``. Going up in frequency the part sticks until ``a_h w^2`` exceeds
``mu_0 g``; going down it slides until ``a_h w^2`` falls below ``mu g``. In the window between, the radius has two values.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.figure import Figure, figure
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
    """Closed form of a sliding part's circle for any friction law, see :func:`sliding_circles`."""

    radius: np.ndarray  # (n,) m, a_h where the part cannot slide
    window: tuple[float, float]  # Hz, frequencies where sliding ends, going down, and where sticking ends, going up


def sliding_circles(frequencies: Any, part: Part, horizontal_amplitude: float = HORIZONTAL_AMPLITUDE) -> Sliding:
    """Return the radius of a sliding part's motion at frequencies (n,) Hz for its friction law.

    In the steady state all points slip at one speed ``u``, so that ``r = mu(u) g / w^2`` and ``r^2 + (u / w)^2 = a_h^2``. Where
    friction falls with speed there may be several such circles; that of the largest slip is stable and the one reached from
    above. The static friction is not used: sticking ends at the coefficient of the law at rest.
    """
    table = law_table(part.friction_law)
    slip = np.linspace(0.0, LAW_SPEED * (ENTRIES - 1), 4 * (ENTRIES - 1) + 1)
    pull = part.friction * GRAVITY * np.interp(slip, LAW_SPEED * np.arange(len(table)), table)
    square = horizontal_amplitude**2
    # Frequency by slip: a_h^2 w^4 - u^2 w^2 - (mu g)^2 = 0. The largest slip of a frequency is where the running minimum
    # from above passes it.
    squared = (slip**2 + np.sqrt(slip**4 + 4.0 * square * pull**2)) / (2.0 * square)
    lowest = np.minimum.accumulate(squared[::-1])[::-1]
    wanted = (2.0 * math.pi * np.asarray(frequencies, dtype=float)) ** 2
    radius = np.interp(np.interp(wanted, lowest, slip), slip, pull) / wanted
    window = (math.sqrt(lowest[0]) / (2.0 * math.pi), math.sqrt(squared[0]) / (2.0 * math.pi))
    return Sliding(np.where(wanted <= lowest[0], horizontal_amplitude, radius), window)


def transition_frequency(friction: float) -> float:
    """Return the frequency (Hz) at which ``a_h w^2 = friction g``: sticking ends with mu_0, sliding with mu."""
    return math.sqrt(friction * GRAVITY / HORIZONTAL_AMPLITUDE) / (2.0 * math.pi)


def sweep(part: Part, frequencies: np.ndarray, *, up: bool) -> np.ndarray:
    """Return the radius of the part's motion (n,) m at every frequency, each reached from the one before.

    Upwards the part starts stuck to the table, downwards from rest, sliding. Frequency changes at the start of a period: a
    part that sticks continues with the new table's velocity, one that slides keeps its velocity.

    The simulator returns one point of the path a period, so the radius is computed from the velocity: a circle has radius
    ``|v| / w`` after subtraction of the mean velocity.

    Args:
        part: with ``friction`` and ``static_friction``.
        frequencies: (n,) Hz, rising; a downward sweep takes them from the last to the first.
        up: direction.
    """
    radii = np.empty(len(frequencies))
    velocity, stuck = np.zeros(3), up
    for k in range(len(frequencies)) if up else reversed(range(len(frequencies))):
        surface = Surface(
            rows=1, columns=1, element_size=20.0 * part.radius + 40.0 * HORIZONTAL_AMPLITUDE,
            horizontal_amplitude=HORIZONTAL_AMPLITUDE, frequency=float(frequencies[k]), gravity=GRAVITY,
        )  # fmt: skip
        simulator = Simulator(surface, part, model="planar", threads=1)
        if stuck:
            velocity = np.array([0.0, surface.table_speed, 0.0])
        simulator.reset([0.5 * surface.width, 0.5 * surface.depth, 0.0], velocity)
        simulator.advance(0.0, 0.0, SETTLE_PERIODS)
        velocity, stuck = simulator.velocity[0, 0], bool(simulator.sticking[0, 0])
        radii[k] = math.hypot(*(velocity - simulator.mean_velocity[0, 0])[:2]) / surface.angular_frequency
    return radii


def fit_friction(frequencies: np.ndarray, radii: np.ndarray) -> tuple[float, float]:
    """Return the coefficient of sliding friction and its standard error, by least squares on ``min(a_h, mu g / w^2)``.

    Use a downward sweep where mu_0 exceeds mu: going up, the part sticks in a window where this model lets it slide.

    Args:
        frequencies, radii: (n,) Hz and m; n >= 2, and some of the radii below ``a_h``.

    Raises:
        ValueError: no radius of a sliding part.
    """
    squares = (2.0 * math.pi * frequencies) ** 2

    def misfit(x: np.ndarray) -> np.ndarray:
        return (np.minimum(HORIZONTAL_AMPLITUDE, x[0] * GRAVITY / squares) - radii) / HORIZONTAL_AMPLITUDE

    # The model has a kink at every frequency, and zero slope if all of them stick: start from the best of many.
    highest = HORIZONTAL_AMPLITUDE * float(squares.max()) / GRAVITY
    candidates = np.linspace(0.0, highest, 401)[1:]
    start = min(candidates, key=lambda mu: float((misfit(np.array([mu])) ** 2).sum()))
    fit = least_squares(misfit, [start], x_scale=[start], method="trf", bounds=([0.0], [2.0 * highest]), xtol=1e-14)
    slope = float((fit.jac**2).sum())
    if not slope > 0.0 or start == candidates[-1]:
        raise checks.refuse("radii", radii.tolist(), "radii of which some are smaller than a_h: none slides")
    variance = 2.0 * fit.cost / (len(radii) - 1)
    return float(fit.x[0]), math.sqrt(variance / slope)


class Block(NamedTuple):
    """One block's part of the experiment; all radii in m, in the order of the frequencies."""

    name: str  # of the shipped part
    friction: float  # coefficient of sliding friction
    up: np.ndarray  # (n,) radii of the simulated sweeps
    down: np.ndarray
    measured: np.ndarray  # (n,) those of the downward sweep with the camera's noise
    fitted: float  # friction from ``measured``
    standard_error: float
    expected_up: np.ndarray  # (n,) closed forms
    expected_down: np.ndarray
    window: tuple[float, float]  # frequencies (Hz) where sliding and where sticking ends


def experiment(frequencies: np.ndarray, static_ratio: float) -> list[Block]:
    """Return the experiment on both shipped blocks, up and down, with noisy measurements and their fits.

    Args:
        frequencies: (n,) Hz, rising.
        static_ratio: mu_0 over mu, at least 1. The thesis observed no window, so its ratio was close to 1.
    """
    rng = np.random.default_rng(0)
    blocks = []
    for name, properties in SHIPPED.items():
        friction = properties["friction"]
        static = static_ratio * friction
        part = Part.rectangle(**properties, static_friction=static, name=name)
        up, down = (sweep(part, frequencies, up=rising) for rising in (True, False))
        measured = down + NOISE * rng.standard_normal(len(frequencies))
        window = transition_frequency(friction), transition_frequency(static)
        expected_up = closed_form_radius(frequencies, friction, sticking=frequencies <= window[1])
        expected_down = closed_form_radius(frequencies, friction)
        fit = fit_friction(frequencies, measured)
        blocks.append(Block(name, friction, up, down, measured, *fit, expected_up, expected_down, window))
    return blocks


FREQUENCIES = np.linspace(1.0, 10.0, 46)
STATIC_RATIO = 1.02
"""mu_0 over mu in the measurement: a window of 1 % in frequency, below the resolution of 0.2 Hz."""

SHOWN_RATIO = 1.3
"""mu_0 over mu in the plot of the expected radius, with a visible window."""

DOTTED = (0.5, 0.6, 0.7, 0.8)  # friction of the dotted lines in the thesis
PART = {"steel_block": "steel", "aluminium_block": "aluminium"}


def largest_misfit(block: Block, frequencies: np.ndarray) -> float:
    """Return the largest deviation of simulated radii from the closed forms (eqs. 3.30, 3.37), m.

    Frequencies within 0.05 Hz of the transitions are excluded.
    """
    away = np.abs(frequencies[:, None] - block.window).min(axis=1) > 0.05
    off = block.up - block.expected_up, block.down - block.expected_down
    return float(np.abs(off)[:, away].max())


def draw() -> Figure:
    """Compute and plot the expected radius, and the measurement on both blocks."""
    measured, shown = (experiment(FREQUENCIES, ratio) for ratio in (STATIC_RATIO, SHOWN_RATIO))
    values = {
        **{PART[block.name]: block.fitted for block in measured},
        "misfit": 1e6 * max(largest_misfit(block, FREQUENCIES) for block in (*measured, *shown)),
        "gap": 1e3 * max(np.abs(block.up - block.down).max() for block in measured),
    }
    rows = [
        {
            "Block": PART[block.name], "Friction": f"{block.fitted:.4f}", "Standard error": f"{block.standard_error:.4f}",
            "Down": f"{block.window[0]:.3f} Hz", "Up": f"{block.window[1]:.3f} Hz",
        }
        for block in measured
    ]  # fmt: skip
    return figure("friction_radius", values, [_plot(measured, shown[0])], rows)


def _plot(measured: list[Block], expected: Block) -> bytes:
    picture = new_figure(7.6, 2.8)
    panels = picture.subplots(1, 3, sharey=True)
    fine = np.linspace(1.0, 10.0, 901)
    stuck = closed_form_radius(fine, expected.friction, sticking=fine <= expected.window[1])
    panels[0].plot(fine, 1e3 * stuck, color=INK, linewidth=1.2, linestyle="--")
    panels[0].plot(fine, 1e3 * closed_form_radius(fine, expected.friction), color=INK, linewidth=1.2)
    for radii, marker in ((expected.up, "^"), (expected.down, "v")):
        panels[0].plot(FREQUENCIES, 1e3 * radii, marker, color=FAILURE, markersize=2.4)
    panels[0].set_title(f"expected, mu_0 = {SHOWN_RATIO} mu")
    for axes, block in zip(panels[1:], measured, strict=True):
        for friction in DOTTED:
            axes.plot(fine, 1e3 * closed_form_radius(fine, friction), color=MUTED, linewidth=0.8, linestyle=":")
        axes.plot(fine, 1e3 * closed_form_radius(fine, block.fitted), color=SUCCESS, linewidth=1.2)
        axes.plot(FREQUENCIES, 1e3 * block.measured, ".", color=FAILURE, markersize=3)
        axes.set_title(f"{PART[block.name]}: fitted friction {block.fitted:.3f}")
    for axes in panels:
        style(axes, xlabel="frequency, Hz")
        axes.set_ylim(1.2, 3.0)
    style(panels[0], ylabel="radius of motion, mm")
    return png(picture)
