"""Plots of the report, as PNG on white: what all of them share, and those of the tasks for one part."""

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
from vibgym.scene import Surface

SHOWN = 30
"""Episodes in a trajectory plot: the first ones."""

WORTH_SHOWING = 0.05
"""The time axis of arrivals ends with the last success of those policies that succeed at least so often."""

INK, MUTED, GRID = "#262c38", "#6c7380", "#e3e6ea"
SUCCESS, FAILURE = "#0b7a75", "#d1572a"
POLICY_COLOURS = ("#9aa1ac", "#d1572a", "#b8860b", "#2f6fde", "#0b7a75", "#8a4fbf", "#c2478a", "#4c8c2b")
DPI = 170


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches."""
    return Figure((width, height), dpi=DPI, layout="constrained", facecolor="white")


def png(figure: Figure) -> bytes:
    """The figure as a file."""
    file = io.BytesIO()
    figure.savefig(file, format="png", metadata={"Software": None})
    return file.getvalue()


def style(axes: Axes, **labels: str) -> None:
    """Quiet axes; ``labels`` are arguments of ``axes.set``."""
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
    map_height = height_of_map(surface)
    figure = new_figure(6.2, map_height + 1.5)
    grid = figure.add_gridspec(2, panels, height_ratios=[map_height, 1.5])
    _map(figure.add_subplot(grid[0, :]), results, rollout)
    times = np.arange(rollout.poses.shape[1]) * rollout.step_time
    left = rollout.goals[:SHOWN, None, :] - rollout.poses[:SHOWN, :, 0]
    distance = 1e3 * np.hypot(left[..., 0], left[..., 1])
    axes = figure.add_subplot(grid[1, 0])
    assert facts.position_tolerance is not None
    _errors(axes, rollout, times, distance, 1e3 * facts.position_tolerance, 0.1)
    style(axes, xlabel="time (s)", ylabel="distance (mm)")
    if facts.heading_tolerance is not None:
        turn = np.degrees(left[..., 2])
        if task == "Align":
            symmetry = results.scenes[task].parts[0].symmetry
            period = 360.0 / symmetry if symmetry else 1e-9
            turn = turn - period * np.floor(turn / period + 0.5)
        axes = figure.add_subplot(grid[1, 1])
        _errors(axes, rollout, times, np.abs(turn), math.degrees(facts.heading_tolerance), 0.1)
        style(axes, xlabel="time (s)", ylabel="heading error (deg)")
    return png(figure)


def outcome_colours(rollout: Rollout) -> list[str]:
    """Of the first episodes."""
    return [SUCCESS if each else FAILURE for each in rollout.success[:SHOWN]]


def height_of_map(surface: Surface) -> float:
    """Of a map 6.2 inches wide, inches."""
    return 5.75 * (surface.height + surface.element_size) / (surface.width + surface.element_size) + 0.32


def draw_table(axes: Axes, surface: Surface) -> None:
    """The surface from above, in mm."""
    size, edge = (1e3 * surface.width, 1e3 * surface.height), 1e3 * surface.element_size
    axes.add_patch(Rectangle((0, 0), *size, facecolor="#f7f8f9", edgecolor="#474e5c", linewidth=1.0, zorder=0))
    lines: list[Any] = [[(edge * j, 0), (edge * j, size[1])] for j in range(1, surface.columns)]
    lines += [[(0, edge * i), (size[0], edge * i)] for i in range(1, surface.rows)]
    axes.add_collection(LineCollection(lines, colors="#e0e3e8", linewidths=0.5, zorder=1))
    margin = 0.5 * edge
    style(axes)
    axes.grid(False)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g} mm")
    axes.set_yticks([])  # the same scale
    axes.set(xlim=(-margin, size[0] + margin), ylim=(-margin, size[1] + margin), aspect="equal")
    for spine in axes.spines.values():
        spine.set_visible(False)


def draw_path(axes: Axes, points: np.ndarray, colour: Any) -> None:
    """A path (k, 2), mm, with a ring at its start and a dot at its end."""
    axes.plot(*points.T, color=colour, linewidth=0.9, alpha=0.75, zorder=3, solid_capstyle="round")
    axes.plot(*points[0], "o", color=colour, markersize=2.6, markerfacecolor="white", markeredgewidth=0.8, zorder=4)
    axes.plot(*points[-1], ".", color=colour, markersize=3.4, zorder=5)


def _map(axes: Axes, results: Results, rollout: Rollout) -> None:
    tolerance = results.tasks[rollout.task].position_tolerance
    assert tolerance is not None
    for path, goal, colour in zip(rollout.poses[:SHOWN], rollout.goals, outcome_colours(rollout), strict=False):
        points = path[:, 0, :2]
        draw_path(axes, 1e3 * points[np.isfinite(points[:, 0])], colour)
        ring = Circle(tuple(1e3 * goal[:2]), 1e3 * tolerance, fill=False, edgecolor=INK, linewidth=0.6, zorder=4)
        axes.add_patch(ring)
    draw_table(axes, results.surface)


def _errors(
    axes: Axes, rollout: Rollout, times: np.ndarray, errors: np.ndarray, tolerance: float, floor: float
) -> None:
    for each, colour in zip(errors, outcome_colours(rollout), strict=True):
        axes.plot(times, np.maximum(each, floor), color=colour, linewidth=0.8, alpha=0.6)
    axes.axhspan(floor, tolerance, color=SUCCESS, alpha=0.10, linewidth=0)
    top = max(float(np.nanmax(errors)), 10.0 * tolerance)
    axes.set(yscale="log", ylim=(floor, 1.4 * top), xlim=(0.0, float(times[rollout.steps[:SHOWN].max()])))
    axes.minorticks_off()
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")


def policy_colour(results: Results, name: str) -> str:
    """Of a policy throughout the report."""
    return POLICY_COLOURS[list(results.policies).index(name) % len(POLICY_COLOURS)]


def arrivals(results: Results, task: str) -> bytes:
    """Share of all episodes that have reached the goal by a time, for every policy."""
    figure = new_figure(8.2, 2.8)
    axes = figure.add_subplot()
    draw_arrivals(axes, results, task)
    put_legend(axes)
    return png(figure)


def draw_arrivals(axes: Axes, results: Results, task: str) -> float:
    """The curves of :func:`arrivals`; returns where the time axis ends, s."""
    rollouts = {name: results.rollouts[task, name] for name in results.names(task)}
    episodes = results.tasks[task].episodes
    end = results.tasks[task].step_limit * next(iter(rollouts.values())).step_time
    arrived = {name: np.sort(each.time_to_goal[each.success]) for name, each in rollouts.items()}
    # A few late successes would squeeze the rest into a corner; the legend has all of them.
    last = [float(each[-1]) for each in arrived.values() if len(each) >= WORTH_SHOWING * episodes]
    shown = min(end, 1.08 * max(last, default=end))
    for name, times in arrived.items():
        share = 100.0 * np.arange(len(times) + 1) / episodes
        axes.step(
            [0.0, *times, end],
            [*share, share[-1]],
            where="post",
            color=policy_colour(results, name),
            linewidth=1.9,
            label=f"{name} ({share[-1]:.1f} %)",
        )
    axes.set(xlim=(0.0, shown), ylim=(-2.0, 103.0))
    style(axes, xlabel="time to goal, hold included (s)", ylabel="episodes at the goal (%)")
    return shown


def put_legend(axes: Axes) -> None:
    """Beside the axes."""
    legend = axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8.5, handlelength=1.4)
    for text in legend.get_texts():
        text.set_color(INK)
