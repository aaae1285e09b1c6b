"""From settings to cases: everything that can fail for bad input, before anything is simulated."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from gymnasium.vector import VectorEnv

import vibgym
from agents.evaluation.entry_process import EntryPolicy
from agents.evaluation.films import Log
from agents.evaluation.run import FILM, PLOT, Case, Prepared
from agents.evaluation.settings import (
    EvaluationSettings,
    HardwareEntry,
    PolicyEntry,
    RunSettings,
    Study,
    SuiteSettings,
    laid_over,
    with_sensor,
)
from agents.evaluation.table import LOAD, REPORT, Place
from agents.learning_curve import read_curve
from agents.provenance import code, digest, user_modules
from vibgym import checks
from vibgym.config import json_values
from vibgym.envs.vector import environment_id
from vibgym.envs.viewer import scenery_of
from vibgym.policies.measures import Measures, check_cost_limit, least_times, most_rates
from vibgym.policies.registry import NEED_MORE, make_policy
from vibgym.policies.rollout import Ends, worlds_of
from vibgym.policies.task_info import POLICIES, TaskInfo
from vibgym.policies.trained.catalogue import SHIPPED
from vibgym.rendering import Scenery

if TYPE_CHECKING:
    from agents.evaluation.entries import Entry

PACKAGES = Path(vibgym.__file__).parent, Path(__file__).parent
"""Code that determines episodes: if it and the files of policies are unchanged, recorded episodes are reused. Shipped agents
count where a policy reads them, see :meth:`.run.Case.file`."""


def cases(settings: RunSettings) -> list[Case]:
    """Return the cases of settings; see :func:`prepare`."""
    return list(prepare(settings).cases)


def prepare(settings: RunSettings, entries: Mapping[str, Entry] | None = None) -> Prepared:
    """Build everything that can fail for bad input, before anything runs.

    Args:
        settings: of the command.
        entries: of a suite, by the name of their policy.

    Raises:
        ValueError: a bad environment setting, an unknown or unfitting policy, a task, hardware or policy without a case, a bad
            learning curve; of a suite, a task without a bound.
    """
    plan = _Cases(settings, entries or {})
    plan.add_main()
    curves: dict[tuple[str, str], dict[int | None, pd.DataFrame]] = {}
    if isinstance(settings, EvaluationSettings):
        curves = plan.curves()
        for place, study in settings.studies.items():
            plan.add_study(study, settings.label(place), place)
        plan.add_load()
    return Prepared(settings, plan.tasks, tuple(plan.cases), plan.origin, plan.refused, curves)


class Infos:
    """Public information on environments, each of which is made once."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[TaskInfo, Scenery]] = {}

    def of(self, task: str, environment: dict[str, Any], place: str) -> tuple[TaskInfo, Scenery]:
        """Return the information on an environment, and what its pictures show; errors begin with ``place``."""
        key = json.dumps([task, json_values(environment)], sort_keys=True, default=repr)
        if key not in self._known:
            with checks.within(place):
                env = certified_world(task, environment)
            self._known[key] = TaskInfo.of(env), scenery_of(env.unwrapped)  # type: ignore[arg-type]
            env.close()
        return self._known[key]


