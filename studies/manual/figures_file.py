"""Published figures, read from ``results/``."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from agents.evaluation.table import BY_NAME, markdown

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
RESULTS = ROOT / "results"
NOTHING = "–"


class Place(NamedTuple):
    """Key of the figures of one policy on one task and hardware model."""

    study: str
    task: str
    hardware: str
    policy: str


Row = Mapping[str, Any]
"""Figures of a place, NaN where they do not apply, and ``interval`` of the success rate."""


class Published:
    """Figures written by ``python -m agents publish``.

    Args:
        directory: contains ``figures.csv`` and ``report.json``.

    Attributes:
        places: place -> row, in the order of the file.
        about: content of ``report.json``.
    """

    def __init__(self, directory: Path) -> None:
        self.about = json.loads((directory / "report.json").read_text(encoding="utf-8"))
        self.places: dict[Place, dict[str, Any]] = {}
        for line in rows(directory / "figures.csv"):
            place = Place(line["study"], line["task"], line["hardware"], line["policy"])
            row = self.places.setdefault(place, dict.fromkeys(BY_NAME, math.nan))
            row[line["figure"]] = float(line["value"])
            if line["figure"] == "success_rate":
                row["interval"] = (float(line["low"]), float(line["high"]))

    @property
    def day(self) -> str:
        """Return the date of the evaluation."""
        return self.about["time"][:10]

    def of(self, task: str, hardware: str, study: str = "report") -> dict[str, Row]:
        """Return the rows of one task and hardware model, by policy."""
        where = (study, task, hardware)
        return {place.policy: row for place, row in self.places.items() if place[:3] == where}


def rows(path: Path) -> list[dict[str, str]]:
    """Return the lines of a CSV file, by column."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def success(row: Row) -> str:
    """Return the success rate in percent."""
    return BY_NAME["success_rate"].text(row)


def with_time(row: Row | None) -> str:
    """Return success and, if there is one, the median time to the goal; a dash for None."""
    if row is None:
        return NOTHING
    time = BY_NAME["time_to_goal_median_s"].text(row)
    return success(row) + ("" if time == NOTHING else f" ({time})")


def table(published: Published, tasks: Iterable[str], hardware: str, names: Iterable[str]) -> str:
    """Return a Markdown table of all policies on one hardware model: success, its interval, and the figures ``names``."""
    figures = [BY_NAME[name] for name in names]
    lines = []
    for task in tasks:
        for policy, row in published.of(task, hardware).items():
            low, high = (100.0 * end for end in row["interval"])
            cells = [figure.text(row) for figure in figures]
            lines.append([task, policy, success(row), f"{low:.1f} to {high:.1f} %", *cells])
    return markdown(("task", "policy", "success", "95 % interval", *(figure.label for figure in figures)), lines)
