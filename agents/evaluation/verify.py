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
    EPISODE_FILE,
    FIGURE_FILE,
    PUBLISHED,
    RECORD,
    Published,
    canonical,
    changed,
    changed_settings,
    figure_rows,
    load,
    rounded,
    samples,
    written_settings,
)
from agents.evaluation.run import Case, run
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.table import BY_NAME, PLACE, Place, markdown, places, values, where
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
    known, rows = samples(published), []
    for (place, figure), now in samples(episodes).items():
        if (before := known.get((place, figure))) is not None:
            chance = chance_of(before, now, figure.rate)
            rows.append([*place, figure.name, len(now), figure.value(before), figure.value(now), chance, True])
    tested = pd.DataFrame(rows, columns=TESTED)
    return tested.assign(agrees=tested["chance"] > ALPHA / max(len(rows), 1))


def chance_of(before: np.ndarray, now: np.ndarray, rate: bool) -> float:
    """Return the probability that two samples (n,) of one distribution differ as much; ``rate``: of values that are 0 or 1."""
    if rate:
        counts = [[int(sample.sum()), len(sample) - int(sample.sum())] for sample in (before, now)]
        exact: Any = stats.fisher_exact(counts)
        return float(exact.pvalue)
    if np.ptp(np.concatenate([before, now])) == 0.0:
        return 1.0
    test: Any = stats.mannwhitneyu(before, now)
    return float(test.pvalue)


def _new_seeds(published: pd.DataFrame, episodes: int, first_seed: int | None) -> list[int]:
    """Return the seeds of new episodes, by default those after the published ones; raise ValueError for published seeds."""
    seeds = values(published, "seed")
    least, last = int(seeds.min()), int(seeds.max())
    checks.count("--episodes", episodes, most=MAX_EPISODES)
    first = last + 1 if first_seed is None else first_seed
    check_seeds("--first-seed", first, episodes, range_of(last))
    if first <= last and first + episodes > least:
        raise checks.refuse("--first-seed", first, f"chosen so that no seed was published, e.g. {last + 1}")
    return list(range(first, first + episodes))


def _chosen(published: pd.DataFrame, **wanted: Sequence[str] | None) -> pd.DataFrame:
    """Return the published episodes of the places to play; raise ValueError if there are none."""
    chosen = published
    for label, names in wanted.items():
        known = tuple(published[label].unique())
        for name in names or ():
            checks.choice(f"--{label}", name, known)
        chosen = chosen.loc[np.isin(values(chosen, label), names or known)]
    if not len(chosen):
        tasks, policies = (wanted[label] or () for label in ("task", "policy"))
        raise checks.conflict(f"--policy: none of {list(policies)} ran on {', '.join(tasks)}")
    return chosen


def _cases(published: Published, chosen: pd.DataFrame, seeds: Sequence[int], again: int) -> list[Case]:
    """Return the cases of the first ``again`` published episodes and the new ones in every place."""
    known, planned = {case.place: case for case in cases(published.settings)}, []
    for place, some in places(chosen).items():
        if place not in known:
            raise checks.unknown(f"place in {published.directory / EPISODE_FILE}", str(place), known)
        planned.append(replace(known[place], seeds=[*some["seed"][:again].tolist(), *seeds], pictures=()))
    return planned


def differences(published: Published) -> list[str]:
    """Return what differs from what was published: files, settings, policies and figures, a line each; runs nothing."""
    directory, record = published.directory, published.record
    before = record["digests"]
    digests = [
        (f"{directory / name}: edited since it was published", before["files"].get(name), _digest(directory / name))
        for name in (FIGURE_FILE, EPISODE_FILE)
    ]
    text = f"{directory / RECORD}: settings: edited since they were published"
    digests.append((text, before["settings"], digest(canonical(record["settings"]))))
    for path, known in before["policies"].items():
        now = _digest(path)
        text = f"{path}: {'missing' if now is None else 'changed'} since results were published"
        digests.append((text, known, now))
    lines = [text for text, known, now in digests if known != now]
    path = Path(str(record.get("config")))
    try:
        both = (written_settings(settings) for settings in (published.settings, EvaluationSettings.load(path)))
        lines += [f"{path}: other {name} than published" for name in changed_settings(*both)]
    except ValueError as error:
        lines.append(str(error))
    return lines + _figures(published)


def _digest(path: str | Path) -> str | None:
    """Return the digest of a file; None if it cannot be read."""
    try:
        return digest(Path(path).read_bytes())
    except (OSError, ValueError):
        return None


