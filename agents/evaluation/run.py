"""From settings to runs, built and checked before anything is simulated, and from runs to the table of episodes."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium.vector import VectorEnv
from tqdm import tqdm

from agents import parallel
from agents.evaluation.films import Log, Rollout
from agents.evaluation.settings import EvaluationSettings, RunSettings, laid_over, with_sensor
from agents.evaluation.study_settings import EffectsSettings
from agents.evaluation.table import EFFECTS, LOAD, REPORT, Place, Table
from agents.provenance import policy_files, provenance
from vibgym import checks
from vibgym.envs.vector import environment_id
from vibgym.envs.viewer import scenery_of
from vibgym.files import output_directory, output_files
from vibgym.imports import taking_part
from vibgym.policies.measures import Measures
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import CONTROLLERS, NEED_MORE, make_policy
from vibgym.policies.rollout import Ends, Outcomes, rollout, worlds_of
from vibgym.policies.task_info import TaskInfo
from vibgym.rendering import Scenery
from vibgym.simulation.models import has_fast_contacts


@dataclass(frozen=True)
class Run:
    """Episodes of one policy on one task and hardware.

    Attributes:
        place: labels in the table.
        training_seed: of the policy, if it was trained several times.
        task: as in the settings.
        info: public information on the task.
        seeds: of the episodes.
        environment: arguments other than action and observation.
        content: argument of :func:`vibgym.policies.registry.make_policy`.
        recorder: what is recorded, see :func:`vibgym.policies.rollout.rollout`.
        policy: None until :meth:`made`, and in transfer to a worker process.
        line: of the progress bar; 0 for runs in this process.
    """

    place: Place
    training_seed: int | None
    task: str
    info: TaskInfo
    seeds: list[int]
    environment: dict[str, Any]
    content: Any
    recorder: type[Ends] = Measures
    policy: Policy | None = None
    line: int = 0

    def made(self) -> Run:
        """Return the run with its policy."""
        return replace(self, policy=make_policy(self.content, self.info, self.seeds[0]))

    def play(self, quiet: bool) -> Any:
        """Return what the recorder keeps of the episodes."""
        name = f"{self.task:>9} {self.place.policy:<12}"
        with tqdm(
            total=len(self.seeds), desc=name, unit="ep", disable=quiet, position=self.line, leave=not self.line
        ) as bar:
            asked = {"seeds": self.seeds, "keep": self.recorder, "progress": bar.update}
            return rollout(self.policy, self.task, **asked, **self.environment)

    @property
    def plain(self) -> bool:
        """Whether a worker process can play it: the policy is plain data, and workers can make the environment."""
        spec = gym.registry.get(environment_id(self.task))
        custom = spec is None or spec.namespace != "vibgym"
        plain = isinstance(self.content, str) or (isinstance(self.content, Mapping) and "policy" not in self.content)
        return plain and (not custom or bool(taking_part()))

    @property
    def order(self) -> tuple[bool, int]:
        """Sort key: tasks for one part first (each kernel is compiled once), then the longest."""
        parts = len(self.info.parts)
        return parts > 1, -len(self.seeds) * parts * (self.info.step_limit or 1)


@dataclass(frozen=True)
class Prepared:
    """Checked settings and their runs: environments and policies exist, and the output directory is writable.

    Attributes:
        tasks: public information by task, on the settings' own environment.
        scenery: what pictures of each task show.
        refused: place -> why the policy cannot run there, where that is no error.
        curves: (task, policy) -> training seed -> learning curve.
        film: run and path of the film that is written as a GIF.
        play: function of a run and ``quiet``; workers must be able to import it.
    """

    settings: Any
    tasks: dict[str, TaskInfo]
    runs: tuple[Run, ...]
    scenery: dict[str, Scenery] = field(default_factory=dict)
    refused: dict[Place, str] = field(default_factory=dict)
    curves: dict[tuple[str, str], dict[int | None, Any]] = field(default_factory=dict)
    film: tuple[Place, Path] | None = None
    play: Callable[[Run, bool], Any] = Run.play


@dataclass(frozen=True, kw_only=True)
class Results(Prepared):
    """Prepared runs and their results: the table of episodes, and of each run what its recorder kept."""

    table: Table
    rollouts: dict[tuple[Place, int | None], Any]
    provenance: dict[str, Any]

    @property
    def asked(self) -> tuple[float, int]:
        """Level and number of resamples of the intervals."""
        return self.settings.confidence, self.settings.resamples

    @property
    def places(self) -> dict[Place, Table]:
        """Episodes of every policy on every task and hardware, without those of studies."""
        return self.table.where(study=REPORT).places()

    def hardware_of(self, task: str | None = None) -> list[str]:
        """Return the hardware models that the task (or any) ran on, in the order of the settings."""
        ran = {place.hardware for place in self.places if task in (None, place.task)}
        return [name for name in self.settings.named_hardware() if name in ran]

    def rollout(self, task: str, hardware: str, policy: str) -> Rollout:
        """Return what was recorded of a policy on a task."""
        return self.rollouts[Place(REPORT, task, hardware, policy), None]


def run_all(
    runs: Sequence[Run],
    processes: int,
    ray: str | None = None,
    quiet: bool = False,
    play: Callable[[Run, bool], Any] = Run.play,
) -> list[Any]:
    """Play runs in parallel and return their results in order.

    Args:
        runs: those whose policy is an object are played in this process.
        processes: worker processes on this host.
        ray: address of a Ray cluster, or None.
        quiet: no progress bars.
        play: see :class:`Prepared`.
    """
    alone = ray is None and parallel.usable(processes) == 1
    elsewhere = [] if alone else sorted((k for k, run in enumerate(runs) if run.plain), key=lambda k: runs[k].order)
    found: list[Any] = [None if k in elsewhere else play(run, quiet) for k, run in enumerate(runs)]
    workers = parallel.usable(processes)
    items = [
        (play, replace(runs[k], policy=None, line=n % workers + 1), quiet or ray is not None)
        for n, k in enumerate(elsewhere)
    ]
    with tqdm(total=len(items), desc="running policies", unit="run", disable=quiet or alone) as bar:
        played = parallel.run(_made_and_played, items, workers=processes, ray=ray, done=bar.update)
    for k, each in zip(elsewhere, played, strict=True):
        found[k] = each
    return found


def _made_and_played(play: Callable[[Run, bool], Any], run: Run, quiet: bool) -> Any:
    return play(run.made(), quiet)


def evaluate(prepared: Prepared, quiet: bool = False, ray: str | None = None) -> Results:
    """Play all runs; see :func:`run_all`. Writes nothing."""
    runs = prepared.runs
    # Before the runs: files may change meanwhile.
    origin = provenance() | {"policy_files": policy_files((run.content, run.info.name) for run in runs)}
    found: list[Outcomes] = run_all(runs, prepared.settings.processes, ray, quiet, prepared.play)
    tables = [Table.of(each, run.place, run.training_seed) for run, each in zip(runs, found, strict=True)]
    kept = {(run.place, run.training_seed): each for run, each in zip(runs, found, strict=True)}
    return Results(**vars(prepared), table=Table.joined(tables), rollouts=kept, provenance=origin)


def writable(settings: RunSettings, names: Iterable[str]) -> None:
    """Raise ValueError unless files of these names can be written into the output directory."""
    where = f"{settings.where}.output"
    directory = output_directory(Path(settings.output), where)
    output_files((directory / name for name in names), where)


def certified_world(task: str, environment: Mapping[str, Any]) -> VectorEnv:
    """Return one world of an environment whose results may be published.

    Raises:
        ValueError: an invalid environment, or one with fast contacts.
    """
    env = worlds_of(task, 1, **environment)
    if has_fast_contacts(env.unwrapped.core.options.model):  # type: ignore[attr-defined]
        env.close()
        raise checks.conflict(
            f"{task}: contacts='fast' is for training: results require contacts='certified', the default"
        )
    return env


class Infos:
    """Public information on environments, each of which is made once."""

    def __init__(self) -> None:
        self._known: list[tuple[str, dict[str, Any], TaskInfo]] = []

    def of(self, task: str, environment: dict[str, Any], where: str) -> TaskInfo:
        """Return the information on an environment; errors begin with ``where``."""
        for name, arguments, info in self._known:
            if (name, arguments) == (task, environment):
                return info
        with checks.within(where):
            env = certified_world(task, environment)
        info = TaskInfo.of(env)
        env.close()
        self._known.append((task, environment, info))
        return info


def main_runs(
    settings: RunSettings, recorder: type[Ends] = Log
) -> tuple[dict[str, TaskInfo], dict[str, Scenery], list[Run]]:
    """Return the tasks, their scenery and the runs of every policy on every task and hardware that it serves.

    Raises:
        ValueError: a bad environment setting, an unknown or unfitting policy, or a task or hardware without any policy.
    """
    where, infos = settings.where, Infos()
    entries, hardware = settings.entries(), settings.hardware_entries()
    tasks: dict[str, TaskInfo] = {}
    scenery: dict[str, Scenery] = {}
    runs: list[Run] = []
    unserved: dict[str, str] = {}
    for task in settings.tasks:
        with checks.within(f"{where}.environment"):
            env = certified_world(task, settings.environment)
        tasks[task], scenery[task] = TaskInfo.of(env), scenery_of(env.unwrapped)  # type: ignore[arg-type]
        env.close()
        reasons = {
            each.name: None if each.tasks is not None else refusal(each.content, tasks[task]) for each in entries
        }
        unserved |= {name: f": {reason}" for name, reason in reasons.items() if reason is not None}
        serving = [each for each in entries if reasons[each.name] is None]
        for machine in hardware:
            environment, info = laid_over(settings.environment, machine.arguments), tasks[task]
            seeds = settings.seed_list(task, machine.episodes)
            there = task if settings.hardware is None else f"{task}, {machine.name}"
            for entry in serving:
                if not machine.runs(entry, task):
                    continue
                if machine.arguments:
                    info = infos.of(task, environment, f"{where}.hardware.{machine.name}")
                place = Place(REPORT, task, machine.name, entry.name)
                for seed in entry.seeds:
                    with checks.within(f"{where}.policies ({entry.name} on {there})"):
                        run = Run(place, seed, task, info, seeds, environment, entry.run(seed), recorder)
                        runs.append(run.made())
        if not any(run.place.task == task for run in runs):
            raise checks.conflict(f"{where}.tasks: no policy serves {task!r}")
    for entry in entries:
        if not any(run.place.policy == entry.name for run in runs):
            raise checks.conflict(
                f"{where}.policies: {entry.name!r} serves none of {', '.join(tasks)}{unserved.get(entry.name, '')}"
            )
    for machine in hardware:
        if not any(run.place.hardware == machine.name for run in runs):
            raise checks.conflict(f"{where}.hardware.{machine.name}: no policy runs on it")
    return tasks, scenery, runs


def study_runs(
    settings: RunSettings,
    study: EffectsSettings,
    label: str,
    where: str,
    infos: Infos,
    refused: dict[Place, str] | None = None,
) -> Iterator[Run]:
    """Yield the runs of every cell of a study, case after case.

    Args:
        settings: of the evaluation.
        study: its policies and cases.
        label: of the study in the table.
        where: start of errors.
        infos: environments made so far.
        refused: place -> why a policy cannot act there, extended by this function; None: that is an error.

    Raises:
        ValueError: an environment that cannot be made.
    """
    entries = {each.name: each for each in settings.entries()}
    for case in study.tested(where):
        environment = laid_over(settings.environment, case.arguments)
        infos.of(case.task, environment, f"{where}.cases.{case.name}")
        for column in study.columns(where, list(entries)):
            entry, there = entries[column.policy], f"{where}.policies ({column.name} in {case.name})"
            own = with_sensor(environment, column.sensor)
            info, seeds = infos.of(case.task, own, there), settings.seed_list(case.task, study.episodes)
            place = Place(label, study.task, case.name, column.name)
            runs = [Run(place, seed, case.task, info, seeds, own, entry.run(seed), Ends) for seed in entry.seeds]
            try:
                with checks.within(there):
                    runs = [_acting(run) for run in runs]
            except ValueError as error:
                if refused is None:
                    raise
                refused[place] = " ".join(str(error).split())
                continue
            yield from runs


def _acting(run: Run) -> Run:
    """Return the run with its policy; raise ValueError if its environment lacks the policy's action or observation."""
    made = run.made()
    assert made.policy is not None
    spoken = {"action": made.policy.action, "observation": made.policy.observation}
    worlds_of(run.task, 1, **{**run.environment, **spoken}).close()
    return made


