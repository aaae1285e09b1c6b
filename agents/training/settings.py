"""Settings of a training run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium as gym
from pydantic import Field, field_validator
from pydantic_core import PydanticCustomError

import vibgym  # noqa: F401 - registers the environments
from agents.training import outlines
from vibgym import checks
from vibgym.config import Settings, load_yaml, parse
from vibgym.policies.trained.residual import base_named
from vibgym.tasks import TASKS

MOST_STEPS = 10**12

Rate = Annotated[float, Field(gt=0, le=1)]
Width = Annotated[int, Field(ge=1, le=4096)]


class RateSettings(Settings):
    """A learning rate that falls linearly."""

    learning_rate: Rate = 1e-3
    final_learning_rate: Rate = 1e-4  # reached linearly at the end

    def rate(self, remaining: float) -> float:
        """Where this share of the training remains."""
        return self.final_learning_rate + remaining * (self.learning_rate - self.final_learning_rate)


class NetworkSettings(Settings):
    """The network that acts, what it reads, and its critic."""

    network: Literal["parts", "elements", "pixels"] = "parts"
    activation: Literal["tanh", "relu"] = "tanh"
    net: list[Width] = Field([128, 128], min_length=1, max_length=8)
    critic_net: list[Width] = Field([64, 64], min_length=1, max_length=8)
    attention: Width = 32
    turned: bool = False  # rows are turned by quarter turns until their way leads to the right and up
    remembers: bool = False  # rows tell what a part was told at the last step
    blind: list[str] = Field([], max_length=100)  # names of columns that the network does not read


class PPOSettings(NetworkSettings, RateSettings):
    """PPO with parts as samples; defaults are what trained fastest on two cores."""

    n_steps: int = Field(32, ge=1, le=1_000_000)
    batch_size: int = Field(4096, ge=2, le=100_000_000)  # parts
    n_epochs: int = Field(3, ge=1, le=1000)
    gamma: float = Field(0.98, gt=0, le=1)
    gae_lambda: float = Field(0.95, gt=0, le=1)
    clip_range: float = Field(0.2, gt=0, le=10)
    ent_coef: float = Field(0.0, ge=0, le=100)
    target_kl: float | None = Field(None, gt=0, le=100)  # within an update; the learning rate follows it
    log_std_init: float = Field(-0.5, ge=-5, le=0.5)
    noise_floor: float | None = Field(
        None, gt=0, le=1
    )  # exploration grows with actions above it; None: is the same for all
    touch_cost: float = Field(0.0, ge=0, le=1000)  # of a step, to a part in touch with another; in training alone
    critic_steps: int = Field(0, ge=0, le=MOST_STEPS)  # in which the critic alone learns


class OfflineSettings(NetworkSettings, RateSettings):
    """Learning from a data set alone, see :mod:`agents.training.offline`; a step is an update from one minibatch."""

    dataset: str = Field(min_length=1)  # Minari's name, as ``python -m agents record`` gave it
    directory: str | None = None  # of the data sets; None: where Minari keeps them
    method: Literal["cloning", "iql"] = "cloning"
    batch_size: int = Field(1024, ge=2, le=10_000_000)  # parts
    floor: float = Field(1.0, gt=0, le=10)  # size of actions below which errors are not weighed by it any more
    # Of "iql" alone (Kostrikov, Nair & Levine 2021):
    gamma: float = Field(0.98, gt=0, lt=1)
    expectile: float = Field(0.8, gt=0.5, lt=1)  # of the values of actions that were done, which counts as a state's
    temperature: float = Field(
        1.0, gt=0, le=100
    )  # standard deviations of advantage that change a weight by a factor of e
    tau: Rate = 0.01  # of the target network


class ImitationSettings(Settings):
    """What an expert teaches beforehand, see :class:`agents.training.imitation.Imitation`."""

    expert: Any  # a policy that speaks the environment's action
    rounds: int = Field(4, ge=1, le=1000)
    steps: int = Field(100, ge=1, le=1_000_000)  # of each world, in a round
    epochs: int = Field(4, ge=1, le=10_000)  # after each round, over all that has been found
    batch_size: int = Field(2048, ge=1, le=10_000_000)  # parts
    learning_rate: Rate = 1e-3
    noise: float = Field(0.2, ge=0, le=10)  # largest standard deviation of what disturbs those who act
    floor: float = Field(1.0, gt=0, le=10)  # size of actions below which errors are not weighed by it any more
    own_share: float = Field(0.8, ge=0, le=1)  # of worlds in which the network acts, after the first round


class JudgingSettings(Settings):
    """How a learning curve is measured: deterministic episodes on the same seeds every time."""

    episodes: int = Field(100, ge=1, le=1_000_000)
    first_seed: int = Field(500_000, ge=0, le=2**31)
    every: int = Field(1_000_000, ge=1, le=MOST_STEPS)  # steps


class OutlineSettings(Settings):
    """Scenes of one part each, of random outline, size and friction, see :func:`agents.training.outlines.scenes`."""

    count: int = Field(48, ge=1, le=10_000)
    seed: int = Field(0, ge=0, lt=2**63)
    families: list[str] = list(outlines.TRAINING)
    size: list[float] = Field([0.020, 0.080], min_length=2, max_length=2)  # m, of the largest dimension
    friction: list[float] = Field([0.3, 0.9], min_length=2, max_length=2)


class ServesSettings(Settings):
    """What else a policy may act on than what it was trained on."""

    tasks: list[str] | None = None  # names; None: the one that it was trained on
    surface: Literal["same", "any"] = "same"
    parts: Literal["same", "any"] = "same"  # their number


class ResidualSettings(Settings):
    """What the network corrects, see :class:`agents.training.residual_env.ResidualEnv`."""

    base: dict[str, Any]  # a policy that speaks "wrench", which need not be said, and reads "state"
    scale: float = Field(0.5, gt=0, le=2)  # of the network's action, before it is added to the base's

    @field_validator("base")
    @classmethod
    def _named(cls, base: dict[str, Any]) -> dict[str, Any]:
        try:
            return base_named(base)
        except ValueError:
            allowed = "a mapping with 'kind', the name of a policy that is itself no correction"
            raise PydanticCustomError("base", allowed) from None  # type: ignore[arg-type]


class SACSettings(RateSettings):
    """Stable-Baselines3's SAC with hindsight, see :mod:`agents.training.off_policy`."""

    buffer_size: int = Field(300_000, ge=1, le=1_000_000_000)  # transitions of all worlds
    learning_starts: int = Field(2_000, ge=0, le=MOST_STEPS)  # steps with random actions
    train_freq: int = Field(1, ge=1, le=100_000)  # steps of each world between updates
    gradient_steps: int = Field(4, ge=1, le=100_000)  # at each update
    policy_delay: int = Field(2, ge=1, le=1000)  # gradient steps of the critics for one of the actor
    batch_size: int = Field(256, ge=1, le=10_000_000)
    gamma: float = Field(0.95, gt=0, lt=1)
    tau: Rate = 0.02  # of the target network
    ent_coef: float = Field(0.1, gt=0, le=100)  # at the beginning; learned from there
    target_entropy: float | None = Field(None, ge=-1e6, le=1e6)  # default: minus the number of actions
    hindsight: float = Field(0.8, ge=0, le=1)  # share of a batch with goals that were reached later
    horizon: int = Field(50, ge=0, le=1_000_000)  # steps that these were reached later at most
    noise: float = Field(0.3, ge=0, le=10)  # standard deviation of what is added to actions in the loudest world ...
    noise_steps: float = Field(5.0, ge=1, le=1e6)  # ... and steps that it lasts
    net: list[Width] = Field([128, 128], min_length=1, max_length=8)


