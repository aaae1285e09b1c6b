"""Settings of SAC."""

from __future__ import annotations

from pydantic import Field

from agents.training.hyperparameters import MOST_STEPS, Rate, RateSettings, Widths


class SACSettings(RateSettings):
    """Soft actor-critic, see :class:`agents.training.sac.learner.SAC`; the learning rate stays, unless you let it fall."""

    final_learning_rate: Rate = 1e-3
    buffer_size: int = Field(200_000, ge=1, le=1_000_000_000)  # transitions of all worlds
    learning_starts: int = Field(2_000, ge=0, le=MOST_STEPS)  # steps with random actions
    train_freq: int = Field(1, ge=1, le=100_000)  # steps of each world between updates
    gradient_steps: int = Field(8, ge=1, le=100_000)  # at each update
    batch_size: int = Field(512, ge=1, le=10_000_000)
    gamma: float = Field(0.99, gt=0, lt=1)
    tau: Rate = 0.005  # of the target networks
    ent_coef: float = Field(1.0, gt=0, le=100)  # the temperature at the beginning; learned from there
    target_entropy: float | None = Field(None, ge=-1e6, le=1e6)  # default: minus the number of actions
    net: Widths = [128, 128]  # of actor and critics
