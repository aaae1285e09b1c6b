"""Scores of a suite of tasks: ``python -m agents score [CONFIG]``.

0 is a policy that does nothing, 1 is the bound, see :func:`agents.evaluation.statistics.episode_scores`. A task's score is the
mean of its episodes; the score of all is the interquartile mean of the tasks' (Agarwal et al., "Deep reinforcement learning at
the edge of the statistical precipice", NeurIPS 2021).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from agents.command_line import Command
from agents.evaluation import commands, entries, pages
from agents.evaluation.pages import Cell, Grid, Section, grid
from agents.evaluation.plan import prepare
from agents.evaluation.run import Results
from agents.evaluation.settings import SuiteSettings
from agents.evaluation.statistics import interval_of, quartiles, suite_interval, suite_score
from agents.evaluation.table import BY_NAME, OWN, ends, mean, quantity, values, where
from vibgym import checks
from vibgym.files import csv_text, output_directory, write_together

SUITE = Path("configs/suite/open.yaml")
FILES = ("scores.csv", "suite.csv", "results.json", "scores.md", "scores.html")
FAULTS = ("tilted", "close", "wrong", "lost")

TERMS = (
    "An episode that succeeds scores the least possible time over the time that it took, 0 without success; where parts come "
    "and go, good parts a minute over the most that are possible. A task's score is the mean of its episodes. The score of "
    "all is the interquartile mean of the tasks', those that a policy does not serve counting as 0. In brackets: intervals."
)

Row = Mapping[str, Any]


def task_scores(episodes: pd.DataFrame, cost_limit: float | None = None) -> np.ndarray:
    """Return the scores of episodes of one policy on one task (episodes,), (0,) becoming a zero: a task that is not served.

    With a ``cost_limit``, episodes whose cost exceeds it score 0.
    """
    scores = values(episodes, "score")
    if cost_limit is not None:
        scores = np.where(values(episodes, "cost") <= cost_limit, scores, 0.0)
    return scores if len(scores) else np.zeros(1)


def score(
    episodes: pd.DataFrame,
    tasks: Sequence[str],
    level: float = 0.95,
    resamples: int = 9999,
    cost_limit: float | None = None,
) -> pd.DataFrame:
    """Return the score of every policy on every hardware, with its interval.

    Args:
        episodes: see :mod:`agents.evaluation.table`.
        tasks: of the suite; those without episodes score 0.
        level, resamples: of the intervals.
        cost_limit: see :func:`task_scores`.
    """
    rows = []
    for key, some in episodes.groupby(["hardware", "policy"], sort=False):
        scores = [task_scores(where(some, task=task), cost_limit) for task in tasks]
        interval = suite_interval(scores, level, resamples)
        labels = dict(zip(("hardware", "policy"), key, strict=True))  # type: ignore[arg-type]
        rows.append({**labels, "score": suite_score(scores), **ends("score", interval)})
    return pd.DataFrame(rows)


def rows(results: Results) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the rows of scores.csv (policy, task, hardware) and of suite.csv (policy, hardware)."""
    settings, by_task = results.settings, []
    limit, intervals = settings.cost_limit, settings.intervals
    order = [(hardware, policy) for hardware in settings.machines() for policy in settings.names]
    for hardware, policy in order:
        for task in settings.tasks:
            some = where(results.main, task=task, hardware=hardware, policy=policy)
            by_task.append({
                "task": task,
                "hardware": hardware,
                "policy": policy,
                "served": len(some) > 0,
                "why_not": next((why for place, why in results.refused.items() if place[1:] == (task, hardware, policy)), ""),
                "episodes": len(some),
                "score": float(task_scores(some, limit).mean()),
                **ends("score", interval_of(task_scores(some, limit)[None], *intervals) if len(some) else None),
                **_details(some, limit),
            })  # fmt: skip
    known = {
        (row["hardware"], row["policy"]): row
        for row in score(results.main, settings.tasks, *intervals, cost_limit=limit).to_dict("records")
    }
    nothing = {"score": 0.0, **ends("score", None)}
    return by_task, [known.get(key, {"hardware": key[0], "policy": key[1], **nothing}) for key in order]


