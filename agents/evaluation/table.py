"""The table of episodes that all commands share, its metrics and figures, and how numbers are written.

A :class:`pandas.DataFrame` with one row per episode. Label columns: ``study`` ("report", "effects", ...), ``task``,
``hardware`` (or case), ``policy``, ``training_seed`` (-1 without one), ``limit_s`` (duration of the longest episode) and
``seed``. All other columns are metrics, float64, nan where they do not apply. A new metric is one line in :data:`METRICS`, and
a figure of it one in :data:`QUANTITIES`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from agents.evaluation.statistics import (
    Interval,
    bootstrap,
    episode_scores,
    interval_of,
    iqm,
    iqm_difference,
    mean_difference,
    median_interval,
    quartiles,
    success_difference,
    success_interval,
)
from vibgym import checks
from vibgym.policies.measures import MeasuredOutcomes
from vibgym.policies.rollout import CUSTOM_INFO, Outcomes
from vibgym.tasks.episode import EVENTS

REPORT, EFFECTS, LOAD = "report", "effects", "load"
"""Names of the studies of an evaluation."""

OWN = {
    "transit_s": "transit",
    "pattern_error_m": "pattern_error",
    **{name: name for name in CUSTOM_INFO if name not in ("transit", "pattern_error")},
}
"""Column -> name in :data:`vibgym.policies.rollout.CUSTOM_INFO`: metrics of some tasks only."""

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
    "rate_bound_per_minute": "rate_bound",
    "cost": "cost",
    "filmed": "filmed",
}
"""Column -> attribute of the outcomes."""

TIMING = {"timed_steps": "world_steps", "policy_s": "policy", "environment_s": "environment"}
"""Column -> attribute of :class:`vibgym.policies.rollout.Timing`: of all episodes of a case together."""

RECORDED = ("seed", *METRICS, "score", *TIMING)
"""Columns of recorded episodes, which have no labels."""

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

    def __str__(self) -> str:
        return ", ".join(self[1:] if self.study == REPORT else self)


PLACE = list(Place._fields)


def frame(outcomes: Outcomes) -> pd.DataFrame:
    """Return the episodes of one policy's rollout: seed, metrics, score and timing."""
    columns: dict[str, Any] = {"seed": outcomes.seeds}
    for name, what in METRICS.items():
        applies = name in ENDS or isinstance(outcomes, MeasuredOutcomes)
        value = outcomes.reported(what) if name in OWN else getattr(outcomes, what, np.nan)
        columns[name] = np.asarray(value if applies else np.nan, dtype=np.float64)[()]
    columns["score"] = episode_scores(outcomes) if isinstance(outcomes, MeasuredOutcomes) else np.nan
    columns |= {name: float(getattr(outcomes.timing, what)) for name, what in TIMING.items()}
    return pd.DataFrame(columns, index=pd.RangeIndex(len(outcomes.seeds)))


def places(episodes: pd.DataFrame, study: str | None = None) -> dict[Place, pd.DataFrame]:
    """Return the episodes of every policy in every place, in their order; of one study alone with ``study``."""
    some = episodes if study is None else where(episodes, study=study)
    return {Place(*key): rows for key, rows in some.groupby(PLACE, sort=False)}  # type: ignore[misc]


def table(
    episodes: pd.DataFrame,
    by: Sequence[str] = ("task", "hardware", "policy"),
    columns: Callable[[pd.DataFrame], Mapping[str, Any]] | None = None,
) -> pd.DataFrame:
    """Return a row of statistics for every group of episodes, in the order of their first episodes.

    Args:
        episodes: see above.
        by: label columns that define a group.
        columns: statistics of one group; by default :func:`summary`.
    """
    columns = columns or summary
    groups = episodes.groupby(list(by), sort=False)
    return pd.DataFrame(
        [{**dict(zip(by, key, strict=True)), **columns(rows)} for key, rows in groups],  # type: ignore[arg-type]
        dtype=object,
    )


def where(episodes: pd.DataFrame, **labels: Any) -> pd.DataFrame:
    """Return the episodes with these labels."""
    which = np.logical_and.reduce([episodes[name] == value for name, value in labels.items()])
    return episodes.loc[which]


def values(episodes: pd.DataFrame, name: str) -> np.ndarray:
    """Return a column (episodes,)."""
    return np.asarray(episodes[name])


def by_run(episodes: pd.DataFrame, name: str) -> np.ndarray:
    """Return a metric (runs, episodes) of one policy, whose training runs follow one another on the same seeds."""
    return values(episodes, name).reshape(len(np.unique(values(episodes, "training_seed"))), -1)


def mean(episodes: pd.DataFrame, name: str) -> float:
    """Return the mean of a metric; nan if it does not apply to all episodes, and without episodes."""
    return float(values(episodes, name).mean()) if len(episodes) else math.nan


def limited_times(episodes: pd.DataFrame) -> np.ndarray:
    """Return times to goal (runs, episodes), s, in which a failure counts as the longest episode."""
    success, time, limit = (by_run(episodes, name) for name in ("success", "time_to_goal_s", "limit_s"))
    return np.where(success > 0.0, time, limit)


