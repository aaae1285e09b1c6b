"""Interface of safe reinforcement learning libraries: ``step`` returns the cost as a value of its own."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from vibgym import checks


class SafetyEnv:
    """Single or vector environment whose ``step`` returns ``(observation, reward, cost, terminated, truncated, info)``.

    This is the interface of Safety-Gymnasium (Ji et al., NeurIPS 2023), which libraries for constrained reinforcement learning
    expect. Other attributes and methods are those of the environment.

        SafetyEnv("vibgym/SortCrowded-v0", costs={"impulse": 1.0}, action="velocity")
        SafetyEnv(gym.make_vec("vibgym/SortCrowded-v0", num_envs=64, costs={"impulse": 1.0}))

    Args:
        env: an environment with ``costs=``, or the id of a registered one.
        **settings: of ``gym.make``, with an id.

    Raises:
        ValueError: an environment without costs, or settings without an id.
    """

    def __init__(self, env: Any, **settings: Any) -> None:
        if isinstance(env, str):
            env = gym.make(env, **settings)
        elif settings:
            raise checks.conflict(f"settings {sorted(settings)} require the id of an environment, not an environment")
        core = getattr(env.unwrapped, "core", None)
        if getattr(core, "costs", None) is None:
            raise checks.refuse("env", env, 'an environment of vibgym with costs, such as costs={"impulse": 1.0}')
        self.env = env

    def __getattr__(self, name: str) -> Any:
        if name == "env":  # not yet set, while a copy is made
            raise AttributeError(name)
        return getattr(self.env, name)

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, Any, dict[str, Any]]:
        """Advance by one step; the cost is ``info["cost"]``, of a batch one per world.

        In same-step autoreset mode the cost of a finished world is that of its last step, as is its reward.
        """
        observation, reward, terminated, truncated, info = self.env.step(action)
        cost = info["cost"]
        if "final_info" in info:
            cost = cost.copy()
            ended = info["_final_info"]
            cost[ended] = info["final_info"]["cost"][ended]
        return observation, reward, cost, terminated, truncated, info
