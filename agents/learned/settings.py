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
    """Stable-Baselines3's PPO; defaults are what trained fastest on two cores."""

    n_steps: int = Field(32, ge=1, le=1_000_000)
    batch_size: int = Field(4096, ge=2, le=100_000_000)
    n_epochs: int = Field(3, ge=1, le=1000)
    learning_rate: Rate = 1e-3
    final_learning_rate: Rate = 1e-4  # reached linearly at the end
    gamma: float = Field(0.98, gt=0, le=1)
    gae_lambda: float = Field(0.95, gt=0, le=1)
    clip_range: float = Field(0.2, gt=0, le=10)
    ent_coef: float = Field(0.0, ge=0, le=100)
    log_std_init: float = Field(-0.5, ge=-20, le=5)
    activation: Literal["tanh", "relu"] = "tanh"
    net: list[Width] = Field([128, 128], min_length=1, max_length=8)


class SACSettings(Settings):
    """Stable-Baselines3's SAC with hindsight, see :mod:`agents.learned.off_policy`."""

    buffer_size: int = Field(300_000, ge=1, le=1_000_000_000)  # transitions of all worlds
    learning_starts: int = Field(2_000, ge=0, le=MOST_STEPS)  # steps with random actions
    train_freq: int = Field(1, ge=1, le=100_000)  # steps of each world between updates
    gradient_steps: int = Field(4, ge=1, le=100_000)  # at each update
    policy_delay: int = Field(2, ge=1, le=1000)  # gradient steps of the critics for one of the actor
    batch_size: int = Field(256, ge=1, le=10_000_000)
    learning_rate: Rate = 1e-3
    final_learning_rate: Rate = 1e-4  # reached linearly at the end
    gamma: float = Field(0.95, gt=0, lt=1)
    tau: Rate = 0.02  # of the target network
    ent_coef: float = Field(0.1, gt=0, le=100)  # at the beginning; learned from there
    target_entropy: float | None = Field(None, ge=-1e6, le=1e6)  # default: minus the number of actions
    hindsight: float = Field(0.8, ge=0, le=1)  # share of a batch with goals that were reached later
    horizon: int = Field(50, ge=0, le=1_000_000)  # steps that these were reached later at most
    noise: float = Field(0.3, ge=0, le=10)  # standard deviation of what is added to actions in the loudest world ...
    noise_steps: float = Field(5.0, ge=1, le=1e6)  # ... and steps that it lasts
    net: list[Width] = Field([128, 128], min_length=1, max_length=8)


class JudgingSettings(Settings):
    """How a learning curve is measured: deterministic episodes on the same seeds every time."""

    episodes: int = Field(100, ge=1, le=1_000_000)
    first_seed: int = Field(500_000, ge=0, le=2**31)
    every: int = Field(1_000_000, ge=1, le=MOST_STEPS)  # steps


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
    judging: JudgingSettings | None = None
    algorithm: Literal["ppo", "sac"] = "ppo"
    ppo: PPOSettings = PPOSettings()  # type: ignore[call-arg]
    sac: SACSettings = SACSettings()  # type: ignore[call-arg]

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
    for name, settings in (("ppo", PPOSettings), ("sac", SACSettings), ("judging", JudgingSettings)):
        if isinstance(data.get(name), dict):
            data[name] = parse(settings, data[name], f"{path}: {name}")
    return parse(TrainSettings, data, str(path))
