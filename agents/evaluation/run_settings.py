"""What is run, however it is judged: policies on tasks and hardware, all on the same seeds."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import Field

from agents.evaluation.entries import HARDWARE_KEYS, HardwareEntry, PolicyEntry, hardware_entry, laid_over, policy_entry
from agents.provenance import portable
from vibgym import checks
from vibgym.config import Settings, load_yaml, parse
from vibgym.envs.named import environment_id

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
    "task_settings",
)
"""What may be set of the environment: action and observation belong to each policy."""


class RunSettings(Settings):
    """Policies on tasks, all on the same seeds; :class:`agents.evaluation.settings.EvaluationSettings` and
    :class:`agents.evaluation.comparison.contenders.ComparisonSettings` say how they are judged.

    Attributes:
        tasks: ids of registered environments; those of vibgym also without ``vibgym/`` and version.
        policies: each a name ("zero"), the path of a trained policy, or a mapping of ``name`` (shown in the report),
            ``kind`` and the policy's own arguments, see :func:`vibgym.policies.make_policy`. From Python also objects that
            have ``predict``, themselves or as ``policy`` of such a mapping, beside ``action`` where they must be told which.
            Relative paths start from the current directory. A mapping may have ``tasks`` and ``hardware``, lists of names, on
            which the policy runs; by default it runs on all that it serves.
        episodes: number of episodes, with the seeds ``first_seed``, ``first_seed + 1``, ...
        task_episodes: other numbers of episodes for some tasks, by name.
        first_seed: see above.
        seeds: the seeds themselves, instead of ``episodes`` and ``first_seed``.
        environment: keyword arguments of the environments, see :data:`ENVIRONMENT_KEYS`.
        hardware: machines that all of it runs on, one after the other: name in the report -> keyword arguments of the
            environments that lie over ``environment`` (``actuators``, ``sensor``, ``randomize``, ``model``), beside ``tasks``,
            a list of those that run on it, and ``episodes``, at most so many of each. By default there is one, of
            ``environment`` alone.
        confidence: level of the intervals.
        resamples: number of bootstrap resamples.
        output: directory for the results, made if needed.
        processes: that share the pairs of policies and tasks, at most one a processor. They change nothing but the times. Each
            starts anew: what a program registers is known to the first one alone, and a program of your own must begin under
            ``if __name__ == "__main__":``.
    """

    where: ClassVar[str] = "evaluation"
    """What errors call it."""

    tasks: list[str] = Field(min_length=1)
    policies: list[Any] = Field(min_length=1)
    episodes: int | None = Field(default=None, ge=1, le=100_000)
    task_episodes: dict[str, Any] = {}
    first_seed: int | None = Field(default=None, ge=0, lt=2**63)
    seeds: list[int] | None = Field(default=None, min_length=1, max_length=100_000)
    environment: dict[str, Any] = {}
    hardware: dict[str, Any] | None = Field(default=None, min_length=1, max_length=20)
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    resamples: int = Field(default=9999, ge=100, le=1_000_000)
    output: str = Field(default="runs/report", min_length=1)
    processes: int = Field(default=1, ge=1, le=256)

    def seed_list(self, task: str | None = None, most: int | None = None) -> list[int]:
        """The seed of every episode of a task, at most so many; of None, those of tasks without an own number."""
        own = None if task is None else self.task_episodes.get(task)
        if self.seeds is not None:
            return self.seeds[:own][:most]
        first = DEFAULT_FIRST_SEED if self.first_seed is None else self.first_seed
        return list(range(first, first + (own or self.episodes or DEFAULT_EPISODES)))[:most]

    def machines(self) -> list[HardwareEntry]:
        """The hardware, checked."""
        return [
            hardware_entry(f"{self.where}.hardware", name, content, self.tasks)
            for name, content in self.named_hardware().items()
        ]

    def named_hardware(self) -> dict[str, Any]:
        """As given, or the one that there is without: it is called what it is."""
        return self.hardware or {"own" if set(self.environment) & set(HARDWARE_KEYS) else "ideal": {}}

    def entries(self) -> list[PolicyEntry]:
        """The policies, each with its tasks and hardware."""
        found: list[PolicyEntry] = []
        for index, policy in enumerate(self.policies):
            entry = policy_entry(policy, f"policies.{index}", self.tasks, list(self.named_hardware()))
            checks.label(f"policies.{index}.name", entry.name)
            if any(entry.name == other.name for other in found):
                raise checks.refuse(f"policies.{index}.name", entry.name, "a name that no other policy has")
            found.append(entry)
        return found

    def named_policies(self) -> dict[str, Any]:
        """Name in the report -> what :func:`vibgym.policies.registry.make_policy` takes."""
        return {entry.name: entry.content for entry in self.entries()}

    def environments(self) -> dict[str, dict[str, Any]]:
        """Name of the machine -> keyword arguments of the environments on it."""
        return {each.name: laid_over(self.environment, each.arguments) for each in self.machines()}

    def as_written(self) -> dict[str, Any]:
        """All of it as values for JSON, policies by their names, without paths of this machine alone."""
        given = self.model_dump(exclude={"policies", "processes", "hardware"})
        return portable({**given, "hardware": self.named_hardware(), "policies": self.written_policies()})

    def written_policies(self) -> dict[str, Any]:
        """What the settings say of every policy, by its name."""
        return {
            entry.name: {"policy": entry.content, **entry.limits} if entry.limits else entry.content
            for entry in self.entries()
        }

    def check(self) -> None:
        """Check what only one kind of settings has.

        Raises:
            ValueError: the first fault, in one line.
        """

    @classmethod
    def checked(cls, data: Any, episodes: int | None = None, output: str | None = None) -> Self:
        """Checked settings from a mapping.

        Args:
            data: the mapping, with the attributes as keys.
            episodes: another number of episodes, for all tasks; of explicit seeds, the first ones.
            output: another output directory.

        Raises:
            ValueError: the first fault, in one line.
        """
        where = cls.where
        settings = parse(cls, data, where)
        for field in ("episodes", "first_seed"):
            if settings.seeds is not None and getattr(settings, field) is not None:
                raise checks.refuse(f"{where}.{field}", getattr(settings, field), "nothing beside explicit 'seeds'")
        for field in ("tasks", "seeds"):
            values = getattr(settings, field) or []
            if len(set(values)) != len(values):
                twice = next(value for value in values if values.count(value) > 1)
                raise checks.refuse(f"{where}.{field}", twice, "each value once")
        for index, task in enumerate(settings.tasks):
            environment_id(task, f"{where}.tasks.{index}")
        most = 100_000 if settings.seeds is None else len(settings.seeds)
        for task, count in settings.task_episodes.items():
            checks.choice(f"{where}.task_episodes", task, tuple(settings.tasks))
            checks.count(f"{where}.task_episodes.{task}", count, most=most)
        for index, seed in enumerate(settings.seeds or []):
            checks.count(f"{where}.seeds.{index}", seed, least=0, most=2**63 - 1)
        for key in settings.environment:
            checks.choice(f"{where}.environment", key, ENVIRONMENT_KEYS)
        settings.machines()
        settings.entries()
        settings.check()
        changes: dict[str, Any] = {} if output is None else {"output": output}
        if episodes is not None:
            checks.count("--episodes", episodes, most=most)
            changes["task_episodes"] = {}
            changes |= {"episodes": episodes} if settings.seeds is None else {"seeds": settings.seeds[:episodes]}
        return settings.model_copy(update=changes)

    @classmethod
    def load(cls, path: Path, episodes: int | None = None, output: str | None = None) -> Self:
        """Checked settings from a YAML file; see :meth:`checked`. Errors name the file."""
        data = load_yaml(path)
        with checks.within(path):
            return cls.checked(data, episodes, output)
