"""The figures that are published, each one number from the episodes of one policy in one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.quantities import QUANTITIES
from agents.evaluation.records import OWN

REPORT, EFFECTS = "report", "effects"
"""The two studies of an evaluation: every policy on all hardware, and single effects of it."""


class Place(NamedTuple):
    """Where a policy's episodes belong; of the study of effects, ``hardware`` is the case."""

    study: str
    task: str
    hardware: str
    policy: str

    def __str__(self) -> str:
        return ", ".join(self[1:] if self.study == REPORT else self)


def place_of(row: Mapping[str, Any]) -> Place:
    """Of a row with its names; the apostrophe before what a spreadsheet would take for a formula is none of theirs."""
    return Place(*(row[name].removeprefix("'") for name in Place._fields))


OPTIONAL = ("rate_over_bound", *OWN)
"""Columns that results of former versions do not have."""

COLUMNS = (
    "success",
    "fallen",
    "steps",
    "time_to_goal_s",
    "time_over_bound",
    "position_error_m",
    "heading_error_rad",
    "path_error_m",
    "throughput_parts_per_s",
    "collisions",
    "path_efficiency",
    *OPTIONAL,
)
"""What is kept of an episode beside its seed: those columns of an evaluation's episodes that figures come from."""

DIGITS = 6
"""Significant ones of what is kept. All figures come from numbers that are rounded so, published or played again."""


@dataclass(frozen=True)
class EpisodeTable:
    """Episodes of one policy in one place: ``columns`` (episodes,) float64 by :data:`COLUMNS`, nan where one does not apply."""

    seeds: tuple[int, ...]
    columns: Mapping[str, np.ndarray]

    @classmethod
    def of(cls, rows: list[dict[str, Any]]) -> EpisodeTable:
        """From mappings of an evaluation, one an episode, with None, nan or nothing for what does not apply."""
        columns = {name: np.array([_rounded(row.get(name)) for row in rows]) for name in COLUMNS}
        return cls(tuple(int(row["seed"]) for row in rows), columns)

    def some(self, chosen: slice) -> EpisodeTable:
        """Some of them."""
        return EpisodeTable(self.seeds[chosen], {name: values[chosen] for name, values in self.columns.items()})


def _rounded(value: Any) -> float:
    return float("nan") if value is None else float(f"{float(value):.{DIGITS}g}")


def figure_rows(
    episodes: Mapping[Place, EpisodeTable], level: float | None = None, resamples: int = 9999
) -> list[dict[str, Any]]:
    """One mapping for every figure of every place; without a ``level``, no intervals."""
    rows = []
    for place, those in episodes.items():
        for figure in QUANTITIES:
            sample = figure.sample(those.columns)
            if len(sample):
                row = place._asdict() | {"figure": figure.name, "episodes": len(sample), "value": figure.value(sample)}
                if level is not None:
                    interval = figure.interval(sample, level, resamples)
                    row |= {"low": interval.low, "high": interval.high, "interval": interval.method}
                rows.append(row)
    return rows
