"""Picture of the library of shapes: ``python -m studies.benchmarks.shapes docs/shapes.png``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from studies import common
from vibgym.scene.library import FAMILIES, SPLITS, shapes

PITCH, ACROSS = 92.0, 16
"""mm between the parts, and parts in a row."""


def main() -> None:
    """Draw all parts to scale, a row or more for each split."""
    from matplotlib.figure import Figure

    parser = common.parser(__doc__, keep=False)
    parser.add_argument("path", type=Path, metavar="PNG")
    path = parser.parse_args().path
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    axes, row = figure.subplots(), 0
    for split in SPLITS:
        for k, part in enumerate(shapes(split)):
            x, y = 1e3 * part.outline.T + np.array([[PITCH * (k % ACROSS)], [-PITCH * (row + k // ACROSS)]])
            axes.fill(x, y, color=f"C{list(FAMILIES).index(part.name.split('-')[0])}")
        axes.text(-0.6 * PITCH, -PITCH * row, split.replace("_", " "), rotation=90, ha="center", va="center")
        row += -(-len(shapes(split)) // ACROSS)
    axes.set(aspect="equal", xlim=(-0.8 * PITCH, (ACROSS - 0.4) * PITCH), ylim=(-(row - 0.4) * PITCH, 0.6 * PITCH))
    axes.set_axis_off()
    figure.savefig(path, dpi=90)


if __name__ == "__main__":
    main()