def _details(episodes: pd.DataFrame, limit: float | None) -> dict[str, float]:
    """Return what a score is made of; nan without episodes."""
    cost = values(episodes, "cost")
    steps, policy = (
        float(episodes[name].iloc[0]) if len(episodes) else math.nan for name in ("timed_steps", "policy_s")
    )
    return {
        "success_rate": mean(episodes, "success"),
        **BY_NAME["time_to_goal_median_s"].columns(episodes),
        "bound_median_s": quartiles(values(episodes, "bound_s")).median,
        "collisions_mean": mean(episodes, "collisions"),
        "cost_median": float(np.quantile(cost, 0.5)) if len(cost) else math.nan,
        "cost_high": float(np.quantile(cost, 0.95)) if len(cost) else math.nan,
        "within_limit": math.nan if limit is None or not len(cost) else float((cost <= limit).mean()),
        "fallen": float(values(episodes, "fallen").sum()) if len(episodes) else math.nan,
        "rate_bound_per_minute": quartiles(values(episodes, "rate_bound_per_minute")).median,
        **{name: mean(episodes, column) for column, name in OWN.items()},
        "seconds_per_step": policy / steps if steps else math.nan,
    }


def totals_table(by_task: Sequence[Row], totals: Sequence[Row]) -> Grid:
    """Return the table of scores: of all tasks, and of each."""
    known = {(row["hardware"], row["policy"], row["task"]): row for row in by_task}
    columns: dict[str, Callable[[Row], Cell | str]] = {
        "policy": lambda row: Cell(row["policy"], kind="name"),
        "hardware": lambda row: row["hardware"],
        "score": _score,
    }
    for task in dict.fromkeys(row["task"] for row in by_task):
        columns[task] = lambda row, task=task: _score(known[row["hardware"], row["policy"], task])
    return grid("Scores", totals, columns)


DETAILS: dict[str, Callable[[Row], Cell | str]] = {
    "task": lambda row: Cell(row["task"], kind="name"),
    "hardware": lambda row: row["hardware"],
    "policy": lambda row: row["policy"],
    "score": lambda row: _score(row),
    "success": lambda row: (
        "–" if math.isfinite(row["rate_bound_per_minute"]) else quantity(row["success_rate"], 100.0, 1, "%")
    ),
    "time to goal": lambda row: quantity(row["time_to_goal_median_s"], 1.0, 2, "s"),
    "bound": lambda row: quantity(row["bound_median_s"], 1.0, 2, "s"),
    "bound a minute": lambda row: quantity(row["rate_bound_per_minute"], 1.0, 0, ""),
    "collisions": lambda row: quantity(row["collisions_mean"], 1.0, 1, ""),
    "cost": lambda row: quantity(row["cost_median"], 1.0, 3, ""),
    "within the limit": lambda row: quantity(row["within_limit"], 100.0, 1, "%"),
    "good a minute": lambda row: quantity(row["good_per_minute"], 1.0, 1, ""),
    "faulty": lambda row: quantity(sum(row[f"{name}_per_minute"] for name in FAULTS), 1.0, 1, ""),
    "pattern error": lambda row: quantity(row["pattern_error"], 1e3, 2, "mm"),
    "coverage": lambda row: quantity(row["coverage"], 100.0, 1, "%"),
    "policy, a step": lambda row: quantity(row["seconds_per_step"], 1e3, 2, "ms"),
}
"""Columns of the table of what scores are made of."""


def _score(row: Row) -> Cell:
    """Return 0.480 and "0.450 to 0.510"; "–" for a task that a policy does not serve, which counts as 0."""
    if not row.get("served", True):
        return Cell("–")
    between = "" if math.isnan(row["score_low"]) else f"{row['score_low']:.3f} to {row['score_high']:.3f}"
    return Cell(f"{row['score']:.3f}", between)


