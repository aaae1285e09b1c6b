"""Figs. 7.4 and 7.5: alignment of parts in a squeeze field without a sensor (section 7.2.2)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, new_figure, png, style
from studies.thesis.closed_loop import common_command, ready
from studies.thesis.figure import Figure, figure
from vibgym import Part, Simulator, Surface
from vibgym.fields import squeeze
from vibgym.scene.parts import shipped_part

LINE = 0.078
"""m, y of the squeeze line: middle of the six rows on the thesis's axis."""

START = 0.442
"""m, x of the parts at the start: middle of the thesis's axis."""

REACH = 0.013
"""m: all elements have full amplitude, as the nearest centres are half an element from the line."""

SECONDS = 10.0
TRANSIENT, LAST = 2.0, 1.5  # s, at the start and at the end
RESTING = math.radians(10.0)
STABLE = math.radians(22.5)


@dataclass(frozen=True)
class Squeezed:
    """Trajectories of parts, one per world."""

    time: np.ndarray  # (k,) s
    pose: np.ndarray  # (k, worlds, 3) m, rad, not wrapped
    symmetry: int  # headings are modulo ``2 pi / symmetry``; in the thesis, modulo pi

    @property
    def offset(self) -> np.ndarray:
        """Distance from the squeeze line along y (k, worlds) m."""
        return self.pose[..., 1] - LINE

    @property
    def heading(self) -> np.ndarray:
        """Heading relative to the mean final heading, modulo the symmetry (k, worlds) rad."""
        final = np.exp(1j * self.symmetry * self.pose[-1, :, 2]).mean()
        return np.angle(np.exp(1j * self.symmetry * self.pose[..., 2]) * np.conj(final)) / self.symmetry

    @property
    def late(self) -> np.ndarray:
        """Whether the transient is over (k,)."""
        return self.time >= TRANSIENT

    @property
    def resting(self) -> float:
        """Share of the parts with a change of heading below 10 deg during the last 1.5 s."""
        return float(self._rests().mean())

    @property
    def stable(self) -> float:
        """Share of the parts that also end within 22.5 deg of the mean heading."""
        return float((self._rests() & (np.abs(self.heading[-1]) < STABLE)).mean())

    def _rests(self) -> np.ndarray:
        heading = self.pose[self.time >= self.time[-1] - LAST, :, 2]
        return np.ptp(heading, axis=0) < RESTING


def squeezed(
    part: Part,
    hardware: str | Mapping[str, Any],
    *,
    worlds: int,
    surface: Surface | None = None,
    seconds: float = SECONDS,
) -> Squeezed:
    """Simulate parts from random poses in a squeeze field at the lift-off amplitude.

    Args:
        part: of any shape.
        hardware: ``"ideal"``, or ``"prototype"``: a sample of :class:`vibgym.actuators.PrototypeActuators` per world; a
            mapping of ``kind`` and settings for others.
        worlds: number of starts.
        surface: None: the prototype's.
        seconds: duration, s.
    """
    surface = Surface() if surface is None else surface
    random = np.random.default_rng(74)
    pose = np.zeros((worlds, 1, 3))
    pose[:, 0, 0] = START
    pose[:, 0, 1] = random.uniform(part.radius, 2.0 * LINE - part.radius, worlds)
    pose[:, 0, 2] = random.uniform(-math.pi, math.pi, worlds)
    actuators = ready(hardware, surface, worlds, random)
    amplitude, phase = (np.tile(grid, (worlds, 1, 1)) for grid in squeeze(START, LINE, 0.0, 1.0, REACH).drive(surface))
    command = common_command(surface, amplitude, phase)
    simulator = Simulator(surface, part, worlds=worlds)
    simulator.reset(pose, [*surface.idle_velocity(part.friction), 0.0])
    poses = [simulator.pose[:, 0]]
    for _ in range(round(seconds / surface.period)):
        for drive, periods in actuators.apply(command):
            simulator.advance_drive(drive, periods)
        poses.append(simulator.pose[:, 0])
    return Squeezed(np.arange(len(poses)) * surface.period, np.array(poses), max(part.symmetry, 1))


HARDWARE = ("ideal", "prototype")
STARTS, OTHERS = 200, 100  # of the part in the plot, and of the others
PLOTTED = 20


