"""Plots of the report, as PNG on white."""

from __future__ import annotations

import io
import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from studies.accuracy import comparisons
from studies.accuracy.friction_experiment import Experiment
from studies.accuracy.ladder import SceneResult
from studies.accuracy.model_checks import Order

INK, MUTED, GRID = "#262c38", "#6c7380", "#e3e6ea"
STYLES = {
    "planar": ("#0b7a75", "o"),
    "averaged, order 1": ("#8fb3f0", "v"),
    "averaged, order 2": ("#2f6fde", "^"),
    "point sampling": ("#b8860b", "s"),
    "SciPy LSODA": ("#d1572a", "D"),
    "SciPy DOP853": ("#c2478a", "P"),
    "MuJoCo": ("#6c7380", "X"),
}
LEAST_STRONG, LEAST_WEAK = 1e-9, 1e-7  # m and relative: what is smaller is drawn there
DPI = 150


def style_of(method: str) -> tuple[str, str]:
    """Colour and marker of a method."""
    return STYLES.get(method, ("#8a4fbf", "*"))


def png(figure: Figure) -> bytes:
    """The picture's file. All text means what it says, no formulas."""
    for text in figure.findobj(Text):
        text.set_parse_math(False)  # type: ignore[attr-defined]
    file = io.BytesIO()
    figure.savefig(file, format="png", metadata={"Software": None})
    return file.getvalue()


def styled(axes: Axes) -> None:
    """The look of all plots."""
    axes.tick_params(colors=MUTED, labelsize=8, length=2.5, width=0.6, which="major")
    axes.tick_params(length=0, which="minor")
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set(color="#b6bcc6", linewidth=0.6)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set(color=MUTED, fontsize=8.5)
    axes.title.set(color=INK, fontsize=9.5)


def error_against_cost(result: SceneResult) -> bytes:
    """Strong errors on the left, weak ones on the right; every usable candidate, fronts, tolerances, failures."""
    figure = Figure((11.0, 4.7), dpi=DPI, layout="constrained", facecolor="white")
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
    floor = LEAST_WEAK if weak else LEAST_STRONG
    scale = 100.0 if weak else 1e3

    def shown(error: float) -> float:
        return scale * max(error, floor)

    tolerances = result.scene.weak_tolerances if weak else result.scene.strong_tolerances
    for tolerance in tolerances:
        axes.axhline(scale * tolerance, color="#9aa1ac", linewidth=0.7, zorder=1)
    models = {each.method: each for each in result.models}
    for method in result.methods:
        colour, marker = style_of(method)
        rows, costs, values = result.curve(method, weak)
        axes.plot(
            costs, [shown(each) for each in values], marker, color=colour, markersize=5.5, alpha=0.85,
            markeredgecolor="white", markeredgewidth=0.5, label=method if rows else "", zorder=3,
        )  # fmt: skip
        if method in models:
            model = models[method].weak if weak else models[method].strong.median
            if math.isfinite(model):
                axes.axhline(shown(model), color=colour, linewidth=1.0, linestyle=(0, (5, 2)), zorder=2)
            steps = [row.weak_step if weak else row.strong_step and row.strong_step.median for row in rows]
            axes.plot(
                costs, [shown(each or 0.0) for each in steps], marker, color=colour, markersize=5.0,
                markerfacecolor="none", markeredgewidth=0.8, zorder=2,
            )  # fmt: skip
        failed = [row for row in result.rows if row.candidate.method == method and row.failed and not row.refused]
        found = [(row.cost, row.weak if weak else row.strong.median) for row in failed]
        found = [each for each in found if math.isfinite(each[0]) and math.isfinite(each[1])]
        if found:
            axes.plot(
                [cost for cost, _ in found], [shown(error) for _, error in found], "x", color=colour, markersize=5,
                markeredgewidth=1.0, zorder=3,
            )  # fmt: skip
    best = comparisons.front(result, weak)
    errors = [shown(row.weak if weak else row.strong.median) for row in best]
    axes.plot([row.cost for row in best], errors, color=INK, linewidth=1.1, label="Pareto front", zorder=2.5)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="cost (µs per period, world and core)",
        ylabel="error of the mean velocity (%)" if weak else "median error of the trajectory (mm)",
        title="Weak: mean velocity" if weak else "Strong: trajectory",
    )
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(numticks=12))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}" if 1e-4 < value < 1e5 else f"{value:.0e}"))
        axis.set_minor_formatter(NullFormatter())
    styled(axes)


def convergence(found: list[Order]) -> bytes:
    """Error over steps for every scene, with the fitted slopes."""
    figure = Figure((6.4, 3.4), dpi=DPI, layout="constrained", facecolor="white")
    axes = figure.subplots()
    for order, colour, marker in zip(found, ("#0b7a75", "#2f6fde", "#d1572a"), ("o", "s", "^"), strict=False):
        axes.loglog(
            order.steps, [1e3 * each for each in order.errors], marker, color=colour, markersize=5, linestyle="-",
            linewidth=1.0, label=f"{order.scene}: order {order.order:.2f}",
        )  # fmt: skip
    axes.set(xlabel="Runge-Kutta steps per period", ylabel="median error after 10 periods (mm)")
    axes.legend(frameon=False, fontsize=8, labelcolor=INK)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    styled(axes)
    return png(figure)


def radius_over_frequency(found: Experiment) -> bytes:
    """The friction experiment: sweeps up and down, closed forms, noisy measurements."""
    figure = Figure((11.0, 3.9), dpi=DPI, layout="constrained", facecolor="white")
    panels = figure.subplots(1, len(found.blocks), squeeze=False)[0]
    for axes, block in zip(panels, found.blocks, strict=True):
        low, high = block.window
        name = block.name.replace("_", " ")
        axes.axvspan(low, high, color="#eef1f4", zorder=0, label="both are possible")
        axes.plot(
            found.frequencies, 1e3 * block.expected_up, color="#0b7a75", linewidth=1.1, label="closed form, upward"
        )
        axes.plot(
            found.frequencies, 1e3 * block.expected_down, color="#d1572a", linewidth=1.1, linestyle=(0, (4, 2)),
            label="closed form, downward",
        )  # fmt: skip
        axes.plot(
            found.frequencies, 1e3 * block.measured, ".", color="#9aa1ac", markersize=4, label="measured, with noise"
        )
        axes.plot(found.frequencies, 1e3 * block.up, "^", color="#0b7a75", markersize=3.6, label="simulated, upward")
        axes.plot(
            found.frequencies, 1e3 * block.down, "v", color="#d1572a", markersize=3.6, label="simulated, downward"
        )
        axes.set(
            xlabel="frequency (Hz)",
            ylabel="radius of motion (mm)",
            title=f"{name}: µ = {block.friction:g}, fitted {block.fitted:.4f} ± {block.standard_error:.4f}",
        )
        styled(axes)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, frameon=False, fontsize=8, labelcolor=INK)
    return png(figure)
