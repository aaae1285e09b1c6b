"""Scores of a suite of tasks: ``python -m agents score [CONFIG]``.

0 is a policy that does nothing, 1 is the bound, see :func:`agents.evaluation.statistics.episode_scores`. A task's score is the
mean of its episodes; the score of all is the interquartile mean of the tasks' (Agarwal et al., "Deep reinforcement learning at
the edge of the statistical precipice", NeurIPS 2021).
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation import pages
from agents.evaluation.run import Infos, Prepared, Results, Run, evaluate, writable
from agents.evaluation.settings import SuiteSettings, laid_over
from agents.evaluation.statistics import episode_scores, interval_of, quartiles, suite_interval, suite_score
from agents.evaluation.table import REPORT, Place, ends, markdown, quantity, spread
from agents.provenance import code, digest, policy_files
from vibgym import checks
from vibgym.files import csv_text, write_atomically, write_together
from vibgym.policies.measures import Measured, Measures, least_times, most_rates
from vibgym.policies.rollout import OWN_FACTS, Timing, worlds_of
from vibgym.policies.trained.catalogue import SHIPPED

LEARNED = '"learned"'
"""Policy that is read from the shipped files."""

FILES = ("scores.csv", "suite.csv", "results.json", "scores.md", "scores.html")
SOURCES = (":/vibgym", ":/agents/evaluation", ":(top,exclude)vibgym/policies/trained/shipped")
"""Code that determines episodes, besides the files of policies: if unchanged, recorded episodes are reused."""

KEPT = "episodes"
"""Folder of recorded episodes in the output directory, see :func:`_recorded`."""

FAULTS = ("tilted", "close", "wrong", "lost")

HEADS = ("success", "time to goal", "bound", "collisions", "good a minute", "faulty", "pattern error", "coverage")
"""Heads of :func:`_measured`."""

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Timed(Measured):
    """Outcomes with ``seconds`` (1,), the time of the policy for a step of one world."""

    seconds: np.ndarray

    def to_json(self) -> str:
        """Return the text for :meth:`of_json`."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        return json.dumps({k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()})

    @classmethod
    def of_json(cls, text: str) -> Timed:
        """Return the outcomes that :meth:`to_json` wrote."""
        content = json.loads(text)
        task, seeds, step_time = (content.pop(name) for name in ("task", "seeds", "step_time"))
        arrays: dict[str, Any] = {name: np.array(value) for name, value in content.items()}
        return cls(task, tuple(seeds), step_time, **arrays)


class Recorder(Measures):
    """Recorder of :class:`Timed`."""

    def result(self, task: str, timing: Timing) -> Timed:
        """Return the outcomes of all episodes."""
        seconds = timing.policy / timing.world_steps if timing.world_steps else np.nan
        return Timed(task, self.seeds, self.env.step_time, **self.fields, seconds=np.array([seconds]))


def prepare(settings: SuiteSettings) -> Prepared:
    """Build everything that can fail for bad input, before anything runs.

    Raises:
        ValueError: a bad setting, a task without a bound or without a limit, or a policy that serves no task.
    """
    infos, tasks, entries = Infos(), {}, settings.entries()
    runs: list[Run] = []
    refused: dict[Place, str] = {}
    for task in settings.tasks:
        for machine in settings.hardware_entries():
            environment = laid_over(settings.environment, machine.arguments)
            info = tasks[task] = infos.of(task, environment, f"suite.hardware.{machine.name}")
            _check_bound(task, environment)
            for entry in entries:
                place = Place(REPORT, task, machine.name, entry.name)
                if not machine.runs(entry, task):
                    refused[place] = "not entered here"
                    continue
                seeds = settings.seed_list(task, machine.episodes)[: entry.episodes]
                try:
                    runs.append(Run(place, None, task, info, seeds, environment, entry.content, Recorder).made())
                except checks.Refused as error:
                    refused[place] = str(error)
    for entry in entries:
        if not any(run.place.policy == entry.name for run in runs):
            reason = next(why for place, why in refused.items() if place.policy == entry.name)
            raise checks.conflict(f"suite.policies: {entry.name!r} serves none of {', '.join(tasks)}: {reason}")
    writable(settings, FILES)
    return Prepared(settings, tasks, tuple(runs), refused=refused)


def _check_bound(task: str, environment: Mapping[str, Any]) -> None:
    env = worlds_of(task, 1, **environment)
    env.reset(seed=0)
    known = np.isfinite([least_times(env.unwrapped)[0], most_rates(env.unwrapped)[0]]).any()  # type: ignore[arg-type]
    env.close()
    if not known:
        raise checks.refuse("suite.tasks", task, "a task with a bound, see vibgym.bounds")


def score(prepared: Prepared, quiet: bool = False, ray: str | None = None) -> Results:
    """Play all runs that are not recorded yet; writes nothing but their episodes."""
    play = functools.partial(_recorded, Path(prepared.settings.output) / KEPT, code(*SOURCES))
    return evaluate(prepared, quiet, ray, play)


def _recorded(folder: Path, origin: str, run: Run, quiet: bool) -> Timed:
    """Return a run's episodes: from a file if the same code has played them, else played now and written there."""
    content = run.content if run.plain else None
    files = policy_files([(content, run.info.name)])
    if LEARNED in json.dumps(content, default=repr):
        files |= {each.name: digest(each.read_bytes()) for each in sorted(SHIPPED.iterdir()) if each.is_file()}
    key = json.dumps([run.place[1:], run.environment, run.seeds, content, origin, files], sort_keys=True, default=repr)
    path = folder / f"{digest(key)[:24]}.json"
    if content is not None and path.exists():
        return Timed.of_json(path.read_text())
    found = run.play(quiet)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, found.to_json())
    return found


