"""The native vector environment as Stable-Baselines3 wants it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from vibgym.envs import VibgymVectorEnv


class StableBaselinesAdapter(VecEnv):
    """A ``VecEnv`` over ``VibgymVectorEnv`` in same-step autoreset mode.

    A finished world's info holds ``terminal_observation``, ``TimeLimit.truncated``, ``is_success``, ``fallen`` where the task
    tells it, and ``episode`` (return and length), as SB3's Monitor would give; the infos of running worlds are empty. Of
    dictionary observations every entry is a batch.

    Args:
        env: made with ``autoreset_mode="SameStep"`` and an observation that is a box or a dictionary of boxes.
    """

    def __init__(self, env: VibgymVectorEnv) -> None:
        if env.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f"env: autoreset_mode is {env.autoreset_mode}; allowed: {AutoresetMode.SAME_STEP}")
        space = env.single_observation_space
        boxes = space.values() if isinstance(space, gym.spaces.Dict) else (space,)
        if not all(isinstance(each, gym.spaces.Box | gym.spaces.MultiBinary) for each in boxes):
            raise ValueError(f"env: observation is {space}; allowed: a box, or a dictionary of boxes and binary arrays")
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._seed: int | None = None
        self._actions = np.zeros(env.action_space.shape or (), dtype=np.float32)
        self._return = np.zeros(env.num_envs)
        self._length = np.zeros(env.num_envs, dtype=np.int64)

    def reset(self) -> Any:
        observation, _ = self.env.reset(seed=self._seed)
        self._seed = None
        self._return[:] = 0.0
        self._length[:] = 0
        return observation

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """World k gets ``seed + k`` at the next reset."""
        self._seed = seed
        return [None if seed is None else seed + k for k in range(self.num_envs)]

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> Any:
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        done = terminated | truncated
        self._return += reward
        self._length += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        worlds = np.flatnonzero(done)
        for world in worlds.tolist():
            infos[world] = {
                "terminal_observation": info["final_obs"][world],
                "TimeLimit.truncated": bool(truncated[world] and not terminated[world]),
                "is_success": bool(info["final_info"]["is_success"][world]),
                "episode": {"r": float(self._return[world]), "l": int(self._length[world]), "t": 0.0},
            }
            if "fallen" in info["final_info"]:
                infos[world]["fallen"] = bool(info["final_info"]["fallen"][world])
        self._return[worlds] = 0.0
        self._length[worlds] = 0
        return observation, reward.astype(np.float32), done, infos

    def close(self) -> None:
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return self._of(self.env.get_attr(attr_name), indices)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """All worlds share one environment, so an attribute is set for all."""
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """What a method says of the worlds, one by one; a batch of rewards, which is of no world, whole for each of them."""
        if method_name == "compute_reward":
            return [self.env.compute_reward(*args, **kwargs) for _ in self._get_indices(indices)]
        return self._of(self.env.call(method_name, *args, **kwargs), indices)

    def _of(self, values: Sequence[Any], indices: Any) -> list[Any]:
        return [values[world] for world in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * len(list(self._get_indices(indices)))
