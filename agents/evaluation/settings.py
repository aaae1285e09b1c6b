"""Settings of all evaluations: policies on tasks and hardware with the same seeds, and studies of them."""

from __future__ import annotations

import json
from abc import abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from agents.provenance import portable
from agents.training_settings import Arguments, Plain, for_seed
from vibgym import checks
from vibgym.config import json_values, load_yaml
from vibgym.envs.vector import environment_id
from vibgym.seeds import RANGES, check_seeds
from vibgym.settings import BaseSettings, read

HARDWARE_KEYS = ("actuators", "sensor", "randomize")
"""Arguments of environments that describe the hardware model."""

ENVIRONMENT_KEYS = (
    "surface", "parts", "model", *HARDWARE_KEYS, "start", "zones", "paths", "walls", "costs", "periods_per_step",
    "task_settings",
)  # fmt: skip
"""Arguments that all environments share. Action and observation belong to the policies."""

MAX_NAME = 40
"""Characters of a name in tables."""

MAX_EPISODES = 100_000
DEFAULT_EPISODES = 100


def _known(*keys: str) -> AfterValidator:
    """Return a validator of mappings whose keys are among ``keys``."""

    def check(value: dict[str, Any]) -> dict[str, Any]:
        for key in value:
            checks.choice("key", key, keys)
        return value

    return AfterValidator(check)


def _differ(values: Sequence[Any]) -> Sequence[Any]:
    for value, count in Counter(values).items():
        if count > 1:
            raise checks.refuse("each value", value, "in the list only once")
    return values


Different = AfterValidator(_differ)
"""No value of a list occurs twice."""

