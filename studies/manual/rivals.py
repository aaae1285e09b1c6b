"""The tables of ``docs/rivals.md``: what ``python -m studies.rivals`` has found."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from agents.evaluation.table import markdown
from studies.manual.figures_file import ROOT, rows
from studies.rivals.figures import CONTENDERS, EPISODES, FIGURES, PUSH

Row = Mapping[str, Any]


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


def figures_table(found: Sequence[Row]) -> str:
    """Machines by tasks."""
    cell = {(row["machine"], row["task"]): success_cell(row) for row in found}
    tasks = [task for task in EPISODES if any(row["task"] == task for row in found)]
    heads = ("machine", *(f"{task} ({_episodes(found, task)})" for task in tasks))
    lines = [(each.title, *(cell.get((name, task), "") for task in tasks)) for name, each in CONTENDERS.items()]
    return markdown(heads, lines)


def _episodes(found: Sequence[Row], task: str) -> str:
    return next(row["episodes"] for row in found if row["task"] == task)


def push_table(found: Sequence[Row]) -> str:
    """Machines by number of parts."""
    counts = list(dict.fromkeys(row["parts"] for row in found))
    cell = {(row["machine"], row["parts"]): f"{_number(row, 'share', 1, 100.0)} %" for row in found}
    names = list(dict.fromkeys(row["machine"] for row in found))
    heads = ("machine", *(f"{count} part{'s' if int(count) > 1 else ''}" for count in counts))
    return markdown(heads, [(CONTENDERS[name].title, *(cell[name, count] for count in counts)) for name in names])


TABLES: dict[str, Callable[[], str]] = {
    "rivals": lambda: figures_table(rows(ROOT / FIGURES)),
    "rivals-push": lambda: push_table(rows(ROOT / PUSH)),
}
"""By the name of the file in ``docs/generated``."""
