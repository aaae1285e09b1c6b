"""Settings of all evaluations: policies on tasks and hardware with the same seeds, and the studies of each command."""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field

from agents.provenance import portable
from agents.training_settings import Arguments, Plain, for_seed
from vibgym import checks
from vibgym.config import load_yaml
from vibgym.envs.vector import environment_id
from vibgym.seeds import RANGES, check_seeds
from vibgym.settings import BaseSettings, read

HARDWARE_KEYS = ("actuators", "sensor", "randomize")
"""Arguments of environments that describe the hardware model."""

CASE_KEYS = (*HARDWARE_KEYS, "model")
"""Arguments that a hardware entry or a case of the study of effects may set."""

ENVIRONMENT_KEYS = (
    "surface", "parts", "model", "actuators", "sensor", "randomize", "start", "zones", "paths", "walls", "costs",
    "periods_per_step", "task_settings",
)  # fmt: skip
"""Arguments that all environments share. Action and observation belong to the policies."""

MOST_NAME = 40
"""Characters of a name in tables."""

MOST_EPISODES = 100_000
DEFAULT_EPISODES = 100
Episodes = Annotated[int, Field(ge=1, le=MOST_EPISODES)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Names = Annotated[tuple[str, ...], Field(min_length=1)]


class PolicyEntry(BaseSettings):
    """One policy of the settings."""

    name: str  # in tables
    content: Any  # argument of make_policy; its texts may hold {seed}
    tasks: Names | None = None  # on which it runs; None: all that it serves
    hardware: Names | None = None
    group: Literal["learned", "hybrid", "classical"] | None = None  # a hybrid is a residual on a classical controller
    training_seeds: tuple[Seed, ...] = Field(default=(), min_length=2, max_length=100)  # empty: a single policy
    curve: str | None = Field(default=None, min_length=1)  # path of the learning curve, with {task} and {seed}
    training_steps: int | None = Field(default=None, ge=0)
    episodes: Episodes | None = None  # at most so many on each task

    @property
    def own(self) -> dict[str, Any]:
        """Keys other than name and content that are set."""
        values = self.model_dump(include={"tasks", "hardware", "group", "training_seeds", "curve"})
        return {key: value for key, value in values.items() if value}

    @property
    def seeds(self) -> Sequence[int | None]:
        """Training seeds; (None,) for a single policy."""
        return self.training_seeds or (None,)

    def run(self, seed: int | None) -> Any:
        """Return the content for the policy of one training run."""
        return self.content if seed is None else for_seed(self.content, seed)

    def curve_path(self, task: str, seed: int | None) -> Path:
        """Return the path of the learning curve of one training run."""
        assert self.curve is not None
        path = self.curve.replace("{task}", task.lower())
        return Path(path if seed is None else for_seed(path, seed))


class HardwareEntry(BaseSettings):
    """One hardware model: ``arguments`` of the environments, ``tasks`` that run on it, at most so many ``episodes`` of each."""

    name: str
    arguments: dict[str, Any]
    tasks: Names | None = None
    episodes: Episodes | None = None

    def runs(self, policy: PolicyEntry, task: str) -> bool:
        """Return whether a policy is to run on a task on this hardware."""
        wanted = all(tasks is None or task in tasks for tasks in (policy.tasks, self.tasks))
        return wanted and (policy.hardware is None or self.name in policy.hardware)


class StudyPolicy(BaseSettings):
    """One policy of a study: its name in the table, the evaluation's policy, settings laid over every sensor."""

    name: str
    policy: str
    sensor: Arguments = {}
    trained_on: str = ""


@dataclass(frozen=True)
class StudyCase:
    """One case of a study: arguments of the environments of a task."""

    name: str
    task: str
    arguments: dict[str, Any]


class EffectsSettings(BaseSettings):
    """Study of hardware effects: success of policies on one task in several cases."""

    task: str  # one of the evaluation's
    policies: tuple[Plain, ...] = Field(min_length=1, max_length=40)  # names of the evaluation's, or StudyPolicy
    cases: Arguments = Field(min_length=1, max_length=100)  # name -> arguments of the environments
    episodes: Episodes | None = None  # at most so many in each case; None: as many as the task has

    keys: ClassVar[tuple[str, ...]] = CASE_KEYS

    def columns(self, where: str, policies: Sequence[str]) -> list[StudyPolicy]:
        """Return the policies of the study, checked against the names of the evaluation's."""
        found: list[StudyPolicy] = []
        for index, entry in enumerate(self.policies):
            field = f"{where}.policies.{index}"
            if not isinstance(entry, Mapping):
                checks.choice(field, entry, policies)
                entry = {"policy": entry}
            policy = read(StudyPolicy, {"name": entry.get("policy"), **entry}, field)
            checks.choice(f"{field}.policy", policy.policy, policies)
            checks.label(f"{field}.name", policy.name, most=MOST_NAME)
            if policy.trained_on:
                checks.label(f"{field}.trained_on", policy.trained_on)
            found.append(policy)
        all_differ(f"{where}.policies", [policy.name for policy in found])
        return found

    def tests(self, where: str) -> list[StudyCase]:
        """Return the cases, checked."""
        found = []
        for name, content in self.cases.items():
            field = f"{where}.cases.{checks.label(f'{where}.cases (a name)', name, most=MOST_NAME)}"
            arguments = mapping_of(field, content, self.keys)
            task = arguments.pop("task", self.task)
            environment_id(task, f"{field}.task")
            found.append(StudyCase(name, task, arguments))
        return found

    def check(self, where: str, policies: Sequence[str]) -> None:
        """Check all of it; errors begin with ``where``."""
        environment_id(self.task, f"{where}.task")
        self.columns(where, policies)
        self.tests(where)


class MatrixSettings(EffectsSettings):
    """Generalisation matrix: policies, ``trained_on`` one thing, by cases, which may set another task and everything else."""

    name: str

    keys: ClassVar[tuple[str, ...]] = (*ENVIRONMENT_KEYS, "task")


class LoadSettings(BaseSettings):
    """Study of throughput: parts a minute against the number of parts in play, on a task in which parts come and go."""

    task: str
    policies: tuple[str, ...] = Field(min_length=1, max_length=8)
    parts: tuple[Annotated[int, Field(ge=1, le=10_000)], ...] = Field(min_length=1, max_length=40)
    episodes: Episodes | None = None


class LadderSettings(BaseSettings):
    """Ablation: policies with learning curves that differ in one thing, such as the action; default hardware: the first."""

    name: str
    task: str
    hardware: str | None = None
    policies: tuple[Any, ...] = Field(min_length=2, max_length=20)


class FileSettings(BaseSettings):
    """Settings of one command, from a file or a mapping."""

    where: ClassVar[str]
    """Name in errors."""

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
        if episodes is not None:
            changes |= settings.limited(episodes)
        settings = settings.model_copy(update=changes)
        settings.check_ranges()
        return settings

    @classmethod
    def stored(cls, data: Any) -> Self:
        """Return checked settings of stored results, with seeds of any range."""
        settings = read(cls, data, cls.where)
        settings.check()
        return settings

    @classmethod
    def load(cls, path: Path | None, episodes: int | None = None, output: str | None = None) -> Self:
        """Return checked settings from a YAML file, see :meth:`checked`; None: the defaults. Errors name the file."""
        if path is None:
            return cls.checked({}, episodes, output)
        data = load_yaml(path)
        with checks.within(path):
            return cls.checked(data, episodes, output)

    def check(self) -> None:
        """Check the settings; raise ValueError at the first fault."""

    @abstractmethod
    def check_ranges(self) -> None:
        """Check that the seeds are in a range of the command; raise ValueError at the first that is not."""

    @abstractmethod
    def limited(self, episodes: int) -> dict[str, Any]:
        """Return the fields to change for another number of episodes, that of ``--episodes``."""


class RunSettings(FileSettings):
    """Policies on tasks, all on the same seeds.

    Attributes:
        tasks: ids of registered environments; those of vibgym also without ``vibgym/`` and version.
        policies: each a name ("zero"), the path of a trained policy, or a mapping of ``name`` (in the tables), ``kind`` and the
            policy's own arguments, see :func:`vibgym.policies.make_policy`. From Python also objects with ``predict``, alone
            or as ``policy`` of such a mapping, with ``action`` if they do not declare it. Relative paths start from the current
            directory. A mapping may have ``tasks`` and ``hardware``, lists of names; by default a policy runs on all it serves.
        episodes: number of episodes, with the seeds ``first_seed``, ``first_seed + 1``, ...
        task_episodes: other numbers of episodes for some tasks, by name.
        first_seed: seed of the first episode, by default the first of :attr:`ranges`.
        seeds: explicit seeds, instead of ``episodes`` and ``first_seed``.
        environment: arguments of the environments, see :data:`ENVIRONMENT_KEYS`.
        hardware: hardware models: name -> arguments of the environments that replace those of ``environment`` (see
            :data:`CASE_KEYS`), ``tasks`` that run on it, and ``episodes``, at most so many of each. By default one, of
            ``environment`` alone.
        confidence: level of the intervals.
        resamples: number of bootstrap resamples.
        output: directory for the results, created if needed.
        processes: worker processes, at most one per processor. They affect only the times. Each starts a new interpreter, so a
            script that calls this must be guarded by ``if __name__ == "__main__":``.
    """

    where: ClassVar[str] = "evaluation"

    policy_keys: ClassVar[tuple[str, ...]] = ()
    """Keys of a policy's mapping in addition to ``name``, ``tasks`` and ``hardware`` that are no arguments of the policy."""

    tasks: tuple[str, ...] = Field(min_length=1)
    policies: tuple[Plain, ...] = Field(min_length=1)
    episodes: Episodes | None = None
    task_episodes: dict[str, Episodes] = {}
    first_seed: Seed | None = None
    seeds: tuple[Seed, ...] | None = Field(default=None, min_length=1, max_length=MOST_EPISODES)
    environment: Arguments = {}
    hardware: Arguments | None = Field(default=None, min_length=1, max_length=20)
    confidence: float = Field(default=0.95, gt=0.0, lt=1.0)
    resamples: int = Field(default=9999, ge=100, le=1_000_000)
    output: str = Field(default="runs/report", min_length=1)
    processes: int = Field(default=1, ge=1, le=256)

    @property
    def ranges(self) -> tuple[str, ...]:
        """Names of the ranges of seeds that the command uses, see :mod:`vibgym.seeds`."""
        return "evaluation", "own"

    @property
    def asked(self) -> tuple[float, int]:
        """Level and number of resamples of the intervals."""
        return self.confidence, self.resamples

    def check_ranges(self) -> None:
        """Check that all seeds are in one of :attr:`ranges`."""
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

    def named_hardware(self) -> dict[str, Any]:
        """Return the hardware as given, or the default: "ideal", or "own" if ``environment`` describes one."""
        return self.hardware or {"own" if set(self.environment) & set(HARDWARE_KEYS) else "ideal": {}}

    def hardware_entries(self) -> list[HardwareEntry]:
        """Return the hardware, checked."""
        found = []
        for name, content in self.named_hardware().items():
            field = f"{self.where}.hardware"
            field += f".{checks.label(f'{field} (a name)', name, most=MOST_NAME)}"
            arguments = mapping_of(field, content, (*CASE_KEYS, "tasks", "episodes"))
            limits = {key: arguments.pop(key, None) for key in ("tasks", "episodes")}
            entry = read(HardwareEntry, {"name": name, "arguments": arguments, **limits}, field)
            some_of(f"{field}.tasks", entry.tasks or (), self.tasks)
            found.append(entry)
        return found

    def environments(self) -> dict[str, dict[str, Any]]:
        """Return the arguments of the environments by hardware."""
        return {each.name: laid_over(self.environment, each.arguments) for each in self.hardware_entries()}

    def entries(self) -> list[PolicyEntry]:
        """Return the policies, checked."""
        found: list[PolicyEntry] = []
        for index, policy in enumerate(self.policies):
            field = f"{self.where}.policies.{index}"
            entry = self.entry(policy, field)
            checks.label(f"{field}.name", entry.name, most=MOST_NAME)
            if any(entry.name == other.name for other in found):
                raise checks.conflict(f"{field}.name: {entry.name!r} is the name of another policy")
            found.append(entry)
        return found

    def entry(self, policy: Any, field: str) -> PolicyEntry:
        """Return one policy, checked; errors begin with ``field``."""
        content, own = policy, {}
        if isinstance(policy, Mapping):
            keys = ("name", "tasks", "hardware", *self.policy_keys)
            own = {key: policy[key] for key in keys if key in policy}
            content = {key: value for key, value in policy.items() if key not in own}
            if "policy" in content:
                if not hasattr(content["policy"], "predict") or set(content) - {"policy", "action"}:
                    allowed = "an object with predict() as 'policy', with 'action', 'name', 'tasks' and 'hardware' only"
                    raise checks.refuse(field, policy, allowed)
                content = content if "action" in content else content["policy"]
        elif not isinstance(policy, str) and not hasattr(policy, "predict"):
            raise checks.refuse(field, policy, "a name, the path of a trained policy, or a mapping with 'kind'")
        entry = read(PolicyEntry, self.defaults(content) | own | {"content": content}, field)
        some_of(f"{field}.tasks", entry.tasks or (), self.tasks)
        some_of(f"{field}.hardware", entry.hardware or (), tuple(self.named_hardware()))
        return entry

    def defaults(self, content: Any) -> dict[str, Any]:
        """Return the keys of a policy that follow from its content."""
        if isinstance(content, str):
            return {"name": Path(content).stem if content.endswith(".json") else content}
        if isinstance(content, Mapping) and "policy" not in content:
            return {"name": content.get("kind")}
        model = content["policy"] if isinstance(content, Mapping) else content
        return {"name": str(getattr(model, "name", type(model).__name__))}

    def as_written(self) -> dict[str, Any]:
        """Return all of it as JSON values: policies by name, without absolute paths and studies that are not set."""
        unset = {name for name in ("effects", "under_load") if getattr(self, name, None) is None}
        given = self.model_dump(exclude={"policies", "processes", "hardware", "held_out"} | unset)
        policies = {
            entry.name: {"policy": entry.content, **entry.own} if entry.own else entry.content
            for entry in self.entries()
        }
        return portable({**given, "hardware": self.named_hardware(), "policies": policies})

    def check(self) -> None:
        """Check the settings; raise ValueError at the first fault."""
        where = self.where
        for field in ("episodes", "first_seed"):
            if self.seeds is not None and getattr(self, field) is not None:
                raise checks.conflict(f"{where}.{field} cannot be set together with seeds")
        for field in ("tasks", "seeds"):
            all_differ(f"{where}.{field}", getattr(self, field) or [])
        for index, task in enumerate(self.tasks):
            environment_id(task, f"{where}.tasks.{index}")
        for task, count in self.task_episodes.items():
            checks.choice(f"{where}.task_episodes", task, self.tasks)
            checks.count(f"{where}.task_episodes.{task}", count, most=len(self.seeds or range(MOST_EPISODES)))
        for key in self.environment:
            checks.choice(f"{where}.environment", key, ENVIRONMENT_KEYS)
        self.hardware_entries()
        self.entries()

    def limited(self, episodes: int) -> dict[str, Any]:
        """Return the fields to change for another number of episodes, that of ``--episodes``."""
        checks.count("--episodes", episodes, most=len(self.seeds or range(MOST_EPISODES)))
        number = {"episodes": episodes} if self.seeds is None else {"seeds": self.seeds[:episodes]}
        return {"task_episodes": {}, **number}


class EvaluationSettings(RunSettings):
    """Settings of ``python -m agents evaluate``.

    Attributes:
        effects: study of hardware effects, see :class:`EffectsSettings`.
        under_load: study of throughput, see :class:`LoadSettings`.
        animations: whether the report has a film of each policy on each task.
        held_out: whether the seeds are those of suites, for results that are published beside scores.
    """

    effects: EffectsSettings | None = None
    under_load: LoadSettings | None = None
    animations: bool = True
    held_out: bool = False

    @property
    def ranges(self) -> tuple[str, ...]:
        """Names of the ranges of seeds."""
        return ("held_out",) if self.held_out else super().ranges

    def check(self) -> None:
        """Check the settings and the studies."""
        super().check()
        names, load, effects = [each.name for each in self.entries()], self.under_load, self.effects
        if load is not None:
            where = "evaluation.under_load"
            checks.choice(f"{where}.task", load.task, self.tasks)
            some_of(f"{where}.policies", load.policies, names)
            all_differ(f"{where}.parts", load.parts)
        if effects is not None:
            checks.choice("evaluation.effects.task", effects.task, self.tasks)
            effects.check("evaluation.effects", names)


class ComparisonSettings(RunSettings):
    """Settings of ``python -m agents compare``.

    A policy's mapping may also have ``group`` ("learned", "hybrid" or "classical"; by default trained policies are learned,
    residual policies hybrid and all others classical), ``training_seeds``, a list of integers that replace ``{seed}`` in its
    paths, and ``curve``, the path of the learning curves, in which ``{task}`` is the task's name in lower case.

    Attributes:
        generalisation: matrices of policies by cases.
        ladders: lists of policies that differ in one thing.
    """

    where: ClassVar[str] = "comparison"
    policy_keys: ClassVar[tuple[str, ...]] = ("group", "training_seeds", "curve")

    generalisation: tuple[MatrixSettings, ...] = ()
    ladders: tuple[LadderSettings, ...] = ()
    output: str = Field(default="runs/comparison", min_length=1)

    def defaults(self, content: Any) -> dict[str, Any]:
        """Return the keys of a policy that follow from its content."""
        kind = content.get("kind") if isinstance(content, Mapping) else content
        trained = kind == "trained" or (isinstance(kind, str) and kind.endswith(".json"))
        group = "hybrid" if kind == "residual" else "learned" if trained else "classical"
        return {**super().defaults(content), "group": group}

    def entry(self, policy: Any, field: str) -> PolicyEntry:
        """Return one policy with group, training seeds and curve."""
        entry = super().entry(policy, field)
        if entry.training_seeds and entry.group == "classical":
            raise checks.conflict(f"{field}.training_seeds cannot be set where group is classical")
        all_differ(f"{field}.training_seeds", entry.training_seeds)
        for what, value in (("policy", entry.content), ("curve", entry.curve)):
            if value is not None and (for_seed(value, 0) != value) != bool(entry.training_seeds):
                raise checks.conflict(
                    f"{field} ({what}): training_seeds requires {{seed}} in all paths, and vice versa"
                )
        return entry

    def ladder_hardware(self, ladder: LadderSettings) -> str:
        """Return the hardware of a ladder, by default the first."""
        return ladder.hardware or next(iter(self.named_hardware()))

    def check(self) -> None:
        """Check the settings, matrices and ladders."""
        super().check()
        entries = {each.name: each for each in self.entries()}
        for index, matrix in enumerate(self.generalisation):
            matrix.check(f"comparison.generalisation.{index}", list(entries))
        for index, ladder in enumerate(self.ladders):
            where = f"comparison.ladders.{index}"
            checks.choice(f"{where}.task", ladder.task, self.tasks)
            checks.choice(f"{where}.hardware", self.ladder_hardware(ladder), tuple(self.named_hardware()))
            for name in some_of(f"{where}.policies", ladder.policies, list(entries)):
                if entries[name].curve is None:
                    raise checks.conflict(f"{where}.policies: {name!r} has no curve")
        titles = [study.name for study in (*self.generalisation, *self.ladders)]
        for title in titles:
            checks.label("comparison (name of a study)", title)
        all_differ("comparison (name of a study)", titles)


def some_of(field: str, names: Sequence[Any], known: Sequence[str]) -> Sequence[str]:
    """Return ``names``, checked: all different and among ``known``."""
    for name in names:
        checks.choice(field, name, known)
    all_differ(field, names)
    return names


def all_differ(field: str, values: Sequence[Any]) -> None:
    """Raise ValueError if a value occurs twice."""
    for value, count in Counter(values).items():
        if count > 1:
            raise checks.refuse(field, value, "in the list only once")


def mapping_of(field: str, content: Any, allowed: tuple[str, ...]) -> dict[str, Any]:
    """Return a copy of a mapping whose keys are among ``allowed``, checked."""
    if not isinstance(content, Mapping):
        raise checks.refuse(field, content, f"a mapping with keys among {', '.join(map(repr, allowed))}")
    for key in content:
        checks.choice(field, key, allowed)
    return dict(content)


def laid_over(environment: Mapping[str, Any], arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of an environment on some hardware: ``randomize`` is merged, all else replaced."""
    result = {**environment, **arguments}
    both = [each.get("randomize") for each in (environment, arguments)]
    if all(isinstance(each, Mapping) for each in both):
        result["randomize"] = {**both[0], **both[1]}  # type: ignore[dict-item]
    return result


def with_sensor(environment: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of an environment with some settings of its sensor replaced."""
    if not settings:
        return dict(environment)
    sensor = environment.get("sensor", "ideal")
    return {**environment, "sensor": {**(sensor if isinstance(sensor, Mapping) else {"kind": sensor}), **settings}}


settings_from = EvaluationSettings.checked
load_settings = EvaluationSettings.load
