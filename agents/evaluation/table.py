"""The table of episodes that all commands share, its metrics, and how numbers are written.

One row is one episode. Label columns: ``study`` ("report", "effects", ...), ``task``, ``hardware`` (or case), ``policy``,
``training_seed`` (-1 without one) and ``seed``. All other columns are metrics, float64, nan where they do not apply.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.statistics import Interval, bootstrap, median_interval, quartiles, success_interval
from vibgym.policies.measures import Measured
from vibgym.policies.rollout import OWN_FACTS, Outcomes
from vibgym.tasks.episode import EVENTS

REPORT, EFFECTS, LOAD = "report", "effects", "load"
"""Names of the studies of an evaluation."""

OWN = {
    "transit_s": "transit",
    "pattern_error_m": "pattern_error",
    **{name: name for name in OWN_FACTS if name not in ("transit", "pattern_error")},
}
"""Column -> name in :data:`vibgym.policies.rollout.OWN_FACTS`: metrics of some tasks only."""

METRICS = {
    "success": "success",
    "steps": "steps",
    "time_to_goal_s": "time_to_goal",
    "bound_s": "bound",
    "time_over_bound": "time_over_bound",
    "position_error_m": "position_error",
    "heading_error_rad": "heading_error",
    "path_error_m": "path_error",
    "fallen": "fallen",
    "diverged": "diverged",
    "return": "returns",
    "path_length_m": "path_length",
    "path_efficiency": "path_efficiency",
    "parts_done": "parts_done",
    "throughput_parts_per_s": "throughput",
    "collisions": "collisions",
    "clearance_m": "clearance",
    "rate_over_bound": "rate_over_bound",
    **OWN,
}
"""Column -> attribute of the outcomes: the metrics of episodes.csv."""

ENDS = ("success", "steps", "time_to_goal_s", "position_error_m", "heading_error_rad", "fallen")
"""Metrics of studies that record only how episodes end."""

BOOLEANS = ("success", "fallen", "diverged")
WHOLE = ("steps", "parts_done", "collisions")

RATES = {f"{event}_per_minute": event for event in EVENTS[1:]}
"""Columns of parts a minute -> what became of the parts."""


class Place(NamedTuple):
    """Key of the episodes of one policy: of the study of effects, ``hardware`` is the case."""

    study: str
    task: str
    hardware: str
    policy: str

    @property
    def labels(self) -> dict[str, str]:
        """Columns of tables of the main study."""
        return {"task": self.task, "hardware": self.hardware, "policy": self.policy}

    def __str__(self) -> str:
        return ", ".join(self[1:] if self.study == REPORT else self)


class Table:
    """Columns of equal length by name, one row per episode."""

    def __init__(self, columns: Mapping[str, np.ndarray]) -> None:
        self.columns = dict(columns)

    @classmethod
    def of(cls, found: Outcomes, place: Place, training_seed: int | None = None) -> Table:
        """Return the table of one policy's rollout."""
        count = len(found.seeds)
        columns: dict[str, Any] = {name: np.full(count, value, dtype=object) for name, value in place._asdict().items()}
        columns["training_seed"] = np.full(count, -1 if training_seed is None else training_seed)
        columns["seed"] = np.array(found.seeds)
        for name, what in METRICS.items():
            values = np.full(count, np.nan)
            if name in ENDS or isinstance(found, Measured):
                values = found.fact(what) if name in OWN else getattr(found, what, values)
            columns[name] = np.asarray(values, dtype=np.float64)
        return cls(columns)

    @classmethod
    def joined(cls, tables: Sequence[Table]) -> Table:
        """Return all rows of some tables with the same columns."""
        return cls({name: np.concatenate([each[name] for each in tables]) for name in tables[0].columns})

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def rows(self, which: np.ndarray | slice) -> Table:
        """Return some rows."""
        return Table({name: values[which] for name, values in self.columns.items()})

    def where(self, **labels: Any) -> Table:
        """Return the rows with these labels."""
        return self.rows(np.logical_and.reduce([self[name] == value for name, value in labels.items()]))

    def groups(self, *names: str) -> dict[tuple[Any, ...], Table]:
        """Return the rows by the values of some columns, in the order of their first rows."""
        found: dict[tuple[Any, ...], list[int]] = {}
        for index, key in enumerate(zip(*(self[name].tolist() for name in names), strict=True)):
            found.setdefault(key, []).append(index)
        return {key: self.rows(np.array(which)) for key, which in found.items()}

    def places(self) -> dict[Place, Table]:
        """Return the rows of every policy in every place."""
        return {Place(*key): those for key, those in self.groups(*Place._fields).items()}

    def by_run(self, name: str) -> np.ndarray:
        """Return a metric (runs, episodes) of one policy, whose training runs follow one another on the same seeds."""
        runs = len(np.unique(self["training_seed"]))
        return self[name].reshape(runs, -1)

    def records(self, names: Iterable[str]) -> list[dict[str, Any]]:
        """Return one mapping per row for CSV and JSON; booleans and counts are not floats."""
        columns = {name: self[name].tolist() for name in names}
        for name, values in columns.items():
            if name in BOOLEANS:
                columns[name] = [bool(each) for each in values]
            elif name in WHOLE:
                columns[name] = [int(each) if math.isfinite(each) else each for each in values]
        return [dict(zip(columns, each, strict=True)) for each in zip(*columns.values(), strict=True)]


