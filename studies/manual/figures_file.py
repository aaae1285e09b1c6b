"""Published figures, read from ``results/``: of each policy in each place one row with what is known of it."""

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
RESULTS = ROOT / "results"
NOTHING = "–"


class Place(NamedTuple):
    """Where a policy was tried."""

    study: str
    task: str
    hardware: str
    policy: str


class Published:
    """The figures of a directory that ``python -m agents publish`` wrote.

    Args:
        directory: of ``figures.csv`` and ``report.json``.

    Attributes:
        places: rows by place, in the order of the file; an attribute for each figure, NaN where it does not apply.
        about: what ``report.json`` says.
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
        """On which they were found."""
        return self.about["time"][:10]

    def of(self, task: str, hardware: str, study: str = "report") -> dict[str, Any]:
        """Rows of all policies in one place, by policy."""
        where = (study, task, hardware)
        return {place.policy: row for place, row in self.places.items() if place[:3] == where}


def rows(path: Path) -> list[dict[str, str]]:
    """Lines of a CSV file, by the names in its head."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def success(row: Any) -> str:
    """In percent."""
    return BY_NAME["success_rate"].text(row)


def between(row: Any) -> str:
    """The interval of the success rate."""
    low, high = row.interval["success_rate"]
    return f"{100 * low:.1f} to {100 * high:.1f} %"


def with_time(row: Any) -> str:
    """Success and, where there is any, the median time to the goal: a cell of tables that compare policies; None: a dash."""
    if row is None:
        return NOTHING
    time = "" if math.isnan(row.time_to_goal_median_s) else f" ({BY_NAME['time_to_goal_median_s'].text(row)})"
    return success(row) + time


def table(
    published: Published, tasks: Iterable[str], hardware: str, names: Iterable[str], study: str = "report"
) -> str:
    """All policies of some tasks on one machine, in Markdown: success, its interval, and the quantities of ``names``."""
    names = list(names)
    labels = [BY_NAME[name].label for name in names]
    lines = [
        [task, policy, success(row), between(row), *(BY_NAME[name].text(row) for name in names)]
        for task in tasks
        for policy, row in published.of(task, hardware, study).items()
    ]
    return markdown(("task", "policy", "success", "95 % interval", *labels), lines)
