"""Settings of a training run and of the built-in algorithms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, SerializeAsAny, field_validator, model_serializer, model_validator
from pydantic_core import PydanticCustomError

from vibgym import checks
from vibgym.config import Settings
from vibgym.envs.drawn import drawn_shapes, fixed_scenes
from vibgym.envs.vector import environment_id
from vibgym.policies.trained.coding import MOST_REMEMBERED
from vibgym.policies.trained.flow import MOST_HORIZON
from vibgym.policies.trained.residual import CORRECTED, base_named

MOST_STEPS = 10**12
MOST_BYTES = 4e9
"""Of a rollout, and of the demonstrations of imitation."""

Rate = Annotated[float, Field(gt=0, le=1)]
Range = Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=2, max_length=2)]
"""Low and high end."""

Width = Annotated[int, Field(ge=1, le=4096)]
Steps = Annotated[
    int,
    BeforeValidator(lambda value: int(value) if isinstance(value, bool) else value),
    Field(ge=0, le=MOST_REMEMBERED),
]
Widths = Annotated[list[Width], Field(min_length=1, max_length=8)]


def check_bytes(name: str, value: int, bytes_each: float) -> None:
    """Raise if ``value`` items of ``bytes_each`` bytes have more than :data:`MOST_BYTES`.

    Raises:
        ValueError: names the setting.
    """
    if value * bytes_each > MOST_BYTES:
        raise checks.refuse(name, value, f"at most {MOST_BYTES:.1e} bytes in all; each has {bytes_each:.1e}")


def for_seed(value: Any, seed: int) -> Any:
    """Return a setting with ``{seed}`` replaced in all its texts."""
    if isinstance(value, str):
        return value.replace("{seed}", str(seed))
    if isinstance(value, Mapping):
        return {key: for_seed(each, seed) for key, each in value.items()}
    return [for_seed(each, seed) for each in value] if isinstance(value, list | tuple) else value


class RateSettings(Settings):
    """Learning rate with linear decay."""

    learning_rate: Rate = 1e-3
    final_learning_rate: Rate = 1e-4  # at the end

    def rate(self, remaining: float) -> float:
        """Return the learning rate where this share (1 to 0) of the training remains."""
        return self.final_learning_rate + remaining * (self.learning_rate - self.final_learning_rate)


class NetworkSettings(Settings):
    """Actor and critic, and their inputs."""

    network: str = "parts"  # among agents.networks.NETWORKS
    activation: Literal["tanh", "relu"] = "tanh"
    net: Widths = [128, 128]
    critic_net: Widths = [64, 64]
    attention: Width = 32
    turned: bool = False  # rotate rows by quarter turns so that the goal lies to the right and up
    remembers: Steps = 0  # previous steps of which rows contain the action; true: 1
    recalls: list[str] = Field([], max_length=100)  # columns of these steps' observations that rows contain
    blind: list[str] = Field([], max_length=100)  # columns that the network does not read


class PPOSettings(NetworkSettings, RateSettings):
    """PPO with parts as samples; defaults are what trained fastest on two cores."""

    n_steps: int = Field(32, ge=1, le=1_000_000)
    batch_size: int = Field(4096, ge=2, le=100_000_000)  # parts
    n_epochs: int = Field(3, ge=1, le=1000)
    gamma: float = Field(0.98, gt=0, le=1)
    gae_lambda: float = Field(0.95, gt=0, le=1)
    clip_range: float = Field(0.2, gt=0, le=10)
    target_kl: float | None = Field(None, gt=0, le=100)  # of an update; the learning rate follows it
    log_std_init: float = Field(-0.5, ge=-5, le=0.5)
    # Size of actions above which exploration grows with them; None: the same for all.
    noise_floor: float | None = Field(None, gt=0, le=1)
    # Of exploration between successive steps (coloured noise: Hollenstein et al. 2024, arXiv 2312.11091).
    noise_correlation: float = Field(0.0, ge=0, lt=1)
    touch_cost: float = Field(0.0, ge=0, le=1000)  # reward per step and part in contact with another; training only
    shared: float = Field(0.0, ge=0, le=1)  # share of every other part's reward that a part gets; training only
    # Largest mean cost of an episode, for environments with ``costs``: costs are then subtracted from rewards with a multiplier
    # that follows the excess (Ray, Achiam & Amodei 2019, "Benchmarking safe exploration in deep reinforcement learning").
    cost_limit: float | None = Field(None, ge=0)
    multiplier_rate: float = Field(0.05, gt=0, le=100)  # change of the multiplier in an update, times the excess
    critic_steps: int = Field(0, ge=0, le=MOST_STEPS)  # first steps, in which the critic alone learns


class DataSettings(NetworkSettings, RateSettings):
    """Learning from a data set; a step is an update from one minibatch."""

    dataset: str = Field(min_length=1)  # Minari's name, as ``python -m agents record`` writes it
    directory: str | None = None  # of the data sets; None: Minari's default
    episodes: int | None = Field(None, ge=1)  # of the data set, at most; None: all
    batch_size: int = Field(1024, ge=2, le=10_000_000)  # parts


class FlowSettings(DataSettings):
    """Flow matching, see :mod:`agents.flow`."""

    network: Literal["joint", "parts", "pixels"] = "joint"
    net: Widths = [256, 256, 256]  # residual blocks, of equal width
    batch_size: int = Field(256, ge=2, le=10_000_000)  # parts
    horizon: int = Field(8, ge=1, le=MOST_HORIZON)  # actions of a plan
    executed: int = Field(2, ge=1, le=MOST_HORIZON)  # of these, before the next plan
    euler_steps: int = Field(5, ge=1, le=1000)  # from noise to actions

    @model_validator(mode="after")
    def _fits(self) -> FlowSettings:
        if len(set(self.net)) > 1:
            raise PydanticCustomError("net", "equal widths of all residual blocks in 'net'")  # type: ignore[arg-type]
        if self.executed > self.horizon:
            raise PydanticCustomError("executed", "'executed' of at most 'horizon'")  # type: ignore[arg-type]
        return self


class OfflineSettings(DataSettings):
    """Cloning and implicit Q-learning, see :mod:`agents.offline`."""

    method: Literal["cloning", "iql"] = "cloning"
    floor: float = Field(1.0, gt=0, le=10)  # size of actions below which errors are absolute
    # Of "iql" (Kostrikov, Nair & Levine 2021):
    gamma: float = Field(0.98, gt=0, lt=1)
    expectile: float = Field(0.8, gt=0.5, lt=1)
    temperature: float = Field(1.0, gt=0, le=100)  # standard deviations of advantage per factor e of the weight
    tau: Rate = 0.01  # of the target network

    @model_validator(mode="after")
    def _supported(self) -> OfflineSettings:
        if self.method == "iql" and self.network == "pixels":
            raise PydanticCustomError("method", "method 'cloning' with network 'pixels'")  # type: ignore[arg-type]
        return self


class ImitationSettings(Settings):
    """Imitation of an expert before training, see :class:`agents.imitation.Imitation`."""

    expert: Any  # a policy with the environment's action; {seed} in its texts is replaced by the run's
    rounds: int = Field(4, ge=1, le=1000)
    steps: int = Field(100, ge=1, le=1_000_000)  # of each world, per round
    epochs: int = Field(4, ge=1, le=10_000)  # after each round, over all demonstrations
    batch_size: int = Field(2048, ge=1, le=10_000_000)  # parts
    learning_rate: Rate = 1e-3
    noise: float = Field(0.2, ge=0, le=10)  # largest standard deviation of the noise added to actions
    floor: float = Field(1.0, gt=0, le=10)  # size of actions below which errors are absolute


class ResidualSettings(Settings):
    """Correction of a classical policy, see :class:`agents.training_envs.ResidualEnv`."""

    base: dict[str, Any]  # a policy with action "wrench" (the default), "velocity" or "target", and observation "state"
    scale: float = Field(0.5, gt=0, le=2)  # of the network's action, before it is added to the base's

    @field_validator("base")
    @classmethod
    def _named(cls, base: dict[str, Any]) -> dict[str, Any]:
        try:
            return base_named(base)
        except ValueError:
            allowed = "a mapping with 'kind', the name of a policy that is itself no correction"
            raise PydanticCustomError("base", allowed) from None  # type: ignore[arg-type]


class JudgingSettings(Settings):
    """Evaluation during training: deterministic episodes on the same seeds every time."""

    episodes: int = Field(100, ge=1, le=1_000_000)
    first_seed: int = 500_000  # in the range "selection" of vibgym.seeds
    every: int = Field(1_000_000, ge=1, le=MOST_STEPS)  # steps
    # Which actor is kept: that with the highest success rate, or with the highest mean of 1 / time to goal, as scores rank.
    best: Literal["success", "speed"] = "success"
    cost_limit: float | None = Field(None, ge=0)  # that 95 % of the episodes shall not exceed; comes before ``best``


class ServesSettings(Settings):
    """Scenes that the policy file accepts besides the one of training."""

    tasks: list[str] | None = None  # names; None: the task of training
    surface: Literal["same", "any"] = "same"  # "any": number of rows and columns
    frequency: Range | None = None  # Hz, measured range; None: that of training
    element_size: Range | None = None  # m, the same
    parts: Literal["same", "any"] = "same"  # their number

    @field_validator("frequency", "element_size")
    @classmethod
    def _ordered(cls, ends: list[float] | None) -> list[float] | None:
        if ends is not None and ends[0] > ends[1]:
            raise PydanticCustomError("range", "[low, high]")
        return ends


class UntilSettings(Settings):
    """Condition that ends a stage of a curriculum: the first of those given that holds."""

    success: float | None = Field(None, gt=0, le=1)  # of the last 100 training episodes, with exploration
    steps: int | None = Field(None, ge=1, le=MOST_STEPS)  # of the stage

    @model_validator(mode="after")
    def _ends(self) -> UntilSettings:
        if self.success is None and self.steps is None:
            raise PydanticCustomError("until", "'success', 'steps' or both")  # type: ignore[arg-type]
        return self


class StageSettings(Settings):
    """Stage of a curriculum, see :class:`agents.curriculum.Curriculum`."""

    environment: dict[str, Any]  # arguments that differ from those of the run's environment; mappings are merged
    until: UntilSettings


class TrainSettings(Settings):
    """One training run, see :func:`agents.training_file.settings_from`."""

    task: str  # see vibgym.envs.vector.batch_of
    environment: dict[str, Any] = {"action": "patch"}
    worlds: int = Field(512, ge=1, le=100_000)
    steps: int = Field(ge=1, le=MOST_STEPS)
    seed: int = Field(0, ge=0, lt=2**32)  # Stable-Baselines3 accepts no more
    checkpoint_steps: int = Field(500_000, ge=1, le=MOST_STEPS)
    output: str | None = None  # directory; default: runs/<name of the file>
    scenes: list[dict[str, Any]] = Field([], max_length=10_000)  # added to environment; worlds are divided among them
    start: str | None = None  # policy file to start from; {seed} is replaced by the run's
    imitation: ImitationSettings | None = None
    residual: ResidualSettings | None = None
    curriculum: list[StageSettings] = Field([], max_length=100)  # easier environments before the run's own
    judging: JudgingSettings | None = None
    serves: ServesSettings = ServesSettings()
    algorithm: str = "ppo"  # among agents.algorithms.ALGORITHMS, or sb3.NAME
    own: SerializeAsAny[Settings]  # the algorithm's; in files they stand under its name

    def check_alone(self) -> None:
        """Reject ``residual``, ``imitation``, ``start`` and ``curriculum``, which PPO alone supports.

        Raises:
            ValueError: one is set.
        """
        for name in ("residual", "imitation", "start", "curriculum"):
            if getattr(self, name):
                raise checks.conflict(f"{name} requires algorithm 'ppo', got {self.algorithm!r}")

    def check_residual(self) -> None:
        """Reject settings of PPO that conflict with ``residual``.

        An expert of imitation gives actions, not corrections. In rows that remember or turn, the base's action would be
        repeated or not turned.

        Raises:
            ValueError: one is set.
        """
        assert isinstance(self.own, PPOSettings)
        if self.residual is None:
            return
        checks.choice("residual.base.action", self.residual.base["action"], CORRECTED)
        for name, got, allowed in (
            ("imitation", self.imitation, None),
            ("ppo.remembers", self.own.remembers, 0),
            ("ppo.turned", self.own.turned, False),
            ("ppo.network", self.own.network, "parts"),
            ("environment.action", self.action, self.residual.base["action"]),
        ):
            if got != allowed:
                raise checks.conflict(f"{name} must be {allowed!r} with 'residual'")

    @property
    def action(self) -> str:
        """Action of the environment."""
        return self.environment.get("action", "element")

    @property
    def all_scenes(self) -> list[dict[str, Any]]:
        """Scenes of the run: those given, or one for each shape of a split, or one without arguments."""
        if self.scenes:
            return self.scenes
        drawn = drawn_shapes(environment_id(self.task), self.environment)
        return [{}] if drawn is None else fixed_scenes(drawn)

    @model_serializer(mode="wrap")
    def _as_in_files(self, plain: Any) -> dict[str, Any]:
        """Put the algorithm's settings under its name."""
        key = self.algorithm.partition(".")[0]
        return {key if name == "own" else name: value for name, value in plain(self).items()}
