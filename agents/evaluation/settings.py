"""What an evaluation is asked to do: tasks, policies, seeds, and where the results go."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from agents.evaluation.entries import (
    HARDWARE_KEYS,
    Column,
    HardwareEntry,
    PolicyEntry,
    column,
    effect_arguments,
    hardware_entry,
    policy_entry,
)
from vibgym import checks
from vibgym.config import Settings, load_yaml, parse
from vibgym.registration import ENVIRONMENTS

DEFAULT_EPISODES = 100
DEFAULT_FIRST_SEED = 100_000

ENVIRONMENT_KEYS = (
    "surface",
    "parts",
    "model",
    "actuators",
    "sensor",
    "randomize",
    "start",
    "zones",
    "paths",
    "walls",
    "periods_per_step",
)
"""What an evaluation may set of the environment: action and observation belong to each policy."""


class EffectsSettings(Settings):
    """A study of which effect of the hardware breaks which policy: one table of success rates.

    Attributes:
        task: name of one of the evaluation's tasks.
        policies: each the name of one of the evaluation's policies, or a mapping of ``policy`` (that name), ``name`` (shown in
            the table) and ``sensor``: settings that lie over those of every case, such as ``{estimator: model}``.
        cases: name in the table -> arguments of the environment, see :data:`agents.evaluation.entries.HARDWARE_KEYS`.
        episodes: at most so many of each policy in each case; by default as many as the task has.
    """

    task: str
    policies: list[Any] = Field(min_length=1, max_length=12)
    cases: dict[str, Any] = Field(min_length=1, max_length=100)
    episodes: int | None = Field(default=None, ge=1, le=100_000)

    def columns(self, policies: Sequence[str]) -> list[Column]:
        """The policies of the table, checked against the names of the evaluation's."""
        found: list[Column] = []
        for index, entry in enumerate(self.policies):
            field = f"evaluation.effects.policies.{index}"
            each = column(entry, field, policies)
            if any(each.name == other.name for other in found):
                raise checks.refuse(f"{field}.name", each.name, "a name that no other policy of the table has")
            found.append(each)
        return found

    def arguments(self) -> dict[str, dict[str, Any]]:
        """Name of a case -> arguments of the environment, checked."""
        return {name: effect_arguments(name, content) for name, content in self.cases.items()}


class EvaluationSettings(Settings):
    """An evaluation of policies on tasks, all on the same seeds.

    Attributes:
        tasks: names of environments without ``vibgym/`` and version.
        policies: each a name ("zero"), the path of a trained policy, or a mapping of ``name`` (shown in the report),
            ``kind`` and the policy's own arguments, see :func:`agents.registry.make_policy`. From Python also objects that
            have ``predict``, themselves or as ``policy`` of such a mapping, beside ``action`` where they must be told which.
            Relative paths start from the current directory. A mapping may have ``tasks`` and ``hardware``, lists of names, on
            which the policy runs; by default it runs on all that it serves.
        episodes: number of episodes, with the seeds ``first_seed``, ``first_seed + 1``, ...
        task_episodes: other numbers of episodes for some tasks, by name.
        first_seed: see above.
        seeds: the seeds themselves, instead of ``episodes`` and ``first_seed``.
        environment: keyword arguments of the environments, see :data:`ENVIRONMENT_KEYS`.
        hardware: machines that all of it runs on, one after the other: name in the report -> keyword arguments of the
            environments that lie over ``environment`` (``actuators``, ``sensor``, ``randomize``), beside ``tasks``, a list of
            those that run on it, and ``episodes``, at most so many of each. By default there is one, of ``environment`` alone.
        effects: a study of which effect of the hardware breaks which policy, see :class:`EffectsSettings`.
        confidence: level of the intervals.
        resamples: number of bootstrap resamples.
        output: directory for the results, made if needed.
        animations: whether the report holds an animation of each policy on each task.
        processes: that share the pairs of policies and tasks, at most one a processor. They change nothing but the times. Each
            starts anew: what a program registers is known to the first one alone, and a program of your own must begin under
            ``if __name__ == "__main__":``.
        cost_per_period: whether it also says what one period costs with up to 64 parts, simulation and control apart.
    """

    tasks: list[str] = Field(min_length=1)
    policies: list[Any] = Field(min_length=1)
    episodes: int | None = Field(default=None, ge=1, le=100_000)
    task_episodes: dict[str, Any] = {}
    first_seed: int | None = Field(default=None, ge=0, lt=2**63)
    seeds: list[int] | None = Field(default=None, min_length=1, max_length=100_000)
    environment: dict[str, Any] = {}
    hardware: dict[str, Any] | None = Field(default=None, min_length=1, max_length=20)
    effects: EffectsSettings | None = None
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    resamples: int = Field(default=9999, ge=100, le=1_000_000)
    output: str = Field(default="runs/report", min_length=1)
    animations: bool = True
    processes: int = Field(default=1, ge=1, le=256)
    cost_per_period: bool = False

    def seed_list(self, task: str | None = None, most: int | None = None) -> list[int]:
        """The seed of every episode of a task, at most so many; of None, those of tasks without an own number."""
        own = None if task is None else self.task_episodes.get(task)
        if self.seeds is not None:
            return self.seeds[:own][:most]
        first = DEFAULT_FIRST_SEED if self.first_seed is None else self.first_seed
        return list(range(first, first + (own or self.episodes or DEFAULT_EPISODES)))[:most]

    def machines(self) -> list[HardwareEntry]:
        """The hardware, checked."""
        return [hardware_entry(name, content, self.tasks) for name, content in self._hardware().items()]

    def _hardware(self) -> dict[str, Any]:
        """As given, or the one that there is without: it is called what it is."""
        return self.hardware or {"own" if set(self.environment) & set(HARDWARE_KEYS) else "ideal": {}}

    def entries(self) -> list[PolicyEntry]:
        """The policies, each with its tasks and hardware."""
        found: list[PolicyEntry] = []
        for index, policy in enumerate(self.policies):
            entry = policy_entry(policy, f"policies.{index}", self.tasks, list(self._hardware()))
            checks.label(f"policies.{index}.name", entry.name)
            if any(entry.name == other.name for other in found):
                raise checks.refuse(f"policies.{index}.name", entry.name, "a name that no other policy has")
            found.append(entry)
        return found

    def named_policies(self) -> dict[str, Any]:
        """Name in the report -> what :func:`agents.registry.make_policy` takes."""
        return {entry.name: entry.content for entry in self.entries()}

    def as_written(self) -> dict[str, Any]:
        """All of it as values for JSON, policies by their names."""
        policies = {}
        for entry in self.entries():
            own = {key: names for key in ("tasks", "hardware") if (names := getattr(entry, key)) is not None}
            policies[entry.name] = {"policy": entry.content, **own} if own else entry.content
        given = self.model_dump(exclude={"policies", "processes", "hardware", "effects"})
        more = {} if self.effects is None else {"effects": self.effects.model_dump()}
        return {**given, "hardware": self._hardware(), **more, "policies": policies}


