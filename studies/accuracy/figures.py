"""Plots of the report, as PNG on white."""

from __future__ import annotations

import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from agents.evaluation.figures import INK, MUTED, new_figure, png, style
from studies.accuracy import comparisons
from studies.accuracy.ladder import Row, SceneResult
from studies.accuracy.model_checks import Order

STYLES = {
    "planar": ("#0b7a75", "o"),
    "averaged, order 1": ("#8fb3f0", "v"),
    "averaged, order 2": ("#2f6fde", "^"),
    "point sampling": ("#b8860b", "s"),
    "SciPy LSODA": ("#d1572a", "D"),
    "SciPy DOP853": ("#c2478a", "P"),
    "MuJoCo": ("#6c7380", "X"),
}
MIN_STRONG, MIN_WEAK = 1e-9, 1e-7  # m and relative: lower limits of the axes


def style_of(method: str) -> tuple[str, str]:
    """Return colour and marker of a method."""
    return STYLES.get(method, ("#8a4fbf", "*"))


def error_against_cost(result: SceneResult) -> bytes:
    """Draw strong errors on the left, weak ones on the right; every usable candidate, fronts, tolerances, failures."""
    figure = new_figure(11.0, 4.7)
    panels = figure.subplots(1, 2)
    for axes, weak in zip(panels, (False, True), strict=True):
        _panel(axes, result, weak)
    handles, _ = panels[0].get_legend_handles_labels()
    look: dict[str, Any] = {"color": MUTED, "linestyle": "none", "markersize": 5}
    if result.models:
        handles.append(Line2D([], [], marker="^", markerfacecolor="none", label="step error alone", **look))
        handles.append(Line2D([], [], color=MUTED, linewidth=1.0, linestyle=(0, (5, 2)), label="model error alone"))
    if any(row.failed for row in result.rows):
        handles.append(Line2D([], [], marker="x", label="fails in some worlds", **look))
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False, fontsize=8, labelcolor=INK)
    return png(figure)


def _panel(axes: Axes, result: SceneResult, weak: bool) -> None:
    floor = MIN_WEAK if weak else MIN_STRONG
    scale = 100.0 if weak else 1e3

    def shown(error: float | None) -> float:
        return scale * max(error or 0.0, floor)

    for tolerance in result.scene.weak_tolerances if weak else result.scene.strong_tolerances:
        axes.axhline(scale * tolerance, color="#9aa1ac", linewidth=0.7, zorder=1)
    models = {each.method: each.weak if weak else each.strong.median for each in result.models}
    for method in result.methods:
        colour, marker = style_of(method)
        rows, costs, values = result.curve(method, weak)
        axes.plot(
            costs, [shown(each) for each in values], marker, color=colour, markersize=5.5, alpha=0.85,
            markeredgecolor="white", markeredgewidth=0.5, label=method if rows else "", zorder=3,
        )  # fmt: skip
        if method in models:
            if math.isfinite(models[method]):
                axes.axhline(shown(models[method]), color=colour, linewidth=1.0, linestyle=(0, (5, 2)), zorder=2)
            steps = [row.weak_step if weak else row.strong_step and row.strong_step.median for row in rows]
            axes.plot(
                costs, [shown(each) for each in steps], marker, color=colour, markersize=5.0, markerfacecolor="none",
                markeredgewidth=0.8, zorder=2,
            )  # fmt: skip
        failed = [row for row in result.rows if row.candidate.method == method and row.failed]
        failed = [row for row in failed if math.isfinite(row.cost) and math.isfinite(_error(row, weak))]
        if failed:
            points = [row.cost for row in failed], [shown(_error(row, weak)) for row in failed]
            axes.plot(*points, "x", color=colour, markersize=5, markeredgewidth=1.0, zorder=3)
    best = comparisons.front(result, weak)
    costs, errors = [row.cost for row in best], [shown(_error(row, weak)) for row in best]
    axes.plot(costs, errors, color=INK, linewidth=1.1, label="Pareto front", zorder=2.5)
    axes.set(xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(numticks=12))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}" if 1e-4 < value < 1e5 else f"{value:.0e}"))
        axis.set_minor_formatter(NullFormatter())
    style(
        axes,
        xlabel="cost (µs per period, world and core)",
        ylabel="error of the mean velocity (%)" if weak else "median error of the trajectory (mm)",
        title="Weak: mean velocity" if weak else "Strong: trajectory",
    )


def _error(row: Row, weak: bool) -> float:
    return row.weak if weak else row.strong.median


def convergence(found: list[Order]) -> bytes:
    """Draw error over steps for every scene, with the fitted slopes."""
    figure = new_figure(6.4, 3.4)
    axes = figure.subplots()
    for order, colour, marker in zip(found, ("#0b7a75", "#2f6fde", "#d1572a"), ("o", "s", "^"), strict=False):
        axes.loglog(
            order.steps, [1e3 * each for each in order.errors], marker, color=colour, markersize=5, linestyle="-",
            linewidth=1.0, label=f"{order.scene}: order {order.order:.2f}",
        )  # fmt: skip
    axes.legend(frameon=False, fontsize=8, labelcolor=INK)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    style(axes, xlabel="Runge-Kutta steps per period", ylabel="median error after 10 periods (mm)")
    return png(figure)
