"""Published figures, read from ``results/``."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
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


class Published:
    """Figures written by ``python -m agents publish``.

    Args:
        directory: contains ``figures.csv`` and ``report.json``.

    Attributes:
        places: place -> row, in the order of the file. A row has one attribute per figure, NaN where it does not apply.
        about: content of ``report.json``.
    """

    def __init__(self, directory: Path) -> None:
        self.about = json.loads((directory / "report.json").read_text(encoding="utf-8"))
        self.places: dict[Place, Any] = {}
        for line in rows(directory / "figures.csv"):
            place = Place(line["study"], line["task"], line["hardware"], line["policy"])
            row = self.places.setdefault(place, SimpleNamespace(**dict.fromkeys(BY_NAME, math.nan), interval={}))
            setattr(row, line["figure"], float(line["value"]))
            row.interval[line["figure"]] = (float(line["low"]), float(line["high"]))
            if line["figure"] == "success_rate":
                row.episodes = int(line["episodes"])

    @property
    def day(self) -> str:
        """Return the date of the evaluation."""
        return self.about["time"][:10]

    def of(self, task: str, hardware: str, study: str = "report") -> dict[str, Any]:
        """Return the rows of one task and hardware model, by policy."""
        where = (study, task, hardware)
        return {place.policy: row for place, row in self.places.items() if place[:3] == where}


def rows(path: Path) -> list[dict[str, str]]:
    """Return the lines of a CSV file, by column."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def success(row: Any) -> str:
    """Return the success rate in percent."""
    return BY_NAME["success_rate"].text(row)


def between(row: Any) -> str:
    """Return the interval of the success rate in percent."""
    low, high = row.interval["success_rate"]
    return f"{100 * low:.1f} to {100 * high:.1f} %"


def with_time(row: Any) -> str:
    """Return success and, if there is one, the median time to the goal; a dash for None."""
    if row is None:
        return NOTHING
    time = "" if math.isnan(row.time_to_goal_median_s) else f" ({BY_NAME['time_to_goal_median_s'].text(row)})"
    return success(row) + time


def table(published: Published, tasks: Iterable[str], hardware: str, names: Iterable[str]) -> str:
    """Return a Markdown table of all policies on one hardware model: success, its interval, and the figures ``names``."""
    names = list(names)
    labels = [BY_NAME[name].label for name in names]
    lines = [
        [task, policy, success(row), between(row), *(BY_NAME[name].text(row) for name in names)]
        for task in tasks
        for policy, row in published.of(task, hardware).items()
    ]
    return markdown(("task", "policy", "success", "95 % interval", *labels), lines)
