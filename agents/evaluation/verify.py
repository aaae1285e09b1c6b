"""Verification of published results: ``python -m agents verify [DIR]`` plays a sample and tests every figure.

Null hypothesis: published and new episodes have the same distribution. Then the new ones are a random sample of all of them,
and the distribution of their figures follows by counting, without further assumptions. Intervals of rates and medians follow
from the published episodes alone (prediction intervals), those of other means from both together (permutation test).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from agents.evaluation.published import (
    COLUMNS,
    EPISODE_FILE,
    FIGURE_FILE,
    RECORD,
    Published,
    canonical,
    figure_rows,
    rounded,
    settings_apart,
    written_settings,
)
from agents.evaluation.run import Run, effects_runs, main_runs, run_all
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.table import BY_NAME, QUANTITIES, Place, Quantity, Table, markdown, quantity
from agents.provenance import commit, digest, versions
from vibgym import checks
from vibgym.files import csv_text
from vibgym.seeds import check_seeds, range_of

ALPHA = 0.01
"""Probability that any figure is outside by chance; all have the same share of it (Bonferroni), as they may be dependent."""

MOST_EPISODES = 1000

MOST_LINES = 5
"""Reported figures of one file that do not follow from its episodes."""

VALUES = ("episodes", "published", "found", "low", "high", "inside")
"""Columns of a tested figure."""

FIRST = ("success_rate", "time_to_goal_median_s")
"""Figures with their own column in the printed table."""


@dataclass(frozen=True)
class Sample:
    """Episodes to play of published results.

    Attributes:
        episodes: new ones per policy, task and hardware.
        again: published ones, played again (the first ones).
        first_seed: of the new episodes, in the range of the published ones; None: the one after the last of these.
        tasks, policies: only these; None: all.
    """

    episodes: int = 20
    again: int = 5
    first_seed: int | None = None
    tasks: Sequence[str] | None = None
    policies: Sequence[str] | None = None

    def seeds(self, published: Published) -> list[int]:
        """Return the seeds of the new episodes.

        Raises:
            ValueError: a number out of range, or seeds that were published.
        """
        checks.count("--episodes", self.episodes, most=MOST_EPISODES)
        checks.count("--again", self.again, least=0, most=MOST_EPISODES)
        first = published.last_seed + 1 if self.first_seed is None else self.first_seed
        check_seeds("--first-seed", first, self.episodes, range_of(published.last_seed))
        if first <= published.last_seed and first + self.episodes > int(published.table["seed"].min()):
            allowed = f"chosen so that no seed was published, e.g. {published.last_seed + 1}"
            raise checks.refuse("--first-seed", first, allowed)
        return list(range(first, first + self.episodes))

    def places(self, published: Published) -> dict[Place, Table]:
        """Return the published episodes of the places to play.

        Raises:
            ValueError: a task or policy that was not published, or no place with both.
        """
        found = everything = published.table.places()
        for option, names in (("task", self.tasks), ("policy", self.policies)):
            if names:
                known = tuple(dict.fromkeys(getattr(place, option) for place in everything))
                for name in names:
                    checks.choice(f"--{option}", name, known)
                found = {place: those for place, those in found.items() if getattr(place, option) in names}
        if not found:
            raise checks.conflict(f"--policy: none of {list(self.policies or ())} ran on {', '.join(self.tasks or ())}")
        return found


@dataclass(frozen=True)
class Tested:
    """One figure, published and of the new episodes, with the interval in which it should lie."""

    place: Place
    figure: Quantity
    published: float
    found: float
    low: float
    high: float
    episodes: int

    @property
    def inside(self) -> bool:
        """Whether it lies there, up to rounding."""
        slack = 1e-9 * abs(self.found)
        return self.low - slack <= self.found <= self.high + slack

    @property
    def between(self) -> str:
        """The interval as text."""
        return f"{self.text(self.low, '')} to {self.text(self.high)}"

    def text(self, value: float, unit: str | None = None) -> str:
        """Return a value with the figure's unit, or with ``unit``."""
        figure = self.figure
        return quantity(value, figure.factor, figure.digits, figure.unit if unit is None else unit).rstrip()


