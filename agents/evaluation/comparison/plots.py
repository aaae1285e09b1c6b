"""Plots of a comparison, as the reports have theirs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from agents.evaluation.comparison.curves import Curve
from agents.evaluation.comparison.profiles import Profile
from agents.evaluation.figures import POLICY_COLOURS, name_lines, new_figure, png, style

COLOURS = (*POLICY_COLOURS[1:], POLICY_COLOURS[0])
"""The grey last: in reports it is that of the policy that does nothing."""

PATTERNS: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.2)))
"""Of lines, when there are more policies than colours."""

IMITATION = (0, (3, 1.6))
"""Pattern of a learning curve while a law is imitated."""


def look_of(name: str, names: Sequence[str]) -> dict[str, Any]:
    """Colour and pattern of a policy's lines, the same on the whole page."""
    index = list(names).index(name)
    return {
        "color": COLOURS[index % len(COLOURS)],
        "linestyle": PATTERNS[index // len(COLOURS) % len(PATTERNS)],
    }


def draw_profile(profile: Profile, names: Sequence[str]) -> bytes:
    """Share of the episodes solved within a limit, with its band, for every policy."""
    figure = new_figure(8.6, 3.0)
    axes = figure.subplots()
    for name, (share, low, high) in profile.curves.items():
        look, band = look_of(name, names), (100.0 * low, 100.0 * high)
        axes.fill_between(profile.limits, *band, color=look["color"], alpha=0.16, linewidth=0, step="post")
        axes.plot(profile.limits, 100.0 * share, linewidth=1.8, label=name, drawstyle="steps-post", **look)
    limit = "limit (multiples of the time bound)" if profile.unit == "bound" else "limit (s)"
    axes.set(xlim=(profile.limits[0], profile.limits[-1]), ylim=(-2.0, 103.0))
    style(axes, xlabel=limit, ylabel="episodes solved within it (%)")
    name_lines(figure, axes.get_lines())
    return png(figure)


def draw_curves(curves: Mapping[str, Mapping[int | None, Curve]], names: Sequence[str]) -> bytes:
    """Success rate and median time to goal over the steps of training: a line for every run, a colour for every policy."""
    figure = new_figure(8.6, 3.0)
    left, right = figure.subplots(1, 2)
    most = 1
    for name, runs in curves.items():
        for curve in runs.values():
            most = max(most, int(curve.steps[-1]))
            _draw_run(left, curve, 100.0 * curve.success, look_of(name, names)["color"])
            _draw_run(right, curve, curve.time_to_goal, look_of(name, names)["color"])
    for axes in (left, right):
        axes.xaxis.set_major_formatter(lambda value, _: steps_text(value))
        axes.set(xlim=(0.0, 1.02 * most))
    left.set(ylim=(-2.0, 103.0))
    right.set(ylim=(0.0, None))
    style(left, xlabel="environment steps", ylabel="success (%)")
    style(right, xlabel="environment steps", ylabel="median time to goal (s)")
    name_lines(
        figure, [Line2D([], [], color=look_of(name, names)["color"], linewidth=1.6, label=name) for name in curves]
    )
    return png(figure)


def _draw_run(axes: Axes, curve: Curve, values: np.ndarray, colour: str) -> None:
    """One run, phase by phase; each begins where the one before has ended."""
    for start, end in phases(curve.phase):
        some = slice(max(start - 1, 0), end)
        pattern = IMITATION if curve.phase[start] == "imitation" else "-"
        axes.plot(curve.steps[some], values[some], color=colour, linewidth=1.2, alpha=0.85, linestyle=pattern)
    axes.plot(curve.steps[-1], values[-1], ".", color=colour, markersize=4.0)


def phases(phase: Sequence[str]) -> list[tuple[int, int]]:
    """First and last index plus one of every stretch of equal phases."""
    starts = [k for k in range(len(phase)) if k == 0 or phase[k] != phase[k - 1]]
    return list(zip(starts, [*starts[1:], len(phase)], strict=True))


def steps_text(steps: float) -> str:
    """ "3 M", "250 k"."""
    if steps >= 999_500:
        return f"{steps / 1e6:.3g} M"
    return f"{steps / 1e3:.3g} k" if steps >= 1000 else f"{steps:.0f}"
