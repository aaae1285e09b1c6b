"""Fig. 7.3: steady velocity of a part in a uniform field over the elements' amplitude, with and without a dead zone."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.closed_loop import IDEAL, common_command, ready
from studies.thesis.figure import Figure, figure
from vibgym import Part, Simulator, Surface
from vibgym.physics.core.hardware import FORMS
from vibgym.scene.parts import shipped_part

DEAD_ZONE = 1e-4
"""m, amplitude below which the prototype's elements did not move (thesis 7.2, 7.3)."""

PHASE = 1.5 * math.pi  # pushes along +x
SETTLE, MEAN = 30, 5
"""Periods until the velocity is steady (to 0.03 %, at a decay rate of 6.9 per second), and periods of the average."""


def steady_velocity(
    part: Part,
    amplitude: Sequence[float] | np.ndarray,
    *,
    surface: Surface | None = None,
    dead_zone: float = 0.0,
    form: str = "hard",
    gain: float = 1.0,
) -> np.ndarray:
    """Return steady speeds (n,) m/s of a part in uniform fields of a commanded amplitude, with a dead zone.

    Args:
        part: any.
        amplitude: (n,) m, of all elements; the part does not lift off, so actual amplitudes are limited to that.
        surface: None: the prototype's.
        dead_zone: m, width.
        form: among :data:`vibgym.physics.core.hardware.FORMS`.
        gain: actual over commanded amplitude.
    """
    surface = Surface() if surface is None else surface
    commanded = np.asarray(amplitude, dtype=np.float64)
    hardware = {**IDEAL, "dead_zone": dead_zone, "dead_zone_form": form, "gain": gain}
    actuators = ready(hardware, surface, len(commanded), np.random.default_rng(0))
    simulator = Simulator(surface, part, worlds=len(commanded))
    simulator.reset([0.1, 0.5 * surface.depth, 0.0], [*surface.idle_velocity(part.friction), 0.0])
    positions = []
    for periods in (SETTLE, MEAN):
        ((drive, _),) = actuators.apply(common_command(surface, commanded[:, None, None], np.array(PHASE)))
        simulator.advance_drive(drive, periods)
        positions.append(simulator.pose[:, 0, :2])
    return np.hypot(*(positions[1] - positions[0]).T) / (MEAN * surface.period)


PART = "aluminium_block"
LARGEST, POINTS = 0.39e-3, 79  # m; of the plot
IN_TABLE = (0.05, 0.08, 0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.39)  # mm
ZONES = {"no dead zone": (0.0, FORMS[0]), **{f"{form} dead zone": (DEAD_ZONE, form) for form in FORMS}}


def speeds(amplitude: np.ndarray) -> dict[str, np.ndarray]:
    """Return steady speeds (n,) m/s at amplitudes (n,) m, by name of the dead zone."""
    part = shipped_part(PART)
    return {name: steady_velocity(part, amplitude, dead_zone=width, form=form) for name, (width, form) in ZONES.items()}


def draw() -> Figure:
    """Compute and plot the velocity over the amplitude."""
    series = speeds(1e-3 * np.array(IN_TABLE))
    below = IN_TABLE.index(0.08)
    values = {
        "fastest": float(series["no dead zone"][-1]),
        "below": ", ".join(f"{1e3 * speed[below]:.1f} mm/s ({name})" for name, speed in series.items()),
    }
    rows = [
        {"Amplitude": f"{amplitude:.2f} mm"}
        | {name.capitalize(): f"{1e3 * speed[k]:.1f} mm/s" for name, speed in series.items()}
        for k, amplitude in enumerate(IN_TABLE)
    ]
    return figure("velocity", values, [_plot()], rows)


def _plot() -> bytes:
    picture = new_figure(6.2, 3.2)
    axes = picture.add_subplot()
    amplitude = np.sort(np.append(np.linspace(0.0, LARGEST, POINTS), DEAD_ZONE * np.array([0.9999, 1.0])))
    for (name, speed), colour, line in zip(
        speeds(amplitude).items(), (INK, FAILURE, SUCCESS, MUTED), ("-", "-", "--", ":"), strict=True
    ):
        axes.plot(1e3 * amplitude, speed, color=colour, linestyle=line, linewidth=1.4, label=name)
    axes.axvline(1e3 * DEAD_ZONE, color=MUTED, linewidth=0.6)
    style(axes, xlabel="commanded amplitude of all elements, mm", ylabel="steady velocity, m/s")
    axes.set_xlim(0, 0.4)
    axes.legend(frameon=False, fontsize=7.5, labelcolor=MUTED)
    return png(picture)
