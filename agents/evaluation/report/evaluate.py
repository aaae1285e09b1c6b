"""From jobs to results to files."""

from __future__ import annotations

import inspect
import itertools
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from tqdm import tqdm

from agents.evaluation import animation, cost
from agents.evaluation.cost import Cost
from agents.evaluation.jobs import Job, run_jobs
from agents.evaluation.log import Log, Rollout
from agents.evaluation.records import Row, Trial
from agents.evaluation.report.effects import Effects, cell_of
from agents.evaluation.report.load import Load, Loaded, loaded_row
from agents.evaluation.report.prepare import FILES, Evaluation
from agents.evaluation.report.results import Results, row_of
from agents.evaluation.report.texts_of_results import all_episodes, json_text
from agents.evaluation.statistics import PairedComparison, compare
from agents.provenance import policy_files, provenance
from agents.workers import side_by_side, usable
from vibgym.files import csv_text, write_together
from vibgym.policies.measures import Measures
from vibgym.policies.rollout import Ends, Outcomes


def evaluate(evaluation: Evaluation, quiet: bool = False, ray: str | None = None) -> Results:
    """Run every policy on every task and all hardware, compare them, and study the effects; writes nothing.

    ``ray``: address of a cluster that runs the policies, see :func:`agents.workers.cluster.on_ray`.
    """
    settings = evaluation.settings
    statistics = settings.confidence, settings.resamples
    alone = ray is None and usable(settings.processes) == 1
    measured: Cost | Future[Cost] | None = None
    jobs: dict[tuple[str, ...], Job] = {**evaluation.jobs, **evaluation.study, **evaluation.load}
    # Of what is about to run: while it does, files may change.
    origin = provenance() | {"policy_files": policy_files((job.content, job.info.name) for job in jobs.values())}
    with side_by_side(settings.processes, ray) as submit:
        if settings.cost_per_period:
            measured = cost.measure_alone(quiet) if alone else submit(cost.measure, True)
        found = run_jobs(submit, jobs, _judged, statistics, alone=alone, quiet=quiet)
        if isinstance(measured, Future):
            measured = measured.result()
    rollouts: dict[Trial, Rollout] = {trial: found[trial][0] for trial in evaluation.jobs}
    described = {trial.policy: _first_line(job.policy) for trial, job in reversed(evaluation.jobs.items())}
    return Results(
        settings=settings,
        tasks=evaluation.tasks,
        scenery=evaluation.scenery,
        policies={name: described[name] for name in settings.named_policies()},
        rollouts=rollouts,
        rows=tuple(found[trial][1] for trial in evaluation.jobs),
        comparisons=_comparisons(rollouts, *statistics, quiet),
        provenance=origin,
        cost=measured,
        effects=_effects(evaluation, {key: found[key] for key in evaluation.study}),
        load=_load(evaluation, [found[key] for key in evaluation.load]),
    )


def _comparisons(
    rollouts: dict[Trial, Rollout], level: float, resamples: int, quiet: bool
) -> tuple[PairedComparison, ...]:
    """Each policy with each other, within a task and hardware."""
    pairs = [pair for pair in itertools.combinations(rollouts, 2) if pair[0][:2] == pair[1][:2]]
    pairs = tqdm(pairs, desc="comparing policies", unit="pair", disable=quiet)
    return tuple(
        compare(one.hardware, (one.policy, other.policy), rollouts[one], rollouts[other], level, resamples)
        for one, other in pairs
    )


def _effects(evaluation: Evaluation, found: dict[tuple[str, str], tuple[Outcomes, Row]]) -> Effects | None:
    asked = evaluation.settings.effects
    if asked is None:
        return None
    policies = tuple(dict.fromkeys(policy for _, policy in evaluation.study))
    seeds = tuple(evaluation.settings.seed_list(asked.task, asked.episodes))
    cells, episodes = tuple(cell for _, cell in found.values()), {key: each for key, (each, _) in found.items()}
    return Effects(asked.task, seeds, asked.arguments(), policies, cells, episodes)


def _load(evaluation: Evaluation, rows: list[Row]) -> Load | None:
    asked = evaluation.settings.under_load
    if asked is None:
        return None
    return Load(asked.task, max(row.episodes for row in rows), tuple(asked.policies), tuple(rows))


def _first_line(policy: Any) -> str:
    """What the policy's documentation says of it, without the marks of code."""
    return (inspect.getdoc(policy) or "").partition("\n")[0].replace("`", "").replace('"', "")


def _judged(
    job: Job, key: tuple[str, ...], level: float, resamples: int, quiet: bool
) -> tuple[Rollout, Row] | tuple[Outcomes, Row] | Row:
    """A trial's rollout and its statistics; of the study of effects, where ``key`` is (case, policy), outcomes and a cell; of
    that of load a row."""
    if isinstance(key, Trial):
        rollout = job.play(Log, key.policy, quiet)
        return rollout, row_of(key, rollout, level, resamples)
    if isinstance(key, Loaded):
        return loaded_row(key, job.play(Measures, key.policy, quiet), level, resamples)
    case, name = key
    ends = job.play(Ends, name, quiet)
    return ends, cell_of(case, name, ends, level, resamples)


def write(found: Results, film: tuple[Trial, Path] | None = None, quiet: bool = False) -> Path:
    """Write report.html, results.csv, episodes.csv and results.json, and the film that is asked for.

    Returns:
        The page's path.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    from agents.evaluation.report import report_page  # what draws and writes pages is loaded when it is needed

    directory = Path(found.settings.output)
    tabled = csv_text([vars(row) for row in found.rows]), csv_text(all_episodes(found)), json_text(found)
    contents: dict[Path, str | bytes] = {}
    for name, content in zip(FILES, (*tabled, report_page.page(found, quiet)), strict=True):
        contents[directory / name] = content
    if film is not None:
        trial, path = film
        rollout = found.rollouts[trial]
        contents[path] = animation.film_gif(rollout.film, found.scenery[trial.task], rollout.step_time)
    write_together(contents)
    return directory / "report.html"
