"""Fig. 3.9: steady mean velocity over each oscillation parameter, with the others at their reference values."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.figures import FAILURE, INK, SUCCESS, new_figure, png, style
from studies.thesis.figure import Figure, figure
from studies.thesis.sliding import simulated_velocity, steady
from vibgym import Surface

FRICTION = 0.6
POINTS = 161
REFERENCE = {
    "horizontal_amplitude": Surface().horizontal_amplitude,
    "frequency": Surface().frequency,
    "amplitude": Surface().lift_off_amplitude,
    "phase": 1.5 * math.pi,
}
"""Reference set of the thesis, SI."""


class Sweep(NamedTuple):
    """Parameter, its values and the limits of the axes."""

    name: str  # with unit
    scale: float  # of the unit, SI
    line: np.ndarray  # (n,) values for the equation, where a part always slides
    dots: np.ndarray  # (k,) values for the simulator, also where a part may stick
    limits: tuple[tuple[float, float], tuple[float, float]]  # m/s and deg


SWEEPS = {
    "horizontal_amplitude": Sweep(
        "horizontal amplitude, mm", 1e-3, np.linspace(0.48, 10.0, POINTS),
        np.array([0.1, 0.3, 0.48, 1, 2.7, 5, 7.5, 10]), ((0, 1.25), (-90, 180)),
    ),
    "frequency": Sweep(
        "frequency, Hz", 1.0, np.linspace(10.6, 150.0, POINTS), np.array([5, 8, 10.6, 25, 50, 75, 100, 150]),
        ((0, 2), (-90, 180)),
    ),
    "amplitude": Sweep(
        "vertical amplitude, mm", 1e-3, np.linspace(0.002, 0.397, POINTS), np.array([0.05, 0.1, 0.2, 0.3, 0.397]),
        ((0, 0.4), (-90, 180)),
    ),
    "phase": Sweep(
        "phase, deg", math.pi / 180.0, np.linspace(0.0, 360.0, POINTS), np.arange(0.0, 361.0, 45.0), ((0, 0.4), (-90, 290))
    ),
}  # fmt: skip
"""By parameter. The limits of permanent sliding are 0.477 mm and 10.51 Hz."""


def _settings(parameter: str, value: float) -> tuple[Surface, float, float]:
    """Return surface, vertical amplitude and phase of the reference set with one changed parameter, SI."""
    surface = Surface()
    if parameter in ("horizontal_amplitude", "frequency"):
        surface = replace(surface, max_amplitude=None, **{parameter: value})
    amplitude = value if parameter == "amplitude" else surface.lift_off_amplitude
    return surface, amplitude, value if parameter == "phase" else REFERENCE["phase"]


def solved(parameter: str, values: Any) -> np.ndarray:
    """Return steady mean velocities (n, 2) m/s by eq. 3.27, with ``parameter`` at ``values`` (n,) in SI units."""
    settings = [_settings(parameter, float(value)) for value in values]
    speed = np.array([surface.table_speed for surface, _, _ in settings])
    square = np.array([surface.angular_frequency for surface, _, _ in settings]) ** 2
    gravity, radius = settings[0][0].gravity, np.array([surface.horizontal_amplitude for surface, _, _ in settings])
    amplitude, phase = np.array([setting[1:] for setting in settings]).T
    share = np.minimum(amplitude * square / gravity, 1.0)  # 1 at lift-off, despite rounding
    return speed[:, None] * steady(FRICTION * gravity / (radius * square), share, phase)


def simulated(parameter: str, values: Any) -> np.ndarray:
    """Return the same by the simulator's planar model."""
    settings = [_settings(parameter, float(value)) for value in values]
    return np.array([simulated_velocity(surface, FRICTION, [a], [phase])[0] for surface, a, phase in settings])


def _polar(velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return magnitude and direction, deg."""
    return np.hypot(*velocity.T), np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))


def draw() -> Figure:
    """Compute and plot magnitude and direction over the four parameters."""
    lines = {name: solved(name, sweep.scale * sweep.line) for name, sweep in SWEEPS.items()}
    dots = {name: simulated(name, sweep.scale * sweep.dots) for name, sweep in SWEEPS.items()}
    reference = solved("phase", [REFERENCE["phase"]])
    (speed,), (direction,) = _polar(reference)
    directions = {name: np.unwrap(_polar(line)[1], period=360.0) for name, line in lines.items()}
    values = {
        "speed": float(speed),
        "direction": direction,
        **{f"turned_{name}": np.ptp(line) for name, line in directions.items()},
        "evenness": np.ptp(_polar(lines["phase"])[0]) / speed,
        "per_degree": np.polyfit(SWEEPS["phase"].line, directions["phase"], 1)[0],
        "off": 100.0 * max(_difference(name, dots[name]) for name in SWEEPS),
    }
    rows = [
        {"Parameter": sweep.name, "Value": f"{value:g}", "Speed, m/s": f"{speed:.4f}", "Direction, deg": f"{angle:.2f}"}
        for name, sweep in SWEEPS.items()
        for value, speed, angle in zip(sweep.dots, *_polar(dots[name]), strict=True)
    ]
    return figure("steady_velocity", values, [_plot(lines, dots, reference)], rows)


def _difference(name: str, dots: np.ndarray) -> float:
    """Return the largest relative difference of simulated and solved velocities where a part always slides."""
    sweep = SWEEPS[name]
    valid = sweep.dots >= sweep.line[0]
    expected = solved(name, sweep.scale * sweep.dots[valid])
    return float((np.hypot(*(dots[valid] - expected).T) / np.hypot(*expected.T)).max())


def _plot(lines: dict[str, np.ndarray], dots: dict[str, np.ndarray], reference: np.ndarray) -> bytes:
    picture = new_figure(7.6, 4.2)
    panels = picture.subplots(2, 4)
    for column, (name, sweep) in enumerate(SWEEPS.items()):
        for row, label in enumerate(("speed, m/s", "direction, deg")):
            axes = panels[row, column]
            solution, simulation = (_polar(velocity[name])[row] for velocity in (lines, dots))
            if row and name == "phase":  # up to 270 deg and beyond, as on the thesis's axis
                solution, simulation = (np.unwrap(angles, period=360.0) + 360.0 for angles in (solution, simulation))
            axes.plot(sweep.line, solution, color=INK, linewidth=1.2)
            axes.plot(sweep.dots, simulation, "x", color=FAILURE, markersize=4)
            at = REFERENCE[name] / sweep.scale
            axes.plot(at, _polar(reference)[row], "o", color=SUCCESS, markersize=6, markerfacecolor="none")
            axes.set_ylim(sweep.limits[row])
            style(axes, **({"xlabel": sweep.name} if row else {}), **({"ylabel": label} if not column else {}))
    return png(picture)
