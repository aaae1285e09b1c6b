"""Whether each part is paid on its own: where a wrapper changes the reward of a world, what the parts' are is not known."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from gymnasium import wrappers
from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper, VectorWrapper

_KEEP = {
    each.step
    for each in (
        gym.Wrapper, gym.ObservationWrapper, gym.ActionWrapper, wrappers.TimeLimit, wrappers.OrderEnforcing,
        wrappers.PassiveEnvChecker, wrappers.RecordEpisodeStatistics, wrappers.RecordVideo, wrappers.HumanRendering,
        VectorWrapper, VectorObservationWrapper, VectorActionWrapper, wrappers.vector.RecordEpisodeStatistics,
        wrappers.vector.RecordVideo,
    )
}  # fmt: skip
"""Steps that hand on the reward as it is."""


def keeps_rewards(env: Any) -> bool:
    """Whether what an environment's step returns is what its task pays, single or vector.

    That is so without wrappers, and with those that hand on rewards as they are: Gymnasium's for observations, actions, limits
    and records. A wrapper of your own whose ``step`` is not theirs is taken to change the reward, unless its class says
    ``keeps_rewards = True``.
    """
    return _all(env, "keeps_rewards")


def credits_parts(env: Any) -> bool:
    """Whether ``info["parts"]["reward"]`` is what the reward of an environment's step is made of.

    That is so where rewards are kept, and with wrappers whose class says ``credits_parts = True``: they change the rewards of
    the parts, too, in ``info`` and in ``final_info``. Elsewhere every part is credited with the reward of its world.
    """
    return _all(env, "keeps_rewards", "credits_parts")


def _all(env: Any, *flags: str) -> bool:
    """Whether every wrapper passes rewards on unchanged, or its class sets one of these flags."""
    while env is not env.unwrapped:
        cls = type(env)
        if cls.step not in _KEEP and not any(getattr(cls, name, False) for name in flags):
            return False
        env = env.env
    return True