def effects_runs(settings: EvaluationSettings) -> list[Run]:
    """Return the runs of the study of effects, case after case; none without one."""
    if settings.effects is None:
        return []
    return list(study_runs(settings, settings.effects, EFFECTS, "evaluation.effects", Infos()))


def load_runs(settings: EvaluationSettings) -> list[Run]:
    """Return the runs of the study of throughput: every policy with every number of parts, kinds in turn.

    Raises:
        ValueError: a task without flow, more parts than fit, or an unfitting policy.
    """
    asked, infos, where = settings.under_load, Infos(), "evaluation.under_load"
    if asked is None:
        return []
    info = infos.of(asked.task, settings.environment, where)
    if not info.flows:
        raise checks.refuse(f"{where}.task", asked.task, "a task in which parts come and go")
    kinds = [info.parts[info.kind.index(kind)].to_dict() for kind in range(len(info.kinds))]
    contents = {each.name: each.content for each in settings.entries()}
    seeds, found = settings.seed_list(asked.task, asked.episodes), []
    for name in asked.policies:
        for count in sorted(asked.parts):
            environment = {**settings.environment, "parts": [kinds[k % len(kinds)] for k in range(count)]}
            own = infos.of(asked.task, environment, f"{where}.parts.{count}")
            place = Place(LOAD, asked.task, str(count), name)
            with checks.within(f"{where}.policies ({name}, {count} parts)"):
                found.append(Run(place, None, asked.task, own, seeds, environment, contents[name]).made())
    return found


def refusal(content: Any, info: TaskInfo) -> str | None:
    """Return why a policy without ``tasks`` does not run on this one: a controller that cannot be made with its defaults. None
    for any other (making it raises the error)."""
    kind = content.get("kind") if isinstance(content, Mapping) else content
    if not isinstance(kind, str) or kind not in CONTROLLERS or kind in NEED_MORE:
        return None
    try:
        make_policy(kind, info)
    except ValueError as error:
        return str(error)
    return None


def described(prepared: Prepared) -> dict[str, str]:
    """Return the first line of each policy's docstring by name, without markup."""
    first: dict[str, Policy | None] = {}
    for run in prepared.runs:
        if run.place.study == REPORT:
            first.setdefault(run.place.policy, run.policy)
    return {
        name: (inspect.getdoc(policy) or "").partition("\n")[0].replace("`", "").replace('"', "")
        for name, policy in first.items()
    }
