"""Fig. 3.9: how each oscillation parameter changes the steady mean velocity, with the others at their reference."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from agents.evaluation.figures import FAILURE, INK, SUCCESS, new_figure, png, style
from studies.thesis.figure import Comparison, Figure, Picture, Table, of_number
from studies.thesis.sliding import simulated_velocity, steady
from vibgym import Surface

FRICTION = 0.6
PHASE = 1.5 * math.pi
POINTS = 161
LIMITS = (((0, 1.25), (0, 2), (0, 0.4), (0, 0.4)), ((-90, 180), (-90, 180), (-90, 180), (-90, 290)))
"""Of the axes, m/s and deg, by row and column."""


@dataclass(frozen=True)
class Sweep:
    """One parameter and where it is taken.

    Attributes:
        name: with its unit.
        scale: SI units in one of it.
        line: (n,) values of the equation's line, from where a part always slides.
        dots: (k,) values of the simulator, also where a part may stick.
    """

    name: str
    scale: float
    line: np.ndarray
    dots: np.ndarray


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
"""By the parameter's name. The permanent-sliding limit lies at 0.477 mm and 10.51 Hz."""


def _settings(parameter: str, value: float) -> tuple[Surface, float, float]:
    """Surface, vertical amplitude and phase of the reference set with one parameter altered, SI."""
    surface = Surface()
    if parameter in ("horizontal_amplitude", "frequency"):
        surface = replace(surface, max_amplitude=None, **{parameter: value})
    amplitude = value if parameter == "amplitude" else surface.lift_off_amplitude
    return surface, amplitude, value if parameter == "phase" else PHASE


def solved(parameter: str, values: Any) -> np.ndarray:
    """Steady mean velocities (n, 2) m/s by eq. 3.27, with ``parameter`` at ``values`` (n,) in SI units."""
    settings = [_settings(parameter, float(each)) for each in values]
    speed = np.array([surface.table_speed for surface, _, _ in settings])
    square = np.array([surface.angular_frequency for surface, _, _ in settings]) ** 2
    gravity, radius = settings[0][0].gravity, np.array([surface.horizontal_amplitude for surface, _, _ in settings])
    amplitude, phase = np.array([each[1:] for each in settings]).T
    share = np.minimum(amplitude * square / gravity, 1.0)  # 1 at lift-off, whichever way it was rounded
    return speed[:, None] * steady(FRICTION * gravity / (radius * square), share, phase)


def simulated(parameter: str, values: Any) -> np.ndarray:
    """The same by the simulator's planar model."""
    return np.array(
        [
            simulated_velocity(surface, FRICTION, [amplitude], [phase])[0]
            for surface, amplitude, phase in (_settings(parameter, float(each)) for each in values)
        ]
    )


def _polar(velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Magnitude and direction in deg."""
    return np.hypot(*velocity.T), np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))


def draw() -> Figure:
    """Magnitude and direction over the four parameters."""
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
        shows="From the reference set of 2.7 mm, 25 Hz, 0.4 mm and 270 deg with friction 0.6 the thesis alters one "
        "parameter at a time. Horizontal amplitude and frequency change magnitude and direction, the vertical "
        "amplitude the magnitude only, the phase the direction only.",
        comparisons=(
            of_number("Magnitude at the reference set (read from the axis)", 0.3, float(magnitude[0]), "m/s"),
            Comparison("Direction there", "lost", f"{direction[0]:.2f} deg from +x", "the curve is lost"),
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
                f"by {turned['amplitude']:.2f} deg", "a little, too little to be seen on an axis of 360 deg",
            ),
            Comparison("Magnitude over the phase", "does not change", f"by {evenness:.0e} of it", "none but rounding"),
            Comparison("Direction over the phase", "changes", f"{follow:.6f} deg a degree", "agrees"),
        ),
        differs="All statements hold; the vertical amplitude also turns the velocity, by "
        f"{turned['amplitude']:.1f} deg over its whole range. Where parts always slide, the simulator is within "
        f"{100.0 * off:.2f} % of the equation.",
        assumed=(
            "Of the thesis's curves only axes are left. Over amplitude and frequency the vertical amplitude stays "
            "at lift-off, g / w^2: 0.4 mm would throw parts up above 25 Hz.",
            "The line begins where a part always slides (0.477 mm, 10.51 Hz). Below, eq. 3.27 does not hold; the "
            "simulator's crosses there have sticking in them.",
        ),
        pictures=(
            Picture(
                _plot(lines, dots, reference),
                "Line: eq. 3.27. Crosses: the simulator's planar model. Ring: the reference set. Rows: speed, direction.",
            ),
        ),
        tables=(
            Table("The simulator's crosses.", ("Parameter", "Value", "Speed, m/s", "Direction, deg"), table),
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
    """Largest distance of the simulator's velocities from the equation's where a part always slides, relative."""
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
            angle = _polar(lines[name])[row]
            theirs = _polar(dots[name])[row]
            if row and name == "phase":  # from -90 to 270 deg and beyond, as on the thesis's axis
                angle, theirs = np.unwrap(angle, period=360.0) + 360.0, np.unwrap(theirs, period=360.0) + 360.0
            axes.plot(sweep.line, angle, color=INK, linewidth=1.2)
            axes.plot(sweep.dots, theirs, "x", color=FAILURE, markersize=4)
            axes.plot(at, _polar(reference)[row], "o", color=SUCCESS, markersize=6, markerfacecolor="none")
            axes.set_ylim(LIMITS[row][column])
            style(axes, **({"xlabel": sweep.name} if row else {}), **({"ylabel": label} if not column else {}))
    return png(figure)
