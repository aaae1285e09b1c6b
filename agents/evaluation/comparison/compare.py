"""From jobs to results to files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from agents.evaluation.comparison import texts
from agents.evaluation.comparison.paired import Difference, difference
from agents.evaluation.comparison.prepare import FILES, Prepared, PreparedMatrix, Tested, hardware_of
from agents.evaluation.comparison.profiles import Profile, profile
from agents.evaluation.comparison.results import (
    Comparison,
    Ladder,
    Matrix,
    Rung,
    best_classical,
    cell_of,
    refused_cell,
    row_of,
)
from agents.evaluation.comparison.sample import Sample
from agents.evaluation.jobs import Job, run_jobs
from agents.evaluation.records import Row, Trial
from agents.provenance import provenance
from agents.workers import side_by_side, usable
from vibgym.files import csv_text, write_together
from vibgym.policies.measures import Measured, Measures
from vibgym.policies.rollout import Ends, Outcomes

Samples = dict[tuple[str, str], dict[str, Sample]]
"""Task and hardware -> policy -> its episodes."""


def compare(prepared: Prepared, quiet: bool = False, ray: str | None = None) -> Comparison:
    """Run every policy on all that is asked for, and compare them; writes nothing.

    ``ray``: address of a cluster that runs the policies, see :func:`agents.workers.cluster.on_ray`.
    """
    settings = prepared.settings
    jobs: dict[tuple[str, ...], Job] = {**prepared.jobs}
    for matrix in prepared.matrices:
        jobs |= matrix.jobs
    with side_by_side(settings.processes, ray) as submit:
        found = run_jobs(submit, jobs, _judged, alone=ray is None and usable(settings.processes) == 1, quiet=quiet)
    samples = _samples(prepared, found)
    rows: list[Row] = []
    differences: list[Difference] = []
    profiles: list[Profile] = []
    best: dict[tuple[str, str], str] = {}
    groups = {each.name: each.group for each in settings.contenders()}
    for place, those in tqdm(samples.items(), desc="comparing policies", unit="task", disable=quiet):
        own = _rows(prepared, place, those, groups)
        rows += own
        profiles.append(profile(place, those, settings.confidence, settings.resamples))
        classical = best_classical(own)
        if classical is None:
            continue
        best[place] = classical.policy
        for name, sample in those.items():
            if groups[name] != "classical":
                pair = (name, classical.policy), (sample, those[classical.policy])
                asked = settings.confidence, settings.power, settings.resamples
                differences.append(difference(place, *pair, *asked))
    return Comparison(
        settings=settings,
        tasks=prepared.tasks,
        samples=samples,
        rows=tuple(rows),
        best=best,
        differences=tuple(differences),
        profiles=tuple(profiles),
        curves=prepared.curves,
        matrices=tuple(_matrix(prepared, each, found) for each in prepared.matrices),
        ladders=_ladders(prepared, rows),
        provenance=provenance(),
    )


def _judged(job: Job, key: tuple[str, ...], quiet: bool) -> Outcomes:
    """A trial's episodes with their bounds and collisions; those of a matrix without."""
    if isinstance(key, Tested):
        return job.play(Ends, key.run, quiet)
    return job.play(Measures, Trial(*key).policy, quiet)


def _samples(prepared: Prepared, found: dict[tuple[str, ...], Any]) -> Samples:
    """The episodes of every policy's runs, in the order of the settings."""
    samples: Samples = {}
    places = dict.fromkeys(trial[:2] for trial in prepared.jobs)
    for task, hardware in places:
        for each in prepared.settings.contenders():
            keys = [Trial(task, hardware, each.run_name(seed)) for seed in each.seeds]
            if keys[0] in prepared.jobs:
                runs: list[Measured] = [found[key] for key in keys]
                info = prepared.jobs[keys[0]].info
                assert info.step_limit is not None  # vibgym's own environments have one
                those = samples.setdefault((task, hardware), {})
                those[each.name] = Sample.of(runs, info.step_limit * info.step_time)
    return samples


def _rows(prepared: Prepared, place: tuple[str, str], samples: dict[str, Sample], groups: dict[str, str]) -> list[Row]:
    """Of every policy on a task and hardware, each followed by those of its runs."""
    settings = prepared.settings
    statistics = settings.confidence, settings.resamples
    rows = []
    for name, sample in samples.items():
        names = (name, groups[name])
        rows.append(row_of(place, names, None, sample, *statistics))
        for index, seed in enumerate(settings.contender_of(name).training_seeds):
            rows.append(row_of(place, names, seed, sample.run(index), *statistics))
    return rows


def _matrix(prepared: Prepared, matrix: PreparedMatrix, found: dict[tuple[str, ...], Any]) -> Matrix:
    """The table of one matrix."""
    settings, lines = prepared.settings, []
    for line in matrix.lines:
        name, cells = line.name, []
        for case in matrix.cases:
            if (name, case.name) in matrix.refusals:
                cells.append(refused_cell(name, case.name, matrix.refusals[name, case.name]))
                continue
            runs: list[Outcomes] = [found[key] for key in matrix.jobs if (key.line, key.case) == (name, case.name)]
            success, time = (np.array([getattr(run, what) for run in runs]) for what in ("success", "time_to_goal"))
            cells.append(cell_of(name, case.name, success, time, settings.confidence, settings.resamples))
        lines.append(tuple(cells))
    return Matrix(matrix.name, matrix.lines, matrix.cases, tuple(lines))


def _ladders(prepared: Prepared, rows: list[Row]) -> tuple[Ladder, ...]:
    found = []
    for index, ladder in enumerate(prepared.settings.ladders):
        hardware, steps = hardware_of(prepared.settings, index), []
        for name in ladder.named():
            those = [row for row in rows if (row.task, row.hardware, row.policy) == (ladder.task, hardware, name)]
            curves = prepared.curves[ladder.task, name].values()
            run = prepared.settings.contender_of(name).runs()[0].name
            steps.append(
                Rung(
                    policy=name,
                    action=prepared.jobs[Trial(ladder.task, hardware, run)].acting.action,
                    steps=tuple(int(curve.steps[-1]) for curve in curves),
                    seconds=tuple(float(curve.seconds[-1]) for curve in curves),
                    row=those[0],
                    runs=tuple(those[1:]),
                )
            )
        found.append(Ladder(ladder.name, ladder.task, hardware, tuple(steps)))
    return tuple(found)


def write(found: Comparison) -> Path:
    """Write compare.csv, compare.json and compare.html.

    Returns:
        The page's path.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    from agents.evaluation.comparison import comparison_page  # what draws and writes pages is loaded when it is needed

    directory = Path(found.settings.output)
    contents = csv_text([vars(row) for row in found.rows]), texts.json_text(found), comparison_page.page(found)
    write_together({directory / name: text for name, text in zip(FILES, contents, strict=True)})
    return directory / FILES[-1]
