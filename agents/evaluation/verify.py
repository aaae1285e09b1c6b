"""Verification of published results: ``python -m agents verify [DIR]`` plays a sample and tests every figure.

Null hypothesis: published and new episodes have the same distribution. Rates have Fisher's exact test, medians and means the
test of Mann and Whitney, which compares all values of both samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
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
from agents.evaluation.run import Case, effects_cases, main_cases, run
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.table import BY_NAME, QUANTITIES, Place, Quantity, markdown, places, quantity, values
from agents.provenance import commit, digest, versions
from vibgym import checks
from vibgym.files import csv_text
from vibgym.seeds import check_seeds, range_of

ALPHA = 0.01
"""Probability that any figure differs by chance; all have the same share of it (Bonferroni), as they may be dependent."""

MOST_EPISODES = 1000

MOST_LINES = 5
"""Reported figures of one file that do not follow from its episodes."""

VALUES = ("episodes", "published", "found", "chance", "agrees")
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
        if first <= published.last_seed and first + self.episodes > int(values(published.episodes, "seed").min()):
            allowed = f"chosen so that no seed was published, e.g. {published.last_seed + 1}"
            raise checks.refuse("--first-seed", first, allowed)
        return list(range(first, first + self.episodes))

    def places(self, published: Published) -> dict[Place, pd.DataFrame]:
        """Return the published episodes of the places to play.

        Raises:
            ValueError: a task or policy that was not published, or no place with both.
        """
        found = everything = places(published.episodes)
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
    """One figure, published and of ``episodes`` new ones, and the chance of such a difference; ``agrees`` if it is likely."""

    place: Place
    figure: Quantity
    published: float
    found: float
    episodes: int
    chance: float
    agrees: bool

    def text(self, value: float) -> str:
        """Return a value with the figure's unit."""
        figure = self.figure
        return quantity(value, figure.factor, figure.digits, figure.unit).rstrip()


@dataclass(frozen=True)
class Verification:
    """Result of a verification.

    Attributes:
        published: what was verified.
        different: files, settings and figures that differ from what was published, a line each.
        versions: versions that differ, a line each; not a failure.
        tested: every figure.
        again: place -> number of published episodes with identical metrics, and number played again.
    """

    published: Published
    different: list[str]
    versions: list[str]
    tested: list[Tested]
    again: Mapping[Place, tuple[int, int]]

    @property
    def holds(self) -> bool:
        """Whether something was played, every figure agrees, and nothing differs."""
        return bool(self.tested) and not self.different and all(each.agrees for each in self.tested)


def verify(
    published: Published, sample: Sample, processes: int = 1, quiet: bool = False, ray: str | None = None
) -> Verification:
    """Verify published results; writes nothing.

    If a policy's file is missing or invalid nothing can be played, which is reported among the differences.

    Raises:
        ValueError: an impossible sample.
    """
    seeds, chosen = sample.seeds(published), sample.places(published)
    different, again, tested = differences(published), dict[Place, tuple[int, int]](), list[Tested]()
    try:
        cases = _cases(published, chosen, seeds, sample.again)
    except ValueError as error:
        if not different:
            raise
        different.append(f"nothing was played: {error}")
        cases = []
    if cases:
        played = rounded(run(cases, processes, ray, quiet))
        for place, some in places(played).items():
            repeated = some.iloc[: -len(seeds)]
            again[place] = _identical(repeated, chosen[place]), len(repeated)
        new = played.loc[np.isin(values(played, "seed"), seeds)]
        tested = check(new, pd.concat(chosen.values()))
    return Verification(published, different, version_changes(published), tested, again)


def _cases(published: Published, chosen: Mapping[Place, pd.DataFrame], seeds: Sequence[int], again: int) -> list[Case]:
    """Return the cases of the first ``again`` published episodes and the new ones in every place."""
    known = {case.place: case for case in (*main_cases(published.settings)[2], *effects_cases(published.settings))}
    for place in chosen:
        if place not in known:
            raise checks.unknown(f"place in {published.directory / EPISODE_FILE}", str(place), known)
    return [replace(known[place], seeds=[*some["seed"][:again].tolist(), *seeds]) for place, some in chosen.items()]


