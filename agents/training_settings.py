"""Settings of a training run, and what the settings of algorithms have in common."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    SerializeAsAny,
    field_validator,
    model_serializer,
    model_validator,
)

from vibgym import checks
from vibgym.config import json_values
from vibgym.envs.drawn import drawn_shapes, fixed_scenes
from vibgym.envs.vector import environment_id
from vibgym.policies.trained.coding import MAX_REMEMBERED
from vibgym.policies.trained.residual import CORRECTED, CORRECTING, base_named
from vibgym.settings import BaseSettings, Unit

MAX_STEPS = 10**12
MAX_BYTES = 4e9
"""Of a rollout, and of the demonstrations of imitation."""

Plain = Annotated[Any, BeforeValidator(json_values)]
"""A policy or a scene as JSON values: parts and surfaces become mappings, NumPy's arrays lists."""

Arguments = Annotated[dict[str, Any], BeforeValidator(json_values)]
"""Arguments of an environment or a policy as JSON values."""


def _without_num_envs(arguments: dict[str, Any]) -> dict[str, Any]:
    if "num_envs" in arguments:
        raise checks.conflict("num_envs cannot be set for training: worlds is their number")
    return arguments


Scene = Annotated[Arguments, AfterValidator(_without_num_envs)]
"""Arguments of the worlds of a run."""


