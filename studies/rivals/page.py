"""The tables of ``docs/rivals.md``, between markers, from what stands in ``results/``."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.evaluation.tables import markdown
from studies.rivals.contenders import CONTENDERS
from studies.rivals.figures import EPISODES
from vibgym import checks
from vibgym.files import csv_text, output_directory, write_atomically

FIGURES, PUSH, PAGE = Path("results/rivals.csv"), Path("results/rivals-push.csv"), Path("docs/rivals.md")

Row = Mapping[str, Any]


def read(path: Path) -> list[dict[str, Any]]:
    """Rows of a table.

    Raises:
        ValueError: it cannot be read.
    """
    try:
        with path.open(newline="") as file:
            return list(csv.DictReader(file))
    except OSError as error:
        raise checks.refuse(str(path), error.strerror, "a table that 'figures' or 'push' has written") from error


def merged(old: Sequence[Row], new: Sequence[Row]) -> list[Row]:
    """Old lines of tasks that the new ones do not have, and the new ones, in the order of the tasks."""
    fresh = {row["task"] for row in new}
    rows = [*(row for row in old if row["task"] not in fresh), *new]
    return sorted(rows, key=lambda row: tuple(EPISODES).index(row["task"]))


def written(path: Path, rows: Sequence[Row]) -> Path:
    """Write a table; returns its path."""
    output_directory(path.parent)
    write_atomically(path, csv_text(rows))
    return path


def _number(row: Row, name: str, digits: int, factor: float = 1.0) -> str:
    return "" if row[name] == "" else f"{factor * float(row[name]):.{digits}f}"


def success_cell(row: Row) -> str:
    """Success with its interval, and how much longer it takes."""
    rate, low, high = (_number(row, name, 0 if float(row[name]) in (0.0, 1.0) else 1, 100.0)
                       for name in ("success", "success_low", "success_high"))  # fmt: skip
    text = f"{rate} % ({low} to {high})"
    if row["time_ratio"] == "":
        return text
    spread = (
        ""
        if row["time_ratio_low"] == ""
        else f" ({_number(row, 'time_ratio_low', 2)} to {_number(row, 'time_ratio_high', 2)})"
    )
    return f"{text}, {_number(row, 'time_median', 2)} s" + (
        "" if row["machine"] == "segmented" else f", x {_number(row, 'time_ratio', 2)}{spread}"
    )


def figures_table(rows: Sequence[Row]) -> str:
    """Machines by tasks."""
    cell = {(row["machine"], row["task"]): success_cell(row) for row in rows}
    tasks = [task for task in EPISODES if any(row["task"] == task for row in rows)]
    heads = ("machine", *(f"{task} ({_episodes(rows, task)})" for task in tasks))
    lines = [(each.title, *(cell.get((name, task), "") for task in tasks)) for name, each in CONTENDERS.items()]
    return markdown(heads, lines)


def _episodes(rows: Sequence[Row], task: str) -> str:
    return next(row["episodes"] for row in rows if row["task"] == task)


def push_table(rows: Sequence[Row]) -> str:
    """Machines by number of parts."""
    counts = list(dict.fromkeys(row["parts"] for row in rows))
    cell = {(row["machine"], row["parts"]): f"{_number(row, 'share', 1, 100.0)} %" for row in rows}
    names = list(dict.fromkeys(row["machine"] for row in rows))
    heads = ("machine", *(f"{count} part{'s' if int(count) > 1 else ''}" for count in counts))
    return markdown(heads, [(CONTENDERS[name].title, *(cell[name, count] for count in counts)) for name in names])


def put_between(text: str, name: str, table: str) -> str:
    """The text with a table between its markers.

    Raises:
        ValueError: it has no such markers.
    """
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    before, found, rest = text.partition(begin)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise checks.refuse(str(PAGE), "no such markers", f"{begin} and {end}")
    return f"{before}{begin}\n\n{table}\n\n{end}{after}"


def made(root: Path) -> str:
    """The page with the tables of today.

    Raises:
        ValueError: page or tables cannot be read, or it has no markers.
    """
    try:
        text = (root / PAGE).read_text(encoding="utf-8")
    except OSError as error:
        raise checks.refuse(str(root / PAGE), error.strerror, "the page, with markers for its tables") from error
    text = put_between(text, "figures", figures_table(read(root / FIGURES)))
    return put_between(text, "push", push_table(read(root / PUSH)))


def write(root: Path) -> Path:
    """Write the tables into the page; returns its path."""
    write_atomically(root / PAGE, made(root))
    return root / PAGE
