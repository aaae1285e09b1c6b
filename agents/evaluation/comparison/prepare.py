"""From settings to jobs: everything that can fail for bad input is built before anything runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from agents.evaluation.comparison.contenders import ComparisonSettings, Contender
from agents.evaluation.comparison.curves import Curve, read_curve
from agents.evaluation.comparison.studies import Case, MatrixSettings
from agents.evaluation.entries import Column
from agents.evaluation.jobs import Job, Known, study_jobs, trials, writable
from agents.evaluation.records import Trial
from vibgym import checks
from vibgym.policies.rollout import worlds_of
from vibgym.policies.task_info import TaskInfo

FILES = ("compare.csv", "compare.json", "compare.html")


class Tested(NamedTuple):
    """What is run for a cell of a matrix: one run's policy in one case."""

    matrix: str
    line: str
    case: str
    run: str


@dataclass(frozen=True)
class PreparedMatrix:
    """A matrix whose policies exist.

    Attributes:
        lines: policies.
        cases: that they are tested on.
        jobs: of every run of every policy in every case in which it can act.
        refusals: line and case -> why the policy cannot act there.
    """

    name: str
    lines: tuple[Column, ...]
    cases: tuple[Case, ...]
    jobs: dict[Tested, Job]
    refusals: dict[tuple[str, str], str]


@dataclass(frozen=True)
class Prepared:
    """A checked comparison: environments, policies and curves exist, the output directory can be written to."""

    settings: ComparisonSettings
    tasks: dict[str, TaskInfo]
    jobs: dict[Trial, Job]  # whose policies are runs, see Contender.run_name
    matrices: tuple[PreparedMatrix, ...]
    curves: dict[tuple[str, str], dict[int | None, Curve]]  # task and policy -> training seed -> curve


def prepare(settings: ComparisonSettings) -> Prepared:
    """Build all that can fail for bad input, before anything runs.

    Raises:
        ValueError: a bad environment setting, an unknown or unfitting policy, a learning curve that is missing or none, or a
            place that cannot be written to.
    """
    import agents.evaluation.comparison.comparison_page  # noqa: F401 - a package that pages need is missed before anything runs

    tasks, _, jobs = trials(settings)
    contenders = settings.contenders()
    curves = {}
    for task in tasks:
        for each in contenders:
            runs = any(trial.task == task and trial.policy == each.run_name(each.seeds[0]) for trial in jobs)
            if runs and each.curve is not None:
                field = f"comparison.policies ({each.name}).curve"
                curves[task, each.name] = {
                    seed: read_curve(each.curve_path(tasks[task].name, seed), field) for seed in each.seeds
                }
    for index, ladder in enumerate(settings.ladders):
        hardware = hardware_of(settings, index)
        for name in ladder.named():
            trial = Trial(ladder.task, hardware, settings.contender_of(name).runs()[0].name)
            if trial not in jobs:
                allowed = f"policies that run on {ladder.task}, hardware {hardware}"
                raise checks.refuse(f"comparison.ladders.{index}.policies", name, allowed)
    known = Known()
    matrices = tuple(
        _matrix(settings, each, f"comparison.generalisation.{k}", known)
        for k, each in enumerate(settings.generalisation)
    )
    writable(settings, FILES)
    return Prepared(settings, tasks, jobs, matrices, curves)


def hardware_of(settings: ComparisonSettings, ladder: int) -> str:
    """On which a ladder's results are: its own, or the first one."""
    return settings.ladders[ladder].hardware or next(iter(settings.named_hardware()))


def _matrix(settings: ComparisonSettings, asked: MatrixSettings, where: str, known: Known) -> PreparedMatrix:
    """The jobs of a matrix.

    Raises:
        ValueError: a case of which there is no environment, or a policy that can act in none of them.
    """
    names = [each.name for each in settings.contenders()]
    lines, cases = asked.lines(where, names), asked.tested(where)
    jobs: dict[Tested, Job] = {}
    refusals: dict[tuple[str, str], str] = {}
    places = {case.name: (case.task, case.arguments) for case in cases}
    for case, line, _, job in study_jobs(settings, places, lines, asked.episodes, where, known):
        found = _able(settings.contender_of(line.policy), job)
        if isinstance(found, str):
            refusals[line.name, case] = found
        else:
            jobs |= {Tested(asked.name, line.name, case, run): each for run, each in found.items()}
    for line in lines:
        if not any(job.line == line.name for job in jobs):
            reason = refusals[line.name, cases[0].name]
            allowed = f"policies that can act in one of the cases; in {cases[0].name}: {reason}"
            raise checks.refuse(f"{where}.policies", line.name, allowed)
    return PreparedMatrix(asked.name, tuple(lines), tuple(cases), jobs, refusals)


def _able(contender: Contender, empty: Job) -> dict[str, Job] | str:
    """By its name the job of every run, from one without a policy; or why one of them cannot act there."""
    found = {}
    try:
        for entry in contender.runs():
            job = replace(empty, content=entry.content).made()
            spoken = {"action": job.acting.action, "observation": job.acting.observation}
            worlds_of(job.task, 1, **{**job.environment, **spoken}).close()
            found[entry.name] = job
    except ValueError as error:
        return " ".join(str(error).split())
    return found