def settings_from(data: Any, episodes: int | None = None, output: str | None = None) -> EvaluationSettings:
    """Checked settings from a mapping.

    Args:
        data: the mapping, with the attributes of :class:`EvaluationSettings` as keys.
        episodes: another number of episodes, for all tasks; of explicit seeds, the first ones.
        output: another output directory.

    Raises:
        ValueError: the first fault, in one line.
    """
    settings = parse(EvaluationSettings, data, "evaluation")
    for field in ("episodes", "first_seed"):
        if settings.seeds is not None and getattr(settings, field) is not None:
            raise checks.refuse(f"evaluation.{field}", getattr(settings, field), "nothing beside explicit 'seeds'")
    for field in ("tasks", "seeds"):
        values = getattr(settings, field) or []
        if len(set(values)) != len(values):
            twice = next(value for value in values if values.count(value) > 1)
            raise checks.refuse(f"evaluation.{field}", twice, "each value once")
    for index, task in enumerate(settings.tasks):
        checks.choice(f"evaluation.tasks.{index}", task, tuple(ENVIRONMENTS))
    most = 100_000 if settings.seeds is None else len(settings.seeds)
    for task, count in settings.task_episodes.items():
        checks.choice("evaluation.task_episodes", task, tuple(settings.tasks))
        checks.count(f"evaluation.task_episodes.{task}", count, most=most)
    for index, seed in enumerate(settings.seeds or []):
        checks.count(f"evaluation.seeds.{index}", seed, least=0, most=2**63 - 1)
    for key in settings.environment:
        checks.choice("evaluation.environment", key, ENVIRONMENT_KEYS)
    settings.machines()
    settings.entries()
    if settings.effects is not None:
        checks.choice("evaluation.effects.task", settings.effects.task, tuple(settings.tasks))
        settings.effects.columns(list(settings.named_policies()))
        settings.effects.arguments()
    changes: dict[str, Any] = {} if output is None else {"output": output}
    if episodes is not None:
        checks.count("--episodes", episodes, most=most)
        changes["task_episodes"] = {}
        changes |= {"episodes": episodes} if settings.seeds is None else {"seeds": settings.seeds[:episodes]}
    return settings.model_copy(update=changes)


def load_settings(path: Path, episodes: int | None = None, output: str | None = None) -> EvaluationSettings:
    """Checked settings from a YAML file; see :func:`settings_from`. Errors name the file."""
    data = load_yaml(path)
    try:
        return settings_from(data, episodes, output)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