def records(episodes: pd.DataFrame, names: Iterable[str]) -> list[dict[str, Any]]:
    """Return one mapping per row for CSV and JSON; booleans and counts are not floats."""
    columns: dict[str, list[Any]] = {name: episodes[name].tolist() for name in names}
    for name, values in columns.items():
        if name in BOOLEANS:
            columns[name] = [bool(value) for value in values]
        elif name in WHOLE:
            columns[name] = [int(value) if math.isfinite(value) else value for value in values]
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


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

    def middle_half(self, row: Mapping[str, Any]) -> str:
        """Return the quartiles of a row, "1.20 – 3.40"; empty for a mean."""
        if not self.median:
            return ""
        low, high = (number(self.factor * row[self.name.replace("median", q)], 2) for q in ("q25", "q75"))
        return "" if high == "–" or float(high) == 0.0 else f"{low} – {high}"

    def columns(self, episodes: pd.DataFrame) -> dict[str, float]:
        """Return its columns of a table of statistics: a mean, or quartiles of the finite values."""
        if not self.median:
            return {self.name: mean(episodes, self.column)}
        result = quartiles(values(episodes, self.column))
        return {self.name.replace("median", q): v for q, v in zip(("q25", "median", "q75"), result, strict=True)}

    def sample(self, episodes: pd.DataFrame) -> np.ndarray:
        """Return the finite values (n,)."""
        column = values(episodes, self.column)
        return column[np.isfinite(column)]

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

BY_NAME = {figure.name: figure for figure in QUANTITIES}


def summary(episodes: pd.DataFrame, level: float = 0.95, resamples: int = 9999) -> dict[str, Any]:
    """Return the statistics of one policy in one place.

    Medians of times are over successes, everything else is over all episodes; interquartile means count a failure as the
    longest episode.
    """
    limited, bound, collisions = limited_times(episodes), by_run(episodes, "bound_s"), by_run(episodes, "collisions")
    time = interval_of(limited, level, resamples, iqm)
    over = limited / bound if np.isfinite(bound).all() else None
    counted = np.isfinite(collisions).all()
    row = {"runs": len(limited), **successes(by_run(episodes, "success") > 0.0, level, resamples)}
    for figure in QUANTITIES:
        if not figure.rate:
            row |= figure.columns(episodes)
    steps, policy, environment = (values(episodes, name)[0] for name in TIMING)
    return row | {
        "time_iqm_s": float(iqm(limited.ravel())),
        **ends("time_iqm", time, "_s"),
        "over_bound_iqm": math.nan if over is None else float(iqm(over.ravel())),
        **ends("over_bound_iqm", None if over is None else interval_of(over, level, resamples, iqm)),
        "iqm_interval_method": "" if time is None else time.method,
        **ends("collisions", interval_of(collisions, level, resamples) if counted else None),
        "fallen": int(np.nansum(values(episodes, "fallen"))),
        "diverged": int(np.nansum(values(episodes, "diverged"))),
        "mean_return": mean(episodes, "return"),
        "clearance_median_m": quartiles(values(episodes, "clearance_m")).median,
        "parts_done_mean": mean(episodes, "parts_done"),
        **{
            f"{name}steps_per_second": steps / seconds if seconds > 0.0 else math.nan
            for name, seconds in (("", policy + environment), ("policy_", policy), ("environment_", environment))
        },
    }


def successes(success: np.ndarray, level: float, resamples: int) -> dict[str, Any]:
    """Return the columns on success, from (runs, episodes) bool: episodes of one run, successes of all, rate and interval."""
    interval = success_interval(success, level, resamples)
    return {
        "episodes": success.shape[-1],
        "successes": int(success.sum()),
        "success_rate": float(success.mean()),
        **ends("success", interval),
        "success_interval_method": interval.method,
    }


def difference(
    first: pd.DataFrame, second: pd.DataFrame, level: float = 0.95, resamples: int = 9999, middle: bool = True
) -> dict[str, Any]:
    """Return paired differences of two policies on the same seeds, first minus second, as :class:`.statistics.Estimate`.

    Args:
        first: episodes of a policy, of several training runs too.
        second: of a policy without training runs.
        level, resamples: of the intervals.
        middle: whether interquartile means and collisions are compared, too.

    Raises:
        ValueError: the policies were not played on the same seeds.
    """
    seeds = [by_run(episodes, "seed") for episodes in (first, second)]
    if seeds[0].shape[1:] != seeds[1].shape[1:] or len(seeds[1]) != 1 or (seeds[0] != seeds[1]).any():
        raise checks.conflict("a comparison requires the same episodes of both policies")
    times, collisions = (by_run(first, name) - by_run(second, name) for name in ("time_to_goal_s", "collisions"))
    mine, theirs = (by_run(episodes, "success") > 0.0 for episodes in (first, second))
    estimates = {
        "success": success_difference(mine, theirs, level, resamples),
        "both": int(np.isfinite(times).sum()),
        "time": mean_difference(times, level, resamples),
    }
    if middle:
        estimates["iqm"] = iqm_difference(limited_times(first), limited_times(second), level, resamples)
        estimates["collisions"] = mean_difference(collisions, level, resamples)
    return estimates


def ends(name: str, interval: Interval | None, unit: str = "") -> dict[str, float]:
    """Return the columns on the ends of an interval; nan without one."""
    low, high = (math.nan, math.nan) if interval is None else (interval.low, interval.high)
    return {f"{name}_low{unit}": low, f"{name}_high{unit}": high}


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


def percent_between(row: Mapping[str, Any]) -> str:
    """Return the interval of the success rate without its unit."""
    return f"{100 * row['success_low']:.1f} to {100 * row['success_high']:.1f}"


def plain(value: Any) -> Any:
    """Return JSON values: numbers that are not finite become None, objects their description."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return value if isinstance(value, str | int | float | bool | None) else repr(value)


def markdown(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    rows = [heads, ["-" * len(head) for head in heads], *lines]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in rows)