@dataclass(frozen=True)
class Verification:
    """Result of a verification.

    Attributes:
        published: what was verified.
        different: files, settings and figures that differ from what was published, a line each.
        versions: versions that differ, a line each; not a failure.
        tested: every figure.
        again: place -> number of published episodes with identical metrics, and number played again.
        alpha: probability of each figure to be outside by chance.
    """

    published: Published
    different: list[str]
    versions: list[str]
    tested: list[Tested]
    again: Mapping[Place, tuple[int, int]]
    alpha: float

    @property
    def holds(self) -> bool:
        """Whether something was played, every figure is inside its interval, and nothing differs."""
        return bool(self.tested) and not self.different and all(each.inside for each in self.tested)


def verify(
    published: Published, sample: Sample, processes: int = 1, quiet: bool = False, ray: str | None = None
) -> Verification:
    """Verify published results; writes nothing.

    If a policy's file is missing or invalid nothing can be played, which is reported among the differences.

    Raises:
        ValueError: an impossible sample.
    """
    seeds, places = sample.seeds(published), sample.places(published)
    different = differences(published)
    new: dict[Place, Table] = {}
    again: dict[Place, tuple[int, int]] = {}
    try:
        runs = _runs(published, places, seeds, sample.again)
    except ValueError as error:
        if not different:
            raise
        different.append(f"nothing was played: {error}")
        runs = []
    for run, found in zip(runs, run_all(runs, processes, ray, quiet), strict=True):
        table = rounded(Table.of(found, run.place))
        repeated, new[run.place] = table.rows(slice(None, -len(seeds))), table.rows(slice(-len(seeds), None))
        again[run.place] = _identical(repeated, places[run.place]), len(repeated)
    tested, alpha = tested_figures(places, new)
    return Verification(published, different, version_changes(published), tested, again, alpha)


def _runs(published: Published, places: Mapping[Place, Table], seeds: Sequence[int], again: int) -> list[Run]:
    """Return the runs of the first ``again`` published episodes and the new ones in every place."""
    known = {run.place: run for run in (*main_runs(published.settings)[2], *effects_runs(published.settings))}
    for place in places:
        if place not in known:
            raise checks.unknown(f"place in {published.directory / EPISODE_FILE}", str(place), known)
    return [replace(known[place], seeds=[*those["seed"][:again].tolist(), *seeds]) for place, those in places.items()]


def _identical(repeated: Table, published: Table) -> int:
    """Return the number of episodes whose metrics are all identical."""
    pairs = [(repeated[name], published[name][: len(repeated)]) for name in COLUMNS]
    return int(np.all([(one == other) | (np.isnan(one) & np.isnan(other)) for one, other in pairs], axis=0).sum())


def tested_figures(published: Mapping[Place, Table], new: Mapping[Place, Table]) -> tuple[list[Tested], float]:
    """Return every figure of the new episodes with its interval, and the share of :data:`ALPHA` of each.

    Figures without a value on one side, such as times without a success, are left out: their rate is a figure, too.
    """
    samples = []
    for place, those in new.items():
        for figure in QUANTITIES:
            before, now = figure.sample(published[place]), figure.sample(those)
            if len(before) and len(now):
                samples.append((place, figure, before, now))
    share, tested = ALPHA / max(len(samples), 1), []
    for place, figure, before, now in samples:
        if figure.median:
            low, high = median_between(before, len(now), share)
        elif figure.rate:
            low, high = rate_between(int(before.sum()), len(before), len(now), share)
        else:
            low, high = mean_between(np.concatenate([before, now]), len(now), share)
        tested.append(Tested(place, figure, figure.value(before), figure.value(now), low, high, len(now)))
    return tested, share


