"""What an evaluation is asked to do: tasks, policies, seeds, and where the results go."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

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
    "walls",
    "periods_per_step",
)
"""What an evaluation may set of the environment: action and observation belong to each policy."""


@dataclass(frozen=True)
class PolicyEntry:
    """One policy of an evaluation."""

    name: str  # in the report
    content: Any  # what :func:`agents.registry.make_policy` takes
    tasks: tuple[str, ...] | None  # on which it runs; None: on all that it serves


class EvaluationSettings(Settings):
    """An evaluation of policies on tasks, all on the same seeds.

    Attributes:
        tasks: names of environments without ``vibgym/`` and version.
        policies: each a name ("zero"), the path of a trained policy, or a mapping of ``name`` (shown in the report),
            ``kind`` and the policy's own arguments, see :func:`agents.registry.make_policy`. From Python also objects that
            have ``predict``, themselves or as ``policy`` of such a mapping, beside ``action`` where they must be told which.
            Relative paths start from the current directory. A mapping may have ``tasks``, on which the policy runs; by
            default it runs on all that it serves.
        episodes: number of episodes, with the seeds ``first_seed``, ``first_seed + 1``, ...
        task_episodes: other numbers of episodes for some tasks, by name.
        first_seed: see above.
        seeds: the seeds themselves, instead of ``episodes`` and ``first_seed``.
        environment: keyword arguments of the environments, see :data:`ENVIRONMENT_KEYS`.
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
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    resamples: int = Field(default=9999, ge=100, le=1_000_000)
    output: str = Field(default="runs/report", min_length=1)
    animations: bool = True
    processes: int = Field(default=1, ge=1, le=256)
    cost_per_period: bool = False

    def seed_list(self, task: str | None = None) -> list[int]:
        """The seed of every episode of a task; of None, those of tasks without an own number."""
        own = None if task is None else self.task_episodes.get(task)
        if self.seeds is not None:
            return self.seeds[:own]
        first = DEFAULT_FIRST_SEED if self.first_seed is None else self.first_seed
        return list(range(first, first + (own or self.episodes or DEFAULT_EPISODES)))

    def entries(self) -> list[PolicyEntry]:
        """The policies, each with its tasks."""
        found: list[PolicyEntry] = []
        for index, policy in enumerate(self.policies):
            entry = _entry(policy, f"policies.{index}", self.tasks)
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
        policies = {
            entry.name: entry.content if entry.tasks is None else {"policy": entry.content, "tasks": entry.tasks}
            for entry in self.entries()
        }
        return {**self.model_dump(exclude={"policies", "processes"}), "policies": policies}


def _entry(policy: Any, field: str, tasks: list[str]) -> PolicyEntry:
    if hasattr(policy, "predict"):
        return PolicyEntry(_object_name(policy), policy, None)
    if isinstance(policy, str):
        return PolicyEntry(Path(policy).stem if policy.endswith(".json") else policy, policy, None)
    if not isinstance(policy, Mapping):
        raise checks.refuse(field, policy, "a name, the path of a trained policy, or a mapping with 'kind'")
    content = dict(policy)
    own = content.pop("tasks", None)
    if own is not None:
        allowed = f"a list of different tasks among {', '.join(tasks)}"
        if not isinstance(own, list | tuple) or not own:
            raise checks.refuse(f"{field}.tasks", own, allowed)
        if any(task not in tasks or own.count(task) > 1 for task in own):
            raise checks.refuse(f"{field}.tasks", own, allowed)
    subject: Any = content
    default = content.get("kind")
    if "policy" in content:
        model = content["policy"]
        if not hasattr(model, "predict") or set(content) - {"policy", "action", "name"}:
            allowed = "an object with predict() as 'policy', beside 'action', 'name' and 'tasks' alone"
            raise checks.refuse(field, policy, allowed)
        default = _object_name(model)
        if "action" not in content:
            subject = model
    name = content.pop("name", default)
    checks.label(f"{field}.name", name, most=40)
    return PolicyEntry(name, subject, None if own is None else tuple(own))


def _object_name(policy: Any) -> str:
    return str(getattr(policy, "name", type(policy).__name__))


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
    settings.entries()
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