def write(results: Results) -> tuple[Path, str]:
    """Write :data:`FILES`; return the page's path, and the table of scores in Markdown.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    directory, limit = output_directory(Path(results.settings.output), "suite.output"), results.settings.cost_limit
    by_task, totals = rows(results)
    scores = totals_table(by_task, totals)
    details = grid("What the scores are made of", [row for row in by_task if row["served"]], DETAILS)
    about = (
        "Medians of times over the successes, and of costs; means of collisions, rates, pattern errors and coverage. Faulty: "
        "tilted, close, wrong and lost parts a minute. Time of the policy: of predict(), a step of one world, while all "
        "worlds are at work."
    )
    sections = [
        Section("scores", "Scores", [scores]),
        Section("details", "What they are made of", [details, about]),
        Section("tasks", "Tasks", [pages.task_cards(results)]),
    ]
    lead = TERMS + ("" if limit is None else f" Episodes whose cost exceeds {limit} score 0.")
    contents = (
        csv_text(by_task),
        csv_text(totals),
        pages.json_text(results, by_task, {"suite": totals}),
        f"{scores.markdown()}\n\n{details.markdown()}\n",
        pages.page(results, "score", "Scores between doing nothing and the bound", lead, sections),
    )
    write_together({directory / name: content for name, content in zip(FILES, contents, strict=True)})
    return directory / FILES[-1], scores.markdown()


# -- command -----------------------------------------------------------------------------------------------------------


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "config", type=Path, nargs="?", default=SUITE, metavar="CONFIG", help=f"suite (default: {SUITE})"
    )
    parser.add_argument(
        "--policy", type=Path, metavar="FILE", help="score this policy alone: YAML or JSON, as an entry of 'policies'"
    )
    parser.add_argument(
        "--enter", metavar="AUTHORS", help="with --policy: write an entry of these authors into entries/"
    )
    parser.add_argument("--entries", type=Path, metavar="DIR", help="play and rank the entries of a directory")
    parser.add_argument(
        "--trust",
        action="append",
        default=[],
        metavar="NAME",
        help="with --entries: run the code of this entry, in a process of its own; may be repeated",
    )
    commands.add_episodes(parser)


def command(arguments: argparse.Namespace) -> None:
    """Play a suite, or the rest of it, write the scores and print them."""
    for option, needed in (("enter", "policy"), ("trust", "entries")):
        if getattr(arguments, option) and getattr(arguments, needed) is None:
            raise checks.conflict(f"--{option} requires --{needed}")
    settings, source = commands.load(SuiteSettings, arguments), arguments.policy or arguments.config
    if arguments.entries is not None:
        if arguments.policy is not None:
            raise checks.conflict("--entries excludes --policy")
        _rank(settings, arguments)
        return
    if arguments.policy is not None:
        settings = settings.entered_by(arguments.policy)
    if arguments.enter is not None:
        entries.new_folder(settings.policies[0], source, settings)  # refused before anything is played
    with commands.played(lambda: prepare(settings), FILES, arguments, source) as results:
        page, text = write(results)
        print(f"{text}\n\npage: {page}")
    if arguments.enter is not None:
        print(f"entry: {entries.enter(settings.policies[0], source, arguments.enter, settings)}")


def _rank(settings: SuiteSettings, arguments: argparse.Namespace) -> None:
    """Play and rank entries."""
    loaded = entries.load_entries(arguments.entries, settings, arguments.trust)
    entered, protocol = entries.entered(settings, loaded), SuiteSettings.load(arguments.config)
    try:
        with commands.played(lambda: prepare(entered, loaded), FILES, arguments, arguments.entries) as played:
            results = entries.without_failures(played)
            text, path = entries.write(loaded, results, *rows(results), protocol)
            print(f"{text}\n\ntable: {path}")
    finally:
        for entry in loaded.values():
            if entry.process is not None:
                entry.process.stop()


COMMANDS = {"score": Command(_arguments, command, commands.OUTPUT)}
