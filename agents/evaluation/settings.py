"""Settings of all evaluations: policies on tasks and hardware with the same seeds, and the studies of each command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import Field

from agents.provenance import portable
from vibgym import checks
from vibgym.config import Settings, load_yaml, parse
from vibgym.envs.vector import environment_id

DEFAULT_EPISODES = 100
DEFAULT_FIRST_SEED = 100_000

HARDWARE_KEYS = ("actuators", "sensor", "randomize")
"""Arguments of environments that describe the hardware model."""

CASE_KEYS = (*HARDWARE_KEYS, "model")
"""Arguments that a hardware entry or a case of the study of effects may set."""

ENVIRONMENT_KEYS = (
    "surface", "parts", "model", "actuators", "sensor", "randomize", "start", "zones", "paths", "walls", "periods_per_step",
    "task_settings",
)  # fmt: skip
"""Arguments that all environments share. Action and observation belong to the policies."""

GROUPS = ("learned", "hybrid", "classical")
"""Groups of policies in comparisons. A hybrid is a learned residual on a classical controller."""

MOST_NAME = 40
"""Characters of a name in tables."""

SEED, TASK = "{seed}", "{task}"


@dataclass(frozen=True)
class PolicyEntry:
    """One policy of the settings.

    Attributes:
        name: in tables.
        content: argument of :func:`vibgym.policies.registry.make_policy`; its texts may hold ``{seed}``.
        tasks, hardware: names on which it runs; None: all that it serves.
        group: one of :data:`GROUPS`, in comparisons.
        training_seeds: of its training runs; empty for a single policy.
        curve: path of the learning curve, with ``{task}`` and ``{seed}``; None without one.
        episodes: at most so many on each task.
    """

    name: str
    content: Any
    tasks: tuple[str, ...] | None = None
    hardware: tuple[str, ...] | None = None
    group: str = ""
    training_seeds: tuple[int, ...] = ()
    curve: str | None = None
    episodes: int | None = None

    @property
    def own(self) -> dict[str, Any]:
        """Keys other than name and content that are set."""
        keys = ("tasks", "hardware", "group", "training_seeds", "curve")
        return {key: value for key in keys if (value := getattr(self, key)) not in (None, (), "")}

    @property
    def seeds(self) -> tuple[int | None, ...]:
        """Training seeds; (None,) for a single policy."""
        return self.training_seeds or (None,)

    def run(self, seed: int | None) -> Any:
        """Return the content for the policy of one training run."""
        return self.content if seed is None else _filled(self.content, seed)

    def curve_path(self, task: str, seed: int | None) -> Path:
        """Return the path of the learning curve of one training run."""
        assert self.curve is not None
        path = self.curve.replace(TASK, task.lower())
        return Path(path if seed is None else path.replace(SEED, str(seed)))


@dataclass(frozen=True)
class HardwareEntry:
    """One hardware model: ``arguments`` of the environments, ``tasks`` that run on it, at most so many ``episodes`` of each."""

    name: str
    arguments: dict[str, Any]
    tasks: tuple[str, ...]
    episodes: int | None

    def runs(self, policy: PolicyEntry, task: str) -> bool:
        """Return whether a policy is to run on a task on this hardware."""
        wanted = policy.tasks is None or task in policy.tasks
        return wanted and task in self.tasks and (policy.hardware is None or self.name in policy.hardware)


@dataclass(frozen=True)
class StudyPolicy:
    """One policy of a study: name in its table, the evaluation's policy, settings laid over every sensor, what trained on."""

    name: str
    policy: str
    sensor: dict[str, Any]
    trained_on: str = ""


@dataclass(frozen=True)
class Case:
    """One case of a study: arguments of the environments of a task."""

    name: str
    task: str
    arguments: dict[str, Any]


