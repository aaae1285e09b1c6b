"""Plots of the report, as PNG on white."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from agents.evaluation.figures import INK, MUTED, new_figure, png, style
from studies.accuracy.ladder import SceneResult
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
    if result.table["failed_worlds"].any():
        handles.append(Line2D([], [], marker="x", label="fails in some worlds", **look))
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False, fontsize=8, labelcolor=INK)
    return png(figure)


def _panel(axes: Axes, result: SceneResult, weak: bool) -> None:
    floor, scale = (MIN_WEAK, 100.0) if weak else (MIN_STRONG, 1e3)
    column = "weak" if weak else "strong_median_m"

    def shown(error: Any) -> Any:
        return scale * np.maximum(error, floor)

    for tolerance in result.scene.weak_tolerances if weak else result.scene.strong_tolerances:
        axes.axhline(scale * tolerance, color="#9aa1ac", linewidth=0.7, zorder=1)
    models = {model.method: model.weak if weak else model.strong.median for model in result.models}
    for method in result.methods:
        colour, marker = style_of(method)
        curve = result.curve(method, weak)
        axes.plot(
            curve["cost_us"], shown(curve["error"]), marker, color=colour, markersize=5.5, alpha=0.85,
            markeredgecolor="white", markeredgewidth=0.5, label="" if curve.empty else method, zorder=3,
        )  # fmt: skip
        if method in models:
            if math.isfinite(models[method]):
                axes.axhline(shown(models[method]), color=colour, linewidth=1.0, linestyle=(0, (5, 2)), zorder=2)
            steps = shown(curve["weak_step" if weak else "strong_step_median_m"])
            axes.plot(
                curve["cost_us"], steps, marker, color=colour, markersize=5.0, markerfacecolor="none", markeredgewidth=0.8,
                zorder=2,
            )  # fmt: skip
        failed = result.table[(result.table["method"] == method) & (result.table["failed_worlds"] > 0)]
        failed = failed[np.isfinite(failed["cost_us"]) & np.isfinite(failed[column])]
        axes.plot(
            failed["cost_us"], shown(failed[column]), "x", color=colour, markersize=5, markeredgewidth=1.0, zorder=3
        )
    best = result.table[result.table["front_weak" if weak else "front_strong"]].sort_values("cost_us")
    axes.plot(best["cost_us"], shown(best[column]), color=INK, linewidth=1.1, label="Pareto front", zorder=2.5)
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


def convergence(orders: list[Order]) -> bytes:
    """Draw error over steps for every scene, with the fitted slopes."""
    figure = new_figure(6.4, 3.4)
    axes = figure.subplots()
    for order, colour, marker in zip(orders, ("#0b7a75", "#2f6fde", "#d1572a"), ("o", "s", "^"), strict=False):
        axes.loglog(
            order.steps, [1e3 * error for error in order.errors], marker, color=colour, markersize=5, linestyle="-",
            linewidth=1.0, label=f"{order.scene}: order {order.order:.2f}",
        )  # fmt: skip
    axes.legend(frameon=False, fontsize=8, labelcolor=INK)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    style(axes, xlabel="Runge-Kutta steps per period", ylabel="median error after 10 periods (mm)")
    return png(figure)
