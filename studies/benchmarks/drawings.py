"""Parts from drawings against known geometry: ``python -m studies.benchmarks.drawings [--drawings 200]``.

Area, centre and inertia of parts imported from generated drawings are compared with their true values
(:mod:`studies.benchmarks.drawing_cases`). Then each valid drawing is spoiled in one way, and the error must name the entity at
fault (:mod:`studies.benchmarks.drawing_faults`).
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from studies import common
from studies.benchmarks.drawing_cases import KINDS, Case, Truth, case, write
from studies.benchmarks.drawing_faults import FAULTS, spoiled
from studies.kept import show
from vibgym import Part
from vibgym.plugins.drawings.reading import read
from vibgym.scene import outlines
from vibgym.scene.part_settings import DrawingSettings


def deviations(of: Case, path: Path, true: Truth) -> dict[str, float]:
    """Import a drawing and return the relative deviations of area, centre (over the size) and inertia."""
    part, drawing = Part.from_file(path, friction=0.5, surface=None), read(DrawingSettings(file=str(path)))
    centre = outlines.area_and_centre([drawing.rim, *drawing.holes])[1]
    return {
        "area": abs(1e6 * part.area / true.area - 1.0),
        "centre": float(np.hypot(*(centre - true.centre))) / true.size,
        "inertia": abs(1e6 * part.gyration / true.gyration - 1.0),
    }


def refusal(content: bytes, kind: str, folder: Path) -> str | None:
    """Return the error of a file; None if it is imported."""
    path = folder / f"spoiled.{kind}"
    path.write_bytes(content)
    try:
        Part.from_file(path, friction=0.5)
    except ValueError as error:
        return str(error)
    return None


def main() -> None:
    """Print the tables; with ``--keep`` write that of the documentation."""
    parser = common.parser(__doc__)
    parser.add_argument("--drawings", type=int, default=200, help="valid ones; a third of each kind of file")
    parser.add_argument("--seed", type=int, default=0, help="of the first one")
    asked = parser.parse_args()
    results = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for k in range(asked.drawings):
            kind = KINDS[k % len(KINDS)]
            of, path = case(asked.seed + k, kind), folder / f"{k}.{kind}"
            true = write(of, path, k)
            fault = FAULTS[kind][k // len(KINDS) % len(FAULTS[kind])]
            made = spoiled(of, fault, k)
            error = refusal(made.content, kind, folder)
            named = error is not None and any(text in error for text in made.expected)
            results.append({"kind": kind, **deviations(of, path, true), "named": named})
            if not named:
                print(k, kind, fault, error, made.expected)
    rows = [
        [kind.upper(), str(len(some)), *(f"{100 * some[what].max():.4f} %" for what in ("area", "centre", "inertia")),
         f"{some['named'].sum()} of {len(some)}"]
        for kind, some in pd.DataFrame(results).groupby("kind", sort=False)
    ]  # fmt: skip
    show("drawings", ("file", "drawings", "area", "centre", "inertia", "faults named"), rows, asked.keep)


if __name__ == "__main__":
    main()
