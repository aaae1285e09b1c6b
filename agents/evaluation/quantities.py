"""What tables, pages and published results say of a policy in one place, each one number from its episodes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from agents.evaluation.records import Row
from agents.evaluation.resampling import Interval, bootstrap
from agents.evaluation.statistics import median_interval, success_interval
from agents.evaluation.tables import number, quantity
from vibgym.tasks.episode import EVENTS

OCCURRENCES = ("success", "fallen")
"""Columns of 0 and 1."""


@dataclass(frozen=True)
class Quantity:
    """The median of a column over the episodes where it applies, or the mean of whole numbers."""

    name: str  # of published figures, and of the column of results.csv where there is one
    column: str  # of an episode
    label: str  # in tables, where a value is written times ``factor``, with so many ``digits`` and the ``unit``
    factor: float
    digits: int
    unit: str
    median: bool = True

    @property
    def rate(self) -> bool:
        """Whether it is the share of the episodes in which something occurs."""
        return self.column in OCCURRENCES

    def text(self, row: Row) -> str:
        """As tables have it."""
        return quantity(getattr(row, self.name), self.factor, self.digits, self.unit)

    def middle_half(self, row: Row) -> str | None:
        """ "1.20 – 3.40", the quartiles, or nothing where there is nothing to show; None where they are not kept."""
        names = [self.name.replace("median", which) for which in ("q25", "q75")]
        if not hasattr(row, names[0]):
            return None
        low, high = (number(self.factor * getattr(row, name), 2) for name in names)
        return "" if high == "–" or float(high) == 0.0 else f"{low} – {high}"

    def sample(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """What it comes from, (n,) finite, of the columns of some episodes."""
        values = columns[self.column]
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


RATES = {f"{event}_per_minute": event for event in EVENTS[1:]}
"""Columns of parts a minute, by what became of them."""

QUANTITIES = (
    Quantity("success_rate", "success", "success", 100.0, 1, "%", median=False),
    Quantity("fallen_rate", "fallen", "fallen", 100.0, 1, "%", median=False),
    Quantity("time_to_goal_median_s", "time_to_goal_s", "time to goal", 1.0, 2, "s"),
    Quantity("time_over_bound_median", "time_over_bound", "time / bound", 1.0, 2, ""),
    Quantity("position_error_median_m", "position_error_m", "position error", 1e3, 2, "mm"),
    Quantity("heading_error_median_rad", "heading_error_rad", "heading error", 180.0 / math.pi, 2, "deg"),
    Quantity("path_error_median_m", "path_error_m", "path error (rms)", 1e3, 2, "mm"),
    Quantity("throughput_median_parts_per_s", "throughput_parts_per_s", "throughput", 1.0, 2, "parts/s"),
    Quantity("collisions_mean", "collisions", "collisions", 1.0, 2, "", median=False),
    Quantity("rate_over_bound_mean", "rate_over_bound", "rate / bound", 100.0, 1, "%", median=False),
    *(Quantity(f"{name}_mean", name, label, 1.0, 1, "/min", median=False) for name, label in RATES.items()),
    Quantity("transit_mean_s", "transit_s", "transit", 1.0, 2, "s", median=False),
    Quantity("on_table_mean", "on_table", "on the table", 1.0, 1, "", median=False),
    Quantity("pattern_error_median_m", "pattern_error_m", "pattern error (rms)", 1e3, 2, "mm"),
    Quantity("coverage_median", "coverage", "coverage", 100.0, 1, "%"),
    Quantity("path_efficiency_median", "path_efficiency", "efficiency", 100.0, 0, "%"),
)
"""Of every place, where they apply. Tables have the number of falls instead of their rate."""

BY_NAME = {each.name: each for each in QUANTITIES}
