"""Tabulate learned and classical policies of ``make compare``: ``python -m studies.benchmarks.compared [--run DIR]``.

Reads ``compare.json`` of the run: success and interquartile mean of the time to goal of every policy, and the difference of the
latter to the best classical policy on the same seeds.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.evaluation.table import quantity, signed
from studies import common
from studies.kept import show

HEADS = (
    "task", "hardware", "policy", "success", "of", "time to goal: interquartile mean [95 %]",
    "minus the best law's, paired", "collisions",
)  # fmt: skip


def value(number: float | None) -> float:
    """Return a number, NaN for None."""
    return math.nan if number is None else number


def difference(found: Mapping[str, Any] | None) -> str:
    """Format the difference of the interquartile means, with its interval."""
    if found is None or found["iqm"]["value"] is None or found["iqm"]["interval"] is None:
        return "–"
    low, high = (signed(found["iqm"]["interval"][end], 3) for end in ("low", "high"))
    return f"{signed(found['iqm']['value'], 3)} s [{low}, {high}]"


def line(row: Mapping[str, Any], apart: Mapping[str, Any] | None) -> list[str]:
    """Return the row of a policy on a task and hardware model."""
    time = quantity(value(row["time_iqm_s"]), 1.0, 3, "s")
    if row["time_iqm_low_s"] is not None:
        time += f" [{row['time_iqm_low_s']:.3f}, {row['time_iqm_high_s']:.3f}]"
    return [
        row["task"],
        row["hardware"],
        row["policy"],
        quantity(row["success_rate"], 100.0, 1, "%"),
        f"{row['runs']} x {row['episodes']}" if row["runs"] > 1 else str(row["episodes"]),
        time,
        difference(apart),
        quantity(value(row["collisions_mean"]), 1.0, 2, ""),
    ]


def main() -> None:
    """Read and print."""
    parser = common.parser(__doc__)
    parser.add_argument(
        "--run", type=Path, default=Path("runs/agents-compared"), help="output directory of make compare"
    )
    asked = parser.parse_args()
    found = json.loads((asked.run / "compare.json").read_text(encoding="utf-8"))
    apart = {(each["task"], each["hardware"], each["first"]): each for each in found["differences"]}
    rows = [row for row in found["results"] if row["training_seed"] is None and "ladder" not in row["policy"]]
    lines = [line(row, apart.get((row["task"], row["hardware"], row["policy"]))) for row in rows]
    show("compared", HEADS, lines, asked.keep, {**found, "command": "make compare"})


if __name__ == "__main__":
    main()