@dataclass(frozen=True)
class Quantity:
    """A published figure: the median of a metric where it applies, or its mean.

    Attributes:
        name: of the figure, and of the column of results.csv if there is one.
        column: metric.
        label: in tables, where a value is multiplied by ``factor`` and written with ``digits`` decimals and ``unit``.
        median: whether it is a median; else a mean.
    """

    name: str
    column: str
    label: str
    factor: float
    digits: int
    unit: str
    median: bool = True

    @property
    def rate(self) -> bool:
        """Whether it is the fraction of episodes in which something occurs."""
        return self.column in BOOLEANS

    def text(self, row: Any) -> str:
        """Return the value of a row (mapping or object) as text."""
        value = row[self.name] if isinstance(row, Mapping) else getattr(row, self.name)
        return quantity(value, self.factor, self.digits, self.unit)

    def middle_half(self, row: Mapping[str, Any]) -> str | None:
        """Return the quartiles, "1.20 – 3.40"; None if the row has none."""
        names = [self.name.replace("median", which) for which in ("q25", "q75")]
        if names[0] not in row:
            return None
        low, high = (number(self.factor * row[name], 2) for name in names)
        return "" if high == "–" or float(high) == 0.0 else f"{low} – {high}"

    def sample(self, table: Table) -> np.ndarray:
        """Return the finite values (n,)."""
        values = table[self.column]
        return values[np.isfinite(values)]

    def value(self, sample: np.ndarray) -> float:
        """Return the figure of a sample with at least one value."""
        return float(np.median(sample) if self.median else np.mean(sample))

    def interval(self, sample: np.ndarray, level: float, resamples: int) -> Interval:
        """Return the confidence interval: order statistics for medians, bootstrap for means, exact where all are equal."""
        if self.median:
            return median_interval(sample, level)
        if self.rate:
            return success_interval(sample > 0.0, level, resamples)
        if np.ptp(sample) == 0.0:
            return Interval(sample[0], sample[0], "none")
        return bootstrap(sample, level, resamples)


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
"""Published figures, where they apply. Tables of pages have the number of falls instead of their rate."""

BY_NAME = {each.name: each for each in QUANTITIES}


