"""From a suite's settings to its scores."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.entries import laid_over
from agents.evaluation.jobs import Job, Known, run_jobs, writable
from agents.evaluation.records import Row, Trial, ends, spread
from agents.evaluation.resampling import interval_of
from agents.evaluation.statistics import quartiles
from agents.evaluation.suite.scores import episode_scores, suite_interval, suite_score
from agents.evaluation.suite.settings import SuiteSettings
from agents.provenance import code, digest, policy_files, provenance
from agents.workers import side_by_side, usable
from vibgym import checks
from vibgym.files import write_atomically
from vibgym.policies.measures import Measured, Measures, least_times, most_rates
from vibgym.policies.rollout import OWN_FACTS, Timing, worlds_of
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.catalogue import SHIPPED

LEARNED = '"learned"'
"""The policy that is read from what is shipped."""

FILES = ("scores.csv", "suite.csv", "results.json", "scores.md", "scores.html")
SOURCES = (":/vibgym", ":/agents/evaluation", ":(top,exclude)vibgym/policies/trained/shipped")
"""What episodes come from, besides the files of policies: where it is the same, what has been played stays."""

KEPT = "episodes"
"""Folder of the output directory: what has been played already, see :func:`_played`."""


@dataclass(frozen=True)
class Timed(Measured):
    """Episodes of one policy on one task and hardware."""

    seconds: np.ndarray  # (1,) of the policy, a step of one world

    def to_json(self) -> str:
        """From which :meth:`of_json` makes the same again."""
        return json.dumps({each.name: _plain(getattr(self, each.name)) for each in fields(self)})

    @classmethod
    def of_json(cls, text: str) -> Timed:
        """See :meth:`to_json`."""
        content = json.loads(text)
        task, seeds, step_time = (content.pop(name) for name in ("task", "seeds", "step_time"))
        arrays: dict[str, Any] = {name: np.array(value) for name, value in content.items()}
        return cls(task, tuple(seeds), step_time, **arrays)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


class Keeping(Measures):
    """Keeps what scores are made of."""

    def result(self, task: str, timing: Timing) -> Timed:
        """All of it, when all episodes have ended."""
        seconds = timing.policy / timing.world_steps if timing.world_steps else np.nan
        return Timed(task, self.seeds, self.env.step_time, **self.fields, seconds=np.array([seconds]))


@dataclass(frozen=True)
class Prepared:
    """A checked suite: environments and policies exist, the output directory can be written to."""

    settings: SuiteSettings
    tasks: dict[str, TaskInfo]
    jobs: dict[Trial, Job]
    unserved: dict[Trial, str]  # and why


@dataclass(frozen=True)
class Suite:
    """Scores of every policy on every task and hardware, and of each on all tasks."""

    settings: SuiteSettings
    tasks: dict[str, TaskInfo]
    rows: tuple[Row, ...]
    totals: tuple[Row, ...]
    provenance: dict[str, Any]


def prepare(settings: SuiteSettings) -> Prepared:
    """Build all that can fail for bad input, before anything runs.

    Raises:
        ValueError: a bad setting, a task without a bound or without a limit, or a policy that serves no task.
    """
    known, tasks = Known(), {}
    jobs: dict[Trial, Job] = {}
    unserved: dict[Trial, str] = {}
    for task in settings.tasks:
        for machine in settings.machines():
            environment = laid_over(settings.environment, machine.arguments)
            info = tasks[task] = known.info(task, environment, f"suite.hardware.{machine.name}")
            _check_bound(task, environment)
            for index, entry in enumerate(settings.entries()):
                trial = Trial(task, machine.name, entry.name)
                if not machine.runs(entry, task):
                    unserved[trial] = "it is not entered here"
                    continue
                seeds = settings.seeds_of(task, machine, index)
                try:
                    jobs[trial] = Job(task, info, seeds, environment, entry.content, None).made()
                except checks.Refused as error:
                    unserved[trial] = str(error)
    for entry in settings.entries():
        if not any(trial.policy == entry.name for trial in jobs):
            reason = next(why for trial, why in unserved.items() if trial.policy == entry.name)
            raise checks.refuse(
                f"suite.policies ({entry.name})", reason, f"a policy that serves one of {', '.join(tasks)}"
            )
    writable(settings, FILES)
    return Prepared(settings, tasks, jobs, unserved)


def _check_bound(task: str, environment: Mapping[str, Any]) -> None:
    """Refuse a task on hardware where nobody knows what 1 is."""
    env = worlds_of(task, 1, **environment)
    env.reset(seed=0)
    known = np.isfinite([least_times(env.unwrapped)[0], most_rates(env.unwrapped)[0]]).any()  # type: ignore[arg-type]
    env.close()
    if not known:
        raise checks.refuse("suite.tasks", task, "tasks for which vibgym.bounds knows a bound")


def score(prepared: Prepared, quiet: bool = False, ray: str | None = None) -> Suite:
    """Play all that has not been played, and score it; writes nothing but the episodes.

    ``ray``: address of a cluster that runs the policies, see :func:`agents.workers.cluster.on_ray`.
    """
    settings = prepared.settings
    files = policy_files((job.content, job.info.name) for job in prepared.jobs.values())
    origin = provenance() | {"policy_files": files}
    more = str(Path(settings.output) / KEPT), code(*SOURCES)
    alone = ray is None and usable(settings.processes) == 1
    with side_by_side(settings.processes, ray) as submit:
        found = run_jobs(submit, {**prepared.jobs}, _played, more, alone=alone, quiet=quiet)
    rows, totals = [], []
    for hardware in settings.named_hardware():
        for name in settings.named_policies():
            scores = []
            for task in settings.tasks:
                trial = Trial(task, hardware, name)
                scores.append(episode_scores(found[trial]) if trial in found else np.zeros(1))
                rows.append(_row(trial, found.get(trial), scores[-1], prepared))
            totals.append(_total(hardware, name, scores, settings))
    return Suite(settings, prepared.tasks, tuple(rows), tuple(totals), origin)


def _played(job: Job, trial: Trial, folder: str, origin: str, quiet: bool) -> Timed:
    """A trial's episodes: from a file, if the same has been played by the same code, else played now and kept there."""
    content = job.content if job.plain else None
    files = policy_files([(content, job.info.name)])
    if LEARNED in json.dumps(content, default=repr):
        files |= {each.name: digest(each.read_bytes()) for each in sorted(SHIPPED.iterdir()) if each.is_file()}
    said = json.dumps([trial, job.environment, job.seeds, content, origin, files], sort_keys=True, default=repr)
    path = Path(folder) / f"{digest(said)[:24]}.json"
    if content is not None and path.exists():
        return Timed.of_json(path.read_text())
    found = job.play(Keeping, trial.policy, quiet)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, found.to_json())
    return found


