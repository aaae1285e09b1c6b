"""SAC with hindsight on goal observations: model, checkpoint and policy of a training run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces

from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from agents.learned.adapter import StableBaselinesAdapter
from agents.learned.goal_features import GoalFeatures
from agents.learned.hindsight import HindsightBuffer, buffer_bytes
from agents.learned.sac import LeanSAC
from agents.learned.settings import TrainSettings
from agents.task_info import TaskInfo
from vibgym import checks

MOST_BUFFER = 2e9
"""Bytes of the replay buffer."""


class GoalExtractor(BaseFeaturesExtractor):
    """:class:`GoalFeatures` of a batch of tensors.

    Args:
        observation_space: of goal observations.
        features: which ones.
    """

    def __init__(self, observation_space: spaces.Dict, features: GoalFeatures) -> None:
        super().__init__(observation_space, features.size)
        self.period, self.goals = features.period, features.goals
        # What is no part of the state, so that a checkpoint does not carry it.
        self.register_buffer("kept", torch.from_numpy(features.kept), persistent=False)
        self.register_buffer("goal", torch.from_numpy(features.goal), persistent=False)
        self.register_buffer("inverse", torch.from_numpy(1.0 / features.scale), persistent=False)

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        difference = observations["desired_goal"] - observations["achieved_goal"]
        if self.period:
            turn = difference[:, 2]
            difference[:, 2] = turn - self.period * torch.round(turn / self.period)
        far = torch.tanh(difference[:, self.goal] * self.inverse)  # type: ignore[index, operator]
        return torch.cat((observations["observation"][:, self.kept], far), dim=1)  # type: ignore[index]


def make_model(settings: TrainSettings, env: StableBaselinesAdapter) -> LeanSAC:
    """An untrained SAC model.

    Raises:
        ValueError: an environment without goal observations, or a replay buffer that is too large to keep.
    """
    sac = settings.sac
    features = GoalFeatures(TaskInfo.of(env.env))
    if not isinstance(env.observation_space, spaces.Dict) or not env.env.core.observation.goal_reward:
        raise checks.refuse("observation", settings.environment.get("observation", "state"), "'goal' for SAC")
    assert isinstance(env.action_space, spaces.Box)
    size = buffer_bytes(sac.buffer_size, env.num_envs, env.observation_space, env.action_space)
    if size > MOST_BUFFER:
        allowed = f"a buffer of at most {MOST_BUFFER:.1e} bytes; this one has {size:.1e}"
        raise checks.refuse("sac.buffer_size", sac.buffer_size, allowed)

    def learning_rate(remaining: float) -> float:
        return sac.final_learning_rate + remaining * (sac.learning_rate - sac.final_learning_rate)

    return LeanSAC(
        "MultiInputPolicy",
        env,
        learning_rate=learning_rate,
        buffer_size=sac.buffer_size,
        learning_starts=sac.learning_starts,
        batch_size=sac.batch_size,
        tau=sac.tau,
        gamma=sac.gamma,
        train_freq=sac.train_freq,
        gradient_steps=sac.gradient_steps,
        policy_delay=sac.policy_delay,
        values=(-1.0 / (1.0 - sac.gamma), 0.0),
        replay_buffer_class=HindsightBuffer,
        replay_buffer_kwargs={"env": env, "hindsight": sac.hindsight},
        ent_coef=f"auto_{sac.ent_coef}",
        target_entropy="auto" if sac.target_entropy is None else sac.target_entropy,
        policy_kwargs={
            "net_arch": list(sac.net),
            "features_extractor_class": GoalExtractor,
            "features_extractor_kwargs": {"features": features},
            "optimizer_kwargs": {"fused": True},  # one pass over all weights, a third of the time of a pass over each
        },
        seed=settings.seed,
        device="cpu",
    )