class EffectsSettings(Settings):
    """Study of hardware effects: success of policies on one task in several cases.

    Attributes:
        task: one of the evaluation's tasks.
        policies: names of the evaluation's policies, or mappings of ``policy``, ``name`` (in the table) and ``sensor``
            (settings laid over those of every case, such as ``{estimator: model}``).
        cases: name -> arguments of the environments, see :data:`CASE_KEYS`.
        episodes: at most so many of each policy in each case; by default as many as the task has.
    """

    task: str
    policies: list[Any] = Field(min_length=1, max_length=40)
    cases: dict[str, Any] = Field(min_length=1, max_length=100)
    episodes: int | None = Field(default=None, ge=1, le=100_000)

    keys: ClassVar[tuple[str, ...]] = CASE_KEYS
    more: ClassVar[tuple[str, ...]] = ()

    def columns(self, where: str, policies: Sequence[str]) -> list[StudyPolicy]:
        """Return the policies of the study, checked against the names of the evaluation's."""
        found: list[StudyPolicy] = []
        for index, entry in enumerate(self.policies):
            each = _study_policy(entry, f"{where}.policies.{index}", policies, self.more)
            if any(each.name == other.name for other in found):
                raise checks.conflict(f"{where}.policies.{index}.name: {each.name!r} is the name of another policy")
            found.append(each)
        return found

    def tested(self, where: str) -> list[Case]:
        """Return the cases, checked."""
        found = []
        for name, content in self.cases.items():
            field = f"{where}.cases.{checks.label(f'{where}.cases (a name)', name, most=MOST_NAME)}"
            arguments = _mapping(field, content, self.keys)
            task = arguments.pop("task", self.task)
            environment_id(task, f"{field}.task")
            found.append(Case(name, task, arguments))
        return found

    def check(self, where: str, policies: Sequence[str]) -> None:
        """Check all of it; errors begin with ``where``."""
        environment_id(self.task, f"{where}.task")
        self.columns(where, policies)
        self.tested(where)


class MatrixSettings(EffectsSettings):
    """Generalisation matrix: policies, trained on one thing, by cases that they are tested on.

    As :class:`EffectsSettings`; cases may set all of :data:`ENVIRONMENT_KEYS` and ``task``, policies ``trained_on`` (text).
    """

    name: str

    keys: ClassVar[tuple[str, ...]] = (*ENVIRONMENT_KEYS, "task")
    more: ClassVar[tuple[str, ...]] = ("trained_on",)


class LoadSettings(Settings):
    """Study of throughput: parts a minute against the number of parts in play.

    Attributes:
        task: one of the evaluation's tasks in which parts come and go.
        policies: names of the evaluation's policies.
        parts: numbers of parts.
        episodes: at most so many of each policy with each number; by default as many as the task has.
    """

    task: str
    policies: list[str] = Field(min_length=1, max_length=8)
    parts: list[int] = Field(min_length=1, max_length=40)
    episodes: int | None = Field(default=None, ge=1, le=100_000)

    def check(self, where: str, tasks: Sequence[str], policies: Sequence[str]) -> None:
        """Check names and numbers; errors begin with ``where``."""
        checks.choice(f"{where}.task", self.task, tuple(tasks))
        some_of(f"{where}.policies", self.policies, policies)
        _distinct(f"{where}.parts", self.parts)
        for index, count in enumerate(self.parts):
            checks.count(f"{where}.parts.{index}", count, most=10_000)


class LadderSettings(Settings):
    """Ablation: policies with learning curves that differ in one thing, such as the action.

    Attributes:
        name: title.
        task, hardware: one of the comparison's; by default its first hardware.
        policies: names of the comparison's policies, in the order of the rows.
    """

    name: str
    task: str
    hardware: str | None = None
    policies: list[Any] = Field(min_length=2, max_length=20)


