"""Rewards of single parts: they are unknown where a wrapper changes the reward of a world."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from gymnasium import wrappers
from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper, VectorWrapper

_KEEP = {
    wrapper.step
    for wrapper in (
        gym.Wrapper, gym.ObservationWrapper, gym.ActionWrapper, wrappers.TimeLimit, wrappers.OrderEnforcing,
        wrappers.PassiveEnvChecker, wrappers.RecordEpisodeStatistics, wrappers.RecordVideo, wrappers.HumanRendering,
        VectorWrapper, VectorObservationWrapper, VectorActionWrapper, wrappers.vector.RecordEpisodeStatistics,
        wrappers.vector.RecordVideo,
    )
}  # fmt: skip
"""Steps that return the reward unchanged."""


def keeps_rewards(env: Any) -> bool:
    """Return whether no wrapper of an environment, single or vector, changes the reward of its task.

    Gymnasium's wrappers for observations, actions, limits and records do not. A custom wrapper with its own ``step`` counts as
    one that does, unless its class sets ``keeps_rewards = True``.
    """
    return _all(env, "keeps_rewards")


def credits_parts(env: Any) -> bool:
    """Return whether ``info["parts"]["reward"]`` agrees with the reward of an environment's step.

    It does if :func:`keeps_rewards`, and with wrappers whose class sets ``credits_parts = True``: they also change the rewards
    of the parts, in ``info`` and ``final_info``. Otherwise every part is credited with the reward of its world.
    """
    return _all(env, "keeps_rewards", "credits_parts")


def _all(env: Any, *flags: str) -> bool:
    """Return whether every wrapper keeps rewards, or its class sets one of these flags."""
    while env is not env.unwrapped:
        cls = type(env)
        if cls.step not in _KEEP and not any(getattr(cls, name, False) for name in flags):
            return False
        env = env.env
    return True
