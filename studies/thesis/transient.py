"""Fig. 3.8: acceleration of a part from rest, for three coefficients of friction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.figure import Comparison, Figure, Picture, Table, of_number
from studies.thesis.sliding import STEPS, simulated_velocity, steady, velocity
from vibgym import Surface

FRICTION = (0.3, 0.6, 0.9)
PERIODS = 20  # 0.8 s, as the thesis's axis
ARRIVED = 0.95


class Transient(NamedTuple):
    """Motion of a part from rest."""

    time: np.ndarray  # (k,) s
    speed: np.ndarray  # (k,) m/s
    mean_time: np.ndarray  # (m,) s
    mean_speed: np.ndarray  # (m,) m/s, of the mean velocity over the period around each time
    steady: np.ndarray  # (2,) m/s, mean velocity in the steady state
    rise: float  # s until the mean speed is 0.95 of the steady one
    ripple: float  # m/s, largest deviation of the velocity from its mean in the steady state


def transients(frictions: Sequence[float] = FRICTION, periods: int = PERIODS) -> list[Transient]:
    """Solve eq. 3.27 for the prototype at the lift-off amplitude and a phase of 270 deg, for each friction."""
    surface, phase = Surface(), 1.5 * math.pi
    ratio = np.asarray(frictions) * surface.gravity / (surface.table_speed * surface.angular_frequency)
    path = velocity(ratio, 1.0, phase, periods)
    final = surface.table_speed * steady(ratio, 1.0, phase)
    late = surface.table_speed * velocity(ratio, 1.0, phase, 1, path[-1])
    path = surface.table_speed * path
    step = surface.period / STEPS
    sums = np.concatenate([np.zeros_like(path[:1]), np.cumsum(0.5 * (path[1:] + path[:-1]), axis=0)])
    speed, mean_speed = (np.hypot(*np.moveaxis(each, -1, 0)) for each in (path, (sums[STEPS:] - sums[:-STEPS]) / STEPS))
    mean_time = (np.arange(len(mean_speed)) + 0.5 * STEPS) * step
    ripple = np.hypot(*np.moveaxis(late - late[:-1].mean(axis=0), -1, 0)).max(axis=0)
    return [
        Transient(
            time=np.arange(len(path)) * step,
            speed=speed[:, k],
            mean_time=mean_time,
            mean_speed=mean_speed[:, k],
            steady=final[k],
            rise=float(mean_time[np.argmax(mean_speed[:, k] >= ARRIVED * np.hypot(*final[k]))]),
            ripple=float(ripple[k]),
        )
        for k in range(len(ratio))
    ]


def draw() -> Figure:
    """Compute and plot the three transients."""
    found = transients()
    surface = Surface()
    simulated = [
        simulated_velocity(surface, each, [surface.lift_off_amplitude], [1.5 * math.pi])[0] for each in FRICTION
    ]
    speeds = np.array([np.hypot(*one.steady) for one in found])
    spread = 100.0 * (speeds.max() / speeds.min() - 1.0)
    angles = [math.degrees(math.atan2(one.steady[1], one.steady[0])) for one in found]
    rises, ripples = [one.rise for one in found], [one.ripple for one in found]
    off = max(float(np.hypot(*(a - b.steady)) / np.hypot(*b.steady)) for a, b in zip(simulated, found, strict=True))
    return Figure(
        title="Fig. 3.8: from rest to the steady velocity",
        shows="The thesis solves eq. 3.27 for friction 0.3, 0.6 and 0.9: the mean speed in the steady state does not "
        "depend on friction; more friction shortens the transient and increases the oscillation about the mean.",
        comparisons=(
            of_number("Steady mean speed, friction 0.6 (read from the axis)", 0.3, float(speeds[1]), "m/s"),
            Comparison(
                "Its change from friction 0.3 to 0.9", "none", f"{-spread:.2f} %", "not visible in a plot"
            ),
            Comparison(
                "Time to 95 % of it, friction 0.3, 0.6, 0.9", "falls with friction", _list(rises, "s", 2),
                "agrees" if rises == sorted(rises, reverse=True) else "does not fall",
            ),
            Comparison(
                "Largest deviation from the mean velocity", "grows with friction",
                _list([1e3 * each for each in ripples], "mm/s", 0), "agrees" if ripples == sorted(ripples) else "does not grow",
            ),
            Comparison(
                "Direction of the mean velocity", "not given for this figure", _list(angles, "deg", 2),
                "it depends on friction, by 10 deg between 0.3 and 0.9",
            ),
        ),
        differs="The speed agrees with the axis, and all three statements hold: friction changes the speed by "
        f"{spread:.1f} %. It also changes the direction. The simulator is within {100.0 * off:.3f} % of the equation.",
        assumed=("Start at rest, while the table moves along +y; amplitude and phase as in fig. 3.9.",),
        pictures=(
            Picture(
                _plot(found), "Solid: speed. Dashed: speed of the mean velocity over a period. Ring: steady "
                "state."
            ),
        ),
        tables=(
            Table(
                "Steady mean speed from the equation and from the simulator's planar model.",
                ("Friction", "Equation", "Simulator"),
                tuple(
                    (f"{friction}", f"{speed:.5f} m/s", f"{np.hypot(*each):.5f} m/s")
                    for friction, speed, each in zip(FRICTION, speeds, simulated, strict=True)
                ),
            ),
        ),
    )  # fmt: skip


def _list(values: list[float], unit: str, digits: int) -> str:
    return ", ".join(f"{each:.{digits}f}" for each in values) + f" {unit}"


def _plot(found: Sequence[Transient]) -> bytes:
    figure = new_figure(6.2, 4.6)
    for k, (friction, one) in enumerate(zip(FRICTION, found, strict=True)):
        axes = figure.add_subplot(3, 1, k + 1)
        axes.plot(one.time, one.speed, color=INK, linewidth=0.8)
        axes.plot(one.mean_time, one.mean_speed, color=FAILURE, linewidth=1.4, linestyle="--")
        axes.plot(
            [0.8], [np.hypot(*one.steady)], "o", color=SUCCESS, markersize=5, markerfacecolor="none", clip_on=False
        )
        style(axes, ylabel="speed, m/s", **({"xlabel": "time, s"} if k == 2 else {}))
        axes.set(xlim=(0.0, 0.8), ylim=(0.0, 0.42))
        axes.annotate(f"friction {friction}", (0.78, 0.04), ha="right", fontsize=7.5, color=MUTED)
    return png(figure)