class RunSettings(Settings):
    """Policies on tasks, all on the same seeds.

    Attributes:
        tasks: ids of registered environments; those of vibgym also without ``vibgym/`` and version.
        policies: each a name ("zero"), the path of a trained policy, or a mapping of ``name`` (in the tables), ``kind`` and the
            policy's own arguments, see :func:`vibgym.policies.make_policy`. From Python also objects with ``predict``, alone
            or as ``policy`` of such a mapping, with ``action`` if they do not declare it. Relative paths start from the current
            directory. A mapping may have ``tasks`` and ``hardware``, lists of names; by default a policy runs on all it serves.
        episodes: number of episodes, with the seeds ``first_seed``, ``first_seed + 1``, ...
        task_episodes: other numbers of episodes for some tasks, by name.
        first_seed: seed of the first episode.
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
    """Name in errors."""

    policy_keys: ClassVar[tuple[str, ...]] = ()
    """Keys of a policy's mapping besides ``name``, ``tasks`` and ``hardware`` that are no arguments of the policy."""

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
        """Return the seeds of a task's episodes, at most ``most``; for None, those of tasks without their own number."""
        own = None if task is None else self.task_episodes.get(task)
        if self.seeds is not None:
            return self.seeds[:own][:most]
        first = DEFAULT_FIRST_SEED if self.first_seed is None else self.first_seed
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
            arguments = _mapping(field, content, (*CASE_KEYS, "tasks", "episodes"))
            own, episodes = arguments.pop("tasks", None), arguments.pop("episodes", None)
            tasks = tuple(self.tasks) if own is None else some_of(f"{field}.tasks", own, self.tasks)
            most = None if episodes is None else checks.count(f"{field}.episodes", episodes, most=100_000)
            found.append(HardwareEntry(name, arguments, tasks, most))
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
        if hasattr(policy, "predict"):
            return PolicyEntry(_object_name(policy), policy)
        if isinstance(policy, str):
            return PolicyEntry(Path(policy).stem if policy.endswith(".json") else policy, policy)
        if not isinstance(policy, Mapping):
            raise checks.refuse(field, policy, "a name, the path of a trained policy, or a mapping with 'kind'")
        content = {key: value for key, value in policy.items() if key not in self.policy_keys}
        limits = {}
        for key, known in (("tasks", self.tasks), ("hardware", list(self.named_hardware()))):
            value = content.pop(key, None)
            limits[key] = None if value is None else some_of(f"{field}.{key}", value, known)
        subject: Any = content
        default = content.get("kind")
        if "policy" in content:
            model = content["policy"]
            if not hasattr(model, "predict") or set(content) - {"policy", "action", "name"}:
                allowed = "an object with predict() as 'policy', with 'action', 'name', 'tasks' and 'hardware' only"
                raise checks.refuse(field, policy, allowed)
            default = _object_name(model)
            if "action" not in content:
                subject = model
        name = content.pop("name", default)
        checks.label(f"{field}.name", name, most=MOST_NAME)
        return PolicyEntry(name, subject, **limits)

    def as_written(self) -> dict[str, Any]:
        """Return all of it as JSON values: policies by name, without absolute paths."""
        given = self.model_dump(exclude={"policies", "processes", "hardware"})
        policies = {
            entry.name: {"policy": entry.content, **entry.own} if entry.own else entry.content
            for entry in self.entries()
        }
        return portable({**given, "hardware": self.named_hardware(), "policies": policies})

    def check(self) -> None:
        """Check the settings of one command; raise ValueError at the first fault."""

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
        where = cls.where
        settings = parse(cls, data, where)
        for field in ("episodes", "first_seed"):
            if settings.seeds is not None and getattr(settings, field) is not None:
                raise checks.conflict(f"{where}.{field} cannot be set together with seeds")
        for field in ("tasks", "seeds"):
            _distinct(f"{where}.{field}", getattr(settings, field) or [])
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
        settings.hardware_entries()
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
        """Return checked settings from a YAML file, see :meth:`checked`; errors name the file."""
        data = load_yaml(path)
        with checks.within(path):
            return cls.checked(data, episodes, output)


