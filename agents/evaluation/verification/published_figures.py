"""The figures that are published, each one number from the episodes of one policy in one place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from agents.evaluation.resampling import Interval, bootstrap
from agents.evaluation.statistics import success_interval

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
)
"""What is kept of an episode beside its seed: those columns of an evaluation's episodes that figures come from."""

OCCURRENCES = ("success", "fallen")
"""Columns of 0 and 1."""

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


@dataclass(frozen=True)
class Figure:
    """One number from episodes: the median of a column over the episodes where it applies, or the mean of whole numbers."""

    name: str
    column: str
    label: str  # in tables, where a value is written times ``factor``, with so many ``digits`` and the ``unit``
    factor: float
    digits: int
    unit: str
    median: bool = True

    @property
    def rate(self) -> bool:
        """Whether it is the share of the episodes in which something occurs."""
        return self.column in OCCURRENCES

    def sample(self, episodes: EpisodeTable) -> np.ndarray:
        """What it comes from, (n,) finite."""
        values = episodes.columns[self.column]
        return values[np.isfinite(values)]

    def value(self, sample: np.ndarray) -> float:
        """Of a sample of one number at least."""
        return float(np.median(sample) if self.median else np.mean(sample))

    def interval(self, sample: np.ndarray, level: float, resamples: int) -> Interval:
        """Confidence interval, as the report has it for success rates; of a median by the order of the sample."""
        if self.median:
            return median_interval(sample, level)
        if self.rate:
            return success_interval(sample > 0.0, level, resamples)
        equal = np.ptp(sample) == 0.0
        return Interval(sample[0], sample[0], "none") if equal else bootstrap(sample, level, resamples)


FIGURES = (
    Figure("success_rate", "success", "success", 100.0, 1, "%", median=False),
    Figure("fallen_rate", "fallen", "fallen", 100.0, 1, "%", median=False),
    Figure("time_to_goal_median_s", "time_to_goal_s", "time to goal", 1.0, 2, "s"),
    Figure("time_over_bound_median", "time_over_bound", "time / bound", 1.0, 2, ""),
    Figure("position_error_median_m", "position_error_m", "position error", 1e3, 2, "mm"),
    Figure("heading_error_median_rad", "heading_error_rad", "heading error", 180.0 / math.pi, 2, "deg"),
    Figure("path_error_median_m", "path_error_m", "path error (rms)", 1e3, 2, "mm"),
    Figure("throughput_median_parts_per_s", "throughput_parts_per_s", "throughput", 1.0, 2, "parts/s"),
    Figure("collisions_mean", "collisions", "collisions", 1.0, 2, "", median=False),
    Figure("path_efficiency_median", "path_efficiency", "efficiency", 100.0, 0, "%"),
)
"""Of every place, where they apply: what the report's tables show, with the rate of falls instead of their number."""


def median_interval(sample: np.ndarray, level: float) -> Interval:
    """Exact confidence interval of a median from ``sample`` (n,): between two values of the sample (Conover, "Practical
    nonparametric statistics", 1999, section 3.2). One of few values that has too low a level is the whole sample."""
    ordered, tail = np.sort(sample), 0.5 - 0.5 * level
    below = max(int(stats.binom.ppf(tail, len(sample), 0.5)) - 1, 0)
    return Interval(float(ordered[below]), float(ordered[len(sample) - 1 - below]), "order statistics")


def figure_rows(
    episodes: Mapping[Place, EpisodeTable], level: float | None = None, resamples: int = 9999
) -> list[dict[str, Any]]:
    """One mapping for every figure of every place; without a ``level``, no intervals."""
    rows = []
    for place, those in episodes.items():
        for figure in FIGURES:
            sample = figure.sample(those)
            if len(sample):
                row = place._asdict() | {"figure": figure.name, "episodes": len(sample), "value": figure.value(sample)}
                if level is not None:
                    interval = figure.interval(sample, level, resamples)
                    row |= {"low": interval.low, "high": interval.high, "interval": interval.method}
                rows.append(row)
    return rows
