"""A policy against the best classical one, episode by episode."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from agents.evaluation.comparison.power import detectable_mean, detectable_normal, detectable_success
from agents.evaluation.comparison.sample import Sample
from agents.evaluation.resampling import Interval, bootstrap, drawn, iqm, iqm_of, mean_of, mean_where, percentiles
from agents.evaluation.statistics import difference_interval


@dataclass(frozen=True)
class Estimate:
    """A difference, first minus second.

    Attributes:
        value: nan where nothing can be compared.
        interval: None where all pairs differ alike, so that resampling says nothing.
        detectable: the smallest difference that the sample could have shown; nan where it cannot be said.
    """

    value: float
    interval: Interval | None
    detectable: float

    @property
    def clear(self) -> bool:
        """Whether zero is outside the interval."""
        return self.interval is not None and (self.interval.low > 0.0 or self.interval.high < 0.0)


@dataclass(frozen=True)
class Difference:
    """Two policies on the same episodes of a task and hardware."""

    task: str
    hardware: str
    first: str
    second: str
    episodes: int
    runs: int  # of the first one's training
    success: Estimate  # difference of the success rates, mean of all runs
    both: int  # pairs on which both succeed, of all runs
    time: Estimate  # s, mean difference of the times to goal over those
    iqm: Estimate  # s, difference of the interquartile means of the times, in which failures count as the longest episode
    collisions: Estimate  # mean difference of the pairs newly in touch, an episode


def difference(
    place: tuple[str, str],
    names: tuple[str, str],
    samples: tuple[Sample, Sample],
    confidence: float,
    power: float,
    resamples: int,
) -> Difference:
    """Compare two policies, the second of which has one run.

    Args:
        place: task and hardware.
        names: of the policies.
        samples: their episodes.
        confidence: level of the intervals.
        power: chance to find the smallest detectable difference.
        resamples: draws of the bootstrap.

    Raises:
        ValueError: the samples are not of the same episodes.
    """
    first, second = samples
    if first.seeds != second.seeds or second.runs != 1:
        raise ValueError(
            f"{names[0]} and {names[1]}: a paired comparison needs the same seeds, and one run of the second"
        )
    asked = confidence, power, resamples
    both = first.success & second.success
    times = np.where(both, first.time_to_goal, 0.0) - np.where(both, second.time_to_goal, 0.0)
    collisions = first.collisions - second.collisions
    return Difference(
        task=place[0],
        hardware=place[1],
        first=names[0],
        second=names[1],
        episodes=len(first.seeds),
        runs=first.runs,
        success=_success(first.success, second.success, *asked),
        both=int(both.sum()),
        time=_mean(times, both, *asked),
        iqm=_iqm(first.limited_time, second.limited_time, *asked),
        collisions=_mean(collisions, np.isfinite(collisions), *asked),
    )


def _success(first: np.ndarray, second: np.ndarray, confidence: float, power: float, resamples: int) -> Estimate:
    """Of (runs, episodes) against (1, episodes)."""
    runs, episodes = first.shape
    gap = first.astype(np.float64) - second
    value = float(gap.mean())
    if runs == 1 or np.ptp(gap) == 0.0:  # runs that do all the same are no more than one
        interval = difference_interval(first[0], second[0], confidence, resamples)
        other = min(float((gap[0] < 0).mean()), float((gap[0] > 0).mean()))
        return Estimate(value, interval, detectable_success(other, episodes, confidence, power))
    draws = drawn(mean_of(gap), runs, episodes, resamples)
    detectable = detectable_normal(float(draws.std(ddof=1)), confidence, power)
    return Estimate(value, percentiles(draws, confidence, runs), detectable)


def _mean(gap: np.ndarray, counted: np.ndarray, confidence: float, power: float, resamples: int) -> Estimate:
    """Mean of the differences (runs, episodes) that are ``counted``."""
    runs, episodes = gap.shape
    values = gap[counted]
    if not len(values):
        return Estimate(math.nan, None, math.nan)
    value = float(values.mean())
    # Times are whole steps: equal ones differ by rounding at most.
    if len(values) < 2 or np.ptp(values) < 1e-9:
        return Estimate(value, None, math.nan)
    if runs == 1:
        detectable = detectable_mean(float(values.std(ddof=1)), len(values), confidence, power)
        return Estimate(value, bootstrap(values, confidence, resamples), detectable)
    draws = drawn(mean_where(gap, counted), runs, episodes, resamples)
    detectable = detectable_normal(float(np.nanstd(draws, ddof=1)), confidence, power)
    return Estimate(value, percentiles(draws, confidence, runs), detectable)


def _iqm(first: np.ndarray, second: np.ndarray, confidence: float, power: float, resamples: int) -> Estimate:
    """Of times (runs, episodes) against (1, episodes); both get the same draws.

    The second one is set against each run: of as many cells, so that both lose quarters that are rounded alike.
    """
    runs, episodes = first.shape
    second = np.repeat(second, runs, axis=0)
    value = float(iqm(first.ravel()) - iqm(second.ravel()))
    one, other = iqm_of(first), iqm_of(second)
    draws = drawn(lambda weight: one(weight) - other(weight), runs, episodes, resamples)
    if np.ptp(draws) < 1e-9:
        return Estimate(value, None, math.nan)
    detectable = detectable_normal(float(draws.std(ddof=1)), confidence, power)
    return Estimate(value, percentiles(draws, confidence, runs), detectable)
