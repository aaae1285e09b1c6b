"""Plots of the pages: paths, errors over time, arrivals, learning curves, parts a minute."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import MaxNLocator

from agents.evaluation.figures import FAILURE, INK, MUTED, POLICY_COLOURS, SUCCESS, kind_colour, new_figure, png, style
from agents.evaluation.films import Rollout
from agents.evaluation.table import RATES, values, where
from vibgym.policies.task_info import TaskInfo
from vibgym.rendering import Scenery
from vibgym.scene import Surface

COLOURS = {"good": "#0b7a75", "tilted": "#b8860b", "close": "#2f6fde", "wrong": "#8a4fbf", "lost": "#d1572a"}
"""Colours of the outcomes of parts that come and go."""

WORTH_SHOWING = 0.05
"""Time axes end with the last success of policies with at least this success rate."""

SHOWN = 30
"""Episodes in a trajectory plot, from the first."""

MAPPED = 4
"""Episodes on a map of several parts, from the first; more lines would hide each other."""

FLOOR = 0.1
"""mm and degrees at which the logarithmic axes of errors begin."""


PANELS = {
    "position_error": ("distance (mm)", 1e3),
    "heading_error": ("heading error (deg)", 180.0 / math.pi),
    "parts_done": ("parts done", 1.0),
    "clearance": ("smallest distance (mm)", 1e3),
}
"""Labels of :data:`agents.evaluation.films.SERIES` and factors; the axes of errors are logarithmic."""


def trajectories(rollout: Rollout, task: TaskInfo, scenery: Scenery) -> bytes:
    """Draw the paths of the first episodes on the surface, to scale, and below them their errors over time."""
    shown = ("position_error", "heading_error") if task.has_goal else ("parts_done", "clearance")
    panels = [(name, values[:SHOWN]) for name in shown if (values := rollout.over_time(name)) is not None]
    # What counts as success, shaded.
    good = {
        "position_error": (FLOOR, 1e3 * task.position_tolerance),
        "heading_error": (FLOOR, math.degrees(task.heading_tolerance)),
        "clearance": None if task.apart is None else (1e3 * task.apart, 1.3e3 * task.apart),
    }
    table, edge = task.surface, task.surface.element_size
    height = 5.75 * (table.depth + edge) / (table.width + edge) + 0.32  # inches, of a map 6.2 inches wide
    end = float(rollout.steps[:SHOWN].max()) * rollout.step_time
    seconds = np.arange(rollout.poses.shape[1]) * rollout.step_time
    figure = new_figure(6.2, height + 1.5)
    layout = figure.add_gridspec(2, max(len(panels), 1), height_ratios=[height, 1.5])
    _map(figure.add_subplot(layout[0, :]), rollout, task, scenery)
    for column, (name, values) in enumerate(panels):
        axes, (label, factor) = figure.add_subplot(layout[1, column]), PANELS[name]
        least = FLOOR if task.has_goal else 0.0
        for curve, colour in zip(np.maximum(factor * values, least), outcome_colours(rollout), strict=True):
            axes.plot(seconds, curve, color=colour, linewidth=0.8, alpha=0.6)
        if good.get(name) is not None:
            axes.axhspan(*good[name], color=SUCCESS, alpha=0.10, linewidth=0)
        axes.set(xlim=(0.0, end))
        if task.has_goal:
            axes.set(yscale="log")
            axes.minorticks_off()
            axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        style(axes, xlabel="time (s)", ylabel=label)
    return png(figure)


def outcome_colours(rollout: Rollout) -> list[str]:
    """Return the colours of the first episodes."""
    return [SUCCESS if success else FAILURE for success in rollout.success[:SHOWN]]


def draw_table(axes: Axes, surface: Surface) -> None:
    """Draw the surface from above, in mm."""
    size, edge = (1e3 * surface.width, 1e3 * surface.depth), 1e3 * surface.element_size
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


def _map(axes: Axes, rollout: Rollout, task: TaskInfo, scenery: Scenery) -> None:
    """Draw the paths, with a ring at the start and a dot at the end: of one part coloured by outcome, of several by kind."""
    several = len(task.parts) > 1
    for zone in scenery.zones:
        low, size = 1e3 * np.array(zone.low), 1e3 * (np.array(zone.high) - zone.low)
        tint = kind_colour(zone.kind)
        axes.add_patch(Rectangle(tuple(low), *size, facecolor=(*tint, 0.14), edgecolor="none", zorder=1.5))
        dashed: dict[str, Any] = {"fill": False, "edgecolor": tint, "linewidth": 0.9, "linestyle": (0, (4, 2))}
        axes.add_patch(Rectangle(tuple(low), *size, **dashed, zorder=2))
    outcomes = outcome_colours(rollout)
    most = 1 if task.continuous_feed else MAPPED if several else SHOWN
    for episode in range(min(most, len(rollout.seeds))):
        for part, kind in enumerate(task.kind):
            points = 1e3 * rollout.poses[episode, :, part, :2]
            there = np.flatnonzero(np.isfinite(points[:, 0]))
            if not len(there):
                continue
            points = points[there[0] : there[-1] + 1]  # the line has a gap while the slot is empty
            line: dict[str, Any] = {"color": kind_colour(kind) if several else outcomes[episode]}
            axes.plot(*points.T, **line, linewidth=0.9, alpha=0.75, zorder=3, solid_capstyle="round")
            axes.plot(*points[0], "o", **line, markersize=2.6, markerfacecolor="white", markeredgewidth=0.8, zorder=4)
            axes.plot(*points[-1], ".", **line, markersize=3.4, zorder=5)
            if task.has_goal:
                centre = tuple(1e3 * rollout.goals[episode, part, :2])
                ring: dict[str, Any] = {"fill": False, "edgecolor": INK, "linewidth": 0.6, "zorder": 4}
                axes.add_patch(Circle(centre, 1e3 * task.position_tolerance, **ring))
    draw_table(axes, task.surface)


def name_lines(figure: Figure, lines: Sequence[Line2D]) -> None:
    """Add a legend beside the axes with the labels of some lines."""
    labels = [str(line.get_label()) for line in lines]
    # The texts come afterwards: a label that begins with "_" would be left out.
    shown = {"frameon": False, "fontsize": 8.5, "handlelength": 1.4, "labelcolor": INK}
    legend = figure.legend(lines, ["policy"] * len(labels), loc="outside right center", **shown)
    for text, label in zip(legend.get_texts(), labels, strict=True):
        text.set(text=label, parse_math=False)


def arrivals(episodes: pd.DataFrame, names: Sequence[str], continuous_feed: bool) -> bytes:
    """Draw the share of episodes at the goal over time for every policy; where parts come and go, parts a minute.

    Args:
        episodes: of all policies on one task and hardware.
        names: of all policies of the page, which have the same colours everywhere.
        continuous_feed: whether parts come and go.
    """
    some = {name: where(episodes, policy=name) for name in dict.fromkeys(episodes["policy"])}
    if continuous_feed:
        return _rates(some)
    figure = new_figure(8.6, 2.8)
    axes, end = figure.subplots(), float(values(episodes, "limit_s").max())
    arrived = {name: np.sort(group["time_to_goal_s"].dropna()) for name, group in some.items()}
    # A few late successes would squeeze the rest into a corner; the legend has all of them.
    last = [float(at[-1]) for name, at in arrived.items() if len(at) >= max(WORTH_SHOWING * len(some[name]), 1)]
    for name, at in arrived.items():
        share = 100.0 * np.arange(len(at) + 1) / len(some[name])
        look: dict[str, Any] = {**look_of(name, names), "linewidth": 1.9, "where": "post"}
        axes.step([0.0, *at, end], [*share, share[-1]], label=f"{name} ({share[-1]:.1f} %)", **look)
    axes.set(xlim=(0.0, min(end, 1.08 * max(last, default=end))), ylim=(-2.0, 103.0))
    style(axes, xlabel="time to goal, hold included (s)", ylabel="episodes at the goal (%)")
    name_lines(figure, axes.get_lines())
    return png(figure)


def _rates(some: Mapping[str, pd.DataFrame]) -> bytes:
    """Draw parts a minute by outcome, a bar for every policy."""
    figure = new_figure(8.6, 0.9 + 0.34 * len(some))
    axes, left = figure.subplots(), np.zeros(len(some))
    for column, event in RATES.items():
        rates = np.array([group[column].mean() for group in some.values()])
        axes.barh(list(some), rates, left=left, color=COLOURS[event], height=0.66, label=event)
        left += rates
    axes.invert_yaxis()
    style(axes, xlabel="parts a minute")
    figure.legend(loc="outside lower center", ncols=len(RATES), frameon=False, fontsize=8, labelcolor=INK)
    return png(figure)


LINE_COLOURS = (*POLICY_COLOURS[1:], POLICY_COLOURS[0])
"""The grey last: in reports it is that of the policy that does nothing."""

PATTERNS: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.2)))
"""Patterns of lines, when there are more policies than colours."""

IMITATION = (0, (3, 1.6))
"""Pattern of a learning curve during imitation."""


def look_of(name: str, names: Sequence[str]) -> dict[str, Any]:
    """Return colour and pattern of a policy's lines, the same on the whole page."""
    pattern, colour = divmod(list(names).index(name), len(LINE_COLOURS))
    return {"color": LINE_COLOURS[colour], "linestyle": PATTERNS[pattern % len(PATTERNS)]}


