"""Scores of a suite of tasks: ``python -m agents score [CONFIG]``.

0 is a policy that does nothing, 1 is the bound, see :func:`agents.evaluation.statistics.episode_scores`. A task's score is the
mean of its episodes; the score of all is the interquartile mean of the tasks' (Agarwal et al., "Deep reinforcement learning at
the edge of the statistical precipice", NeurIPS 2021).
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from agents.evaluation import pages
from agents.evaluation.pages import Cell, Grid, Section, grid
from agents.evaluation.run import Case, Infos, Prepared, Results, writable
from agents.evaluation.settings import PolicyEntry, RunSettings, laid_over
from agents.evaluation.statistics import episode_scores, interval_of, quartiles, suite_interval, suite_score
from agents.evaluation.table import BY_NAME, REPORT, Place, ends, frame, quantity
from agents.provenance import code, digest, policy_sources, user_modules
from vibgym import checks
from vibgym.config import load_yaml
from vibgym.files import csv_text, write_atomically, write_together
from vibgym.policies.measures import Measured, Measures, check_cost_limit, least_times, most_rates
from vibgym.policies.rollout import OWN_FACTS, Timing, worlds_of
from vibgym.policies.trained.catalogue import SHIPPED

if TYPE_CHECKING:
    from agents.evaluation.entries import Entry

LEARNED = "learned"
"""Policy that is read from the shipped files."""

FILES = ("scores.csv", "suite.csv", "results.json", "scores.md", "scores.html")
SOURCES = (":/vibgym", ":/agents/evaluation", ":(top,exclude)vibgym/policies/trained/shipped")
"""Code that determines episodes: if it and the files of policies are unchanged, recorded episodes are reused."""

KEPT = "episodes"
"""Folder of recorded episodes in the output directory, see :func:`_recorded`."""

FAULTS = ("tilted", "close", "wrong", "lost")

VALUES = (
    "bound_median_s", "collisions_mean", "cost_median", "cost_high", "within_limit", "fallen", "rate_bound_per_minute",
    *OWN_FACTS, "seconds_per_step",
)  # fmt: skip
"""Columns of scores.csv that are empty for a task that a policy does not serve."""

TIMES = ("time_to_goal_q25_s", "time_to_goal_median_s", "time_to_goal_q75_s")

TERMS = (
    "An episode that succeeds scores the least possible time over the time that it took, 0 without success; where parts come "
    "and go, good parts a minute over the most that are possible. A task's score is the mean of its episodes. The score of "
    "all is the interquartile mean of the tasks', those that a policy does not serve counting as 0. In brackets: intervals."
)

Row = Mapping[str, Any]


class SuiteSettings(RunSettings):
    """Settings of ``python -m agents score``: every policy on every task and all hardware; unserved tasks score 0.

    A policy's mapping may have ``training_steps``, what it was trained on, and ``episodes``, at most so many of each task.

    Attributes:
        training_steps: environment steps, all tasks together, that a policy may have been trained on.
        cost_limit: largest cost of an episode, for environments with ``costs``; others score 0 (reward at limited cost).
    """

    where: ClassVar[str] = "suite"
    policy_keys: ClassVar[tuple[str, ...]] = ("training_steps", "episodes")

    training_steps: int = Field(ge=1)
    cost_limit: float | None = Field(default=None, ge=0.0)
    output: str = Field(default="runs/suite", min_length=1)

    @property
    def ranges(self) -> tuple[str, ...]:
        """Names of the ranges of seeds."""
        return ("held_out",)

    def entry(self, policy: Any, field: str) -> PolicyEntry:
        """Return one policy with its number of episodes."""
        entry = super().entry(policy, field)
        if entry.training_steps is not None:
            checks.count(f"{field}.training_steps", entry.training_steps, least=0, most=self.training_steps)
        return entry

    def scores(self, found: Measured) -> np.ndarray:
        """Return the scores of episodes (episodes,)."""
        return episode_scores(found, self.cost_limit)

    def entered_by(self, path: Path) -> SuiteSettings:
        """Return the same protocol for the policy of a file alone.

        Args:
            path: YAML or JSON, a mapping as in ``policies``; or the JSON file of a trained policy.

        Raises:
            ValueError: the file cannot be read, or describes no policy.
        """
        content = load_yaml(path)
        if "kind" not in content:
            if path.suffix != ".json":
                raise checks.missing("kind", f"required in {path}, unless it is a trained policy's JSON file")
            content = {"kind": "trained", "path": str(path)}
        entered = self.model_copy(update={"policies": ({"name": path.stem, **content},)})
        with checks.within(path):
            entered.entries()
        return entered


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


def prepare(settings: SuiteSettings, entered: Mapping[str, Entry] | None = None) -> Prepared:
    """Build everything that can fail for bad input, before anything runs.

    Args:
        settings: of the suite.
        entered: entries by the name of their policy.

    Raises:
        ValueError: a bad setting, a task without a bound or without a limit, a policy that serves no task, or a file of
            recorded episodes that cannot be read.
    """
    infos, tasks, entries, entered = Infos(), {}, settings.entries(), entered or {}
    runs: list[Case] = []
    refused: dict[Place, str] = {}
    for task in settings.tasks:
        for machine in settings.hardware_entries():
            environment = laid_over(settings.environment, machine.arguments)
            info = tasks[task] = infos.of(task, environment, f"suite.hardware.{machine.name}")
            _check_bound(task, environment)
            if settings.cost_limit is not None:
                check_cost_limit("suite.cost_limit", settings.cost_limit, task, environment)
            for entry in entries:
                place = Place(REPORT, task, machine.name, entry.name)
                if not machine.runs(entry, task):
                    refused[place] = "not entered here"
                    continue
                seeds = settings.seed_list(task, machine.episodes)[: entry.episodes]
                try:
                    process = entered[entry.name].process if entry.name in entered else None
                    content = entry.content if process is None else process.policy(info, seeds[0])
                    runs.append(Case(place, None, task, info, seeds, environment, content, Recorder).made())
                except checks.Refused as error:
                    refused[place] = str(error)
    for entry in entries:
        if not any(run.place.policy == entry.name for run in runs):
            reason = next(why for place, why in refused.items() if place.policy == entry.name)
            raise checks.conflict(f"suite.policies: {entry.name!r} serves none of {', '.join(tasks)}: {reason}")
    origin = digest(json.dumps([code(*SOURCES), user_modules()], sort_keys=True))
    origins = {each.name: origin for each in entries} | {
        name: digest(origin + each.digest) for name, each in entered.items()
    }
    files = {run.place: _file(run, origins) for run in runs}
    folder = Path(settings.output) / KEPT
    for run in runs:
        _read(folder, files[run.place], run)
    writable(settings, FILES)
    play = functools.partial(_recorded, folder, origins, files)
    return Prepared(settings, tasks, tuple(runs), refused=refused, play=play)


def _check_bound(task: str, environment: Mapping[str, Any]) -> None:
    env = worlds_of(task, 1, **environment)
    env.reset(seed=0)
    known = np.isfinite([least_times(env.unwrapped)[0], most_rates(env.unwrapped)[0]]).any()  # type: ignore[arg-type]
    env.close()
    if not known:
        raise checks.refuse("suite.tasks", task, "a task with a bound, see vibgym.bounds")


def _file(run: Case, origins: Mapping[str, str]) -> str | None:
    """Return the name of the file of a run's episodes: a digest of the run, of code and of all files that the policy reads.

    None for a policy that is an object, whose code and files are not known.
    """
    if not run.plain:
        return None
    texts, files = policy_sources(run.content, run.info.name)
    if LEARNED in texts:
        files |= {str(each): digest(each.read_bytes()) for each in sorted(SHIPPED.iterdir()) if each.is_file()}
    values = [run.place[1:], run.environment, run.seeds, run.content, origins[run.place.policy], files]
    return f"{digest(json.dumps(values, sort_keys=True, default=repr))[:24]}.json"


def _read(folder: Path, name: str | None, run: Case) -> Timed | None:
    """Return recorded episodes, None if there are none; raise ValueError for a file of anything else."""
    if name is None or not (folder / name).exists():
        return None
    try:
        found = Timed.of_json((folder / name).read_text(encoding="utf-8"))
        lengths = {len(value) for key, value in vars(found).items() if key not in ("task", "step_time", "seconds")}
        if found.task == run.task and list(found.seeds) == run.seeds and lengths == {len(run.seeds)}:
            return found
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        pass
    raise checks.refuse(
        "recorded episodes", str(folder / name), "those of this run; without the file they are played again"
    )


def _recorded(
    folder: Path, origins: Mapping[str, str], files: Mapping[Place, str | None], run: Case, quiet: bool
) -> Timed:
    """Return a run's episodes: recorded ones if code and files are the same, else played now, and written."""
    name = files[run.place]
    kept = _read(folder, name, run)
    if kept is not None:
        return kept
    found = run.play(quiet)
    # A file that changed meanwhile: it is not known which content was played.
    if name is not None and name == _file(run, origins):
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / name, found.to_json())
    return found


