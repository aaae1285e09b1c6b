"""Settings of PPO."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from agents.training.hyperparameters import MOST_STEPS, NetworkSettings, RateSettings


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
    # Exploration grows with actions above it; None: is the same for all.
    noise_floor: float | None = Field(None, gt=0, le=1)
    touch_cost: float = Field(0.0, ge=0, le=1000)  # of a step, to a part in touch with another; in training alone
    critic_steps: int = Field(0, ge=0, le=MOST_STEPS)  # in which the critic alone learns
    precision: Literal["float32", "bfloat16"] = "float32"  # of updates; bfloat16 where the processor computes in it
    overlap: bool = False  # rollouts are made beside updates, by a policy that is one update old
