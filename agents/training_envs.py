"""Environments that runs train in: one batch of all scenes, and corrections of a classical policy."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from agents.training_settings import TrainSettings
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv, divided
from vibgym.envs import VibgymVectorEnv
from vibgym.envs.vector import batch_of
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import make_policy
from vibgym.policies.simulated import rows_of
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.residual import SCALE, Base
from vibgym.seeds import training_seed


def make_worlds(settings: TrainSettings, observation: str) -> VecEnv:
    """Return all worlds of a run as one batch, seeded for the first reset; with ``residual`` in :class:`ResidualEnv`.

    Args:
        settings: of the run.
        observation: the environment's ``observation=``.

    Raises:
        ValueError: invalid settings of the environment, or fewer worlds than scenes.
    """
    envs = []
    for scene, share in divided("worlds", settings.worlds, settings.all_scenes):
        own = {"autoreset_mode": "SameStep", **settings.environment, **scene}
        own |= {"num_envs": share, "observation": observation}
        env = batch_of(settings.task, **own)
        if not isinstance(env.unwrapped, VibgymVectorEnv):
            allowed = "a task or an id whose batch is a VibgymVectorEnv, wrapped or not"
            raise checks.refuse("task", settings.task, allowed)
        if settings.residual is not None:
            with checks.within("residual"):
                base = make_policy(settings.residual.base, TaskInfo.of(env))
                env = ResidualEnv(env, base, settings.residual.scale)
        envs.append(env)
    worlds = VecEnv(*envs)
    worlds.seed(training_seed(settings.seed))
    return worlds


class ResidualEnv(VectorWrapper):
    """Batch of worlds in which a base policy acts, corrected by the learner's action.

    Rows of observations, also of ``info["final_obs"]``, contain the base's action (``vibgym.policies.trained.residual``). The
    base's memory follows the applied action, not the proposed one.

    Args:
        env: a :class:`vibgym.envs.VibgymVectorEnv` with the base's action, ``observation="parts_and_state"`` and
            ``autoreset_mode="SameStep"``.
        base: policy with an action of ``vibgym.envs.motions.MOTIONS`` and observation ``"state"``.
        scale: of the learner's action.

    Attributes:
        parts_layout: of a row.
        parts, surface, autoreset_mode: of the environment.

    Raises:
        ValueError: an environment or a base that does not fit, or a bad scale.
    """

    keeps_rewards = True  # see vibgym.adapters.credit

    def __init__(self, env: VectorEnv, base: Policy, scale: float = SCALE) -> None:
        inner: Any = env.unwrapped
        space = env.single_observation_space
        if inner.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise checks.refuse("env.autoreset_mode", inner.autoreset_mode, f"{AutoresetMode.SAME_STEP}")
        if not isinstance(space, spaces.Dict) or set(space.spaces) != {"parts", "mask", "state"}:
            raise checks.refuse("env.single_observation_space", space, "that of observation='parts_and_state'")
        super().__init__(env)
        self.base = Base(base, TaskInfo.of(env), scale)
        checks.choice("env.action", inner.core.options.action, (base.action,))
        self.parts, self.surface, self.autoreset_mode = inner.parts, inner.surface, inner.autoreset_mode
        self.parts_layout = self.base.layout
        columns = sum(row.width for row in self.base.layout)
        rows = spaces.Box(-1.0, 1.0, (inner.task.slots, columns), np.float32)
        self.single_observation_space = spaces.Dict({"parts": rows, "mask": space["mask"]})
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, env.num_envs)
        self._memory: Any = None
        self._action = np.zeros((env.num_envs, inner.core.action.size), dtype=np.float32)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset all worlds; ``options`` are those of the environment except ``reset_mask``."""
        seen, info = self.env.reset(seed=seed, options=options)
        self._memory = None
        return self._with_base(seen, None), info

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Apply the base's corrected action, then query the base again.

        Args:
            actions: (worlds, n) in [-1, 1]; the environment checks their sum with the base's.
        """
        done, self._memory = self.base.corrected(self._action, actions, self._memory)
        seen, reward, terminated, truncated, info = self.env.step(done)
        ended = terminated | truncated
        if ended.any():
            self._finish(info["final_obs"], np.flatnonzero(ended))
        return self._with_base(seen, ended), reward, terminated, truncated, info

    def get_state(self) -> dict[str, Any]:
        """Return everything needed to continue bit for bit, including the base's memory."""
        inner: Any = self.env.unwrapped
        return {"env": inner.get_state(), "action": self._action.copy(), "memory": copy.deepcopy(self._memory)}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Continue from what :meth:`get_state` returned; tuples of a memory may have become lists.

        Raises:
            ValueError: a state of another environment or base.
        """
        inner: Any = self.env.unwrapped
        inner.set_state(state["env"])
        memory = state["memory"]
        if memory is not None:
            _, pattern = self.base.policy.predict(inner.observed("state"))
            memory = _in_form(pattern, memory)
        self._memory, self._action = memory, np.array(state["action"])

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of the wrapper, or else of the environment, once for each world."""
        if name in vars(self):
            return (getattr(self, name),) * self.num_envs
        return self.env.unwrapped.get_attr(name)  # type: ignore[attr-defined]

    def _with_base(self, seen: dict[str, np.ndarray], start: np.ndarray | None) -> dict[str, np.ndarray]:
        """Query the base; return the learner's observation."""
        self._action, self._memory = self.base.policy.predict(seen["state"], self._memory, start)
        return {"parts": self.base.rows(seen["parts"], self._action), "mask": seen["mask"]}

    def _finish(self, final: np.ndarray, worlds: np.ndarray) -> None:
        """Add the base's action to the final observations of episodes, in place."""
        state = np.stack([final[world]["state"] for world in worlds])
        rows = np.stack([final[world]["parts"] for world in worlds])
        action, _ = self.base.policy.predict(state, rows_of(self._memory, worlds))
        for world, wide in zip(worlds, self.base.rows(rows, action), strict=True):
            final[world] = {"parts": wide, "mask": final[world]["mask"]}


def _in_form(pattern: Any, tree: Any) -> Any:
    """Return ``tree`` with tuples, including named ones, where ``pattern`` has them.

    Raises:
        ValueError: they differ in form.
    """
    if isinstance(pattern, tuple):
        values = [_in_form(*each) for each in zip(pattern, tree, strict=True)]
        return type(pattern)(*values) if hasattr(pattern, "_fields") else tuple(values)
    if np.shape(pattern) != np.shape(tree):
        raise ValueError(f"expected an array of shape {np.shape(pattern)}, got {np.shape(tree)}")
    return tree
