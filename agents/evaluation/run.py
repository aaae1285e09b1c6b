"""From settings to cases, built and checked before anything is simulated, and from cases to the table of episodes."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import pandas as pd
from gymnasium.vector import VectorEnv
from tqdm import tqdm

from agents import parallel
from agents.evaluation.films import Log, Rollout
from agents.evaluation.settings import EffectsSettings, EvaluationSettings, RunSettings, laid_over, with_sensor
from agents.evaluation.table import EFFECTS, LOAD, REPORT, Place, frame, where
from agents.provenance import policy_files, provenance
from vibgym import checks
from vibgym.envs.vector import environment_id
from vibgym.envs.viewer import scenery_of
from vibgym.files import output_directory, output_files
from vibgym.imports import taking_part
from vibgym.policies.measures import Measures
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import CONTROLLERS, NEED_MORE, make_policy
from vibgym.policies.rollout import Ends, rollout, worlds_of
from vibgym.policies.task_info import TaskInfo
from vibgym.rendering import Scenery
from vibgym.simulation.models import has_fast_contacts


@dataclass(frozen=True)
class Case:
    """Episodes of one policy on one task and hardware.

    Attributes:
        place: labels in the table.
        training_seed: of the policy, if it was trained several times.
        task: environment; in a study it may differ from the label.
        info: public information on the task.
        seeds: of the episodes.
        environment: arguments other than action and observation.
        content: argument of :func:`vibgym.policies.registry.make_policy`.
        recorder: what is recorded, see :func:`vibgym.policies.rollout.rollout`.
        policy: None until :meth:`made`, and in transfer to a worker process.
        line: of the progress bar; 0 for cases in this process.
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

    def made(self) -> Case:
        """Return the case with its policy."""
        return replace(self, policy=make_policy(self.content, self.info, self.seeds[0]))

    def play(self, quiet: bool) -> Any:
        """Return what the recorder keeps of the episodes."""
        bar = tqdm(
            total=len(self.seeds),
            desc=f"{self.task:>9} {self.place.policy:<12}",
            unit="ep",
            disable=quiet,
            position=self.line,
            leave=not self.line,
        )
        with bar:
            policy = self.policy or self.made().policy
            asked = {"seeds": self.seeds, "keep": self.recorder, "progress": bar.update}
            return rollout(policy, self.task, **asked, **self.environment)

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
    """Checked settings and their cases: environments and policies exist, and the output directory is writable.

    Attributes:
        tasks: public information by task, on the settings' own environment.
        scenery: what pictures of each task show.
        refused: place -> why the policy cannot run there, where that is no error.
        curves: (task, policy) -> training seed -> learning curve.
        film: case and path of the film that is written as a GIF.
        play: function of a case and ``quiet``; workers must be able to import it.
    """

    settings: Any
    tasks: dict[str, TaskInfo]
    cases: tuple[Case, ...]
    scenery: dict[str, Scenery] = field(default_factory=dict)
    refused: dict[Place, str] = field(default_factory=dict)
    curves: dict[tuple[str, str], dict[int | None, Any]] = field(default_factory=dict)
    film: tuple[Place, Path] | None = None
    play: Callable[[Case, bool], Any] = Case.play


@dataclass(frozen=True, kw_only=True)
class Results(Prepared):
    """Prepared cases and their results: the table of episodes, and of each case what its recorder kept."""

    episodes: pd.DataFrame
    rollouts: dict[tuple[Place, int | None], Any]
    provenance: dict[str, Any]

    @property
    def main(self) -> pd.DataFrame:
        """Episodes without those of studies."""
        return where(self.episodes, study=REPORT)

    def hardware_of(self, task: str | None = None) -> list[str]:
        """Return the hardware models that the task (or any) ran on, in the order of the settings."""
        ran = {place.hardware for place, _ in self.rollouts if place.study == REPORT and task in (None, place.task)}
        return [name for name in self.settings.named_hardware() if name in ran]

    def rollout(self, task: str, hardware: str, policy: str) -> Rollout:
        """Return what was recorded of a policy on a task."""
        return self.rollouts[Place(REPORT, task, hardware, policy), None]