class TrainSettings(Settings):
    """One training run: task, environment, algorithm, length.

    ``task`` is the name of an environment of vibgym without version, such as ``"SortTwelve"``, the whole name of one of your
    own, or the name of a task in :data:`vibgym.tasks.TASKS`.
    """

    task: str
    environment: dict[str, Any] = {"action": "patch"}
    worlds: int = Field(512, ge=1, le=100_000)
    steps: int = Field(ge=1, le=MOST_STEPS)
    seed: int = Field(0, ge=0, lt=2**32)  # NumPy's old generator, which Stable-Baselines3 seeds, takes no more
    checkpoint_steps: int = Field(500_000, ge=1, le=MOST_STEPS)
    output: str | None = None  # directory; default: runs/<name of the file>
    scenes: list[dict[str, Any]] = Field([], max_length=10_000)  # arguments on top of environment; worlds are dealt out
    outlines: OutlineSettings | None = None  # scenes that are drawn, in the place of those
    start: str | None = None  # path of a policy to begin with; {seed} in it is replaced by the run's
    imitation: ImitationSettings | None = None
    residual: ResidualSettings | None = None
    judging: JudgingSettings | None = None
    serves: ServesSettings = ServesSettings()
    algorithm: Literal["ppo", "sac", "offline"] = "ppo"
    ppo: PPOSettings = PPOSettings()  # type: ignore[call-arg]
    sac: SACSettings = SACSettings()  # type: ignore[call-arg]
    offline: OfflineSettings | None = None  # needed by "algorithm: offline"

    @property
    def network(self) -> NetworkSettings:
        """Of the parts' network, which SAC has not."""
        return self.offline if self.algorithm == "offline" and self.offline is not None else self.ppo

    def check_alone(self) -> None:
        """Refuse what goes before PPO alone, or beside it.

        Raises:
            ValueError: there is some.
        """
        for name, got in (("residual", self.residual), ("imitation", self.imitation), ("start", self.start)):
            if got is not None:
                raise checks.refuse(name, got, f"none with 'algorithm: {self.algorithm}'")

    @property
    def environment_name(self) -> str:
        """Under which Gymnasium may know the environment."""
        return self.task if "/" in self.task else f"vibgym/{self.task}-v0"

    @property
    def all_scenes(self) -> list[dict[str, Any]]:
        """The scenes that a run trains on, given or drawn; one without arguments where there are neither.

        Raises:
            ValueError: outlines that cannot be drawn, or both.
        """
        if self.outlines is None:
            return self.scenes or [{}]
        if self.scenes:
            raise checks.refuse("outlines", self.outlines.model_dump(), "nothing beside scenes")
        return outlines.scenes(**self.outlines.model_dump())

    @field_validator("task")
    @classmethod
    def _known(cls, task: str) -> str:
        own = [spec.name for spec in gym.registry.values() if spec.namespace == "vibgym"]
        known = tuple(dict.fromkeys((*own, *TASKS)))
        if task not in known and not ("/" in task and task in gym.registry):
            raise PydanticCustomError("task", ", ".join(map(repr, known)))  # type: ignore[arg-type]
        return task


