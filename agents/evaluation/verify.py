"""Verification of published results: ``python -m agents verify [DIR]`` plays a sample and tests every figure.

Null hypothesis: published and new episodes have the same distribution. Rates have Fisher's exact test, medians and means the
test of Mann and Whitney, which compares all values of both samples.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from agents import command_line
from agents.command_line import Command
from agents.evaluation.plan import cases
from agents.evaluation.published import (
    COLUMNS,
    EPISODE_FILE,
    FIGURE_FILE,
    PUBLISHED,
    RECORD,
    Published,
    canonical,
    figure_rows,
    load,
    rounded,
    settings_apart,
    written_settings,
)
from agents.evaluation.run import Case, run
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.table import BY_NAME, PLACE, QUANTITIES, Place, markdown, places, values
from agents.provenance import commit, digest, versions
from vibgym import checks
from vibgym.files import csv_text, output_directory, output_files, write_atomically
from vibgym.seeds import check_seeds, range_of

FIGURES = "verification.csv"
"""All figures and their tests."""

ALPHA = 0.01
"""Probability that any figure differs by chance; all have the same share of it (Bonferroni), as they may be dependent."""

MAX_EPISODES = 1000

MAX_LINES = 5
"""Reported figures of one file that do not follow from its episodes."""

TESTED = [*PLACE, "figure", "episodes", "published", "found", "chance", "agrees"]
"""Columns of the tested figures."""

FIRST = ("success_rate", "time_to_goal_median_s")
"""Figures with their own column in the printed table."""


def check(episodes: pd.DataFrame, published: pd.DataFrame) -> pd.DataFrame:
    """Test whether episodes and published ones of the same places have the same distribution, figure by figure.

    Figures without a value on one side, such as times without a success, are left out: their rate is a figure, too.

    Returns:
        A row for every figure, see :data:`TESTED`: values, and the chance of such a difference; it agrees if that is likely.
    """
    known, found = places(published), []
    for place, some in places(episodes).items():
        for figure in QUANTITIES:
            before, now = figure.sample(known[place]), figure.sample(some)
            if len(before) and len(now):
                chance = chance_of(before, now, figure.rate)
                found.append([*place, figure.name, len(now), figure.value(before), figure.value(now), chance, True])
    tested = pd.DataFrame(found, columns=TESTED)
    return tested.assign(agrees=tested["chance"] > ALPHA / max(len(found), 1))


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


def _new_seeds(published: Published, episodes: int, first_seed: int | None) -> list[int]:
    """Return the seeds of new episodes, by default those after the published ones; raise ValueError for published seeds."""
    last = int(values(published.episodes, "seed").max())
    checks.count("--episodes", episodes, most=MAX_EPISODES)
    first = last + 1 if first_seed is None else first_seed
    check_seeds("--first-seed", first, episodes, range_of(last))
    if first <= last and first + episodes > int(values(published.episodes, "seed").min()):
        raise checks.refuse("--first-seed", first, f"chosen so that no seed was published, e.g. {last + 1}")
    return list(range(first, first + episodes))


def _chosen(
    published: Published, tasks: Sequence[str] | None, policies: Sequence[str] | None
) -> dict[Place, pd.DataFrame]:
    """Return the published episodes of the places to play; raise ValueError if there are none."""
    found = everything = places(published.episodes)
    for option, names in (("task", tasks), ("policy", policies)):
        if names:
            known = tuple(dict.fromkeys(getattr(place, option) for place in everything))
            for name in names:
                checks.choice(f"--{option}", name, known)
            found = {place: those for place, those in found.items() if getattr(place, option) in names}
    if not found:
        raise checks.conflict(f"--policy: none of {list(policies or ())} ran on {', '.join(tasks or ())}")
    return found


def _cases(published: Published, chosen: Mapping[Place, pd.DataFrame], seeds: Sequence[int], again: int) -> list[Case]:
    """Return the cases of the first ``again`` published episodes and the new ones in every place."""
    known = {case.place: case for case in cases(published.settings)}
    for place in chosen:
        if place not in known:
            raise checks.unknown(f"place in {published.directory / EPISODE_FILE}", str(place), known)
    return [
        replace(known[place], seeds=[*some["seed"][:again].tolist(), *seeds], pictures=())
        for place, some in chosen.items()
    ]


def _identical(repeated: pd.DataFrame, published: pd.DataFrame) -> int:
    """Return the number of episodes whose metrics are all identical."""
    one, other = (np.asarray(some[list(COLUMNS)]) for some in (repeated, published[: len(repeated)]))
    return int(((one == other) | (np.isnan(one) & np.isnan(other))).all(axis=1).sum())


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
        before, now = (written_settings(each) for each in (published.settings, EvaluationSettings.load(path)))
        found += [f"{path}: other {each} than published" for each in settings_apart(before, now)]
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
    follow = {(Place(*(row[k] for k in PLACE)), row["figure"]): row["value"] for row in figure_rows(published.episodes)}
    for place, name in {**follow, **published.figures}:
        value, stands = follow.get((place, name)), published.figures.get((place, name))
        if value is None:
            found.append(f"{path}: {place}: {name} follows from no published episodes")
        # The last digit of a sum depends on the order of additions.
        elif stands is None or not math.isclose(stands, value, rel_tol=1e-9, abs_tol=1e-12):
            given = "is missing" if stands is None else f"is {stands:g}"
            found.append(f"{path}: {place}: {name} {given}; {value:g} follows from the episodes")
    more = len(found) - MAX_LINES
    return [*found[:MAX_LINES], f"{path}: {more} more figures"] if more > 0 else found


def version_changes(record: Mapping[str, Any]) -> list[str]:
    """Return the versions and the commit that differ from those of a record, a line each; they are no failure."""
    then, now = dict(record["versions"]), versions()
    then["commit"], now["commit"] = record.get("commit"), commit()
    names = [name for name in {**then, **now} if then.get(name) != now.get(name)]
    return [f"{name} {then.get(name) or 'none'}, here {now.get(name) or 'none'}" for name in names]


def _text(figure: str, value: float) -> str:
    """Return a value with the figure's unit."""
    return BY_NAME[figure].text({figure: value}).rstrip()