def play_all(
    cases: Sequence[Case],
    processes: int = 1,
    ray: str | None = None,
    quiet: bool = False,
    play: Callable[[Case, bool], Any] = Case.play,
) -> list[Any]:
    """Play cases in parallel and return what their recorders kept, in order.

    Args:
        cases: those whose policy is an object are played in this process.
        processes: worker processes on this host.
        ray: address of a Ray cluster, or None.
        quiet: no progress bars.
        play: see :class:`Prepared`.
    """
    workers = parallel.usable(processes)
    alone = ray is None and workers == 1
    elsewhere = [] if alone else sorted((k for k, case in enumerate(cases) if case.plain), key=lambda k: cases[k].order)
    found: list[Any] = [None if k in elsewhere else play(case, quiet) for k, case in enumerate(cases)]
    items = [
        (replace(cases[k], policy=None, line=n % workers + 1), quiet or ray is not None)
        for n, k in enumerate(elsewhere)
    ]
    with tqdm(total=len(items), desc="running policies", unit="run", disable=quiet or alone) as bar:
        played = parallel.run(play, items, workers=processes, ray=ray, done=bar.update)
    for k, each in zip(elsewhere, played, strict=True):
        found[k] = each
    return found


def run(cases: Sequence[Case], processes: int = 1, ray: str | None = None, quiet: bool = False) -> pd.DataFrame:
    """Return the episodes of cases, one row each; see :func:`play_all` and :mod:`agents.evaluation.table`."""
    return _table(cases, play_all(cases, processes, ray, quiet))


def _table(cases: Sequence[Case], found: Sequence[Any]) -> pd.DataFrame:
    frames = [frame(each, case.place, case.training_seed) for case, each in zip(cases, found, strict=True)]
    return pd.concat(frames, ignore_index=True)


def evaluate(prepared: Prepared, quiet: bool = False, ray: str | None = None) -> Results:
    """Play all cases; see :func:`play_all`. Writes nothing."""
    cases = prepared.cases
    # Before the runs: files may change meanwhile.
    origin = provenance() | {"policy_files": policy_files((case.content, case.info.name) for case in cases)}
    found = play_all(cases, prepared.settings.processes, ray, quiet, prepared.play)
    kept = {(case.place, case.training_seed): each for case, each in zip(cases, found, strict=True)}
    return Results(**vars(prepared), episodes=_table(cases, found), rollouts=kept, provenance=origin)


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


def main_cases(
    settings: RunSettings, recorder: type[Ends] = Log
) -> tuple[dict[str, TaskInfo], dict[str, Scenery], list[Case]]:
    """Return the tasks, their scenery and the cases of every policy on every task and hardware that it serves.

    Raises:
        ValueError: a bad environment setting, an unknown or unfitting policy, or a task or hardware without any policy.
    """
    where, infos = settings.where, Infos()
    entries, hardware = settings.entries(), settings.hardware_entries()
    tasks: dict[str, TaskInfo] = {}
    scenery: dict[str, Scenery] = {}
    cases: list[Case] = []
    unserved: dict[str, str] = {}
    for task in settings.tasks:
        with checks.within(f"{where}.environment"):
            env = certified_world(task, settings.environment)
        tasks[task], scenery[task] = TaskInfo.of(env), scenery_of(env.unwrapped)  # type: ignore[arg-type]
        env.close()
        reasons = {
            entry.name: None if entry.tasks is not None else refusal(entry.content, tasks[task]) for entry in entries
        }
        unserved |= {name: f": {reason}" for name, reason in reasons.items() if reason is not None}
        for machine in hardware:
            environment, info = laid_over(settings.environment, machine.arguments), tasks[task]
            seeds = settings.seed_list(task, machine.episodes)
            there = task if settings.hardware is None else f"{task}, {machine.name}"
            for entry in entries:
                if reasons[entry.name] is not None or not machine.runs(entry, task):
                    continue
                if machine.arguments:
                    info = infos.of(task, environment, f"{where}.hardware.{machine.name}")
                place = Place(REPORT, task, machine.name, entry.name)
                for seed in entry.seeds:
                    with checks.within(f"{where}.policies ({entry.name} on {there})"):
                        case = Case(place, seed, task, info, seeds, environment, entry.run(seed), recorder)
                        cases.append(case.made())
        if not any(case.place.task == task for case in cases):
            raise checks.conflict(f"{where}.tasks: no policy serves {task!r}")
    for entry in entries:
        if not any(case.place.policy == entry.name for case in cases):
            raise checks.conflict(
                f"{where}.policies: {entry.name!r} serves none of {', '.join(tasks)}{unserved.get(entry.name, '')}"
            )
    for machine in hardware:
        if not any(case.place.hardware == machine.name for case in cases):
            raise checks.conflict(f"{where}.hardware.{machine.name}: no policy runs on it")
    return tasks, scenery, cases


