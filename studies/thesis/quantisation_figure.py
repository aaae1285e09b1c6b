"""Fig. 5.8 as a plot and a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.figure import Comparison, Figure, Picture, Table
from studies.thesis.quantisation import centre_errors, chain_errors
from vibgym.simulation.threads import available_threads

DIAMETERS = tuple(range(2, 41))
TRIALS, GREY_TRIALS = 10_000, 2_000
IN_TABLE = (2, 5, 10, 20, 40)


def draw() -> Figure:
    """The plot, and a table of its numbers."""
    ways: dict[str, Callable[[int], np.ndarray]] = {
        "centre of the pixel": lambda diameter: centre_errors(diameter, TRIALS),
        "half of its area": lambda diameter: chain_errors(diameter, TRIALS),
        "grey levels": lambda diameter: chain_errors(diameter, GREY_TRIALS, grey=True),
    }
    with ThreadPoolExecutor(available_threads()) as pool:  # kernels release the interpreter's lock
        series = {name: list(pool.map(errors, DIAMETERS)) for name, errors in ways.items()}
    rows = tuple(
        (f"{diameter} px", *(f"{series[name][diameter - DIAMETERS[0]].std():.4f} px" for name in series))
        for diameter in IN_TABLE
    )
    binary = ("centre of the pixel", "half of its area")
    bias = max(float(abs(each.mean(axis=0)).max()) for name in binary for each in series[name])
    scatter = max(
        float((abs(each.mean(axis=0)) / each.std(axis=0)).max()) * TRIALS**0.5
        for name in binary
        for each in series[name]
    )
    first, last = ([series[name][k].std() for name in binary] for k in (0, -1))
    finer = max(series["grey levels"][k].std() / series[binary[1]][k].std() for k in range(len(DIAMETERS)))
    return Figure(
        title="Fig. 5.8: error of the centroid of a disc",
        shows="The thesis drew discs of 2 to 40 px at 10 000 random places each and found a mean of about zero and "
        "a standard deviation that falls with the diameter.",
        comparisons=(
            Comparison(
                "Mean error, all diameters",
                "about zero",
                f"at most {bias:.4f} px",
                f"none beyond chance: at most {scatter:.1f} standard errors in 156 means",
            ),
            Comparison(
                "Standard deviation from 2 to 40 px",
                "falls; the curve is lost",
                f"from {first[0]:.3f} and {first[1]:.3f} px to {last[0]:.3f} and {last[1]:.3f} px (both readings)",
                "the trend is the same",
            ),
        ),
        differs="Mean and trend agree; the curve itself is lost, so no difference in pixels can be given. Grey "
        f"levels along the edge, which the prototype did not use, err by at most {100.0 * finer:.0f} % of that.",
        assumed=(
            "The thesis does not say when a pixel belongs to a disc: both readings are shown, by the pixel's "
            "centre and by half of its area.",
        ),
        pictures=(
            Picture(
                _plot(series),
                "Standard deviation and mean of both coordinates, 10 000 places for each "
                "diameter (2000 with grey levels).",
            ),
        ),
        tables=(
            Table("Standard deviations.", ("Diameter", "By pixel centres", "By half the area", "By grey levels"), rows),
        ),
    )


def _plot(series: Mapping[str, list[np.ndarray]]) -> bytes:
    figure = new_figure(6.2, 3.2)
    axes = figure.add_subplot()
    for (name, errors), colour in zip(series.items(), (INK, FAILURE, SUCCESS), strict=True):
        axes.plot(DIAMETERS, [each.std() for each in errors], color=colour, linewidth=1.4, label=name)
        axes.plot(DIAMETERS, [each.mean() for each in errors], color=colour, linewidth=0.8, linestyle=":")
    style(axes, xlabel="diameter, px", ylabel="error of the centroid, px")
    axes.set_xlim(0, 40)
    axes.legend(frameon=False, fontsize=7.5, labelcolor=MUTED, title="what makes a pixel count", title_fontsize=7.5)
    axes.annotate("dotted: mean", (39.5, 0.003), ha="right", va="bottom", fontsize=7, color=MUTED)
    return png(figure)