Name = Annotated[str, AfterValidator(lambda value: checks.label("name", value, MAX_NAME))]
Names = Annotated[tuple[str, ...], Field(min_length=1), Different]
Task = Annotated[str, AfterValidator(lambda value: (environment_id(value, "task"), value)[1])]
Episodes = Annotated[int, Field(ge=1, le=MAX_EPISODES)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Environment = Annotated[Arguments, _known(*ENVIRONMENT_KEYS)]


class PolicyEntry(BaseSettings):
    """One policy: a name ("zero"), the path of a trained policy, an object with ``predict``, or a mapping of the keys below and
    of ``kind`` and the policy's own arguments, or ``policy`` (an object) with ``action``."""

    name: Name
    """In tables; by default the kind, or the stem of the path."""

    content: Any
    """Argument of :func:`vibgym.policies.make_policy`; its texts may hold {seed}."""

    tasks: Names | None = None
    """Those that it runs on; None: all that it serves."""

    hardware: Names | None = None
    """Those that it runs on; None: all."""

    group: Literal["learned", "hybrid", "classical"]
    """By default trained policies are learned, residual policies hybrid and all others classical."""

    training_seeds: Annotated[tuple[Seed, ...], Different] = Field(default=(), min_length=2, max_length=100)
    """They replace ``{seed}`` in its paths; empty: a single policy."""

    curve: str | None = Field(default=None, min_length=1)
    """Path of the learning curve, with {task} (in lower case) and {seed}."""

    training_steps: int | None = Field(default=None, ge=0)
    """Environment steps that it was trained on."""

    episodes: Episodes | None = None
    """At most so many on each task."""

    @model_validator(mode="before")
    @classmethod
    def _split(cls, entry: Any) -> Any:
        entry = json_values(entry)
        own, content = {}, entry
        if isinstance(entry, Mapping):
            own = {key: value for key, value in entry.items() if key in cls.model_fields}
            content = {key: value for key, value in entry.items() if key not in own}
            if "policy" in content:
                if not hasattr(content["policy"], "predict") or set(content) - {"policy", "action"}:
                    allowed = "an object with predict() as 'policy', with 'action' and the keys of all policies only"
                    raise checks.refuse("policy", entry, allowed)
                content = content if "action" in content else content["policy"]
        elif not isinstance(entry, str) and not hasattr(entry, "predict"):
            raise checks.refuse("policy", entry, "a name, the path of a trained policy, or a mapping with 'kind'")
        if isinstance(content, Mapping) and "policy" not in content:
            name = kind = content.get("kind")
        elif isinstance(content, str):
            name, kind = Path(content).stem if content.endswith(".json") else content, content
        else:
            model = content["policy"] if isinstance(content, Mapping) else content
            name, kind = str(getattr(model, "name", type(model).__name__)), None
        trained = kind == "trained" or (isinstance(kind, str) and kind.endswith(".json"))
        group = "hybrid" if kind == "residual" else "learned" if trained else "classical"
        return {"name": name, "group": group} | own | {"content": content}

    @model_validator(mode="after")
    def _check_seeds(self) -> Self:
        if self.training_seeds and self.group == "classical":
            raise checks.conflict("training_seeds cannot be set where group is classical")
        for what, value in (("policy", self.content), ("curve", self.curve)):
            if value is not None and ("{seed}" in json.dumps(value, default=repr)) != bool(self.training_seeds):
                raise checks.conflict(f"({what}): training_seeds requires {{seed}} in all paths, and vice versa")
        return self

    @property
    def own(self) -> dict[str, Any]:
        """Keys other than name and content that were set."""
        return {
            key: value for key, value in self if key in self.model_fields_set - {"name", "content", "group"} and value
        }

    @property
    def seeds(self) -> Sequence[int | None]:
        """Training seeds; (None,) for a single policy."""
        return self.training_seeds or (None,)

    def of_run(self, seed: int | None) -> Any:
        """Return the content for the policy of one training run."""
        return self.content if seed is None else for_seed(self.content, seed)

    def curve_path(self, task: str, seed: int | None) -> Path:
        """Return the path of the learning curve of one training run."""
        path = str(self.curve).replace("{task}", task.lower())
        return Path(path if seed is None else for_seed(path, seed))


class HardwareEntry(BaseSettings):
    """One hardware model: arguments of the environments that replace those of ``environment``."""

    actuators: Plain = None
    sensor: Plain = None
    randomize: Plain = None
    model: Plain = None
    tasks: Names | None = None
    """That run on it; None: all."""

    episodes: Episodes | None = None
    """At most so many of each task."""

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments that were set."""
        return {key: getattr(self, key) for key in (*HARDWARE_KEYS, "model") if key in self.model_fields_set}


class StudyPolicy(BaseSettings):
    """One policy of a study."""

    policy: str
    """Name of one of the evaluation's."""

    name: Name
    """In the table of the study."""

    sensor: Arguments = {}
    """Settings laid over every sensor."""

    trained_on: str = ""

    @model_validator(mode="before")
    @classmethod
    def _named(cls, entry: Any) -> Any:
        entry = {"policy": entry} if isinstance(entry, str) else entry
        return {"name": entry.get("policy"), **entry} if isinstance(entry, Mapping) else entry


class Study(BaseSettings):
    """Policies in several cases: arguments of the environments, which may name another ``task``."""

    name: Name = "effects"
    task: Task
    policies: tuple[StudyPolicy, ...] = Field(min_length=1, max_length=40)
    cases: dict[Name, Annotated[Arguments, _known(*ENVIRONMENT_KEYS, "task")]] = Field(min_length=1, max_length=100)
    episodes: Episodes | None = None
    """At most so many in each case; None: as many as the task has."""


class LoadSettings(BaseSettings):
    """Study of throughput: parts a minute against the number of parts in play, on a task in which parts come and go."""

    task: str
    policies: Names = Field(max_length=8)
    parts: Annotated[tuple[Annotated[int, Field(ge=1, le=10_000)], ...], Different] = Field(min_length=1, max_length=40)
    episodes: Episodes | None = None


class LadderSettings(BaseSettings):
    """Ablation: policies with learning curves that differ in one thing, such as the action."""

    name: Name
    task: str
    hardware: str | None = None
    """None: the first."""

    policies: Annotated[tuple[str, ...], Different] = Field(min_length=2, max_length=20)


class FileSettings(BaseSettings):
    """Settings of one command, from a file or a mapping."""

    where: ClassVar[str]
    """Name in errors."""

    output: str = Field(min_length=1)
    """Directory for the results, created if needed."""

    @classmethod
    def checked(cls, data: Any, episodes: int | None = None, output: str | None = None) -> Self:
        """Return checked settings from a mapping.

        Args:
            data: mapping with the attributes as keys.
            episodes: replaces the number of episodes of all tasks; of explicit seeds, the first ones are taken.
            output: replaces the output directory.

        Raises:
            ValueError: the first fault, in one line.
        """
        settings = cls.stored(data)
        changes: dict[str, Any] = {} if output is None else {"output": output}
        settings = settings.model_copy(update=changes | ({} if episodes is None else settings.limited(episodes)))
        settings.check_ranges()
        return settings

    @classmethod
    def stored(cls, data: Any) -> Self:
        """Return checked settings of stored results, with seeds of any range."""
        settings = read(cls, data, cls.where)
        settings.check()
        return settings

    @classmethod
    def load(cls, path: Path, episodes: int | None = None, output: str | None = None) -> Self:
        """Return checked settings from a YAML file, see :meth:`checked`. Errors name the file."""
        data = load_yaml(path)
        with checks.within(path):
            return cls.checked(data, episodes, output)

    def check(self) -> None:
        """Raise ValueError at the first setting that does not fit others."""

    @abstractmethod
    def check_ranges(self) -> None:
        """Raise ValueError at the first seed outside the ranges of the command."""

    @abstractmethod
    def limited(self, episodes: int) -> dict[str, Any]:
        """Return the fields to change for another number of episodes, that of ``--episodes``."""


class RunSettings(FileSettings):
    """Policies on tasks, all on the same seeds."""

    draws: ClassVar[bool] = False
    """Whether paths are recorded and drawn."""

    policy_keys: ClassVar[tuple[str, ...]]
    """Keys of a policy that the command uses; others are refused."""

    tasks: Annotated[tuple[Task, ...], Different] = Field(min_length=1)
    """Ids of registered environments; those of vibgym also without ``vibgym/`` and version."""

    policies: tuple[PolicyEntry, ...] = Field(min_length=1)
    episodes: Episodes | None = None
    """With the seeds ``first_seed``, ``first_seed + 1``, ..."""

    task_episodes: dict[str, Episodes] = {}
    """Other numbers of episodes for some tasks."""

    first_seed: Seed | None = None
    """By default the first of the range."""

    seeds: Annotated[tuple[Seed, ...], Different] | None = Field(default=None, min_length=1, max_length=MAX_EPISODES)
    """Instead of ``episodes`` and ``first_seed``."""

    environment: Environment = {}
    """Arguments of the environments."""

    hardware: dict[Name, HardwareEntry] | None = Field(default=None, min_length=1, max_length=20)
    """By default one, of ``environment`` alone."""

    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    """Level of the intervals."""

    resamples: int = Field(default=9999, ge=100, le=1_000_000)
    """Of bootstraps."""

    processes: int = Field(default=1, ge=1, le=256)
    """Worker processes, at most one per processor. They affect only the times. Each starts a new interpreter, so a script that
    calls this must be guarded by ``if __name__ == "__main__":``."""

    @property
    def ranges(self) -> tuple[str, ...]:
        """Names of the ranges of seeds that the command uses, see :mod:`vibgym.seeds`."""
        return "evaluation", "own"

    @property
    def intervals(self) -> tuple[float, int]:
        """Level and number of resamples of the intervals."""
        return self.confidence, self.resamples

    @property
    def names(self) -> list[str]:
        """Names of the policies."""
        return [policy.name for policy in self.policies]

    def with_policies(self, policies: Sequence[Any]) -> Self:
        """Return the same settings with other policies, checked."""
        data = {"tasks": self.tasks, "policies": policies, "output": self.output}
        entries = read(RunSettings, data, self.where).policies
        changed = self.model_copy(update={"policies": entries})
        changed.check()
        return changed

    def check_ranges(self) -> None:
        if self.seeds is None:
            longest = max((self.seed_list(task) for task in self.tasks), key=len)
            check_seeds(f"{self.where}.first_seed", longest[0], len(longest), *self.ranges)
        for seed in self.seeds or ():
            check_seeds(f"{self.where}.seeds", seed, 1, *self.ranges)

    def seed_list(self, task: str | None = None, most: int | None = None) -> list[int]:
        """Return the seeds of a task's episodes, at most ``most``; for None, those of tasks without their own number."""
        own = None if task is None else self.task_episodes.get(task)
        if self.seeds is not None:
            return list(self.seeds[:own][:most])
        first = RANGES[self.ranges[0]].start if self.first_seed is None else self.first_seed
        return list(range(first, first + (own or self.episodes or DEFAULT_EPISODES)))[:most]

    def machines(self) -> dict[str, HardwareEntry]:
        """Return the hardware, or the default: "ideal", or "own" if ``environment`` describes one."""
        return self.hardware or {"own" if set(self.environment) & set(HARDWARE_KEYS) else "ideal": HardwareEntry()}

    def environments(self) -> dict[str, dict[str, Any]]:
        """Return the arguments of the environments by hardware."""
        return {name: laid_over(self.environment, machine.arguments) for name, machine in self.machines().items()}

    def as_written(self) -> dict[str, Any]:
        """Return all of it as JSON values: policies by name, without absolute paths and studies that are not set."""
        values = self.model_dump(exclude={"policies", "processes", "hardware", "held_out", "environment"})
        values = {name: value for name, value in values.items() if value is not None and value != ()}
        hardware = {
            name: machine.arguments | machine.model_dump(include={"tasks", "episodes"}, exclude_none=True)
            for name, machine in self.machines().items()
        }
        policies = {
            policy.name: {"policy": policy.content, **policy.own} if policy.own else policy.content
            for policy in self.policies
        }
        return portable({**values, "environment": self.environment, "hardware": hardware, "policies": policies})

    def check(self) -> None:
        where = self.where
        for field in ("episodes", "first_seed"):
            if self.seeds is not None and getattr(self, field) is not None:
                raise checks.conflict(f"{where}.{field} cannot be set together with seeds")
        for task, count in self.task_episodes.items():
            checks.choice(f"{where}.task_episodes", task, self.tasks)
            checks.count(f"{where}.task_episodes.{task}", count, most=len(self.seeds or range(MAX_EPISODES)))
        machines = self.machines()
        for name, machine in machines.items():
            some_of(f"{where}.hardware.{name}.tasks", machine.tasks or (), self.tasks)
        for index, policy in enumerate(self.policies):
            field = f"{where}.policies.{index}"
            if policy.name in self.names[:index]:
                raise checks.conflict(f"{field}.name: {policy.name!r} is the name of another policy")
            for key in policy.own:
                if key not in self.policy_keys:
                    keys = ", ".join(self.policy_keys)
                    raise checks.conflict(f"{field}.{key}: {where}.policies have no such key, only {keys}")
            some_of(f"{field}.tasks", policy.tasks or (), self.tasks)
            some_of(f"{field}.hardware", policy.hardware or (), machines)

    def limited(self, episodes: int) -> dict[str, Any]:
        checks.count("--episodes", episodes, most=len(self.seeds or range(MAX_EPISODES)))
        number = {"episodes": episodes} if self.seeds is None else {"seeds": self.seeds[:episodes]}
        return {"task_episodes": {}, **number}


class EvaluationSettings(RunSettings):
    """Settings of ``python -m agents evaluate``: runs and their studies."""

    where: ClassVar[str] = "evaluation"
    draws: ClassVar[bool] = True
    policy_keys: ClassVar[tuple[str, ...]] = ("tasks", "hardware", "curve")

    effects: Study | None = None
    """Effects of the hardware."""

    generalisation: tuple[Study, ...] = ()
    """Policies, trained on one thing, by cases."""

    ladders: tuple[LadderSettings, ...] = ()
    under_load: LoadSettings | None = None
    animations: bool = True
    """Whether the report has a film of each policy on each task."""

    held_out: bool = False
    """Whether the seeds are those of suites, for results that are published beside scores."""

    output: str = Field(default="runs/report", min_length=1)

    @property
    def ranges(self) -> tuple[str, ...]:
        """Names of the ranges of seeds."""
        return ("held_out",) if self.held_out else super().ranges

    @property
    def studies(self) -> dict[str, Study]:
        """The studies by their place in the settings."""
        effects = {} if self.effects is None else {"effects": self.effects}
        return effects | {f"generalisation.{k}": study for k, study in enumerate(self.generalisation)}

    def label(self, place: str) -> str:
        """Return the label of a study in the table of episodes."""
        return place if place == "effects" else f"generalisation: {self.studies[place].name}"

    def check(self) -> None:
        super().check()
        where, entries, load = self.where, {policy.name: policy for policy in self.policies}, self.under_load
        for place, study in self.studies.items():
            for index, policy in enumerate(study.policies):
                checks.choice(f"{where}.{place}.policies.{index}", policy.policy, entries)
            _all_differ(f"{where}.{place}.policies", [policy.name for policy in study.policies])
        if self.effects is not None:
            checks.choice(f"{where}.effects.task", self.effects.task, self.tasks)
        if load is not None:
            checks.choice(f"{where}.under_load.task", load.task, self.tasks)
            some_of(f"{where}.under_load.policies", load.policies, entries)
        for index, ladder in enumerate(self.ladders):
            field = f"{where}.ladders.{index}"
            checks.choice(f"{field}.task", ladder.task, self.tasks)
            checks.choice(f"{field}.hardware", self.ladder_hardware(ladder), self.machines())
            for name in some_of(f"{field}.policies", ladder.policies, entries):
                if entries[name].curve is None:
                    raise checks.conflict(f"{field}.policies: {name!r} has no curve")
        _all_differ(f"{where} (name of a study)", [study.name for study in (*self.generalisation, *self.ladders)])

    def ladder_hardware(self, ladder: LadderSettings) -> str:
        """Return the hardware of a ladder, by default the first."""
        return ladder.hardware or next(iter(self.machines()))


class ComparisonSettings(EvaluationSettings):
    """Settings of ``python -m agents compare``: the same, without pictures."""

    where: ClassVar[str] = "comparison"
    draws: ClassVar[bool] = False
    policy_keys: ClassVar[tuple[str, ...]] = ("tasks", "hardware", "curve", "training_seeds")

    output: str = Field(default="runs/comparison", min_length=1)


class SuiteSettings(RunSettings):
    """Settings of ``python -m agents score``: every policy on every task and all hardware; unserved tasks score 0."""

    where: ClassVar[str] = "suite"
    policy_keys: ClassVar[tuple[str, ...]] = ("tasks", "hardware", "training_steps", "episodes")

    training_steps: int = Field(ge=1)
    """Environment steps, all tasks together, that a policy may have been trained on."""

    cost_limit: float | None = Field(default=None, ge=0.0)
    """Largest cost of an episode, for environments with ``costs``; others score 0 (reward at limited cost)."""

    output: str = Field(default="runs/suite", min_length=1)

    @property
    def ranges(self) -> tuple[str, ...]:
        """Names of the ranges of seeds."""
        return ("held_out",)

    def check(self) -> None:
        super().check()
        for index, policy in enumerate(self.policies):
            if policy.training_steps is not None:
                field = f"{self.where}.policies.{index}.training_steps"
                checks.count(field, policy.training_steps, least=0, most=self.training_steps)

    def entered_by(self, path: Path) -> SuiteSettings:
        """Return the same protocol for the policy of a file alone.

        Args:
            path: YAML or JSON, a mapping as in ``policies``; or the JSON file of a trained policy.

        Raises:
            ValueError: the file cannot be read, or describes no policy.
        """
        content = load_yaml(path)
        if "kind" not in content:
            if path.suffix != ".json":
                raise checks.missing("kind", f"required in {path}, unless it is a trained policy's JSON file")
            content = {"kind": "trained", "path": str(path)}
        with checks.within(path):
            return self.with_policies([{"name": path.stem, **content}])


def some_of(field: str, names: Sequence[Any], known: Any) -> Sequence[Any]:
    """Return ``names``, checked to be among ``known``."""
    for name in names:
        checks.choice(field, name, tuple(known))
    return names


def _all_differ(field: str, values: Sequence[Any]) -> None:
    with checks.within(field):
        _differ(values)


def laid_over(environment: Mapping[str, Any], arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of an environment on some hardware: ``randomize`` is merged, all else replaced."""
    result = {**environment, **arguments}
    both = [mapping.get("randomize") for mapping in (environment, arguments)]
    if all(isinstance(ranges, Mapping) for ranges in both):
        result["randomize"] = {**both[0], **both[1]}  # type: ignore[dict-item]
    return result


def with_sensor(environment: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of an environment with some settings of its sensor replaced."""
    if not settings:
        return dict(environment)
    sensor = environment.get("sensor", "ideal")
    return {**environment, "sensor": {**(sensor if isinstance(sensor, Mapping) else {"kind": sensor}), **settings}}
