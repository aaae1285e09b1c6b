"""Plots of the report, as PNG on white."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import MaxNLocator

from agents.evaluation.results import Results
from agents.evaluation.rollout import Rollout

SHOWN = 30
"""Episodes in a trajectory plot: the first ones."""

WORTH_SHOWING = 0.05
"""The time axis of arrivals ends with the last success of those policies that succeed at least so often."""

INK, MUTED, GRID = "#262c38", "#6c7380", "#e3e6ea"
SUCCESS, FAILURE = "#0b7a75", "#d1572a"
POLICY_COLOURS = ("#9aa1ac", "#d1572a", "#b8860b", "#2f6fde", "#0b7a75", "#8a4fbf", "#c2478a", "#4c8c2b")
DPI = 170


def _figure(width: float, height: float) -> Figure:
    return Figure((width, height), dpi=DPI, layout="constrained", facecolor="white")


def _png(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png", metadata={"Software": None})
    return file.getvalue()


def _style(axes: Axes, **labels: str) -> None:
    axes.tick_params(colors=MUTED, labelsize=7.5, length=2.5, width=0.6)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set(color="#b6bcc6", linewidth=0.6)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set(**labels)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set(color=MUTED, fontsize=8)
    axes.title.set(color=INK, fontsize=8.5)


def trajectories(results: Results, task: str, policy: str) -> bytes:
    """Paths of the first episodes on the surface, to scale, and how their errors shrink."""
    rollout, facts = results.rollouts[task, policy], results.tasks[task]
    surface = results.surface
    panels = 1 if facts.heading_tolerance is None else 2
    map_height = 5.75 * (surface.height + surface.element_size) / (surface.width + surface.element_size) + 0.32
    figure = _figure(6.2, map_height + 1.5)
    grid = figure.add_gridspec(2, panels, height_ratios=[map_height, 1.5])
    _map(figure.add_subplot(grid[0, :]), results, rollout)
    times = np.arange(rollout.poses.shape[1]) * rollout.step_time
    left = rollout.goals[:SHOWN, None, :] - rollout.poses[:SHOWN]
    distance = 1e3 * np.hypot(left[..., 0], left[..., 1])
    axes = figure.add_subplot(grid[1, 0])
    _errors(axes, rollout, times, distance, 1e3 * facts.position_tolerance, 0.1)
    _style(axes, xlabel="time (s)", ylabel="distance (mm)")
    if facts.heading_tolerance is not None:
        turn = np.degrees(left[..., 2])
        if task == "Align":
            period = 360.0 / results.part.symmetry if results.part.symmetry else 1e-9
            turn = turn - period * np.floor(turn / period + 0.5)
        axes = figure.add_subplot(grid[1, 1])
        _errors(axes, rollout, times, np.abs(turn), math.degrees(facts.heading_tolerance), 0.1)
        _style(axes, xlabel="time (s)", ylabel="heading error (deg)")
    return _png(figure)


def _colours(rollout: Rollout) -> list[str]:
    return [SUCCESS if each else FAILURE for each in rollout.success[:SHOWN]]


def _map(axes: Axes, results: Results, rollout: Rollout) -> None:
    surface, mm = results.surface, 1e3
    size, edge = (mm * surface.width, mm * surface.height), mm * surface.element_size
    axes.add_patch(Rectangle((0, 0), *size, facecolor="#f7f8f9", edgecolor="#474e5c", linewidth=1.0, zorder=0))
    lines: list[Any] = [[(edge * j, 0), (edge * j, size[1])] for j in range(1, surface.columns)]
    lines += [[(0, edge * i), (size[0], edge * i)] for i in range(1, surface.rows)]
    axes.add_collection(LineCollection(lines, colors="#e0e3e8", linewidths=0.5, zorder=1))
    for path, goal, colour in zip(rollout.poses[:SHOWN], rollout.goals, _colours(rollout), strict=False):
        points = mm * path[np.isfinite(path[:, 0]), :2]
        axes.plot(*points.T, color=colour, linewidth=0.9, alpha=0.75, zorder=3, solid_capstyle="round")
        axes.plot(*points[0], "o", color=colour, markersize=2.6, markerfacecolor="white", markeredgewidth=0.8, zorder=4)
        axes.plot(*points[-1], ".", color=colour, markersize=3.4, zorder=5)
        tolerance = mm * results.tasks[rollout.task].position_tolerance
        axes.add_patch(Circle(tuple(mm * goal[:2]), tolerance, fill=False, edgecolor=INK, linewidth=0.6, zorder=4))
    margin = 0.5 * edge
    _style(axes)
    axes.grid(False)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g} mm")
    axes.set_yticks([])  # the same scale
    axes.set(xlim=(-margin, size[0] + margin), ylim=(-margin, size[1] + margin), aspect="equal")
    for spine in axes.spines.values():
        spine.set_visible(False)


def _errors(
    axes: Axes, rollout: Rollout, times: np.ndarray, errors: np.ndarray, tolerance: float, floor: float
) -> None:
    for each, colour in zip(errors, _colours(rollout), strict=True):
        axes.plot(times, np.maximum(each, floor), color=colour, linewidth=0.8, alpha=0.6)
    axes.axhspan(floor, tolerance, color=SUCCESS, alpha=0.10, linewidth=0)
    top = max(float(np.nanmax(errors)), 10.0 * tolerance)
    axes.set(yscale="log", ylim=(floor, 1.4 * top), xlim=(0.0, float(times[rollout.steps[:SHOWN].max()])))
    axes.minorticks_off()
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")


def arrivals(results: Results, task: str) -> bytes:
    """Share of all episodes that have reached the goal by a time, for every policy."""
    figure = _figure(8.2, 2.8)
    axes = figure.add_subplot()
    first = next(iter(results.rollouts.values()))
    end = results.tasks[task].step_limit * first.step_time
    arrived = [np.sort(r.time_to_goal[r.success]) for key, r in results.rollouts.items() if key[0] == task]
    # A few late successes would squeeze the rest into a corner; the legend has all of them.
    last = [float(each[-1]) for each in arrived if len(each) >= WORTH_SHOWING * len(first.seeds)]
    shown = min(end, 1.08 * max(last, default=end))
    for index, (name, times) in enumerate(zip(results.policies, arrived, strict=True)):
        share = 100.0 * np.arange(len(times) + 1) / len(first.seeds)
        colour = POLICY_COLOURS[index % len(POLICY_COLOURS)]
        label = f"{name} ({share[-1]:.1f} %)"
        axes.step([0.0, *times, end], [*share, share[-1]], where="post", color=colour, linewidth=1.9, label=label)
    axes.set(xlim=(0.0, shown), ylim=(-2.0, 103.0))
    _style(axes, xlabel="time to goal, hold included (s)", ylabel="episodes at the goal (%)")
    legend = axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8.5, handlelength=1.4)
    for text in legend.get_texts():
        text.set_color(INK)
    return _png(figure)
