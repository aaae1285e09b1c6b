"""Learning curves from the files that training writes."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.files import reason

COLUMNS = ("steps", "seconds", "phase", "success", "time_to_goal", "return_")
PHASES = ("imitation", "ppo")

MOST_BYTES = 20_000_000
"""Of a file; a curve of a thousand evaluations has a hundred thousand."""


@dataclass(frozen=True)
class Curve:
    """Deterministic evaluations on fixed seeds, one after the other, while a policy was trained. Arrays are (evaluations,)."""

    steps: np.ndarray  # int64, environment steps trained so far, not falling
    seconds: np.ndarray  # of wall time, not falling
    phase: tuple[str, ...]  # each one of PHASES
    success: np.ndarray  # share of the episodes
    time_to_goal: np.ndarray  # s, median of the successes; nan without one
    return_: np.ndarray  # mean

    def as_values(self) -> dict[str, Any]:
        """For JSON."""
        return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(self).items()}


def read_curve(path: Path, field: str) -> Curve:
    """A learning curve from a CSV file with the columns :data:`COLUMNS`, in any order.

    An empty ``time_to_goal`` says that no episode succeeded, and only such a row may have it.

    Args:
        path: the file.
        field: of the settings that name it, for errors.

    Raises:
        ValueError: the file cannot be read, or is no such table.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        text = content.decode("utf-8")
    except (OSError, ValueError) as error:  # ValueError: not UTF-8, or a name that no file can have
        why = reason(error) if isinstance(error, OSError) else "it is no text in UTF-8"
        raise checks.refuse(field, str(path), f"a readable file with a learning curve ({why})") from None
    if len(content) > MOST_BYTES:
        raise checks.refuse(field, str(path), f"a file of at most {MOST_BYTES} bytes")
    lines = list(csv.reader(text.splitlines()))
    if not lines or not set(COLUMNS) <= set(lines[0]):
        raise checks.refuse(f"{path}: line 1", lines[0] if lines else "nothing", f"the columns {', '.join(COLUMNS)}")
    if len(lines) < 2:
        raise checks.refuse(str(path), "no evaluation", "at least one line below the columns' names")
    rows = [_row(dict(zip(lines[0], line)), len(line), f"{path}: line {k}") for k, line in enumerate(lines[1:], 2)]
    arrays = {name: np.array([row[name] for row in rows]) for name in COLUMNS if name != "phase"}
    for name in ("steps", "seconds"):
        falls = np.flatnonzero(np.diff(arrays[name]) < 0)
        if len(falls):
            where = f"{path}: line {falls[0] + 3}: {name}"
            raise checks.refuse(where, arrays[name][falls[0] + 1].item(), "no less than in the line before")
    return Curve(phase=tuple(row["phase"] for row in rows), **arrays)


def _row(cells: dict[str, str], width: int, where: str) -> dict[str, Any]:
    """The values of one line, checked."""
    if width != len(COLUMNS):
        raise checks.refuse(where, f"{width} values", f"{len(COLUMNS)}, one a column")
    row: dict[str, Any] = {"phase": checks.choice(f"{where}: phase", cells["phase"], PHASES)}
    for name in ("seconds", "success", "return_"):
        row[name] = _number(cells[name], f"{where}: {name}")
    steps = _number(cells["steps"], f"{where}: steps")
    row["steps"] = checks.count(f"{where}: steps", int(steps) if steps == int(steps) else steps, least=0, most=2**53)
    checks.number(f"{where}: seconds", row["seconds"], least=0.0)
    checks.number(f"{where}: success", row["success"], least=0.0, most=1.0)
    # An empty cell, "nan" alike, where nothing has succeeded.
    if cells["time_to_goal"].strip().lower() in ("", "nan"):
        if row["success"] > 0.0:
            raise checks.refuse(f"{where}: time_to_goal", cells["time_to_goal"], "a number, where episodes succeed")
        row["time_to_goal"] = math.nan
    else:
        row["time_to_goal"] = _number(cells["time_to_goal"], f"{where}: time_to_goal")
        checks.number(f"{where}: time_to_goal", row["time_to_goal"], least=0.0)
    return row


def _number(cell: str, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise checks.refuse(where, cell, "a finite number")
    return value