def rate_between(times: int, published: int, fresh: int, alpha: float) -> tuple[float, float]:
    """Return the interval of the rate in ``fresh`` episodes of an event that occurred ``times`` in ``published`` ones.

    It holds the rates that Fisher's exact test ("The design of experiments", 1935) does not reject on either side.

    Args:
        alpha: upper bound of the probability that the rate lies outside, half of it on either side.
    """
    again = np.arange(fresh + 1)
    chances = published + fresh, times + again, fresh
    likely = np.minimum(stats.hypergeom.cdf(again, *chances), stats.hypergeom.sf(again - 1, *chances)) > 0.5 * alpha
    kept = again[likely]
    return float(kept[0] / fresh), float(kept[-1] / fresh)


def median_between(published: np.ndarray, fresh: int, alpha: float) -> tuple[float, float]:
    """Return the interval of the median of ``fresh`` values, from the ``published`` ones (n,).

    The number of published values below the j-th fresh one has a negative hypergeometric distribution (Fligner, Wolfe, "Some
    applications of sample analogues to the probability integral transformation", The American Statistician 30, 1976). With
    ties or an even number of fresh values the interval is conservative.

    Args:
        alpha: see :func:`rate_between`.

    Returns:
        Two published values; minus or plus infinity where there are too few of them.
    """
    low, high = _ranks(len(published), fresh, alpha)
    ordered = np.concatenate([[-np.inf], np.sort(published), [np.inf]])
    return float(ordered[low]), float(ordered[high])


@lru_cache(maxsize=1024)
def _ranks(published: int, fresh: int, alpha: float) -> tuple[int, int]:
    """Return the ranks of the published values around the median; 0 and ``published`` + 1 where none is low or high enough."""
    lower, upper, ranks = (fresh + 1) // 2, fresh // 2 + 1, np.arange(published)
    below = stats.betabinom.cdf(ranks, published, lower, fresh - lower + 1) <= 0.5 * alpha
    above = stats.betabinom.sf(ranks, published, upper, fresh - upper + 1) <= 0.5 * alpha
    return int(below.sum()), published + 1 - int(above.sum())


def mean_between(pool: np.ndarray, fresh: int, alpha: float) -> tuple[float, float]:
    """Return the interval of the mean of ``fresh`` values drawn from ``pool`` (n,): an exact permutation test.

    Args:
        pool: published and fresh values together, whole numbers.
        fresh: from 1 to n.
        alpha: see :func:`rate_between`.
    """
    whole = np.rint(pool).astype(np.int64)
    least = int(whole.min())
    chances = _sums(whole - least, fresh)
    upto, beyond = np.cumsum(chances), np.cumsum(chances[::-1])[::-1]  # P(sum <= s), P(sum >= s)
    kept = np.flatnonzero(np.minimum(upto, beyond) > 0.5 * alpha)
    return least + float(kept[0]) / fresh, least + float(kept[-1]) / fresh