def summary(table: Table, level: float, resamples: int) -> dict[str, Any]:
    """Return the statistics of one policy in one place: times are over successes, everything else over all episodes."""
    return {
        **successes(table.by_run("success") > 0.0, level, resamples),
        **spread("time_to_goal", table["time_to_goal_s"], "_s"),
        **spread("time_over_bound", table["time_over_bound"]),
        **spread("position_error", table["position_error_m"], "_m"),
        **spread("heading_error", table["heading_error_rad"], "_rad"),
        **spread("path_error", table["path_error_m"], "_m"),
        "fallen": int(table["fallen"].sum()),
        "diverged": int(np.nansum(table["diverged"])),
        "mean_return": float(table["return"].mean()),
        "path_efficiency_median": quartiles(table["path_efficiency"]).median,
        **spread("throughput", table["throughput_parts_per_s"], "_parts_per_s"),
        "collisions_mean": float(table["collisions"].mean()),
        "clearance_median_m": quartiles(table["clearance_m"]).median,
        "parts_done_mean": float(table["parts_done"].mean()),
        "rate_over_bound_mean": float(table["rate_over_bound"].mean()),
        **{f"{name}_mean": float(table[name].mean()) for name in RATES},
        "transit_mean_s": float(table["transit_s"].mean()),
        "on_table_mean": float(table["on_table"].mean()),
        **spread("pattern_error", table["pattern_error_m"], "_m"),
        **spread("coverage", table["coverage"]),
    }


def successes(success: np.ndarray, level: float, resamples: int) -> dict[str, Any]:
    """Return the columns on success, from (runs, episodes) bool: counts, rate and its interval."""
    interval = success_interval(success, level, resamples)
    return {
        "episodes": success.shape[-1],
        "successes": int(success.sum()),
        "success_rate": float(success.mean()),
        **ends("success", interval),
        "success_interval_method": interval.method,
    }


def ends(name: str, interval: Interval | None, unit: str = "") -> dict[str, float]:
    """Return the columns on the ends of an interval; nan without one."""
    low, high = (math.nan, math.nan) if interval is None else (interval.low, interval.high)
    return {f"{name}_low{unit}": low, f"{name}_high{unit}": high}


def spread(name: str, values: np.ndarray, unit: str = "") -> dict[str, float]:
    """Return the columns on quartiles of the finite values."""
    found = quartiles(values)
    return {f"{name}_{which}{unit}": value for which, value in zip(("q25", "median", "q75"), found, strict=True)}


def quantity(value: float, factor: float, digits: int, unit: str) -> str:
    """Return a number >= 0 with its unit: "–" for nan, "< 0.01" for values that would round to zero."""
    if not math.isfinite(value):
        return "–"
    text, space = number(factor * value, digits), "" if unit in ("°", "") else " "
    if value > 0.0 and float(text) == 0.0:
        text = f"< {10.0**-digits:.{digits}f}"
    return f"{text}{space}{unit}"


def number(value: float, digits: int) -> str:
    """Return a number >= 0 with ``digits`` decimals, at most one from 10 up; "–" for nan."""
    return "–" if math.isnan(value) else f"{value:.{digits if value < 9.995 else min(digits, 1)}f}"


def signed(value: float, digits: int) -> str:
    """Return a number with its sign (a typographic minus), without one if it is zero."""
    text = f"{value:+.{digits}f}"
    return text[1:] if float(text) == 0.0 else text.replace("-", "−")


def span(low: float, high: float, digits: int) -> str:
    """Return "1.20 to 3.40", or "–" without an interval."""
    return "–" if low != low else f"{quantity(low, 1.0, digits, '')} to {quantity(high, 1.0, digits, '')}"


def percent(row: Mapping[str, Any]) -> str:
    """Return the success rate without its unit."""
    return f"{100 * row['success_rate']:.1f}"


def percent_between(row: Mapping[str, Any], joint: str = " to ") -> str:
    """Return the interval of the success rate without its unit."""
    return f"{100 * row['success_low']:.1f}{joint}{100 * row['success_high']:.1f}"


def plain(value: Any) -> Any:
    """Return JSON values: numbers that are not finite become None, objects their description."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return value if isinstance(value, str | int | float | bool | None) else repr(value)


def markdown(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    rows = [heads, ["-" * len(each) for each in heads], *lines]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in rows)
