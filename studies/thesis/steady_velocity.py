"""Fig. 3.9: steady mean velocity over each oscillation parameter, with the others at their reference values."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.figures import FAILURE, INK, SUCCESS, new_figure, png, style
from studies.thesis.figure import Comparison, Figure, Picture, Table, of_number
from studies.thesis.sliding import simulated_velocity, steady
from vibgym import Surface

FRICTION = 0.6
PHASE = 1.5 * math.pi
POINTS = 161
LIMITS = (((0, 1.25), (0, 2), (0, 0.4), (0, 0.4)), ((-90, 180), (-90, 180), (-90, 180), (-90, 290)))
"""Limits of the axes, m/s and deg, by row and column."""


class Sweep(NamedTuple):
    """Parameter and its values."""

    name: str  # with unit
    scale: float  # of the unit, SI
    line: np.ndarray  # (n,) values for the equation, where a part always slides
    dots: np.ndarray  # (k,) values for the simulator, also where a part may stick


SWEEPS = {
    "horizontal_amplitude": Sweep(
        "horizontal amplitude, mm",
        1e-3,
        np.linspace(0.48, 10.0, POINTS),
        np.array([0.1, 0.3, 0.48, 1, 2.7, 5, 7.5, 10]),
    ),
    "frequency": Sweep(
        "frequency, Hz", 1.0, np.linspace(10.6, 150.0, POINTS), np.array([5, 8, 10.6, 25, 50, 75, 100, 150])
    ),
    "amplitude": Sweep(
        "vertical amplitude, mm", 1e-3, np.linspace(0.002, 0.397, POINTS), np.array([0.05, 0.1, 0.2, 0.3, 0.397])
    ),
    "phase": Sweep("phase, deg", math.pi / 180.0, np.linspace(0.0, 360.0, POINTS), np.arange(0.0, 361.0, 45.0)),
}
"""By parameter. The limits of permanent sliding are 0.477 mm and 10.51 Hz."""


def _settings(parameter: str, value: float) -> tuple[Surface, float, float]:
    """Return surface, vertical amplitude and phase of the reference set with one changed parameter, SI."""
    surface = Surface()
    if parameter in ("horizontal_amplitude", "frequency"):
        surface = replace(surface, max_amplitude=None, **{parameter: value})
    amplitude = value if parameter == "amplitude" else surface.lift_off_amplitude
    return surface, amplitude, value if parameter == "phase" else PHASE


def solved(parameter: str, values: Any) -> np.ndarray:
    """Return steady mean velocities (n, 2) m/s by eq. 3.27, with ``parameter`` at ``values`` (n,) in SI units."""
    settings = [_settings(parameter, float(each)) for each in values]
    speed = np.array([surface.table_speed for surface, _, _ in settings])
    square = np.array([surface.angular_frequency for surface, _, _ in settings]) ** 2
    gravity, radius = settings[0][0].gravity, np.array([surface.horizontal_amplitude for surface, _, _ in settings])
    amplitude, phase = np.array([each[1:] for each in settings]).T
    share = np.minimum(amplitude * square / gravity, 1.0)  # 1 at lift-off, despite rounding
    return speed[:, None] * steady(FRICTION * gravity / (radius * square), share, phase)


def simulated(parameter: str, values: Any) -> np.ndarray:
    """Return the same by the simulator's planar model."""
    settings = [_settings(parameter, float(each)) for each in values]
    return np.array([simulated_velocity(surface, FRICTION, [a], [phase])[0] for surface, a, phase in settings])


