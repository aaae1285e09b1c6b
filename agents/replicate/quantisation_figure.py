"""Fig. 5.8 as a plot and a table."""

from __future__ import annotations

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from agents.replicate.quantisation import centre_errors, chain_errors

DIAMETERS = tuple(range(2, 41))
TRIALS = 10_000
IN_TABLE = (2, 5, 10, 20, 40)


def draw() -> tuple[bytes, list[str], list[list[str]]]:
    """The plot, and the table's columns and rows."""
    series = {
        "centre of the pixel": [centre_errors(diameter, TRIALS) for diameter in DIAMETERS],
        "half of its area": [chain_errors(diameter, TRIALS) for diameter in DIAMETERS],
        "grey levels": [chain_errors(diameter, TRIALS, grey=True) for diameter in DIAMETERS],
    }
    figure = new_figure(6.2, 3.2)
    axes = figure.add_subplot()
    for (name, errors), colour in zip(series.items(), (INK, FAILURE, SUCCESS), strict=True):
        axes.plot(DIAMETERS, [each.std() for each in errors], color=colour, linewidth=1.4, label=name)
        axes.plot(DIAMETERS, [each.mean() for each in errors], color=colour, linewidth=0.8, linestyle=":")
    style(axes, xlabel="diameter, px", ylabel="error of the centroid, px")
    axes.set_xlim(0, 40)
    axes.legend(frameon=False, fontsize=7.5, labelcolor=MUTED, title="what makes a pixel count", title_fontsize=7.5)
    axes.annotate("dotted: mean", (39.5, 0.003), ha="right", va="bottom", fontsize=7, color=MUTED)
    rows = [
        [f"{diameter} px", *(f"{series[name][diameter - DIAMETERS[0]].std():.4f} px" for name in series)]
        for diameter in IN_TABLE
    ]
    return png(figure), ["Diameter", "By pixel centres", "By half the area", "By grey levels"], rows