def rows(results: Results) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the rows of scores.csv (policy, task, hardware) and of suite.csv (policy, hardware)."""
    settings, found, totals = results.settings, [], []
    for hardware in settings.named_hardware():
        for entry in settings.entries():
            scores = []
            for task in settings.tasks:
                place = Place(REPORT, task, hardware, entry.name)
                played = results.rollouts.get((place, None))
                scores.append(np.zeros(1) if played is None else settings.scores(played))
                found.append(_row(place, played, scores[-1], results))
            total = {"hardware": hardware, "policy": entry.name, "score": suite_score(scores)}
            totals.append({**total, **ends("score", suite_interval(scores, *results.settings.asked))})
    return found, totals


def _row(place: Place, found: Timed | None, scores: np.ndarray, results: Results) -> dict[str, Any]:
    interval = None if found is None else interval_of(scores[None], *results.settings.asked)
    time = BY_NAME["time_to_goal_median_s"]
    success = math.nan
    times: dict[str, float] = dict.fromkeys(TIMES, math.nan)
    values: dict[str, float] = dict.fromkeys(VALUES, math.nan)
    if found is not None:
        success, times = float(found.success.mean()), time.columns(frame(found, place))
        values = {
            "bound_median_s": quartiles(found.bound).median,
            "collisions_mean": float(found.collisions.mean()),
            **_costs(found, results.settings.cost_limit),
            "fallen": float(found.fallen.sum()),
            "rate_bound_per_minute": quartiles(found.rate_bound).median,
            **{name: float(found.fact(name).mean()) for name in OWN_FACTS},
            "seconds_per_step": float(found.seconds[0]),
        }
    return {
        **place.labels,
        "served": found is not None,
        "why_not": results.refused.get(place, ""),
        "episodes": 0 if found is None else len(found.seeds),
        "score": float(scores.mean()),
        **ends("score", interval),
        "success_rate": success,
        **times,
        **values,
    }


def _costs(found: Timed, limit: float | None) -> dict[str, float]:
    """Return median and 95 % quantile of the costs, and the share of episodes within the limit; nan without costs."""
    median, high = np.quantile(found.cost, [0.5, 0.95])
    within = math.nan if limit is None else float((found.cost <= limit).mean())
    return {"cost_median": float(median), "cost_high": float(high), "within_limit": within}


def summary_table(results: Results) -> str:
    """Return the table of scores in Markdown: a line for every policy on every hardware."""
    return totals_table(*rows(results)).markdown()


def totals_table(found: Sequence[Row], totals: Sequence[Row]) -> Grid:
    """Return the table of scores: of all tasks, and of each."""
    known = {(row["hardware"], row["policy"], row["task"]): row for row in found}
    columns: dict[str, Callable[[Row], Cell | str]] = {
        "policy": lambda row: Cell(row["policy"], kind="name"),
        "hardware": lambda row: row["hardware"],
        "score": _score,
    }
    for task in dict.fromkeys(row["task"] for row in found):
        columns[task] = lambda row, task=task: _score(known[row["hardware"], row["policy"], task])
    return grid("Scores", totals, columns)


DETAILS: dict[str, Callable[[Row], Cell | str]] = {
    "task": lambda row: Cell(row["task"], kind="name"),
    "hardware": lambda row: row["hardware"],
    "policy": lambda row: row["policy"],
    "score": lambda row: _score(row),
    "success": lambda row: "–" if _flows(row) else quantity(row["success_rate"], 100.0, 1, "%"),
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


def _flows(row: Row) -> bool:
    return math.isfinite(row["rate_bound_per_minute"])


def _score(row: Row) -> Cell:
    """Return 0.480 and "0.450 to 0.510"; "–" for a task that a policy does not serve, which counts as 0."""
    if not row.get("served", True):
        return Cell("–")
    between = "" if math.isnan(row["score_low"]) else f"{row['score_low']:.3f} to {row['score_high']:.3f}"
    return Cell(f"{row['score']:.3f}", between)


def write(results: Results, quiet: bool = False) -> Path:
    """Write :data:`FILES`; return the page's path.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    directory, limit = Path(results.settings.output), results.settings.cost_limit
    found, totals = rows(results)
    scores = totals_table(found, totals)
    details = grid("What the scores are made of", [row for row in found if row["served"]], DETAILS)
    about = (
        "Medians of times over the successes, and of costs; means of collisions, rates, pattern errors and coverage. Faulty: "
        "tilted, close, wrong and lost parts a minute. Time of the policy: of predict(), a step of one world, while all "
        "worlds are at work."
    )
    sections = [
        Section("scores", "Scores", [scores]),
        Section("details", "What they are made of", [details, about]),
        Section("asked", "Tasks", [pages.task_cards(results)]),
    ]
    lead = TERMS + ("" if limit is None else f" Episodes whose cost exceeds {limit} score 0.")
    contents = (
        csv_text(found),
        csv_text(totals),
        pages.json_text(results, found, {"suite": totals}),
        f"{scores.markdown()}\n\n{details.markdown()}\n",
        pages.page(results, "score", "Scores between doing nothing and the bound", lead, sections),
    )
    write_together({directory / name: each for name, each in zip(FILES, contents, strict=True)})
    return directory / FILES[-1]
