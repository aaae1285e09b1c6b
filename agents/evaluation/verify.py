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
    """What to play of published results.

    Attributes:
        episodes: new ones in every place.
        again: published ones in every place that are played again (the first ones).
        first_seed: of the new episodes; None: the one after the last published.
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
        checks.count("--first-seed", first, least=0, most=2**63 - 1 - self.episodes)
        new, least = range(first, first + self.episodes), int(published.table["seed"].min())
        if new.start <= published.last_seed and new.stop > least:
            allowed = f"chosen so that no seed was published, e.g. {published.last_seed + 1}"
            raise checks.refuse("--first-seed", first, allowed)
        return list(new)

    def places(self, published: Published) -> dict[Place, Table]:
        """Return the published episodes of the places to play.

        Raises:
            ValueError: a task or policy that was not published, or no place with both.
        """
        everything = published.table.places()
        for option, names in (("task", self.tasks), ("policy", self.policies)):
            known = tuple(dict.fromkeys(getattr(place, option) for place in everything))
            for name in names or ():
                checks.choice(f"--{option}", name, known)
        found = {
            place: those
            for place, those in everything.items()
            if place.task in (self.tasks or [place.task]) and place.policy in (self.policies or [place.policy])
        }
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
    different: tuple[str, ...]
    versions: tuple[str, ...]
    tested: tuple[Tested, ...]
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
        played = _play(published, places, seeds, sample.again, processes, quiet, ray)
    except ValueError as error:
        if not different:
            raise
        different.append(f"nothing was played: {error}")
        played = {}
    for place, table in played.items():
        repeated, new[place] = table.rows(slice(None, -len(seeds))), table.rows(slice(-len(seeds), None))
        again[place] = _identical(repeated, places[place]), len(repeated)
    tested, alpha = tested_figures(places, new)
    return Verification(published, tuple(different), tuple(version_changes(published)), tested, again, alpha)


def _play(
    published: Published,
    places: Mapping[Place, Table],
    seeds: Sequence[int],
    again: int,
    processes: int,
    quiet: bool,
    ray: str | None,
) -> dict[Place, Table]:
    """Play the first ``again`` published episodes and the new ones in every place."""
    known = [*main_runs(published.settings)[2], *effects_runs(published.settings)]
    by_place = {run.place: run for run in known}
    runs: list[Run] = []
    for place, those in places.items():
        if place not in by_place:
            raise checks.unknown(f"place in {published.directory / EPISODE_FILE}", str(place), by_place)
        runs.append(replace(by_place[place], seeds=[*those["seed"][:again].tolist(), *seeds]))
    found = run_all(runs, processes, ray, quiet)
    return {run.place: rounded(Table.of(each, run.place)) for run, each in zip(runs, found, strict=True)}


def _identical(repeated: Table, published: Table) -> int:
    """Return the number of episodes whose metrics are all identical."""
    pairs = [(repeated[name], published[name][: len(repeated)]) for name in COLUMNS]
    return int(np.all([(one == other) | (np.isnan(one) & np.isnan(other)) for one, other in pairs], axis=0).sum())


def tested_figures(
    published: Mapping[Place, Table], new: Mapping[Place, Table], alpha: float = ALPHA
) -> tuple[tuple[Tested, ...], float]:
    """Return every figure of the new episodes with its interval, and the share of ``alpha`` of each.

    Figures without a value on one side, such as times without a success, are left out: their rate is a figure, too.
    """
    samples = []
    for place, those in new.items():
        for figure in QUANTITIES:
            before, now = figure.sample(published[place]), figure.sample(those)
            if len(before) and len(now):
                samples.append((place, figure, before, now))
    share, tested = alpha / max(len(samples), 1), []
    for place, figure, before, now in samples:
        if figure.median:
            low, high = median_between(before, len(now), share)
        elif figure.rate:
            low, high = rate_between(int(before.sum()), len(before), len(now), share)
        else:
            low, high = mean_between(np.concatenate([before, now]), len(now), share)
        tested.append(Tested(place, figure, figure.value(before), figure.value(now), low, high, len(now)))
    return tuple(tested), share


def rate_between(times: int, published: int, fresh: int, alpha: float) -> tuple[float, float]:
    """Interval of the rate in ``fresh`` episodes of what occurred ``times`` in ``published`` ones.

    Those rates which Fisher's exact test does not reject ("The design of experiments", 1935), on either side.

    Args:
        alpha: the rate lies outside with this probability at most, and with half of it on either side.
    """
    again = np.arange(fresh + 1)
    chances = published + fresh, times + again, fresh
    likely = np.minimum(stats.hypergeom.cdf(again, *chances), stats.hypergeom.sf(again - 1, *chances)) > 0.5 * alpha
    kept = again[likely]
    return float(kept[0] / fresh), float(kept[-1] / fresh)


def median_between(published: np.ndarray, fresh: int, alpha: float) -> tuple[float, float]:
    """Interval of the median of ``fresh`` values, from the ``published`` ones (n,).

    How many published values lie below the j-th of the fresh ones has a negative hypergeometric distribution (Fligner, Wolfe,
    "Some applications of sample analogues to the probability integral transformation", The American Statistician 30, 1976).
    With ties less is outside, and so it is with an even number: the lower one of the two in the middle would have to be below,
    or the upper one above.

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
    """Ranks of the published values between which the median lies: 0 and ``published`` + 1 where none is low or high enough."""
    lower, upper, ranks = (fresh + 1) // 2, fresh // 2 + 1, np.arange(published)
    below = stats.betabinom.cdf(ranks, published, lower, fresh - lower + 1) <= 0.5 * alpha
    above = stats.betabinom.sf(ranks, published, upper, fresh - upper + 1) <= 0.5 * alpha
    return int(below.sum()), published + 1 - int(above.sum())


