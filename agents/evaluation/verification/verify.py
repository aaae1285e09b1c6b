"""Whether published results are found again: digests, a sample played, and every figure in its interval."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.evaluation.quantities import QUANTITIES, Quantity
from agents.evaluation.verification.differences import differences, versions_apart
from agents.evaluation.verification.intervals import mean_between, median_between, rate_between
from agents.evaluation.verification.published import Published
from agents.evaluation.verification.published_figures import EpisodeTable, Place
from agents.evaluation.verification.sample import Asked, play_sample

ALPHA = 0.01
"""With which probability at most any figure of all lies outside by chance; each gets the same share (Bonferroni), which holds
however figures depend on one another: policies of a task meet the same starts."""


VALUES = ("episodes", "published", "found", "low", "high", "inside")
"""Of a figure that was checked, as columns."""


@dataclass(frozen=True)
class Checked:
    """One figure, published and found again, and the interval in which it should lie."""

    place: Place
    figure: Quantity
    published: float
    found: float
    low: float
    high: float
    episodes: int  # fresh ones that it comes from

    @property
    def inside(self) -> bool:
        """Whether it lies there, but for rounding."""
        slack = 1e-9 * abs(self.found)
        return self.low - slack <= self.found <= self.high + slack

    def as_row(self) -> dict[str, Any]:
        """For CSV."""
        values = {name: getattr(self, name) for name in VALUES}
        return self.place._asdict() | {"figure": self.figure.name} | values


@dataclass(frozen=True)
class Verification:
    """What came of it.

    Attributes:
        published: what was verified.
        different: lines on files, settings and figures that are not those that were published.
        versions: lines on versions that differ, which is no fault.
        checked: every figure that was found again.
        again: place -> published episodes that came out the same again, and how many were played.
        alpha: with which probability each figure may lie outside by chance.
    """

    published: Published
    different: tuple[str, ...]
    versions: tuple[str, ...]
    checked: tuple[Checked, ...]
    again: Mapping[Place, tuple[int, int]]
    alpha: float

    @property
    def holds(self) -> bool:
        """Whether all is as published: something was played, every figure lies in its interval, and no file differs."""
        return bool(self.checked) and not self.different and all(each.inside for each in self.checked)


def verify(
    published: Published, asked: Asked, processes: int = 1, quiet: bool = False, ray: str | None = None
) -> Verification:
    """Verify published results; writes nothing.

    Where a file of a policy is gone or none any more nothing can be played: that is among the differences.

    Raises:
        ValueError: a sample that cannot be.
    """
    seeds, places = asked.seeds(published), asked.places(published)
    different, played = differences(published), {}
    try:
        played = play_sample(published, places, seeds, asked.again, processes, quiet, ray)
    except ValueError as error:
        if not different:
            raise
        different.append(f"nothing was played: {error}")
    checked, alpha = check(published.episodes, {place: each.fresh for place, each in played.items()})
    again = {place: (each.the_same(published.episodes[place]), len(each.again.seeds)) for place, each in played.items()}
    return Verification(published, tuple(different), tuple(versions_apart(published)), checked, again, alpha)


def check(
    published: Mapping[Place, EpisodeTable], fresh: Mapping[Place, EpisodeTable], alpha: float = ALPHA
) -> tuple[tuple[Checked, ...], float]:
    """Every figure of the fresh episodes with its interval, and the share of ``alpha`` that each of them has.

    Figures of what does not occur in one of the two, such as times without a success, are left out: how often it occurs is a
    figure of its own.
    """
    samples = []
    for place, those in fresh.items():
        for figure in QUANTITIES:
            before, now = figure.sample(published[place].columns), figure.sample(those.columns)
            if len(before) and len(now):
                samples.append((place, figure, before, now))
    share = alpha / max(len(samples), 1)
    checked = []
    for place, figure, before, now in samples:
        if figure.median:
            low, high = median_between(before, len(now), share)
        elif figure.rate:
            low, high = rate_between(int(before.sum()), len(before), len(now), share)
        else:
            low, high = mean_between(np.concatenate([before, now]), len(now), share)
        checked.append(Checked(place, figure, figure.value(before), figure.value(now), low, high, len(now)))
    return tuple(checked), share
