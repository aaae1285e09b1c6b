"""Fig. 3.8: acceleration of a part from rest, for three coefficients of friction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.figure import Figure, figure, listed
from studies.thesis.sliding import STEPS, simulated_velocity, steady, velocity
from vibgym import Surface

FRICTION = (0.3, 0.6, 0.9)
PERIODS = 20  # 0.8 s, as the thesis's axis
PHASE = 1.5 * math.pi
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


def transients() -> list[Transient]:
    """Solve eq. 3.27 for the prototype at the lift-off amplitude and a phase of 270 deg, for each friction."""
    surface = Surface()
    ratio = np.array(FRICTION) * surface.gravity / (surface.table_speed * surface.angular_frequency)
    path = velocity(ratio, 1.0, PHASE, PERIODS)
    final = surface.table_speed * steady(ratio, 1.0, PHASE)
    late = surface.table_speed * velocity(ratio, 1.0, PHASE, 1, path[-1])
    path = surface.table_speed * path
    step = surface.period / STEPS
    sums = np.concatenate([np.zeros_like(path[:1]), np.cumsum(0.5 * (path[1:] + path[:-1]), axis=0)])
    speed, mean_speed = (np.hypot(*np.moveaxis(v, -1, 0)) for v in (path, (sums[STEPS:] - sums[:-STEPS]) / STEPS))
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
    runs, surface = transients(), Surface()
    simulated = [
        simulated_velocity(surface, friction, [surface.lift_off_amplitude], [PHASE])[0] for friction in FRICTION
    ]
    speeds = [float(np.hypot(*run.steady)) for run in runs]
    rises, ripples = [run.rise for run in runs], [1e3 * run.ripple for run in runs]
    off = [np.hypot(*(ours - run.steady)) / np.hypot(*run.steady) for ours, run in zip(simulated, runs, strict=True)]
    values = {
        "speed": speeds[1],
        "spread": 100.0 * (max(speeds) / min(speeds) - 1.0),
        "rises": listed(rises, 2, "s"),
        "falls": "agrees" if rises == sorted(rises, reverse=True) else "does not fall",
        "ripples": listed(ripples, 0, "mm/s"),
        "grows": "agrees" if ripples == sorted(ripples) else "does not grow",
        "directions": listed([math.degrees(math.atan2(*run.steady[::-1])) for run in runs], 2, "deg"),
        "off": 100.0 * max(off),
    }
    rows = [
        {"Friction": f"{friction}", "Equation": f"{speed:.5f} m/s", "Simulator": f"{np.hypot(*ours):.5f} m/s"}
        for friction, speed, ours in zip(FRICTION, speeds, simulated, strict=True)
    ]
    return figure("transient", values, [_plot(runs)], rows)


def _plot(runs: Sequence[Transient]) -> bytes:
    picture = new_figure(6.2, 4.6)
    panels = picture.subplots(3, 1)
    for axes, friction, run in zip(panels, FRICTION, runs, strict=True):
        axes.plot(run.time, run.speed, color=INK, linewidth=0.8)
        axes.plot(run.mean_time, run.mean_speed, color=FAILURE, linewidth=1.4, linestyle="--")
        axes.plot(0.8, np.hypot(*run.steady), "o", color=SUCCESS, markersize=5, markerfacecolor="none", clip_on=False)
        style(axes, ylabel="speed, m/s")
        axes.set(xlim=(0.0, 0.8), ylim=(0.0, 0.42))
        axes.annotate(f"friction {friction}", (0.78, 0.04), ha="right", fontsize=7.5, color=MUTED)
    style(panels[-1], xlabel="time, s")
    return png(picture)