def _identical(repeated: pd.DataFrame, published: pd.DataFrame) -> int:
    """Return the number of episodes whose metrics are all identical."""
    one, other = (np.asarray(some[list(COLUMNS)]) for some in (repeated, published[: len(repeated)]))
    return int(((one == other) | (np.isnan(one) & np.isnan(other))).all(axis=1).sum())


def check(episodes: pd.DataFrame, published: pd.DataFrame) -> list[Tested]:
    """Test whether episodes and published ones of the same places have the same distribution, figure by figure.

    Figures without a value on one side, such as times without a success, are left out: their rate is a figure, too.
    """
    known, samples = places(published), []
    for place, some in places(episodes).items():
        for figure in QUANTITIES:
            before, now = figure.sample(known[place]), figure.sample(some)
            if len(before) and len(now):
                samples.append((place, figure, before, now))
    share, tested = ALPHA / max(len(samples), 1), []
    for place, figure, before, now in samples:
        chance = chance_of(before, now, figure.rate)
        both = figure.value(before), figure.value(now)
        tested.append(Tested(place, figure, *both, len(now), chance, chance > share))
    return tested


def chance_of(before: np.ndarray, now: np.ndarray, rate: bool) -> float:
    """Return the probability that two samples (n,) of one distribution differ as much; ``rate``: of values that are 0 or 1."""
    if rate:
        counts = [[int(sample.sum()), len(sample) - int(sample.sum())] for sample in (before, now)]
        exact: Any = stats.fisher_exact(counts)
        return float(exact.pvalue)
    if np.ptp(np.concatenate([before, now])) == 0.0:
        return 1.0
    found: Any = stats.mannwhitneyu(before, now)
    return float(found.pvalue)


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
    for row in figure_rows(published.episodes):
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
    record, apart = found.published.record, [each for each in found.tested if not each.agrees]
    lines = [f"published {record.get('time')}, commit {record.get('commit')}"]
    if found.tested:
        lines += ["", _table(found), ""]
    for each in apart:
        text = f"{each.text(each.found)} of {each.episodes} episodes, published {each.text(each.published)}"
        lines.append(f"apart: {each.place}: {each.figure.label} {text}, by chance with {each.chance:.1e}")
    lines += [f"different: {each}" for each in found.different]
    lines += [f"version: {each}" for each in found.versions]
    same, played = (sum(each[k] for each in found.again.values()) for k in (0, 1))
    if played:
        lines.append(f"{same} of {played} published episodes have the same metrics when played again")
    agree = f"{len(found.tested) - len(apart)} of {len(found.tested)} figures agree"
    lines += [
        f"{agree} (all with {100 * (1 - ALPHA):g} %, if nothing has changed)",
        "verified" if found.holds else "not verified",
    ]
    return "\n".join(lines)


def figures_csv(found: Verification) -> str:
    """Return all tested figures; only the header if nothing was played."""
    rows: list[dict[str, Any]] = [
        each.place._asdict() | {"figure": each.figure.name} | {name: getattr(each, name) for name in VALUES}
        for each in found.tested
    ]
    return csv_text(rows) if rows else ",".join((*Place._fields, "figure", *VALUES)) + "\n"


def _table(found: Verification) -> str:
    heads = ("task", "hardware", "policy", *(BY_NAME[name].label for name in FIRST), "figures that agree", "identical")
    lines = []
    for place, (same, played) in found.again.items():
        those = {each.figure.name: each for each in found.tested if each.place == place}
        cells = [
            f"{those[name].text(those[name].found)}, published {those[name].text(those[name].published)}"
            if name in those
            else "–"
            for name in FIRST
        ]
        inside = f"{sum(each.agrees for each in those.values())} of {len(those)}"
        lines.append([*place[1:], *cells, inside, f"{same} of {played}"])
    return markdown(heads, lines)
