"""Settings of a training run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium as gym
from pydantic import Field, field_validator
from pydantic_core import PydanticCustomError

import vibgym  # noqa: F401 - registers the environments
from vibgym.config import Settings, load_yaml, parse
from vibgym.tasks import TASKS

MOST_STEPS = 10**12

Rate = Annotated[float, Field(gt=0, le=1)]
Width = Annotated[int, Field(ge=1, le=4096)]


class PPOSettings(Settings):
    """PPO with parts as samples; defaults are what trained fastest on two cores."""

    n_steps: int = Field(32, ge=1, le=1_000_000)
    batch_size: int = Field(4096, ge=2, le=100_000_000)  # parts
    n_epochs: int = Field(3, ge=1, le=1000)
    learning_rate: Rate = 1e-3
    final_learning_rate: Rate = 1e-4  # reached linearly at the end
    gamma: float = Field(0.98, gt=0, le=1)
    gae_lambda: float = Field(0.95, gt=0, le=1)
    clip_range: float = Field(0.2, gt=0, le=10)
    ent_coef: float = Field(0.0, ge=0, le=100)
    target_kl: float | None = Field(None, gt=0, le=100)  # an update ends beyond 1.5 times it
    log_std_init: float = Field(-0.5, ge=-5, le=0.5)
    critic_steps: int = Field(0, ge=0, le=MOST_STEPS)  # in which the critic alone learns
    activation: Literal["tanh", "relu"] = "tanh"
    net: list[Width] = Field([128, 128], min_length=1, max_length=8)
    critic_net: list[Width] = Field([64, 64], min_length=1, max_length=8)
    attention: Width = 32
    network: Literal["parts", "elements"] = "parts"


class ImitationSettings(Settings):
    """What an expert teaches beforehand, see :class:`agents.learned.imitation.Imitation`."""

    expert: Any  # a policy that speaks the environment's action
    rounds: int = Field(4, ge=1, le=1000)
    steps: int = Field(100, ge=1, le=1_000_000)  # of each world, in a round
    epochs: int = Field(4, ge=1, le=10_000)  # after each round, over all that has been found
    batch_size: int = Field(2048, ge=1, le=10_000_000)  # parts
    learning_rate: Rate = 1e-3
    noise: float = Field(0.2, ge=0, le=10)  # largest standard deviation of what disturbs those who act
    own_share: float = Field(0.8, ge=0, le=1)  # of worlds in which the network acts, after the first round


class JudgingSettings(Settings):
    """How a learning curve is measured: deterministic episodes on the same seeds every time."""

    episodes: int = Field(100, ge=1, le=1_000_000)
    first_seed: int = Field(500_000, ge=0, le=2**31)
    every: int = Field(1_000_000, ge=1, le=MOST_STEPS)  # steps


class ServesSettings(Settings):
    """What else a policy may act on than what it was trained on."""

    tasks: list[str] | None = None  # names; None: the one that it was trained on
    surface: Literal["same", "any"] = "same"
    parts: Literal["same", "any"] = "same"  # their number


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
    start: str | None = None  # path of a policy to begin with
    imitation: ImitationSettings | None = None
    judging: JudgingSettings | None = None
    serves: ServesSettings = ServesSettings()
    ppo: PPOSettings = PPOSettings()  # type: ignore[call-arg]

    @property
    def environment_name(self) -> str:
        """Under which Gymnasium may know the environment."""
        return self.task if "/" in self.task else f"vibgym/{self.task}-v0"

    @field_validator("task")
    @classmethod
    def _known(cls, task: str) -> str:
        own = [spec.name for spec in gym.registry.values() if spec.namespace == "vibgym"]
        known = tuple(dict.fromkeys((*own, *TASKS)))
        if task not in known and not ("/" in task and task in gym.registry):
            raise PydanticCustomError("task", ", ".join(map(repr, known)))  # type: ignore[arg-type]
        return task


def load_settings(path: Path) -> TrainSettings:
    """Read a training file; the first fault is a one-line ValueError that names file and field."""
    data = load_yaml(path)
    if isinstance(data.get("ppo"), dict):
        data["ppo"] = parse(PPOSettings, data["ppo"], f"{path}: ppo")
    return parse(TrainSettings, data, str(path))