def mean_between(pool: np.ndarray, fresh: int, alpha: float) -> tuple[float, float]:
    """Interval of the mean of ``fresh`` values drawn without replacement from ``pool`` (n,), published and fresh ones together.

    A permutation test, exact by the distribution of the sum.

    Args:
        pool: whole numbers.
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
    """Probability of every sum of ``drawn`` values of ``pool`` (n,), whole numbers from 0 up."""
    most = int(np.sort(pool)[-drawn:].sum())
    values, counts = np.unique(pool, return_counts=True)
    left = len(pool)
    chances = np.zeros((drawn + 1, most + 1))  # of so many values drawn with such a sum
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
        place = Place(*(row[name] for name in Place._fields))
        follow[place, row["figure"]] = row["value"]
    for (place, name), value in follow.items():
        stands = published.figures.get((place, name))
        # The last digit of a sum depends on the order of additions.
        if stands is None or not math.isclose(stands, value, rel_tol=1e-9, abs_tol=1e-12):
            says = "is missing" if stands is None else f"is {stands:g}"
            found.append(f"{path}: {place}: {name} {says}; {value:g} follows from the episodes")
    for place, name in published.figures:
        if (place, name) not in follow:
            found.append(f"{path}: {place}: {name} follows from no published episodes")
    return (
        found if len(found) <= MOST_LINES else [*found[:MOST_LINES], f"{path}: {len(found) - MOST_LINES} more figures"]
    )


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
        values = f"{_text(each, each.found)} of {each.episodes} episodes, published {_text(each, each.published)}"
        lines.append(f"outside: {each.place}: {each.figure.label} {values}, should be in {_between(each)}")
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
    if not found.tested:
        return ",".join((*Place._fields, "figure", *VALUES)) + "\n"
    rows: list[dict[str, Any]] = [
        each.place._asdict() | {"figure": each.figure.name} | {name: getattr(each, name) for name in VALUES}
        for each in found.tested
    ]
    return csv_text(rows)


def _table(found: Verification) -> str:
    by_place: dict[Place, dict[str, Tested]] = {}
    for each in found.tested:
        by_place.setdefault(each.place, {})[each.figure.name] = each
    heads = ("task", "hardware", "policy", *(BY_NAME[name].label for name in FIRST), "figures inside", "identical")
    lines = []
    for place, those in by_place.items():
        inside = sum(each.inside for each in those.values())
        same, played = found.again[place]
        cells = [
            "–" if (each := those.get(name)) is None else f"{_text(each, each.found)} in {_between(each)}"
            for name in FIRST
        ]
        lines.append([*place[1:], *cells, f"{inside} of {len(those)}", f"{same} of {played}"])
    return markdown(heads, lines)


def _between(each: Tested) -> str:
    return f"{_text(each, each.low, False)} to {_text(each, each.high)}"


def _text(each: Tested, value: float, unit: bool = True) -> str:
    figure = each.figure
    return quantity(value, figure.factor, figure.digits, figure.unit if unit else "").rstrip()
