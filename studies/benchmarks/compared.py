"""Tabulate learned and classical policies of ``make compare``: ``python -m studies.benchmarks.compared [--run DIR]``.

Reads ``compare.json`` of the run: success and interquartile mean of the time to goal of every policy, and the difference of the
latter to the best classical policy on the same seeds.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from agents.evaluation.table import quantity, signed
from studies import common
from studies.kept import show

HEADS = (
    "task", "hardware", "policy", "success", "of", "time to goal: interquartile mean [95 %]",
    "minus the best law's, paired", "collisions",
)  # fmt: skip


def line(row: Any, gap: Any) -> list[str]:
    """Return the row of a policy on a task and hardware model; ``gap``: its paired difference of interquartile means."""
    time, difference = quantity(row.time_iqm_s, 1.0, 3, "s"), "–"
    if np.isfinite(row.time_iqm_low_s):
        time += f" [{row.time_iqm_low_s:.3f}, {row.time_iqm_high_s:.3f}]"
    if gap is not None and gap["value"] is not None and gap["interval"] is not None:
        low, high = (signed(gap["interval"][end], 3) for end in ("low", "high"))
        difference = f"{signed(gap['value'], 3)} s [{low}, {high}]"
    episodes = f"{row.runs} x {row.episodes}" if row.runs > 1 else str(row.episodes)
    success, collisions = quantity(row.success_rate, 100.0, 1, "%"), quantity(row.collisions_mean, 1.0, 2, "")
    return [row.task, row.hardware, row.policy, success, episodes, time, difference, collisions]


def main() -> None:
    """Read and print."""
    parser = common.parser(__doc__)
    parser.add_argument(
        "--run", type=Path, default=Path("runs/agents-compared"), help="output directory of make compare"
    )
    asked = parser.parse_args()
    results = json.loads((asked.run / "compare.json").read_text(encoding="utf-8"))
    gaps = {(gap["task"], gap["hardware"], gap["first"]): gap["iqm"] for gap in results["differences"]}
    rows = pd.DataFrame(results["results"])
    rows = rows[rows["training_seed"].isna() & ~rows["policy"].str.contains("ladder")]
    numbers = ["time_iqm_s", "time_iqm_low_s", "time_iqm_high_s", "collisions_mean"]
    rows = rows.astype(dict.fromkeys(numbers, float))
    lines = [line(row, gaps.get((row.task, row.hardware, row.policy))) for row in rows.itertuples()]
    show("compared", HEADS, lines, asked.keep, {**results, "command": "make compare"})


if __name__ == "__main__":
    main()
