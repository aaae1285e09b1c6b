"""Learning curves from the files that training writes."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.files import reason

COLUMNS = ("steps", "seconds", "phase", "success", "time_to_goal", "return_")
"""Columns of a learning curve."""

PHASES = ("imitation", "ppo")

MOST_BYTES = 20_000_000
"""Largest file of a learning curve; one with a thousand evaluations has a hundred thousand bytes."""


@dataclass(frozen=True)
class Curve:
    """Learning curve: deterministic evaluations on fixed seeds during training. Arrays are (evaluations,).

    Attributes:
        steps: int64, environment steps, not decreasing.
        seconds: wall time, not decreasing.
        phase: of :data:`PHASES`.
        success: success rate.
        time_to_goal: s, median of successes; nan without one.
        return_: mean return.
    """

    steps: np.ndarray
    seconds: np.ndarray
    phase: tuple[str, ...]
    success: np.ndarray
    time_to_goal: np.ndarray
    return_: np.ndarray


def read_curve(path: Path, field: str) -> Curve:
    """Read a learning curve, CSV with the columns :data:`COLUMNS` in any order; ``time_to_goal`` is empty without success.

    Args:
        path: of the file.
        field: of the settings that name it, for errors.

    Raises:
        ValueError: the file cannot be read, or is not a learning curve.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        lines = list(csv.reader(content.decode("utf-8").splitlines()))
    except (OSError, ValueError) as error:  # ValueError: not UTF-8, or an invalid file name
        why = reason(error) if isinstance(error, OSError) else "not UTF-8"
        raise checks.refuse(field, str(path), f"a readable learning curve ({why})") from None
    if len(content) > MOST_BYTES:
        raise checks.refuse(field, str(path), f"a file of at most {MOST_BYTES} bytes")
    if len(lines) < 2 or set(lines[0]) != set(COLUMNS):
        raise checks.refuse(f"{path}: line 1", lines[:1], f"the columns {', '.join(COLUMNS)}, with lines below")
    found = []
    for index, line in enumerate(lines[1:], 2):
        where = f"{path}: line {index}"
        if len(line) != len(COLUMNS):
            raise checks.refuse(where, line, f"{len(COLUMNS)} values")
        found.append(_curve_row(dict(zip(lines[0], line, strict=True)), where))
    arrays = {name: np.array([row[name] for row in found]) for name in COLUMNS if name != "phase"}
    for name in ("steps", "seconds"):
        falls = np.flatnonzero(np.diff(arrays[name]) < 0)
        if len(falls):
            where = f"{path}: line {falls[0] + 3}: {name}"
            raise checks.refuse(where, arrays[name][falls[0] + 1].item(), "at least that of the line before")
    return Curve(phase=tuple(row["phase"] for row in found), **arrays)


def _curve_row(cells: Mapping[str, str], where: str) -> dict[str, Any]:
    def value(name: str, most: float = math.inf) -> float:
        try:
            number: Any = float(cells[name])
        except ValueError:
            number = cells[name]
        return checks.number(f"{where}: {name}", number, least=-math.inf if name == "return_" else 0.0, most=most)

    row: dict[str, Any] = {"phase": checks.choice(f"{where}: phase", cells["phase"], PHASES)}
    row |= {"seconds": value("seconds"), "success": value("success", 1.0), "return_": value("return_")}
    steps = value("steps")
    row["steps"] = checks.count(f"{where}: steps", int(steps) if steps == int(steps) else steps, least=0, most=2**53)
    if cells["time_to_goal"].strip().lower() in ("", "nan") and row["success"] == 0.0:
        row["time_to_goal"] = math.nan
    else:
        row["time_to_goal"] = value("time_to_goal")
    return row