class _Cases:
    """Cases of settings, as they are added."""

    def __init__(self, settings: Any, entries: Mapping[str, Entry]) -> None:
        self.settings, self.entries, self.where = settings, entries, settings.where
        self.origin = digest(json.dumps([code(*PACKAGES, without=SHIPPED), user_modules()], sort_keys=True))
        self.tasks: dict[str, TaskInfo] = {}
        self.cases: list[Case] = []
        self.refused: dict[Place, str] = {}
        self.infos = Infos()

    def add_main(self) -> None:
        """Add the cases of every policy on every task and hardware that it serves."""
        settings, suite = self.settings, isinstance(self.settings, SuiteSettings)
        for task in settings.tasks:
            self.tasks[task], scenery = self.infos.of(task, settings.environment, f"{self.where}.environment")
            for name, machine in settings.machines().items():
                environment = laid_over(settings.environment, machine.arguments)
                info, _ = self.infos.of(task, environment, f"{self.where}.hardware.{name}")
                if suite:
                    self._check_suite(task, environment)
                for entry in settings.policies:
                    place = Place(REPORT, task, name, entry.name)
                    if not _runs(entry, task, name, machine):
                        self.refused[place] = "not entered here"
                        continue
                    seeds = settings.seed_list(task, machine.episodes)[: entry.episodes]
                    with checks.within(f"{self.where}.policies ({entry.name} on {task}, {name})"):
                        self._add(place, entry, info, seeds, environment, scenery)
        ran = [case.place for case in self.cases]
        for entry in settings.policies:
            if not any(place.policy == entry.name for place in ran):
                last = next(why for place, why in reversed(self.refused.items()) if place.policy == entry.name)
                raise checks.conflict(
                    f"{self.where}.policies: {entry.name!r} serves none of {', '.join(settings.tasks)}: {last}"
                )
        for task in () if suite else settings.tasks:
            if not any(place.task == task for place in ran):
                raise checks.conflict(f"{self.where}.tasks: no policy serves {task!r}")
        for name in () if suite else settings.machines():
            if not any(place.hardware == name for place in ran):
                raise checks.conflict(f"{self.where}.hardware.{name}: no policy runs on it")

    def _add(
        self, place: Place, entry: PolicyEntry, info: TaskInfo, seeds: list[int], environment: Any, scenery: Scenery
    ) -> None:
        draws, entered = self.settings.draws, self.entries.get(entry.name)
        pictures = (PLOT, *((FILM,) if self.settings.animations else ())) if draws else ()
        origin = self.origin if entered is None else digest(self.origin + entered.digest)
        try:
            contents = [entry.of_run(seed) for seed in entry.seeds]
            if entered is not None and entered.process is not None:
                contents = [EntryPolicy(entered.process, info, seeds[0])]
            self.cases += [
                Case(
                    place, seed, place.task, info, seeds, environment, content, origin,
                    Log if draws else Measures, pictures, scenery,
                ).made()
                for seed, content in zip(entry.seeds, contents, strict=True)
            ]  # fmt: skip
        except checks.Refused as error:
            if not (isinstance(self.settings, SuiteSettings) or (entry.tasks is None and _unfit(entry.content, info))):
                raise
            self.refused[place] = str(error)

    def _check_suite(self, task: str, environment: dict[str, Any]) -> None:
        env = worlds_of(task, 1, **environment)
        env.reset(seed=0)
        bounds = least_times(env.unwrapped)[0], most_rates(env.unwrapped)[0]  # type: ignore[arg-type]
        env.close()
        if not np.isfinite(bounds).any():
            raise checks.refuse("suite.tasks", task, "a task with a bound, see vibgym.bounds")
        if self.settings.cost_limit is not None:
            check_cost_limit("suite.cost_limit", self.settings.cost_limit, task, environment)

    def curves(self) -> dict[tuple[str, str], dict[int | None, pd.DataFrame]]:
        """Return the learning curves, and check those of ladders."""
        ran = {case.place for case in self.cases}
        for index, ladder in enumerate(self.settings.ladders):
            hardware = self.settings.ladder_hardware(ladder)
            for name in ladder.policies:
                if Place(REPORT, ladder.task, hardware, name) not in ran:
                    field = f"{self.where}.ladders.{index}.policies"
                    raise checks.conflict(f"{field}: {name!r} does not run on {ladder.task}, hardware {hardware}")
        return {
            (task, entry.name): {
                seed: read_curve(entry.curve_path(info.name, seed), f"{self.where}.policies ({entry.name}).curve")
                for seed in entry.seeds
            }
            for task, info in self.tasks.items()
            for entry in self.settings.policies
            if entry.curve is not None and any((place.task, place.policy) == (task, entry.name) for place in ran)
        }

    def add_study(self, study: Study, label: str, field: str) -> None:
        """Add the cases of every cell of a study; a policy that cannot act in some is refused there."""
        settings, where = self.settings, f"{self.where}.{field}"
        entries, served = {entry.name: entry for entry in settings.policies}, set()
        for name, arguments in study.cases.items():
            task = arguments.get("task", study.task)
            with checks.within(f"{where}.cases.{name}"):
                environment_id(task, "task")
            environment = laid_over(settings.environment, {k: v for k, v in arguments.items() if k != "task"})
            self.infos.of(task, environment, f"{where}.cases.{name}")
            for column in study.policies:
                entry, there = entries[column.policy], f"{where}.policies ({column.name} in {name})"
                own = with_sensor(environment, column.sensor)
                info, _ = self.infos.of(task, own, there)
                place, seeds = Place(label, study.task, name, column.name), settings.seed_list(task, study.episodes)
                try:
                    with checks.within(there):
                        self.cases += [
                            _acting(Case(place, seed, task, info, seeds, own, entry.of_run(seed), self.origin, Ends))
                            for seed in entry.seeds
                        ]
                    served.add(column.name)
                except checks.Refused as error:
                    self.refused[place] = " ".join(str(error).split())
        for column in study.policies:
            if column.name not in served:
                why = next(
                    text for place, text in self.refused.items() if (place.study, place.policy) == (label, column.name)
                )
                raise checks.conflict(f"{where}.policies: {column.name!r} can act in none of the cases: {why}")

    def add_load(self) -> None:
        """Add the cases of the study of throughput: every policy with every number of parts, kinds in turn."""
        load, settings, where = self.settings.under_load, self.settings, f"{self.where}.under_load"
        if load is None:
            return
        info, _ = self.infos.of(load.task, settings.environment, where)
        if not info.continuous_feed:
            raise checks.refuse(f"{where}.task", load.task, "a task in which parts come and go")
        kinds = [info.parts[info.kind.index(kind)].to_dict() for kind in range(len(info.kinds))]
        contents = {policy.name: policy.content for policy in settings.policies}
        seeds = settings.seed_list(load.task, load.episodes)
        for name in load.policies:
            for count in sorted(load.parts):
                environment = {**settings.environment, "parts": [kinds[k % len(kinds)] for k in range(count)]}
                own, _ = self.infos.of(load.task, environment, f"{where}.parts.{count}")
                place = Place(LOAD, load.task, str(count), name)
                case = Case(place, None, load.task, own, seeds, environment, contents[name], self.origin)
                with checks.within(f"{where}.policies ({name}, {count} parts)"):
                    self.cases.append(case.made())


def _runs(entry: PolicyEntry, task: str, hardware: str, machine: HardwareEntry) -> bool:
    """Return whether a policy is to run on a task on some hardware."""
    wanted = (entry.tasks, task), (machine.tasks, task), (entry.hardware, hardware)
    return all(names is None or name in names for names, name in wanted)


def _unfit(content: Any, info: TaskInfo) -> bool:
    """Return whether a policy is a controller that cannot be made with its defaults: it does not serve the task."""
    kind = content.get("kind") if isinstance(content, Mapping) else content
    if not isinstance(kind, str) or kind not in POLICIES or kind in NEED_MORE:
        return False
    try:
        make_policy(kind, info)
    except checks.Refused:
        return True
    return False


def _acting(case: Case) -> Case:
    """Return the case with its policy; raise ValueError if its environment lacks the policy's action or observation."""
    made = case.made()
    assert made.policy is not None
    names = {"action": made.policy.action, "observation": made.policy.observation}
    worlds_of(case.task, 1, **{**case.environment, **names}).close()
    return made


def has_fast_contacts(model: str | Mapping[str, Any]) -> bool:
    """Return whether the ``model`` argument of an environment selects fast contacts."""
    return not isinstance(model, str) and model.get("contacts") == "fast"


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
