"""The report's section on what one period costs."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from agents.evaluation import figures
from agents.evaluation.cost import FITTED, Cost, Curve
from agents.evaluation.pages import data_address

SIMULATION_COLOURS = {False: "#2f6fde", True: "#d1572a"}  # apart, in touch
CONTROL_COLOURS = ("#0b7a75", "#8a4fbf", "#b8860b", "#4c8c2b")

PROPORTIONAL = (0.85, 1.15)
"""Exponents that are called proportional to the number of parts."""

PAIRS = 1.85
"""Exponents from here on are those of pairs."""


def name_of(curve: Curve) -> str:
    """In the legend and the table."""
    if curve.what == "simulation":
        return "parts in touch" if curve.touching else "parts apart"
    return curve.what


def size_of(curve: Curve) -> str:
    """Of the surface."""
    return f"{curve.rows} × {curve.columns}"


def growth(exponent: float | None) -> str:
    """How time grows with this exponent, in words."""
    if exponent is None:
        return "–"
    if exponent < PROPORTIONAL[0]:
        return "more slowly than the number of parts"
    if exponent <= PROPORTIONAL[1]:
        return "in proportion to the parts, not to the pairs"
    if exponent < PAIRS:
        return "faster than the parts, more slowly than the pairs"
    return "like the number of pairs, or faster"


def section(cost: Cost) -> dict[str, Any]:
    """What the page shows."""
    rows = [
        {
            "kind": "Simulation" if curve.what == "simulation" else "Control",
            "name": name_of(curve),
            "size": size_of(curve),
            "least": _time(curve.seconds[0]),
            "most": _time(curve.seconds[-1]),
            "fewest": "1 part" if curve.parts[0] == 1 else f"{curve.parts[0]} parts",
            "parts": curve.parts[-1],
            "exponent": "–" if curve.exponent is None else f"{curve.exponent:.2f}",
            "growth": growth(curve.exponent),
        }
        for curve in cost.curves
        if curve.exponent is not None
    ]
    return {
        "rows": sorted(rows, key=lambda row: row["kind"] == "Control"),
        "plot": data_address(draw(cost)),
        "fitted": FITTED,
        "period": f"{1e3 * cost.period:g} ms",
        "repetitions": cost.repetitions,
    }


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms" if seconds >= 1e-3 else f"{1e6 * seconds:.3g} µs"


def draw(cost: Cost) -> bytes:
    """Simulation and control side by side, on the same logarithmic axes, with lines of slope 1."""
    figure = figures.new_figure(8.6, 4.4)
    axes = figure.subplots(1, 2, sharey=True)
    simulation = [curve for curve in cost.curves if curve.what == "simulation"]
    control = [curve for curve in cost.curves if curve.what != "simulation"]
    names = list(dict.fromkeys(curve.what for curve in control))
    largest = max(curve.rows * curve.columns for curve in cost.curves)
    for curve in cost.curves:
        here = axes[0] if curve.what == "simulation" else axes[1]
        colour = SIMULATION_COLOURS[curve.touching]
        if curve.what != "simulation":
            colour = CONTROL_COLOURS[names.index(curve.what) % len(CONTROL_COLOURS)]
        large = curve.rows * curve.columns == largest
        here.plot(
            curve.parts,
            1e3 * np.array(curve.seconds),
            "o-" if large else "o--",
            color=colour,
            linewidth=1.7 if large else 1.0,
            markersize=4.0 if large else 3.4,
            markerfacecolor=colour if large else "white",
            label=f"{name_of(curve)}, {size_of(curve)}",
            zorder=3,
        )
    _frame(axes[0], cost, simulation, "Simulation of one period")
    _frame(axes[1], cost, control, "Control: one call of predict()")
    axes[0].set_ylabel("time (ms)")
    return figures.png(figure)


def _frame(axes: Axes, cost: Cost, curves: list[Curve], title: str) -> None:
    counts = sorted({count for curve in curves for count in curve.parts})
    if not counts:
        return
    axes.set(xscale="log", yscale="log", title=title)
    times = [1e3 * second for curve in cost.curves for second in curve.seconds]
    low, high = 0.6 * min(times), 2.2 * max(*times, 1e3 * cost.period)
    # Slope 1 through the last point of every curve on the axes' largest count.
    for curve in curves:
        if curve.parts[-1] == counts[-1]:
            line = 1e3 * curve.seconds[-1] * np.array(counts) / counts[-1]
            axes.plot(counts, line, color="#9aa1ac", linewidth=0.9, linestyle=(0, (1, 2)), zorder=2)
    axes.axhline(1e3 * cost.period, color=figures.MUTED, linewidth=0.8, zorder=1)
    axes.text(counts[0], 1.1e3 * cost.period, "one period of the table", color=figures.MUTED, fontsize=7.5, va="bottom")
    figures.style(axes, xlabel="parts")
    axes.set(xlim=(0.85 * counts[0], 1.18 * counts[-1]), ylim=(low, high))
    axes.set_xticks(counts, [str(count) for count in counts])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.plot([], [], color="#9aa1ac", linewidth=0.9, linestyle=(0, (1, 2)), label="slope 1")
    legend = axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False, fontsize=7.5)
    for text in legend.get_texts():
        text.set_color(figures.INK)