def _polar(velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return magnitude and direction, deg."""
    return np.hypot(*velocity.T), np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))


def draw() -> Figure:
    """Compute and plot magnitude and direction over the four parameters."""
    lines = {name: solved(name, sweep.scale * sweep.line) for name, sweep in SWEEPS.items()}
    dots = {name: simulated(name, sweep.scale * sweep.dots) for name, sweep in SWEEPS.items()}
    reference = solved("phase", [PHASE])
    magnitude, direction = _polar(reference)
    turned = {name: float(np.ptp(np.unwrap(_polar(line)[1], period=360.0))) for name, line in lines.items()}
    evenness = float(np.ptp(_polar(lines["phase"])[0]) / magnitude[0])
    follow = np.polyfit(SWEEPS["phase"].line, np.unwrap(_polar(lines["phase"])[1], period=360.0), 1)[0]
    off = max(_difference(name, dots[name]) for name in SWEEPS)
    table = tuple(
        (sweep.name, f"{value:g}", f"{speed:.4f}", f"{angle:.2f}")
        for name, sweep in SWEEPS.items()
        for value, speed, angle in zip(sweep.dots, *_polar(dots[name]), strict=True)
    )
    return Figure(
        title="Fig. 3.9: steady mean velocity over each oscillation parameter",
        shows="The thesis varies one parameter at a time of the reference set, 2.7 mm, 25 Hz, 0.4 mm and 270 deg with "
        "friction 0.6. Horizontal amplitude and frequency change magnitude and direction, the vertical amplitude only "
        "the magnitude, the phase only the direction.",
        comparisons=(
            of_number("Magnitude at the reference set (read from the axis)", 0.3, float(magnitude[0]), "m/s"),
            Comparison("Direction at the reference set", "lost", f"{direction[0]:.2f} deg from +x", "the curve is lost"),
            Comparison(
                "Direction over the horizontal amplitude, from the sliding limit to 10 mm", "changes",
                f"by {turned['horizontal_amplitude']:.1f} deg", "agrees",
            ),
            Comparison(
                "Direction over the frequency, from the sliding limit to 150 Hz", "changes",
                f"by {turned['frequency']:.1f} deg", "agrees",
            ),
            Comparison(
                "Direction over the vertical amplitude, 0.002 to 0.397 mm", "does not change",
                f"by {turned['amplitude']:.2f} deg", "slightly, not visible on an axis of 360 deg",
            ),
            Comparison("Magnitude over the phase", "does not change", f"by {evenness:.0e} of it", "rounding only"),
            Comparison("Direction over the phase", "changes", f"{follow:.6f} deg per degree", "agrees"),
        ),
        differs="All statements hold; the vertical amplitude also turns the velocity, by "
        f"{turned['amplitude']:.1f} deg over its whole range. Where parts always slide, the simulator is within "
        f"{100.0 * off:.2f} % of the equation.",
        assumed=(
            "Only the axes of the thesis's curves are left. Over amplitude and frequency the vertical amplitude is "
            "the lift-off amplitude, g / w^2: with 0.4 mm, parts would lift off above 25 Hz.",
            "The line begins at the limit of permanent sliding (0.477 mm, 10.51 Hz). Below, eq. 3.27 does not hold, "
            "and the simulated velocities include sticking.",
        ),
        pictures=(
            Picture(
                _plot(lines, dots, reference),
                "Line: eq. 3.27. Crosses: the simulator's planar model. Ring: the reference set. Rows: speed, direction.",
            ),
        ),
        tables=(
            Table("Simulated velocities.", ("Parameter", "Value", "Speed, m/s", "Direction, deg"), table),
        ),
    )  # fmt: skip


def _reference_value(parameter: str) -> float:
    surface = Surface()
    reference = {
        "horizontal_amplitude": surface.horizontal_amplitude,
        "frequency": surface.frequency,
        "amplitude": surface.lift_off_amplitude,
        "phase": PHASE,
    }
    return reference[parameter]


def _difference(name: str, dots: np.ndarray) -> float:
    """Return the largest relative difference of simulated and solved velocities where a part always slides."""
    sweep = SWEEPS[name]
    valid = sweep.dots >= sweep.line[0]
    expected = solved(name, sweep.scale * sweep.dots[valid])
    return float((np.hypot(*(dots[valid] - expected).T) / np.hypot(*expected.T)).max())


def _plot(lines: dict[str, np.ndarray], dots: dict[str, np.ndarray], reference: np.ndarray) -> bytes:
    figure = new_figure(7.6, 4.2)
    panels = figure.subplots(2, 4)
    for column, (name, sweep) in enumerate(SWEEPS.items()):
        at = np.array([_reference_value(name) / sweep.scale])
        for row, label in enumerate(("speed, m/s", "direction, deg")):
            axes = panels[row, column]
            solution, simulation = (_polar(each[name])[row] for each in (lines, dots))
            if row and name == "phase":  # up to 270 deg and beyond, as on the thesis's axis
                solution, simulation = (np.unwrap(each, period=360.0) + 360.0 for each in (solution, simulation))
            axes.plot(sweep.line, solution, color=INK, linewidth=1.2)
            axes.plot(sweep.dots, simulation, "x", color=FAILURE, markersize=4)
            axes.plot(at, _polar(reference)[row], "o", color=SUCCESS, markersize=6, markerfacecolor="none")
            axes.set_ylim(LIMITS[row][column])
            style(axes, **({"xlabel": sweep.name} if row else {}), **({"ylabel": label} if not column else {}))
    return png(figure)
