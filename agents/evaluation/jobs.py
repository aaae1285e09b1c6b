"""From settings to jobs, built before anything runs, so that bad input fails first; and from jobs to what is kept of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
from tqdm import tqdm

from agents.evaluation.entries import Column, HardwareEntry, PolicyEntry, laid_over, with_sensor
from agents.evaluation.records import Trial
from agents.evaluation.run_settings import RunSettings
from agents.evaluation.settings import EvaluationSettings
from agents.workers import Submit
from vibgym import checks
from vibgym.envs.named import environment_id
from vibgym.envs.viewer import scenery_of
from vibgym.files import output_directory, output_files
from vibgym.imports import taking_part
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import CONTROLLERS, make_policy
from vibgym.policies.rollout import Ends, rollout, worlds_of
from vibgym.policies.task_info import TaskInfo
from vibgym.rendering import Scenery


@dataclass(frozen=True)
class Job:
    """One policy's episodes on one task, in environments with some arguments."""

    task: str  # as the settings call it
    info: TaskInfo
    seeds: list[int]
    environment: dict[str, Any]  # keyword arguments other than action and observation
    content: Any  # from which another process makes the policy, see make_policy
    policy: Policy | None  # None on the way to another process

    def play(self, keep: type[Ends], name: str, quiet: bool) -> Any:
        """:func:`vibgym.policies.rollout` of the policy, which the progress bar calls ``name``."""
        with tqdm(total=len(self.seeds), desc=f"{self.task:>9} {name:<12}", unit="ep", disable=quiet) as bar:
            return rollout(self.policy, self.task, seeds=self.seeds, keep=keep, progress=bar.update, **self.environment)

    def made(self) -> Job:
        """With its policy."""
        return replace(self, policy=make_policy(self.content, self.info, self.seeds[0]))

    @property
    def acting(self) -> Policy:
        """Its policy, once that is made."""
        assert self.policy is not None
        return self.policy

    @property
    def size(self) -> tuple[bool, int]:
        """Jobs in the order of this are done soon.

        Tasks for one part come first, while the cost of several is measured: so hardly a kernel is compiled twice. Then those
        that take longest, lest one is left over in the end.
        """
        parts = len(self.info.parts)
        return parts > 1, -len(self.seeds) * parts * (self.info.step_limit or 1)

    @property
    def plain(self) -> bool:
        """Whether another process can play it as well: a policy from plain data, in an environment that every process knows.

        Objects stay here, whatever they remember, and so do a user's own environments that no module has brought along.
        """
        spec = gym.registry.get(environment_id(self.task))
        own = spec is None or spec.namespace != "vibgym"
        plain = isinstance(self.content, str) or (isinstance(self.content, Mapping) and "policy" not in self.content)
        return plain and (not own or bool(taking_part()))


def writable(settings: RunSettings, names: Sequence[str]) -> None:
    """Make sure that files of these names can be written into the output directory.

    Raises:
        ValueError: they cannot.
    """
    field = f"{settings.where}.output"
    directory = output_directory(Path(settings.output), field)
    output_files((directory / name for name in names), field)


def trials(settings: RunSettings) -> tuple[dict[str, TaskInfo], dict[str, Scenery], dict[Trial, Job]]:
    """Every policy on every task and all hardware that it runs on: what is public of the tasks, what pictures of them show,
    and the jobs.

    Raises:
        ValueError: a bad environment setting, or an unknown or unfitting policy.
    """
    where = settings.where
    entries, machines = settings.entries(), settings.machines()
    tasks: dict[str, TaskInfo] = {}
    scenery: dict[str, Scenery] = {}
    jobs: dict[Trial, Job] = {}
    for task in settings.tasks:
        with checks.within(f"{where}.environment"):
            env = worlds_of(task, 1, **settings.environment)
        tasks[task], scenery[task] = TaskInfo.of(env), scenery_of(env.unwrapped)  # type: ignore[arg-type]
        env.close()
        serving = [each for each in entries if each.tasks is not None or serves(each.content, tasks[task])]
        for machine in machines:
            jobs |= _jobs(settings, task, tasks[task], machine, [each for each in serving if machine.runs(each, task)])
        if not any(trial.task == task for trial in jobs):
            raise checks.refuse(f"{where}.policies", [entry.name for entry in entries], f"one that serves {task}")
    for entry in entries:
        if not any(trial.policy == entry.name for trial in jobs):
            raise checks.refuse(f"{where}.policies", entry.name, f"policies that serve one of {', '.join(tasks)}")
    for machine in machines:
        if not any(trial.hardware == machine.name for trial in jobs):
            allowed = "hardware that a policy runs on"
            raise checks.refuse(f"{where}.hardware.{machine.name}", list(machine.tasks), allowed)
    return tasks, scenery, jobs


