"""The files of results: ``results/rivals.csv``, ``results/rivals-push.csv``."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from studies.rivals.figures import EPISODES
from vibgym.files import csv_text, output_directory, write_atomically

FIGURES, PUSH = Path("results/rivals.csv"), Path("results/rivals-push.csv")

Row = Mapping[str, Any]


def read(path: Path) -> list[dict[str, str]]:
    """Lines of a table; none where there is no file yet."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def merged(old: Sequence[Row], new: Sequence[Row]) -> list[Row]:
    """Old lines of tasks that the new ones do not have, and the new ones, in the order of the tasks."""
    fresh = {row["task"] for row in new}
    both = [*(row for row in old if row["task"] not in fresh), *new]
    return sorted(both, key=lambda row: tuple(EPISODES).index(row["task"]))


def written(path: Path, lines: Sequence[Row]) -> Path:
    """Write a table; return its path."""
    output_directory(path.parent)
    write_atomically(path, csv_text(lines))
    return path