class EvaluationSettings(RunSettings):
    """Settings of ``python -m agents evaluate``.

    Attributes:
        effects: study of hardware effects, see :class:`EffectsSettings`.
        under_load: study of throughput, see :class:`LoadSettings`.
        animations: whether the report has a film of each policy on each task.
    """

    effects: EffectsSettings | None = None
    under_load: LoadSettings | None = None
    animations: bool = True

    def as_written(self) -> dict[str, Any]:
        """Return all of it as JSON values, without studies that are not set."""
        written = super().as_written()
        return {
            key: value for key, value in written.items() if value is not None or key not in ("effects", "under_load")
        }

    def check(self) -> None:
        """Check the studies."""
        names = [each.name for each in self.entries()]
        if self.under_load is not None:
            self.under_load.check("evaluation.under_load", self.tasks, names)
        if self.effects is not None:
            checks.choice("evaluation.effects.task", self.effects.task, tuple(self.tasks))
            self.effects.check("evaluation.effects", names)


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

    generalisation: list[MatrixSettings] = []
    ladders: list[LadderSettings] = []
    output: str = Field(default="runs/comparison", min_length=1)

    def entry(self, policy: Any, field: str) -> PolicyEntry:
        """Return one policy with group, training seeds and curve."""
        own = {key: policy[key] for key in self.policy_keys if key in policy} if isinstance(policy, Mapping) else {}
        entry = super().entry(policy, field)
        group = checks.choice(f"{field}.group", own.get("group", _default_group(entry.content)), GROUPS)
        seeds = own.get("training_seeds", ())
        if "training_seeds" in own:
            if group == "classical":
                raise checks.conflict(f"{field}.training_seeds cannot be set where group is classical")
            if not isinstance(seeds, list | tuple) or not 2 <= len(seeds) <= 100:
                raise checks.refuse(f"{field}.training_seeds", seeds, "a list of 2 to 100 whole numbers")
            for each in seeds:
                checks.count(f"{field}.training_seeds", each, least=0, most=2**63 - 1)
            _distinct(f"{field}.training_seeds", seeds)
        curve = own.get("curve")
        if "curve" in own and (not isinstance(curve, str) or not curve):
            raise checks.refuse(f"{field}.curve", curve, "the path of a learning curve")
        for what, value in (("policy", entry.content), ("curve", curve)):
            if value is not None and (_filled(value, 0) != value) != bool(seeds):
                raise checks.conflict(f"{field} ({what}): training_seeds requires {SEED} in all paths, and vice versa")
        return replace(entry, group=group, training_seeds=tuple(seeds), curve=curve)

    def ladder_hardware(self, ladder: LadderSettings) -> str:
        """Return the hardware of a ladder, by default the first."""
        return ladder.hardware or next(iter(self.named_hardware()))

    def check(self) -> None:
        """Check matrices and ladders."""
        entries = {each.name: each for each in self.entries()}
        titles: list[str] = []
        studies: list[tuple[str, MatrixSettings | LadderSettings]] = [
            *((f"comparison.generalisation.{k}", each) for k, each in enumerate(self.generalisation)),
            *((f"comparison.ladders.{k}", each) for k, each in enumerate(self.ladders)),
        ]
        for where, study in studies:
            if study.name in titles:
                raise checks.conflict(f"{where}.name: {study.name!r} is the name of another study")
            titles.append(checks.label(f"{where}.name", study.name))
            if isinstance(study, MatrixSettings):
                study.check(where, list(entries))
                continue
            checks.choice(f"{where}.task", study.task, tuple(self.tasks))
            checks.choice(f"{where}.hardware", self.ladder_hardware(study), tuple(self.named_hardware()))
            for name in some_of(f"{where}.policies", study.policies, list(entries)):
                if entries[name].curve is None:
                    raise checks.conflict(f"{where}.policies: {name!r} has no curve")


class SuiteSettings(RunSettings):
    """Settings of ``python -m agents score``: every policy on every task and all hardware; unserved tasks score 0.

    A policy's mapping may have ``training_steps``, what it was trained on, and ``episodes``, at most so many of each task.

    Attributes:
        training_steps: environment steps, all tasks together, that a policy may have been trained on.
    """

    where: ClassVar[str] = "suite"
    policy_keys: ClassVar[tuple[str, ...]] = ("training_steps", "episodes")

    training_steps: int = Field(ge=1)
    output: str = Field(default="runs/suite", min_length=1)

    def entry(self, policy: Any, field: str) -> PolicyEntry:
        """Return one policy with its number of episodes."""
        own = {key: policy[key] for key in self.policy_keys if key in policy} if isinstance(policy, Mapping) else {}
        for name, least, most in (("training_steps", 0, self.training_steps), ("episodes", 1, 100_000)):
            if name in own:
                checks.count(f"{field}.{name}", own[name], least=least, most=most)
        return replace(super().entry(policy, field), episodes=own.get("episodes"))

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
        entered = self.model_copy(update={"policies": [{"name": path.stem, **content}]})
        with checks.within(path):
            entered.entries()
        return entered


SQUARE: dict[str, Any] = {
    "shape": "rectangle", "length_mm": 40.0, "width_mm": 40.0, "friction": 0.58, "name": "square part",
}  # fmt: skip
"""Default part of a data sheet."""