def _jobs(
    settings: RunSettings, task: str, plain: TaskInfo, machine: HardwareEntry, entries: list[PolicyEntry]
) -> dict[Trial, Job]:
    """Those of one task on one machine."""
    where, jobs = settings.where, {}
    environment = laid_over(settings.environment, machine.arguments)
    info = plain
    if machine.arguments and entries:
        info = told(task, environment, f"{where}.hardware.{machine.name}")
    seeds = settings.seed_list(task, machine.episodes)
    place = task if settings.hardware is None else f"{task}, {machine.name}"
    for entry in entries:
        with checks.within(f"{where}.policies ({entry.name} on {place})"):
            jobs[Trial(task, machine.name, entry.name)] = Job(
                task, info, seeds, environment, entry.content, None
            ).made()
    return jobs


def effects_jobs(settings: EvaluationSettings) -> dict[tuple[str, str], Job]:
    """Jobs of the study of effects, by (case, policy); none without one.

    Raises:
        ValueError: a bad environment setting, or an unfitting policy.
    """
    asked, jobs = settings.effects, {}
    if asked is None:
        return jobs
    contents = settings.named_policies()
    cases = {case: (asked.task, arguments) for case, arguments in asked.arguments().items()}
    columns, field = asked.columns(list(contents)), "evaluation.effects"
    for case, column, where, job in study_jobs(settings, cases, columns, asked.episodes, field, Known()):
        with checks.within(where):
            jobs[case, column.name] = replace(job, content=contents[column.policy]).made()
    return jobs


def study_jobs(
    settings: RunSettings,
    cases: Mapping[str, tuple[str, dict[str, Any]]],
    columns: Sequence[Column],
    most: int | None,
    field: str,
    known: Known,
) -> Iterator[tuple[str, Column, str, Job]]:
    """Every case of a study with every policy: the case, the policy, the field that errors name, and a job without a policy.

    Args:
        settings: whose environments the cases' arguments lie over.
        cases: name -> task, and arguments of its environment.
        columns: the policies.
        most: episodes in each case.
        field: of the study.
        known: environments that were made before.

    Raises:
        ValueError: an environment that cannot be made.
    """
    for case, (task, arguments) in cases.items():
        environment = laid_over(settings.environment, arguments)
        known.info(task, environment, f"{field}.cases.{case}")
        for column in columns:
            where = f"{field}.policies ({column.name} in {case})"
            own = with_sensor(environment, column.sensor)
            yield (
                case,
                column,
                where,
                Job(task, known.info(task, own, where), settings.seed_list(task, most), own, None, None),
            )


class Known:
    """What is public of environments, each made once, however many policies share it."""

    def __init__(self) -> None:
        self.infos: list[tuple[str, dict[str, Any], TaskInfo]] = []

    def info(self, task: str, environment: dict[str, Any], field: str) -> TaskInfo:
        """Of one; see :func:`told`."""
        for name, arguments, info in self.infos:
            if (name, arguments) == (task, environment):
                return info
        info = told(task, environment, field)
        self.infos.append((task, environment, info))
        return info


def told(task: str, environment: dict[str, Any], field: str) -> TaskInfo:
    """What is public of an environment with these arguments; errors begin with the field that they come from."""
    with checks.within(field):
        env = worlds_of(task, 1, **environment)
    info = TaskInfo.of(env)
    env.close()
    return info


Judge = Callable[..., Any]
"""``judge(job, key, *more, quiet)`` plays a job and returns what is kept of it; a module's own function, so that another
process finds it."""


def run_jobs(
    submit: Submit,
    jobs: Mapping[tuple[str, ...], Job],
    judge: Judge,
    more: tuple[Any, ...] = (),
    *,
    alone: bool,
    quiet: bool,
) -> dict[tuple[str, ...], Any]:
    """What ``judge`` returns of every job, by key, in the order of the jobs.

    Args:
        submit: of :func:`agents.workers.side_by_side`.
        jobs: key -> job.
        judge: see :data:`Judge`.
        more: arguments of it.
        alone: whether there is this process and no other. Else jobs whose policies are plain data go to the others.
        quiet: no progress bars.
    """
    found: dict[tuple[str, ...], Any] = dict.fromkeys(jobs)
    for key in sorted((key for key, job in jobs.items() if job.plain and not alone), key=lambda key: jobs[key].size):
        found[key] = submit(_made_and_judged, judge, replace(jobs[key], policy=None), key, more)
    for key, job in jobs.items():
        if found[key] is None:
            found[key] = judge(job, key, *more, quiet)
    waiting = tqdm(found.items(), desc="running policies", unit="pair", disable=quiet or alone)
    return {key: each.result() if isinstance(each, Future) else each for key, each in waiting}


def _made_and_judged(judge: Judge, job: Job, key: tuple[str, ...], more: tuple[Any, ...]) -> Any:
    """The same in a process of its own, where the policy is made first."""
    return judge(job.made(), key, *more, True)


def serves(content: Any, info: TaskInfo) -> bool:
    """Whether a policy that names no tasks is meant for this one.

    A controller is where it can be made with its own defaults. All others are: where they do not fit, making them says so.
    """
    kind = content.get("kind") if isinstance(content, Mapping) else content
    if not isinstance(kind, str) or kind not in CONTROLLERS or kind in ("trained", "residual", "schedule", "by_task"):
        return True
    try:
        make_policy(kind, info)
    except ValueError:
        return False
    return True