def rows(results: Results) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the rows of scores.csv (policy, task, hardware) and of suite.csv (policy, hardware)."""
    settings, found, totals = results.settings, [], []
    asked = settings.confidence, settings.resamples
    for hardware in settings.named_hardware():
        for entry in settings.entries():
            scores = []
            for task in settings.tasks:
                place = Place(REPORT, task, hardware, entry.name)
                played = results.rollouts.get((place, None))
                scores.append(np.zeros(1) if played is None else episode_scores(played))
                found.append(_row(place, played, scores[-1], results))
            total = {"hardware": hardware, "policy": entry.name, "score": suite_score(scores)}
            totals.append({**total, **ends("score", suite_interval(scores, *asked))})
    return found, totals


def _row(place: Place, found: Timed | None, scores: np.ndarray, results: Results) -> dict[str, Any]:
    settings = results.settings
    interval = None if found is None else interval_of(scores[None], settings.confidence, settings.resamples)
    values: dict[str, float] = dict.fromkeys(
        ("success_rate", "bound_median_s", "collisions_mean", "fallen", "rate_bound_per_minute", *OWN_FACTS,
         "seconds_per_step"), math.nan,
    )  # fmt: skip
    if found is not None:
        values |= {
            "success_rate": float(found.success.mean()),
            "bound_median_s": quartiles(found.bound).median,
            "collisions_mean": float(found.collisions.mean()),
            "fallen": float(found.fallen.sum()),
            "rate_bound_per_minute": quartiles(found.rate_bound).median,
            **{name: float(found.fact(name).mean()) for name in OWN_FACTS},
            "seconds_per_step": float(found.seconds[0]),
        }
    times = spread("time_to_goal", np.full(1, np.nan) if found is None else found.time_to_goal, "_s")
    return {
        "task": place.task,
        "hardware": place.hardware,
        "policy": place.policy,
        "served": found is not None,
        "why_not": results.prepared.refused.get(place, ""),
        "episodes": 0 if found is None else len(found.seeds),
        "score": float(scores.mean()),
        **ends("score", interval),
        "success_rate": values.pop("success_rate"),
        **times,
        **values,
    }


def summary(found: Sequence[Row], totals: Sequence[Row]) -> str:
    """Return the table of scores in Markdown: a line for every policy on every hardware."""
    tasks = list(dict.fromkeys(row["task"] for row in found))
    lines = [[each["hardware"], each["policy"], _score(each), *map(_score, _of(found, each))] for each in totals]
    return markdown(("hardware", "policy", "**score**", *tasks), lines)


def _details(found: Sequence[Row]) -> str:
    lines = [
        [row["task"], row["hardware"], row["policy"], _score(row), *_measured(row), _cost(row)]
        for row in found
        if row["served"]
    ]
    return markdown(("task", "hardware", "policy", "score", *HEADS, "policy, a step"), lines)


def _measured(row: Row) -> list[str]:
    """Return the cells of :data:`HEADS`: times or rates, and metrics of some tasks only."""
    flows = math.isfinite(row["rate_bound_per_minute"])
    faulty = sum(row[f"{name}_per_minute"] for name in FAULTS)
    bound = row["rate_bound_per_minute"] if flows else row["bound_median_s"]
    return [
        "–" if flows else quantity(row["success_rate"], 100.0, 1, "%"),
        quantity(row["time_to_goal_median_s"], 1.0, 2, "s"),
        quantity(bound, 1.0, 0, "a minute") if flows else quantity(bound, 1.0, 2, "s"),
        quantity(row["collisions_mean"], 1.0, 1, ""),
        quantity(row["good_per_minute"], 1.0, 1, ""),
        quantity(faulty, 1.0, 1, ""),
        quantity(row["pattern_error"], 1e3, 2, "mm"),
        quantity(row["coverage"], 100.0, 1, "%"),
    ]


def _cost(row: Row) -> str:
    return quantity(row["seconds_per_step"], 1e3, 2, "ms")


def _of(found: Sequence[Row], total: Row) -> list[Row]:
    return [row for row in found if (row["hardware"], row["policy"]) == (total["hardware"], total["policy"])]


def _score(row: Row) -> str:
    """Return "0.480 (0.450 to 0.510)"; "–" for a task that a policy does not serve, which counts as 0."""
    if not row.get("served", True):
        return "–"
    between = "" if math.isnan(row["score_low"]) else f" ({row['score_low']:.3f} to {row['score_high']:.3f})"
    return f"{row['score']:.3f}{between}"


def write(results: Results) -> Path:
    """Write :data:`FILES`; return the page's path.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    directory = Path(results.settings.output)
    found, totals = rows(results)
    contents = (
        csv_text(found),
        csv_text(totals),
        pages.json_text(results, found, {"suite": totals}),
        f"{summary(found, totals)}\n\n{_details(found)}\n",
        page(results, found, totals),
    )
    write_together({directory / name: text for name, text in zip(FILES, contents, strict=True)})
    return directory / FILES[-1]


def page(results: Results, found: Sequence[Row], totals: Sequence[Row]) -> str:
    """Return the page as HTML."""
    details = [
        {
            "task": task,
            "rows": [
                {"row": row, "score": _score(row), "cells": _measured(row), "cost": _cost(row)}
                for row in found
                if row["task"] == task and row["served"]
            ],
        }
        for task in results.tasks
    ]
    return pages.render(
        "scores.html.j2",
        **pages.common(results),
        tasks=[
            {"name": name, "summary": info.summary, "inventory": pages.inventory(info.parts)}
            for name, info in results.tasks.items()
        ],
        lines=[{"total": each, "score": _score(each), "cells": list(map(_score, _of(found, each)))} for each in totals],
        details=details,
        heads=HEADS,
    )