def draw_curves(curves: Mapping[str, Mapping[int | None, pd.DataFrame]], names: Sequence[str]) -> bytes:
    """Draw success rate and median time to goal over the steps of training: a line per run, a colour per policy."""
    figure = new_figure(8.6, 3.0)
    left, right = figure.subplots(1, 2)
    for name, runs in curves.items():
        for curve in runs.values():
            _draw_run(left, curve, 100.0 * values(curve, "success"), look_of(name, names)["color"])
            _draw_run(right, curve, values(curve, "time_to_goal"), look_of(name, names)["color"])
    most = max(1, *(int(curve["steps"].iloc[-1]) for runs in curves.values() for curve in runs.values()))
    for axes in (left, right):
        axes.xaxis.set_major_formatter(lambda value, _: steps_text(value))
        axes.set(xlim=(0.0, 1.02 * most))
    left.set(ylim=(-2.0, 103.0))
    right.set(ylim=(0.0, None))
    style(left, xlabel="environment steps", ylabel="success (%)")
    style(right, xlabel="environment steps", ylabel="median time to goal (s)")
    shown = [Line2D([], [], color=look_of(name, names)["color"], linewidth=1.6, label=name) for name in curves]
    name_lines(figure, shown)
    return png(figure)


def _draw_run(axes: Axes, curve: pd.DataFrame, seen: np.ndarray, colour: str) -> None:
    """Draw one run, phase by phase; each phase begins where the one before has ended."""
    end, steps = 0, values(curve, "steps")
    for phase, those in itertools.groupby(curve["phase"]):
        start, end = end, end + len(list(those))
        some = slice(max(start - 1, 0), end)
        pattern = IMITATION if phase == "imitation" else "-"
        axes.plot(steps[some], seen[some], color=colour, linewidth=1.2, alpha=0.85, linestyle=pattern)
    axes.plot(steps[-1], seen[-1], ".", color=colour, markersize=4.0)