def _sums(pool: np.ndarray, drawn: int) -> np.ndarray:
    """Return the probability of every sum of ``drawn`` values of ``pool`` (n,), whole numbers >= 0, without replacement."""
    most = int(np.sort(pool)[-drawn:].sum())
    values, counts = np.unique(pool, return_counts=True)
    left = len(pool)
    chances = np.zeros((drawn + 1, most + 1))  # by number of values drawn and their sum
    chances[0, 0] = 1.0
    for value, count in zip(values.tolist(), counts.tolist(), strict=True):
        after, taken = np.zeros_like(chances), np.arange(min(count, drawn) + 1)
        shares = stats.hypergeom.pmf(taken[:, None], left, count, drawn - np.arange(drawn + 1))
        for more in taken[: 1 + most // value if value else None].tolist():
            moved = shares[more, : drawn + 1 - more, None] * chances[: drawn + 1 - more, : most + 1 - more * value]
            after[more:, more * value :] += moved
        chances, left = after, left - count
    return chances[drawn]


def differences(published: Published) -> list[str]:
    """Return what differs from what was published: files, figures, settings and policies, a line each; runs nothing."""
    directory, record = published.directory, published.record
    digests, found = record["digests"], []
    for name, now in published.digests.items():
        if digests["files"].get(name) != now:
            found.append(f"{directory / name}: edited since it was published")
    if digest(canonical(record["settings"])) != digests["settings"]:
        found.append(f"{directory / RECORD}: settings: edited since they were published")
    found += _figures(published)
    path = Path(str(record.get("config")))
    try:
        now = written_settings(EvaluationSettings.load(path))
        found += [f"{path}: other {each} than published" for each in settings_apart(record["settings"], now)]
    except ValueError as error:
        found.append(str(error))
    for path, before in digests["policies"].items():
        try:
            now = digest(Path(path).read_bytes())
        except (OSError, ValueError):
            now = None
        if now != before:
            found.append(f"{path}: {'missing' if now is None else 'changed'} since results were published")
    return found


def _figures(published: Published) -> list[str]:
    """Return the figures that do not follow from the published episodes."""
    path, found = published.directory / FIGURE_FILE, []
    follow: dict[tuple[Place, str], float] = {}
    for row in figure_rows(published.table):
        follow[Place(*(row[name] for name in Place._fields)), row["figure"]] = row["value"]
    for place, name in {**follow, **published.figures}:
        value, stands = follow.get((place, name)), published.figures.get((place, name))
        if value is None:
            found.append(f"{path}: {place}: {name} follows from no published episodes")
        # The last digit of a sum depends on the order of additions.
        elif stands is None or not math.isclose(stands, value, rel_tol=1e-9, abs_tol=1e-12):
            given = "is missing" if stands is None else f"is {stands:g}"
            found.append(f"{path}: {place}: {name} {given}; {value:g} follows from the episodes")
    more = len(found) - MOST_LINES
    return [*found[:MOST_LINES], f"{path}: {more} more figures"] if more > 0 else found


def version_changes(published: Published) -> list[str]:
    """Return the versions and the commit that differ, a line each."""
    then, now = dict(published.record["versions"]), versions()
    then["commit"], now["commit"] = published.record.get("commit"), commit()
    names = [name for name in {**then, **now} if then.get(name) != now.get(name)]
    return [f"{name} {then.get(name) or 'none'}, here {now.get(name) or 'none'}" for name in names]


def report_of(found: Verification) -> str:
    """Return the text of the command: a table, what differs, and the result."""
    record, outside = found.published.record, [each for each in found.tested if not each.inside]
    lines = [f"published {record.get('time')}, commit {record.get('commit')}"]
    if found.tested:
        lines += ["", _table(found), ""]
    for each in outside:
        values = f"{each.text(each.found)} of {each.episodes} episodes, published {each.text(each.published)}"
        lines.append(f"outside: {each.place}: {each.figure.label} {values}, should be in {each.between}")
    lines += [f"different: {each}" for each in found.different]
    lines += [f"version: {each}" for each in found.versions]
    same, played = (sum(each[k] for each in found.again.values()) for k in (0, 1))
    if played:
        lines.append(f"{same} of {played} published episodes have the same metrics when played again")
    inside = f"{len(found.tested) - len(outside)} of {len(found.tested)} figures are inside their intervals"
    chance = f"by chance all are with {100 * (1 - ALPHA):g} %, each with 1 - {found.alpha:.1e}"
    lines += [f"{inside} ({chance})", "verified" if found.holds else "not verified"]
    return "\n".join(lines)


def figures_csv(found: Verification) -> str:
    """Return all figures with their intervals; only the header if nothing was played."""
    rows: list[dict[str, Any]] = [
        each.place._asdict() | {"figure": each.figure.name} | {name: getattr(each, name) for name in VALUES}
        for each in found.tested
    ]
    return csv_text(rows) if rows else ",".join((*Place._fields, "figure", *VALUES)) + "\n"


def _table(found: Verification) -> str:
    heads = ("task", "hardware", "policy", *(BY_NAME[name].label for name in FIRST), "figures inside", "identical")
    lines = []
    for place, (same, played) in found.again.items():
        those = {each.figure.name: each for each in found.tested if each.place == place}
        cells = [
            f"{those[name].text(those[name].found)} in {those[name].between}" if name in those else "–"
            for name in FIRST
        ]
        inside = f"{sum(each.inside for each in those.values())} of {len(those)}"
        lines.append([*place[1:], *cells, inside, f"{same} of {played}"])
    return markdown(heads, lines)
