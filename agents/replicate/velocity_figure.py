"""Fig. 7.3 as a plot and a table."""

from __future__ import annotations

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from agents.replicate.velocity import DEAD_ZONE, steady_velocity
from vibgym.physics.core.hardware import FORMS
from vibgym.scene.parts import shipped_part

PART = "aluminium_block"
LARGEST, POINTS = 0.39e-3, 79  # m; along the axis
IN_TABLE = (0.05, 0.08, 0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.39)  # mm


def draw() -> tuple[bytes, list[str], list[list[str]]]:
    """The plot, and the table's columns and rows."""
    part = shipped_part(PART)
    ways: dict[str, tuple[float, str]] = {"no dead zone": (0.0, FORMS[0])}
    ways |= {f"{form} dead zone": (DEAD_ZONE, form) for form in FORMS}
    figure = new_figure(6.2, 3.2)
    axes = figure.add_subplot()
    amplitude = np.sort(np.append(np.linspace(0.0, LARGEST, POINTS), DEAD_ZONE * np.array([0.9999, 1.0])))
    for (name, (width, form)), colour, line in zip(ways.items(), (INK, FAILURE, SUCCESS, MUTED), ("-", "-", "--", ":")):
        speed = steady_velocity(part, amplitude, dead_zone=width, form=form)
        axes.plot(1e3 * amplitude, speed, color=colour, linestyle=line, linewidth=1.4, label=name)
    axes.axvline(1e3 * DEAD_ZONE, color=MUTED, linewidth=0.6)
    style(axes, xlabel="commanded amplitude of all elements, mm", ylabel="steady velocity, m/s")
    axes.set_xlim(0, 0.4)
    axes.legend(frameon=False, fontsize=7.5, labelcolor=MUTED)
    told = [1e-3 * each for each in IN_TABLE]
    speeds = [steady_velocity(part, told, dead_zone=width, form=form) for width, form in ways.values()]
    rows = [
        [f"{each:.2f} mm", *(f"{1e3 * one:.1f} mm/s" for one in row)]
        for each, row in zip(IN_TABLE, np.transpose(speeds).tolist(), strict=True)
    ]
    return png(figure), ["Amplitude", *(name.capitalize() for name in ways)], rows