def objects() -> dict[str, Part]:
    """Return the parts of the table by description; friction 0.6 where the thesis gives none."""
    triangle = [(0.0, 0.0), (0.05, 0.0), (0.025, 0.025 * math.sqrt(3.0))]
    angle = [(0.0, 0.0), (0.06, 0.0), (0.06, 0.02), (0.02, 0.02), (0.02, 0.06), (0.0, 0.06)]
    return {
        "aluminium block, 50 x 35 mm": shipped_part("aluminium_block"),
        "steel block, 50 x 40 mm": shipped_part("steel_block"),
        "block, 30 x 20 mm": Part.rectangle(0.030, 0.020, friction=0.6),
        "square, 40 mm": Part.rectangle(0.040, 0.040, friction=0.6),
        "square, 20 mm": Part.rectangle(0.020, 0.020, friction=0.6),
        "L-shape, 60 mm": Part.polygon(angle, friction=0.6),
        "triangle, 50 mm": Part.polygon(triangle, friction=0.6),
    }


def largest_deviations(run: Squeezed) -> tuple[float, float]:
    """Return the largest standard deviations after the transient: of y, mm, and of the heading modulo the symmetry, deg."""
    return (
        1e3 * float(run.offset[run.late].std(axis=1).max()),
        math.degrees(float(run.heading[run.late].std(axis=1).max())),
    )


def draw() -> Figure:
    """Compute and plot trajectories and standard deviations of the aluminium block, with a table for other parts."""
    block = next(iter(objects()))
    runs = {
        (name, hardware): squeezed(part, hardware, worlds=STARTS if name == block else OTHERS)
        for name, part in objects().items()
        for hardware in HARDWARE
    }
    deviations = {key: largest_deviations(run) for key, run in runs.items()}
    own = {hardware: runs[block, hardware] for hardware in HARDWARE}
    real = own["prototype"]
    loose = [name for name in objects() if runs[name, "prototype"].stable < 0.9]
    values = {
        "offset": deviations[block, "prototype"][0],
        "heading": deviations[block, "prototype"][1],
        "ideal": deviations[block, "ideal"],
        "below": 100.0 * (np.degrees(real.heading[real.late].std(axis=1)) < 22.5).mean(),
        "loose": f"{len(loose)} of {len(objects())}: {'; '.join(loose)}",
    }
    rows = [
        {
            "Part": name, "Hardware": hardware, "Heading modulo": f"{360 // run.symmetry} deg",
            "Of y": f"{deviations[name, hardware][0]:.2f} mm", "Of the heading": f"{deviations[name, hardware][1]:.1f} deg",
            "Heading at rest": f"{100.0 * run.resting:.0f} %", "Stable": f"{100.0 * run.stable:.0f} %",
        }
        for (name, hardware), run in runs.items()
    ]  # fmt: skip
    return figure("squeeze", values, [_plot(own)], rows)


def _plot(own: dict[str, Squeezed]) -> bytes:
    picture = new_figure(7.6, 4.0)
    panels, real = picture.subplots(2, 2, sharex=True), own["prototype"]
    for k in range(PLOTTED):
        panels[0, 0].plot(real.time, 1e3 * real.pose[:, k, 1], color=INK, linewidth=0.5, alpha=0.7)
        turned = np.degrees(real.heading[:, k])
        jumps = np.abs(np.diff(turned, prepend=turned[0])) > 90.0  # no line where the heading wraps
        panels[1, 0].plot(real.time, np.where(jumps, np.nan, turned), color=INK, linewidth=0.5, alpha=0.7)
    for run, line in ((real, "-"), (own["ideal"], "--")):
        panels[0, 1].plot(run.time, 1e3 * run.offset.std(axis=1), color=INK, linewidth=1.2, linestyle=line)
        panels[1, 1].plot(run.time, np.degrees(run.heading.std(axis=1)), color=INK, linewidth=1.2, linestyle=line)
    for axes, bound in ((panels[0, 1], 5.0), (panels[1, 1], 22.5)):
        axes.axhline(bound, color=FAILURE, linewidth=0.8)
    labels = (("y, mm", "std of y, mm"), ("heading, deg", "std of the heading, deg"))
    for row in range(2):
        for column in range(2):
            style(panels[row, column], ylabel=labels[row][column], **({"xlabel": "time, s"} if row else {}))
            panels[row, column].tick_params(colors=MUTED)
    panels[0, 0].set_yticks(np.arange(0, 157, 26))
    panels[1, 0].set_yticks(np.arange(-90, 91, 45))
    panels[1, 1].set(ylim=(0, 67.5), yticks=np.arange(0, 68, 22.5), xlim=(0.0, real.time[-1]))
    return png(picture)