def _row(trial: Trial, found: Timed | None, scores: np.ndarray, prepared: Prepared) -> Row:
    """One policy on one task and hardware; nan for what does not apply, or was not played."""
    settings = prepared.settings
    interval = None if found is None else interval_of(scores[None], settings.confidence, settings.resamples)
    head = Row(
        **trial._asdict(),
        served=found is not None,
        why_not=prepared.unserved.get(trial, ""),
        episodes=0 if found is None else len(found.seeds),
        score=float(scores.mean()),
        **ends("score", interval),
    )
    return Row(**vars(head), **_figures(found))


def _figures(found: Timed | None) -> dict[str, float]:
    """What there is to say besides; nan of a policy that has not played."""
    time = np.full(1, np.nan) if found is None else found.time_to_goal
    return {
        "success_rate": math.nan if found is None else float(found.success.mean()),
        **spread("time_to_goal", time, "_s"),
        "bound_median_s": math.nan if found is None else quartiles(found.bound).median,
        "collisions_mean": math.nan if found is None else float(found.collisions.mean()),
        "fallen": math.nan if found is None else float(found.fallen.sum()),
        "rate_bound_per_minute": math.nan if found is None else quartiles(found.rate_bound).median,
        **{name: math.nan if found is None else float(found.fact(name).mean()) for name in OWN_FACTS},
        "seconds_per_step": math.nan if found is None else float(found.seconds[0]),
    }


def _total(hardware: str, policy: str, scores: list[np.ndarray], settings: SuiteSettings) -> Row:
    """One policy on all tasks of one hardware."""
    interval = suite_interval(scores, settings.confidence, settings.resamples)
    return Row(hardware=hardware, policy=policy, score=suite_score(scores), **ends("score", interval))
