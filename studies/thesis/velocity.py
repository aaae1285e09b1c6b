"""Fig. 7.3: steady velocity of a part in a uniform field over the elements' amplitude, with and without a dead zone."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.figure import Comparison, Figure, Picture, Table, of_number, of_range
from vibgym import Part, Simulator, Surface
from vibgym.actuators import ACTUATORS
from vibgym.physics.core.drive import polar_drive
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
    shape = (len(commanded), surface.rows, surface.columns)
    command = polar_drive(
        np.broadcast_to(commanded[:, None, None], shape), np.full(shape, PHASE), surface.angular_frequency
    )
    settings = {"dead_zone": dead_zone, "dead_zone_form": form, "latency": 0, "gain_spread": 0.0, "phase_spread": 0.0}
    hardware = {"kind": "prototype", **settings, "seed": 0, "gain": gain}
    actuators = ACTUATORS.make("hardware", hardware, surface, len(commanded), 1)
    actuators.prepare(command)
    actuators.reset(np.arange(len(commanded)), np.zeros((len(commanded), 0)))
    simulator = Simulator(surface, part, worlds=len(commanded))
    simulator.reset([0.1, 0.5 * surface.depth, 0.0], [*surface.idle_velocity(part.friction), 0.0])
    positions = []
    for periods in (SETTLE, MEAN):
        ((drive, _),) = actuators.apply(command)
        simulator.advance_drive(drive, periods)
        positions.append(simulator.pose[:, 0, :2])
    return np.hypot(*(positions[1] - positions[0]).T) / (MEAN * surface.period)


PART = "aluminium_block"
LARGEST, POINTS = 0.39e-3, 79  # m; of the plot
IN_TABLE = (0.05, 0.08, 0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.39)  # mm


def draw() -> Figure:
    """Compute and plot the velocity over the amplitude."""
    part = shipped_part(PART)
    zones: dict[str, tuple[float, str]] = {"no dead zone": (0.0, FORMS[0])}
    zones |= {f"{form} dead zone": (DEAD_ZONE, form) for form in FORMS}
    figure = new_figure(6.2, 3.2)
    axes = figure.add_subplot()
    amplitude = np.sort(np.append(np.linspace(0.0, LARGEST, POINTS), DEAD_ZONE * np.array([0.9999, 1.0])))
    for (name, (width, form)), colour, line in zip(
        zones.items(), (INK, FAILURE, SUCCESS, MUTED), ("-", "-", "--", ":")
    ):
        speed = steady_velocity(part, amplitude, dead_zone=width, form=form)
        axes.plot(1e3 * amplitude, speed, color=colour, linestyle=line, linewidth=1.4, label=name)
    axes.axvline(1e3 * DEAD_ZONE, color=MUTED, linewidth=0.6)
    style(axes, xlabel="commanded amplitude of all elements, mm", ylabel="steady velocity, m/s")
    axes.set_xlim(0, 0.4)
    axes.legend(frameon=False, fontsize=7.5, labelcolor=MUTED)
    commanded = [1e-3 * each for each in IN_TABLE]
    speeds = [steady_velocity(part, commanded, dead_zone=width, form=form) for width, form in zones.values()]
    rows = tuple(
        (f"{each:.2f} mm", *(f"{1e3 * one:.1f} mm/s" for one in row))
        for each, row in zip(IN_TABLE, np.transpose(speeds).tolist(), strict=True)
    )
    below = IN_TABLE.index(0.08)
    return Figure(
        title="Fig. 7.3: velocity in a uniform field over the amplitude",
        shows="On the prototype the velocity of a part agreed with the model for amplitudes above 0.1 mm. Below, it was "
        "smaller or zero, since such amplitudes were not realised. The measured points are lost, so no velocity can be "
        "read: the axis ends at 0.4 m/s, with a tick every 0.1 m/s. The largest velocity is from the thesis's summary.",
        comparisons=(
            of_range("Velocity at 0.39 mm, by the axis", None, 0.4, float(speeds[0][-1]), "m/s"),
            of_number("Largest velocity of the prototype; vibgym at 0.39 mm", 0.35, float(speeds[0][-1]), "m/s"),
            Comparison(
                "Commanded amplitude 0.08 mm, below the smallest realised",
                "slower than the model, or at rest",
                ", ".join(f"{1e3 * speed[below]:.1f} mm/s ({name})" for name, speed in zip(zones, speeds)),
                "slower than the model with all three forms; the form of the prototype is not known",
            ),
        ),
        differs="At large amplitudes the velocity agrees with the axis. The prototype's top speed of 0.35 m/s exceeds the "
        "largest of the model below lift-off (0.305 m/s). Below 0.1 mm only the trend can be compared.",
        assumed=(
            "The part is the aluminium block with a sliding friction of 0.58; the thesis's text does not name it.",
            "The realised amplitude for commands below 0.1 mm is not known: all three forms of dead zone of the "
            "actuators are shown.",
        ),
        pictures=(Picture(png(figure), "Steady mean velocity, from the planar model with actuators."),),
        tables=(Table("Steady velocities.", ("Amplitude", *(name.capitalize() for name in zones)), rows),),
    )