def _table(tested: pd.DataFrame, again: Mapping[Place, tuple[int, int]]) -> str:
    """Return a line for every place: first figures, number that agrees, and number of episodes that are identical."""
    heads = ("task", "hardware", "policy", *(BY_NAME[name].label for name in FIRST), "figures that agree", "identical")
    lines = []
    for place, some in places(tested).items():
        those = some.set_index("figure")
        cells = [
            f"{_text(name, those.found[name])}, published {_text(name, those.published[name])}"
            if name in those.index
            else "–"
            for name in FIRST
        ]
        same, played = again[place]
        lines.append([*place[1:], *cells, f"{some['agrees'].sum()} of {len(some)}", f"{same} of {played}"])
    return markdown(heads, lines)


# -- command -----------------------------------------------------------------------------------------------------------


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("published", type=Path, nargs="?", default=PUBLISHED, metavar="DIR", help="see publish")
    parser.add_argument(
        "--episodes", type=int, default=20, metavar="N", help="new episodes per policy, task and hardware"
    )
    parser.add_argument("--again", type=int, default=5, metavar="N", help="published episodes of each, played again")
    parser.add_argument(
        "--first-seed", type=int, metavar="N", help="of the new episodes (default: after the last published)"
    )
    for option in ("--task", "--policy"):
        command_line.some(parser, option)
    command_line.side_by_side(parser)


def command(arguments: argparse.Namespace) -> int:
    """Play a sample of published results; the exit code is 1 if a figure cannot be reproduced."""
    checks.count("--processes", arguments.processes, most=256)
    checks.count("--again", arguments.again, least=0, most=MAX_EPISODES)
    published, output = load(arguments.published), arguments.output
    seeds = _new_seeds(published, arguments.episodes, arguments.first_seed)
    chosen = _chosen(published, arguments.task, arguments.policy)
    if output is not None:
        output_directory(output, "--output")
        output_files([output / FIGURES], "--output")
    different, again, tested = differences(published), dict[Place, tuple[int, int]](), pd.DataFrame(columns=TESTED)
    try:
        some = _cases(published, chosen, seeds, arguments.again)
    except ValueError as error:  # a policy's file is missing or invalid
        if not different:
            raise
        different.append(f"nothing was played: {error}")
    else:
        played = rounded(run(some, processes=arguments.processes, ray=arguments.ray, quiet=arguments.quiet))
        for place, rows in places(played).items():
            repeated = rows.iloc[: -len(seeds)]
            again[place] = _identical(repeated, chosen[place]), len(repeated)
        tested = check(played.loc[np.isin(values(played, "seed"), seeds)], pd.concat(chosen.values()))
    if output is not None:
        rows = tested.to_dict("records")
        write_atomically(output / FIGURES, csv_text(rows) if rows else ",".join(TESTED) + "\n")
    holds = len(tested) > 0 and not different and bool(tested["agrees"].all())
    print("\n".join([*_lines(published.record, tested, again, different), "verified" if holds else "not verified"]))
    return 0 if holds else 1


def _lines(
    record: Mapping[str, Any], tested: pd.DataFrame, again: Mapping[Place, tuple[int, int]], different: Sequence[str]
) -> list[str]:
    """Return the text of the command: a table, and what differs."""
    lines = [f"published {record.get('time')}, commit {record.get('commit')}"]
    if len(tested):
        lines += ["", _table(tested, again), ""]
    apart = tested.loc[~tested["agrees"].astype(bool)]
    for row in apart.itertuples(index=False):
        text = (
            f"{_text(row.figure, row.found)} of {row.episodes} episodes, published {_text(row.figure, row.published)}"
        )
        label = BY_NAME[row.figure].label
        lines.append(f"apart: {Place(*row[:4])}: {label} {text}, by chance with {row.chance:.1e}")
    lines += [f"different: {each}" for each in different]
    lines += [f"version: {each}" for each in version_changes(record)]
    same, played = (sum(each[k] for each in again.values()) for k in (0, 1))
    if played:
        lines.append(f"{same} of {played} published episodes have the same metrics when played again")
    agree = f"{len(tested) - len(apart)} of {len(tested)} figures agree"
    return [*lines, f"{agree} (all with {100 * (1 - ALPHA):g} %, if nothing has changed)"]


COMMANDS = {"verify": Command(_arguments, command, f"directory of {FIGURES}: all figures and their tests")}