PARTS_OF_SETTINGS: dict[str, type[Settings]] = {
    "ppo": PPOSettings,
    "sac": SACSettings,
    "offline": OfflineSettings,
    "imitation": ImitationSettings,
    "residual": ResidualSettings,
    "judging": JudgingSettings,
    "outlines": OutlineSettings,
    "serves": ServesSettings,
}


TUNING = "tuning"
"""Key of what is tuned, which no training reads: see :mod:`agents.tuning.settings`."""


def load_settings(
    path: Path, agent: str | None = None, seed: int | None = None, changes: Mapping[str, Any] | None = None
) -> TrainSettings:
    """Read a training file; the first fault is a one-line ValueError that names file and field.

    A file holds the settings of one run, or of many agents: then its keys are the ids of environments, such as
    ``vibgym/Align-v0``, under each of which the settings of its agents stand by name. What stands under ``defaults`` counts for
    all of them.

    Args:
        path: of the YAML file.
        agent: ``"Align/prototype"``: that of this name under ``vibgym/Align-v0``; only for files of many agents.
        seed: instead of the file's.
        changes: values instead of the file's, by names such as ``"ppo.learning_rate"``.
    """
    data, where = _read(path, agent, seed)
    data.pop(TUNING, None)
    for name, value in (changes or {}).items():
        first, _, rest = name.partition(".")
        data[first] = {**(data.get(first) or {}), rest: value} if rest else value
    for name, model in PARTS_OF_SETTINGS.items():
        if isinstance(data.get(name), dict):
            data[name] = parse(model, data[name], f"{where}: {name}")
    return parse(TrainSettings, data, where)


def load_tuning(path: Path, agent: str | None = None) -> tuple[Any, str]:
    """What a training file says of tuning, None if nothing, and what to call it."""
    data, where = _read(path, agent, None)
    return data.get(TUNING), f"{where}: {TUNING}"


def _read(path: Path, agent: str | None, seed: int | None) -> tuple[dict[str, Any], str]:
    """The settings of one run as they stand in a file, and what to call them."""
    data, where = load_yaml(path), str(path)
    if "task" not in data and any("/" in str(key) for key in data):  # ids of environments
        return _of_agent(data, where, agent, seed)
    if agent is not None:
        raise checks.refuse("--agent", agent, f"nothing: {path} holds the settings of one run")
    return (dict(data) if seed is None else {**data, "seed": seed}), where


def agents_in(path: Path) -> tuple[str, ...]:
    """Names of the agents in a file of many."""
    return tuple(_agents(load_yaml(path), str(path)))


def _agents(data: dict[str, Any], where: str) -> dict[str, dict[str, Any]]:
    found = {}
    for key, own in data.items():
        if key == "defaults":
            continue
        spec = gym.registry.get(key) if isinstance(key, str) else None
        if spec is None or not isinstance(own, dict):
            raise checks.refuse(
                where, key, "a mapping with 'task', for one run, or with 'defaults' and ids of environments"
            )
        for name, settings in own.items():
            if not isinstance(settings, dict) or "task" in settings:
                raise checks.refuse(f"{where}: {key}.{name}", settings, "a mapping of settings without 'task'")
            task = spec.name if spec.namespace == "vibgym" else key
            if f"{spec.name}/{name}" in found:
                raise checks.refuse(f"{where}: {key}", name, "a name that no other environment of this name has")
            found[f"{spec.name}/{name}"] = {"task": task, **settings}
    return found


def _of_agent(data: dict[str, Any], where: str, agent: str | None, seed: int | None) -> tuple[dict[str, Any], str]:
    """Settings of one agent of a file, and what to call them."""
    defaults, agents = data.get("defaults", {}), _agents(data, where)
    if not isinstance(defaults, dict):
        raise checks.refuse(f"{where}: defaults", defaults, "a mapping of settings")
    if agent not in agents:
        raise checks.refuse(f"{where}: agent", agent, f"one of {', '.join(agents)}")
    own = agents[agent]
    merged = {**defaults, **own}
    for name in PARTS_OF_SETTINGS:
        if isinstance(defaults.get(name), dict) and isinstance(own.get(name), dict):
            merged[name] = {**defaults[name], **own[name]}
    if seed is not None:
        merged["seed"] = seed
    merged.setdefault("output", f"runs/agents/{agent.replace('/', '-')}/seed-{merged.get('seed', 0)}")
    return merged, f"{where}: {agent}"
