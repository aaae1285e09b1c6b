"""Plots of the report for tasks with several parts."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from agents.evaluation import figures
from agents.evaluation.figures import INK, SHOWN, SUCCESS
from agents.evaluation.results import Results
from agents.evaluation.rollout import Rollout
from vibgym.rendering import colours

MAPPED = 4
"""Episodes on a map: the first ones; more lines would hide each other."""


def kind_colour(kind: int) -> tuple[float, ...]:
    """As in the films."""
    return tuple(channel / 255.0 for channel in colours.PARTS[kind % len(colours.PARTS)])


def trajectories(results: Results, task: str, policy: str) -> bytes:
    """Paths of all parts in the first episodes, to scale; how many parts are done, and how near they come to each other."""
    rollout = results.rollouts[task, policy]
    height = figures.height_of_map(results.surface)
    figure = figures.new_figure(6.2, height + 1.5)
    grid = figure.add_gridspec(2, 2, height_ratios=[height, 1.5])
    _map(figure.add_subplot(grid[0, :]), results, rollout)
    _done(figure.add_subplot(grid[1, 0]), rollout)
    _clearances(figure.add_subplot(grid[1, 1]), results, rollout)
    return figures.png(figure)


def _map(axes: Axes, results: Results, rollout: Rollout) -> None:
    scene = results.scenes[rollout.task]
    for zone in scene.zones:
        low, size = 1e3 * np.array(zone.low), 1e3 * (np.array(zone.high) - zone.low)
        colour = kind_colour(zone.kind)
        axes.add_patch(Rectangle(tuple(low), *size, facecolor=(*colour, 0.14), edgecolor="none", zorder=1.5))
        axes.add_patch(
            Rectangle(tuple(low), *size, fill=False, edgecolor=colour, linewidth=0.9, linestyle=(0, (4, 2)), zorder=2)
        )
    for episode in rollout.poses[:MAPPED]:
        for part, kind in enumerate(scene.kinds):
            points = episode[:, part, :2]
            points = points[np.isfinite(points[:, 0])]
            if len(points):
                figures.draw_path(axes, 1e3 * points, kind_colour(kind))
    figures.draw_table(axes, results.surface)


def _times(rollout: Rollout) -> np.ndarray:
    return np.arange(rollout.done.shape[1]) * rollout.step_time


def _end(rollout: Rollout) -> float:
    return float(rollout.steps[:SHOWN].max()) * rollout.step_time


def shares_done(rollout: Rollout) -> np.ndarray:
    """(episodes, most steps + 1) share of the parts that are done; nan after the end."""
    present = np.isfinite(rollout.poses[:, 0, :, 0]).sum(axis=1)
    return rollout.done / present[:, None]


def _done(axes: Axes, rollout: Rollout) -> None:
    times, shares = _times(rollout), 100.0 * shares_done(rollout)[:SHOWN]
    for share, colour in zip(shares, figures.outcome_colours(rollout), strict=True):
        axes.plot(times, share, color=colour, linewidth=0.8, alpha=0.5, drawstyle="steps-post")
    axes.set(xlim=(0.0, _end(rollout)), ylim=(-4.0, 104.0))
    figures.style(axes, xlabel="time (s)", ylabel="parts done (%)")


def _clearances(axes: Axes, results: Results, rollout: Rollout) -> None:
    times, clearances = _times(rollout), 1e3 * rollout.clearances[:SHOWN]
    for each, colour in zip(clearances, figures.outcome_colours(rollout), strict=True):
        axes.plot(times, np.maximum(each, 0.0), color=colour, linewidth=0.8, alpha=0.5)
    finite = clearances[np.isfinite(clearances)]
    top = max(float(finite.max()) if finite.size else 0.0, 10.0)
    apart = results.tasks[rollout.task].apart
    if apart is not None:
        top = max(top, 1.3e3 * apart)
        axes.axhspan(1e3 * apart, 1.05 * top, color=SUCCESS, alpha=0.10, linewidth=0)
    axes.set(xlim=(0.0, _end(rollout)), ylim=(-0.03 * top, 1.05 * top))
    figures.style(axes, xlabel="time (s)", ylabel="smallest distance (mm)")


def arrivals(results: Results, task: str) -> bytes:
    """Share of the episodes at the goal by a time, and mean share of the parts that are done, for every policy."""
    figure = figures.new_figure(8.6, 2.8)
    left, right = figure.subplots(1, 2)
    end = figures.draw_arrivals(left, results, task)
    for name in results.names(task):
        rollout = results.rollouts[task, name]
        shares = _held(shares_done(rollout), rollout.steps)
        right.plot(
            _times(rollout),
            100.0 * shares.mean(axis=0),
            color=figures.policy_colour(results, name),
            linewidth=1.9,
            drawstyle="steps-post",
        )
    right.set(xlim=(0.0, end), ylim=(-2.0, 103.0))
    figures.style(right, xlabel="time (s)", ylabel="parts done, mean (%)")
    handles, labels = left.get_legend_handles_labels()
    legend = figure.legend(handles, labels, loc="outside right center", frameon=False, fontsize=8.5, handlelength=1.4)
    for text in legend.get_texts():
        text.set_color(INK)
    return figures.png(figure)


def _held(values: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """``values`` (episodes, most steps + 1), from the end of each episode on its last one."""
    last = values[np.arange(len(steps)), steps]
    return np.where(np.arange(values.shape[1]) > steps[:, None], last[:, None], values)