def _figures(published: Published) -> list[str]:
    """Return the figures that do not follow from the published episodes, on either side."""
    path, follow = published.directory / FIGURE_FILE, pd.DataFrame(figure_rows(published.episodes))
    both = published.figures.merge(follow, how="outer", on=[*PLACE, "figure"], suffixes=("_published", ""))
    # The last digit of a sum depends on the order of additions.
    apart = both.loc[~np.isclose(both["value_published"], both["value"], rtol=1e-9, atol=1e-12)]
    lines = []
    for row in apart.iloc[:MAX_LINES].itertuples(index=False):
        stands, follows = ("nothing" if math.isnan(v) else f"{v:g}" for v in (row.value_published, row.value))
        lines.append(f"{path}: {Place(*row[:4])}: {row.figure} is {stands}; {follows} follows from the episodes")
    return [*lines, f"{path}: {len(apart) - MAX_LINES} more figures"] if len(apart) > MAX_LINES else lines


def _text(figure: str, value: float) -> str:
    """Return a value with the figure's unit."""
    return BY_NAME[figure].text({figure: value}).rstrip()


def _table(tested: pd.DataFrame, again: pd.DataFrame) -> str:
    """Return a line for every place: first figures, number that agrees, and number of episodes that are identical."""
    heads = ("task", "hardware", "policy", *(BY_NAME[name].label for name in FIRST), "figures that agree", "identical")
    lines = []
    for place, some in places(tested).items():
        those = some.set_index("figure")[["found", "published"]]
        both = [[_text(name, value) for value in (those.loc[name] if name in those.index else ())] for name in FIRST]
        cells = [", published ".join(texts) or "–" for texts in both]
        same = where(again, **place._asdict())["same"]
        agree = f"{some['agrees'].sum()} of {len(some)}"
        lines.append([*place[1:], *cells, agree, f"{same.sum()} of {len(same)}"])
    return markdown(heads, lines)


def _lines(record: Mapping[str, Any], tested: pd.DataFrame, again: pd.DataFrame, different: Sequence[str]) -> list[str]:
    """Return the text of the command: a table, and what differs. Other versions are no failure."""
    lines = [f"published {record.get('time')}, commit {record.get('commit')}"]
    if len(tested):
        lines += ["", _table(tested, again), ""]
    apart = tested.loc[~tested["agrees"].astype(bool)]
    for row in apart.itertuples(index=False):
        now, before = (_text(row.figure, value) for value in (row.found, row.published))
        text = f"{BY_NAME[row.figure].label} {now} of {row.episodes} episodes, published {before}"
        lines.append(f"apart: {Place(*row[:4])}: {text}, by chance with {row.chance:.1e}")
    lines += [f"different: {line}" for line in different]
    then, now = {**record["versions"], "commit": record.get("commit")}, {**versions(), "commit": commit()}
    lines += [
        f"version: {name} {then.get(name) or 'none'}, here {now.get(name) or 'none'}" for name in changed(then, now)
    ]
    if len(again):
        same = f"{again['same'].sum()} of {len(again)}"
        lines.append(f"{same} published episodes have the same metrics when played again")
    agree = f"{len(tested) - len(apart)} of {len(tested)} figures agree"
    return [*lines, f"{agree} (all with {100 * (1 - ALPHA):g} %, if nothing has changed)"]


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
    seeds = _new_seeds(published.episodes, arguments.episodes, arguments.first_seed)
    chosen = _chosen(published.episodes, task=arguments.task, policy=arguments.policy)
    if output is not None:
        output_directory(output, "--output")
        output_files([output / FIGURES], "--output")
    different, played = differences(published), chosen.iloc[:0]
    try:
        some = _cases(published, chosen, seeds, arguments.again)
    except ValueError as error:  # a policy's file is missing or invalid
        if not different:
            raise
        different.append(f"nothing was played: {error}")
    else:
        played = rounded(run(some, processes=arguments.processes, ray=arguments.ray, quiet=arguments.quiet))
    new = np.isin(values(played, "seed"), seeds)
    tested = check(played.loc[new], chosen)
    # Of the episodes that were played again, those are the same that agree in all columns.
    again = played.loc[~new].merge(chosen, how="left", indicator="same")
    again["same"] = again["same"] == "both"
    if output is not None:
        rows = tested.to_dict("records")
        write_atomically(output / FIGURES, csv_text(rows) if rows else ",".join(TESTED) + "\n")
    holds = len(tested) > 0 and not different and bool(tested["agrees"].all())
    print("\n".join([*_lines(published.record, tested, again, different), "verified" if holds else "not verified"]))
    return 0 if holds else 1


COMMANDS = {"verify": Command(_arguments, command, f"directory of {FIGURES}: all figures and their tests")}