def _ordered(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise checks.conflict(f"the low end must be <= the high one, got {list(ends)}")
    return ends


Rate = Annotated[float, Field(gt=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
Range = Annotated[tuple[Positive, Positive], AfterValidator(_ordered)]
"""Low and high end."""

Width = Annotated[int, Field(ge=1, le=4096)]
Steps = Annotated[
    int,
    BeforeValidator(lambda value: int(value) if isinstance(value, bool) else value),
    Field(ge=0, le=MAX_REMEMBERED),
]
Widths = Annotated[tuple[Width, ...], Field(min_length=1, max_length=8)]


def check_bytes(name: str, value: int, bytes_each: float) -> None:
    """Raise if ``value`` items of ``bytes_each`` bytes have more than :data:`MAX_BYTES`; ``name`` is that of the setting."""
    if value * bytes_each > MAX_BYTES:
        raise checks.refuse(name, value, f"at most {MAX_BYTES:.1e} bytes in all; each has {bytes_each:.1e}")


def for_seed(value: Any, seed: int) -> Any:
    """Return a setting with ``{seed}`` replaced in all its texts."""
    return replaced(value, "{seed}", str(seed))


def replaced(value: Any, old: str, new: str) -> Any:
    """Return a setting with a text replaced in all its texts; keys are unchanged."""
    if isinstance(value, str):
        return value.replace(old, new)
    if isinstance(value, Mapping):
        return {key: replaced(entry, old, new) for key, entry in value.items()}
    return [replaced(entry, old, new) for entry in value] if isinstance(value, list | tuple) else value


class RateSettings(BaseSettings):
    """Learning rate with linear decay."""

    learning_rate: Rate = 1e-3
    """At the beginning."""

    final_learning_rate: Rate = 1e-4
    """At the end."""

    def rate(self, remaining: float) -> float:
        """Return the learning rate where this share (1 to 0) of the training remains."""
        return self.final_learning_rate + remaining * (self.learning_rate - self.final_learning_rate)


class NetworkSettings(BaseSettings):
    """Actor and critic, and their inputs."""

    network: str = "parts"
    """Among agents.networks.NETWORKS."""

    activation: Literal["tanh", "relu"] = "tanh"
    """After every hidden layer."""

    net: Widths = (128, 128)
    """Widths of the actor's hidden layers."""

    critic_net: Widths = (64, 64)
    """Widths of the critic's hidden layers."""

    attention: Width = 32
    """Width of attention to other parts."""

    turned: bool = False
    """Rotate rows by quarter turns so that the goal lies to the right and up."""

    history: Steps = 0
    """Previous steps of which rows contain the action; true: 1."""

    history_columns: tuple[str, ...] = Field(default=(), max_length=100)
    """Columns of these steps' observations that rows contain."""

    dropped_columns: tuple[str, ...] = Field(default=(), max_length=100)
    """Columns that the network does not read."""


class ImitationSettings(BaseSettings):
    """Imitation of an expert before training, see :class:`agents.imitation.Imitation`."""

    expert: Plain
    """A policy with the environment's action; {seed} in its texts is replaced by the run's."""

    rounds: int = Field(default=4, ge=1, le=1000)
    """Of demonstrations and learning from them."""

    steps: int = Field(default=100, ge=1, le=1_000_000)
    """Of each world, per round."""

    epochs: int = Field(default=4, ge=1, le=10_000)
    """After each round, over all demonstrations."""

    batch_size: int = Field(default=2048, ge=1, le=10_000_000)
    """Parts."""

    learning_rate: Rate = 1e-3
    """Constant."""

    noise: float = Field(default=0.2, ge=0, le=10)
    """Largest standard deviation of the noise added to actions."""

    floor: float = Field(default=1.0, gt=0, le=10)
    """Size of actions below which errors are absolute."""


class ResidualSettings(BaseSettings):
    """Correction of a classical policy, see :class:`agents.training_envs.ResidualEnv`."""

    base: Arguments
    """A policy with action "wrench" (the default), "velocity" or "target", and observation "state"; itself no correction."""

    scale: float = Field(default=0.5, gt=0, le=2)
    """Of the network's action, before it is added to the base's."""

    @field_validator("base")
    @classmethod
    def _named(cls, base: dict[str, Any]) -> dict[str, Any]:
        return base_named(base)


class SelectionSettings(BaseSettings):
    """Evaluation during training: deterministic episodes on the same seeds every time."""

    episodes: int = Field(default=100, ge=1, le=1_000_000)
    """Of one evaluation."""

    first_seed: int = 500_000
    """In the range "selection" of vibgym.seeds."""

    every: int = Field(default=1_000_000, ge=1, le=MAX_STEPS)
    """Steps between evaluations."""

    best: Literal["success", "speed"] = "success"
    """Which actor is kept: that with the highest success rate, or with the highest mean of 1 / time to goal, as scores rank."""

    cost_limit: float | None = Field(default=None, ge=0)
    """That 95 % of the episodes shall not exceed; comes before ``best``."""


class ServesSettings(BaseSettings):
    """Scenes that the policy file accepts in addition to the one of training."""

    tasks: tuple[str, ...] | None = None
    """Names; None: the task of training."""

    surface: Literal["same", "any"] = "same"
    """ "any": number of rows and columns."""

    frequency: Range | None = None
    """Measured range, Hz; None: that of training."""

    element_size: Annotated[Range, Unit("m")] | None = None
    """The same."""

    parts: Literal["same", "any"] = "same"
    """Their number."""

    hardware: Literal["same", "any"] = "same"
    """ "any": ideal elements and others."""


class UntilSettings(BaseSettings):
    """Condition that ends a stage of a curriculum: the first of those given that holds."""

    success: Rate | None = None
    """Of the last 100 training episodes, with exploration."""

    steps: int | None = Field(default=None, ge=1, le=MAX_STEPS)
    """Of the stage."""

    @model_validator(mode="after")
    def _ends(self) -> UntilSettings:
        if self.success is None and self.steps is None:
            raise checks.conflict("requires 'success', 'steps' or both")
        return self


class StageSettings(BaseSettings):
    """Stage of a curriculum, see :class:`agents.training_envs.Worlds`."""

    environment: Arguments
    """Arguments that differ from those of the run's environment; mappings are merged."""

    until: UntilSettings
    """End of the stage."""


class TrainSettings(BaseSettings):
    """One training run, see :func:`agents.training_file.settings_from`."""

    task: str
    """See :func:`vibgym.envs.vector.batch_of`."""

    environment: Scene = {"action": "patch"}
    """Arguments of the environment."""

    worlds: int = Field(default=512, ge=1, le=100_000)
    """Simulated together."""

    steps: int = Field(ge=1, le=MAX_STEPS)
    """Environment steps, of all worlds together."""

    seed: int = Field(default=0, ge=0, lt=2**32)  # Stable-Baselines3 accepts no more
    """Of the run."""

    checkpoint_steps: int = Field(default=500_000, ge=1, le=MAX_STEPS)
    """Steps between checkpoints."""

    output: str | None = None
    """Directory; None: runs/<name of the file>."""

    scenes: tuple[Scene, ...] = Field(default=(), max_length=10_000)
    """Arguments that are added to ``environment``; worlds are divided among them."""

    start: str | None = None
    """Policy file to start from; {seed} is replaced by the run's."""

    imitation: ImitationSettings | None = None
    """Before training."""

    residual: ResidualSettings | None = None
    """Policy that the network corrects."""

    curriculum: tuple[StageSettings, ...] = Field(default=(), max_length=100)
    """Easier environments before the run's own."""

    selection: SelectionSettings | None = None
    """Evaluation during training."""

    serves: ServesSettings = ServesSettings()
    """Scenes that the policy accepts."""

    algorithm: str = "ppo"
    """Among agents.algorithms.ALGORITHMS, or sb3.NAME."""

    own: SerializeAsAny[BaseSettings]
    """The algorithm's; in files they stand under its name."""

    @model_validator(mode="after")
    def _correctable(self) -> TrainSettings:
        """Reject settings that conflict with ``residual``.

        An expert of imitation gives actions, not corrections. In rows that remember or turn, the base's action would be
        repeated or not turned.
        """
        if self.imitation is not None and getattr(self.own, "network", None) == "joint":
            raise checks.conflict("imitation requires rows of parts, and network 'joint' has one row for all")
        if self.residual is not None and isinstance(self.own, NetworkSettings):
            base, own = checks.choice("residual.base.action", self.residual.base["action"], CORRECTED), self.own
            for name, got, allowed in (
                ("imitation", self.imitation, None),
                (f"{self.algorithm}.history", own.history, 0),
                (f"{self.algorithm}.turned", own.turned, False),
                ("environment.action", self.action, base),
            ):
                if got != allowed:
                    raise checks.conflict(f"{name} must be {allowed!r} with 'residual'")
            if own.network not in CORRECTING:
                raise checks.conflict(f"{self.algorithm}.network must be one of {CORRECTING} with 'residual'")
        return self

    def check_alone(self) -> None:
        """Reject ``residual``, ``imitation``, ``start`` and ``curriculum``, which PPO alone supports."""
        for name in ("residual", "imitation", "start", "curriculum"):
            if getattr(self, name):
                raise checks.conflict(f"{name} requires algorithm 'ppo', got {self.algorithm!r}")

    @property
    def adds_velocities(self) -> bool:
        """Whether corrections are added to velocities, see :attr:`vibgym.policies.trained.coding.Coding.adds_velocities`."""
        return self.residual is not None and getattr(self.own, "network", None) == "joint"

    @property
    def action(self) -> str:
        """Action of the environment."""
        return self.environment.get("action", "element")

    @property
    def all_scenes(self) -> list[dict[str, Any]]:
        """Scenes of the run: those given, or one for each shape of a split, or one without arguments."""
        if self.scenes:
            return list(self.scenes)
        drawn = drawn_shapes(environment_id(self.task), self.environment)
        return [{}] if drawn is None else fixed_scenes(drawn)

    @model_serializer(mode="wrap")
    def _as_in_files(self, plain: Any) -> dict[str, Any]:
        """Put the algorithm's settings under its name."""
        key = self.algorithm.partition(".")[0]
        return {key if name == "own" else name: value for name, value in plain(self).items()}