def study_cases(
    settings: RunSettings,
    study: EffectsSettings,
    label: str,
    where: str,
    refused: dict[Place, str] | None = None,
) -> Iterator[Case]:
    """Yield the cases of every cell of a study.

    Args:
        settings: of the evaluation.
        study: its policies and cases.
        label: of the study in the table.
        where: start of errors.
        refused: place -> why a policy cannot act there, extended by this function; None: that is an error.

    Raises:
        ValueError: an environment that cannot be made.
    """
    entries, infos = {entry.name: entry for entry in settings.entries()}, Infos()
    for test in study.tests(where):
        environment = laid_over(settings.environment, test.arguments)
        infos.of(test.task, environment, f"{where}.cases.{test.name}")
        for column in study.columns(where, list(entries)):
            entry, there = entries[column.policy], f"{where}.policies ({column.name} in {test.name})"
            own = with_sensor(environment, column.sensor)
            info, seeds = infos.of(test.task, own, there), settings.seed_list(test.task, study.episodes)
            place = Place(label, study.task, test.name, column.name)
            cases = [Case(place, seed, test.task, info, seeds, own, entry.run(seed), Ends) for seed in entry.seeds]
            try:
                with checks.within(there):
                    cases = [_acting(case) for case in cases]
            except ValueError as error:
                if refused is None:
                    raise
                refused[place] = " ".join(str(error).split())
                continue
            yield from cases


def _acting(case: Case) -> Case:
    """Return the case with its policy; raise ValueError if its environment lacks the policy's action or observation."""
    made = case.made()
    assert made.policy is not None
    spoken = {"action": made.policy.action, "observation": made.policy.observation}
    worlds_of(case.task, 1, **{**case.environment, **spoken}).close()
    return made


def effects_cases(settings: EvaluationSettings) -> list[Case]:
    """Return the cases of the study of effects; none without one."""
    if settings.effects is None:
        return []
    return list(study_cases(settings, settings.effects, EFFECTS, "evaluation.effects"))


def load_cases(settings: EvaluationSettings) -> list[Case]:
    """Return the cases of the study of throughput: every policy with every number of parts, kinds in turn.

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
    seeds, cases = settings.seed_list(asked.task, asked.episodes), []
    for name in asked.policies:
        for count in sorted(asked.parts):
            environment = {**settings.environment, "parts": [kinds[k % len(kinds)] for k in range(count)]}
            own = infos.of(asked.task, environment, f"{where}.parts.{count}")
            place = Place(LOAD, asked.task, str(count), name)
            with checks.within(f"{where}.policies ({name}, {count} parts)"):
                cases.append(Case(place, None, asked.task, own, seeds, environment, contents[name]).made())
    return cases


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
    for case in prepared.cases:
        if case.place.study == REPORT:
            first.setdefault(case.place.policy, case.policy)
    return {
        name: (inspect.getdoc(policy) or "").partition("\n")[0].replace("`", "").replace('"', "")
        for name, policy in first.items()
    }