def steps_text(steps: float) -> str:
    """Return a number of steps as "3 M" or "250 k"."""
    if steps >= 999_500:
        return f"{steps / 1e6:.3g} M"
    return f"{steps / 1e3:.3g} k" if steps >= 1000 else f"{steps:.0f}"


def throughput(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Draw parts a minute against the number of parts for every policy, by outcome, and the bound."""
    names = list(dict.fromkeys(row["policy"] for row in rows))
    figure = new_figure(2.9 * max(len(names), 2), 3.0)
    all_axes = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
    for axes, name in zip(all_axes, names, strict=True):
        some = [row for row in rows if row["policy"] == name]
        counts = [row["parts"] for row in some]
        axes.plot(counts, [row["bound"] for row in some], "--", color=MUTED, linewidth=1.0, label="bound")
        for event, colour in COLOURS.items():
            width = 1.9 if event == "good" else 1.1
            rates = [row[event] for row in some]
            axes.plot(counts, rates, "o-", color=colour, linewidth=width, markersize=3.2, label=event)
        low, high = (
            [row["good"] if math.isnan(row[end]) else row[end] for row in some] for end in ("good_low", "good_high")
        )
        axes.fill_between(counts, low, high, color=COLOURS["good"], alpha=0.18, linewidth=0)
        axes.set_xticks(counts)
        axes.set_ylim(bottom=0.0)
        style(axes, xlabel="parts in play", title=name)
    all_axes[0].set_ylabel("parts a minute")
    name_lines(figure, all_axes[0].get_lines())
    return png(figure)