class DatasheetSettings(Settings):
    """Settings of ``python -m agents datasheet``.

    Attributes:
        title: of the sheet; None: the part's name.
        surface: ``"prototype"`` or a mapping of :class:`vibgym.Surface`'s fields.
        part: the name of a shipped part or a mapping, see :class:`vibgym.config.PartSettings`.
        model, actuators, sensor: arguments of the environments.
        policy: see :func:`vibgym.policies.make_policy`; it must serve Transport, Align and Rotate.
        episodes: of each measurement.
        first_seed: of the episodes.
        output: directory for the page.
    """

    title: str | None = Field(default=None, min_length=1, max_length=60)
    surface: Any = "prototype"
    part: Any = SQUARE
    model: Any = "planar"
    actuators: Any = "prototype"
    sensor: Any = {"kind": "pose", "estimator": "model"}
    policy: Any = "pose"
    episodes: int = Field(default=48, ge=8, le=10_000)
    first_seed: int = Field(default=100_000, ge=0, lt=2**63)
    output: str = Field(default="runs/datasheet", min_length=1)

    @property
    def environment(self) -> dict[str, Any]:
        """Arguments of the environments."""
        scene = {"surface": self.surface, "parts": [self.part], "model": self.model}
        return {**scene, "actuators": self.actuators, "sensor": self.sensor}

    @property
    def seeds(self) -> list[int]:
        """Seeds of the episodes."""
        return list(range(self.first_seed, self.first_seed + self.episodes))

    @classmethod
    def checked(cls, data: Any, episodes: int | None = None, output: str | None = None) -> Self:
        """Return checked settings from a mapping; ``episodes`` and ``output`` replace its own."""
        settings = parse(cls, data, "datasheet")
        changes: dict[str, Any] = {} if output is None else {"output": output}
        if episodes is not None:
            changes["episodes"] = checks.count("--episodes", episodes, least=8, most=10_000)
        return settings.model_copy(update=changes)

    @classmethod
    def load(cls, path: Path | None, episodes: int | None = None, output: str | None = None) -> Self:
        """Return settings from a YAML file, or the prototype's with a square part; errors name the file."""
        if path is None:
            return cls.checked({}, episodes, output)
        data = load_yaml(path)
        with checks.within(path):
            return cls.checked(data, episodes, output)


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


def some_of(field: str, value: Any, known: Sequence[str]) -> tuple[str, ...]:
    """Return a list of different names among ``known``."""
    if not isinstance(value, list | tuple) or not value:
        raise checks.refuse(field, value, f"a non-empty list of names among {', '.join(known)}")
    for each in value:
        checks.choice(field, each, tuple(known))
    _distinct(field, value)
    return tuple(value)


def _distinct(field: str, values: Sequence[Any]) -> None:
    for each in values:
        if values.count(each) > 1:
            raise checks.refuse(field, each, "in the list only once")


def _mapping(field: str, content: Any, allowed: tuple[str, ...]) -> dict[str, Any]:
    if not isinstance(content, Mapping):
        raise checks.refuse(field, content, f"a mapping with keys among {', '.join(map(repr, allowed))}")
    for key in content:
        checks.choice(field, key, allowed)
    return dict(content)


def _study_policy(entry: Any, field: str, policies: Sequence[str], more: tuple[str, ...]) -> StudyPolicy:
    if not isinstance(entry, Mapping):
        return StudyPolicy(checks.choice(field, entry, tuple(policies)), entry, {})
    _mapping(field, entry, ("policy", "name", "sensor", *more))
    policy = checks.choice(f"{field}.policy", entry.get("policy"), tuple(policies))
    name = checks.label(f"{field}.name", entry.get("name", policy), most=MOST_NAME)
    sensor = entry.get("sensor", {})
    if not isinstance(sensor, Mapping):
        raise checks.refuse(f"{field}.sensor", sensor, "a mapping of settings of the sensor")
    trained_on = checks.label(f"{field}.trained_on", entry["trained_on"]) if "trained_on" in entry else ""
    return StudyPolicy(name, policy, dict(sensor), trained_on)


def _object_name(policy: Any) -> str:
    return str(getattr(policy, "name", type(policy).__name__))


def _filled(content: Any, seed: int) -> Any:
    """Return ``content`` with the training seed in all its texts."""
    if isinstance(content, str):
        return content.replace(SEED, str(seed))
    if isinstance(content, Mapping):
        return {key: _filled(value, seed) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_filled(value, seed) for value in content]
    return content


def _default_group(content: Any) -> str:
    kind = content.get("kind") if isinstance(content, Mapping) else content
    if kind == "residual":
        return "hybrid"
    return "learned" if kind == "trained" or (isinstance(kind, str) and kind.endswith(".json")) else "classical"


settings_from = EvaluationSettings.checked
load_settings = EvaluationSettings.load
