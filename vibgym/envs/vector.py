"""The native vector environment: all worlds of the core in one kernel call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from vibgym import checks
from vibgym.envs.core import Core
from vibgym.tasks import TASKS


class VibgymVectorEnv(VectorEnv):
    """``num_envs`` worlds of one task; the same numbers, bit for bit, as that many single environments.

    Args:
        task: ``"Transport"``, ``"Align"``, ``"Rotate"``, ``"Sort"`` or ``"Singulate"``.
        num_envs: number of worlds.
        max_episode_steps: step limit, which truncates; None for no limit.
        autoreset_mode: NEXT_STEP (default), SAME_STEP (``final_obs`` and ``final_info`` in the info) or DISABLED (reset
            with ``options={"reset_mask": mask}``), as an ``AutoresetMode`` or its value.
        render_mode: None or ``"rgb_array"``.
        **settings: as for :class:`vibgym.envs.VibgymEnv`.

    Raises:
        ValueError: a bad setting.
    """

    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array"],
        "render_fps": 25,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        task: str,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        self.num_envs = checks.count("num_envs", num_envs)
        if max_episode_steps is not None:
            checks.count("max_episode_steps", max_episode_steps)
        if render_mode is not None:
            checks.choice("render_mode", render_mode, ("rgb_array",))
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            allowed = ", ".join(repr(mode.value) for mode in AutoresetMode)
            raise checks.refuse("autoreset_mode", autoreset_mode, allowed) from None
        self.core = Core(TASKS[checks.choice("task", task, tuple(TASKS))], self.num_envs, **settings)
        self.max_episode_steps = max_episode_steps
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_action_space = self.core.action.space
        self.single_observation_space = self.core.observation.space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._steps = np.zeros(self.num_envs, dtype=np.int64)
        self._finished = np.zeros(self.num_envs, dtype=bool)
        self._viewer: Any = None
        if render_mode is not None:
            from vibgym.envs.viewer import Viewer  # pygame is an extra

            self._viewer = Viewer(self.core, f"vibgym {task}", self.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin episodes in all worlds, or in those of ``options["reset_mask"]``.

        Args:
            seed: world k gets ``seed + k``, or entry k of a sequence; None goes on with the world's generator.
            options: ``{"reset_mask": bool array (num_envs,)}`` or None.
        """
        mask = self._reset_mask(options)
        for world, each in enumerate(self._seeds(seed)):
            if mask[world] and (each is not None or self._generators[world] is None):
                self._generators[world] = seeding.np_random(each)[0]
        if isinstance(seed, int | np.integer):
            self._np_random, self._np_random_seed = seeding.np_random(int(seed))
        self._begin(mask)
        return self.core.observe(), self._info(None if mask.all() else mask)

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all worlds by one step; finished ones are treated as the autoreset mode says."""
        core = self.core
        if not core.began:
            raise gym.error.ResetNeeded("call reset() before step()")
        actions = core.action.check(actions, self.num_envs)
        if self._viewer is not None:
            actions = actions.copy()  # the pictures are of this step, whatever the caller does to the array
        waiting = self._finished
        if self.autoreset_mode is AutoresetMode.DISABLED and waiting.any():
            raise gym.error.ResetNeeded(
                f"worlds {np.flatnonzero(waiting).tolist()} have ended: reset them with options={{'reset_mask': mask}}"
            )
        core.step(actions)
        self._steps += 1
        if self._viewer is not None:
            for world in range(self.num_envs):
                self._viewer.follow(world)
        if waiting.any():  # NEXT_STEP: the step after the end is the reset
            self._begin(waiting)
        terminated = core.score.ended.copy()
        truncated = np.zeros(self.num_envs, dtype=bool)
        if self.max_episode_steps is not None:
            truncated = self._steps >= self.max_episode_steps
        finished = terminated | truncated
        reward = core.score.reward.copy()
        final: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and finished.any():
            final = {
                "final_obs": self._objects(core.observe(), finished),
                "_final_obs": finished.copy(),
                "final_info": self._info(finished),
                "_final_info": finished.copy(),
            }
            self._begin(finished)
            finished = np.zeros(self.num_envs, dtype=bool)
        self._finished = finished
        return core.observe(), reward, terminated, truncated, {**final, **self._info()}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """One picture a world for ``"rgb_array"``."""
        if self._viewer is None:
            return None
        return tuple(self._viewer.frame(world) for world in range(self.num_envs))

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray:
        """Batched goal reward, see :meth:`vibgym.tasks.PoseTask.compute_reward`."""
        return self.core.compute_reward(achieved_goal, desired_goal, info)

    def close_extras(self, **kwargs: Any) -> None:
        """Release the viewer."""
        if self._viewer is not None:
            self._viewer.close()

    def _begin(self, mask: np.ndarray) -> None:
        worlds = np.flatnonzero(mask)
        self.core.reset(worlds, [self._generators[world] for world in worlds.tolist()])  # type: ignore[misc]
        self._steps[worlds] = 0
        self._finished = self._finished & ~mask
        if self._viewer is not None:
            for world in worlds:
                self._viewer.begin(world)

    def _seeds(self, seed: Any) -> Sequence[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer) and not isinstance(seed, bool):
            first = checks.count("seed", seed, least=0)
            return [first + k for k in range(self.num_envs)]
        if isinstance(seed, Sequence) and not isinstance(seed, str) and len(seed) == self.num_envs:
            return [None if each is None else checks.count(f"seed[{k}]", each, least=0) for k, each in enumerate(seed)]
        raise checks.refuse("seed", seed, f"None, a whole number >= 0, or a sequence of {self.num_envs}")

    def _reset_mask(self, options: dict[str, Any] | None) -> np.ndarray:
        if not options or "reset_mask" not in options:
            return np.ones(self.num_envs, dtype=bool)
        mask = np.asarray(options["reset_mask"])
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise checks.refuse("options['reset_mask']", mask, f"bool array ({self.num_envs},) with at least one True")
        if not self.core.began and not mask.all():
            raise checks.refuse("options['reset_mask']", mask, "all True at the first reset")
        return mask

    def _objects(self, observations: Any, mask: np.ndarray) -> np.ndarray:
        """The observations of the worlds in ``mask`` one by one, None elsewhere, as Gymnasium hands out final ones."""
        result = np.full(self.num_envs, None, dtype=object)
        for world in np.flatnonzero(mask):
            if isinstance(observations, dict):
                result[world] = {key: value[world] for key, value in observations.items()}
            else:
                result[world] = observations[world]
        return result

    def _info(self, mask: np.ndarray | None = None) -> dict[str, Any]:
        """Batched info with Gymnasium's ``_key`` masks; zeros outside ``mask``."""
        core = self.core
        here = np.ones(self.num_envs, dtype=bool) if mask is None else mask
        info: dict[str, Any] = {}
        for name, value in core.facts().items():
            info[name] = value.copy() if mask is None else np.where(mask, value, np.zeros((), value.dtype))
            info[f"_{name}"] = here.copy()
        terms: dict[str, Any] = {}
        for k, name in enumerate(core.term_names):
            term = core.terms[:, k]
            terms[name] = term.copy() if mask is None else np.where(mask, term, 0.0)
            terms[f"_{name}"] = here.copy()
        info["reward_terms"], info["_reward_terms"] = terms, here.copy()
        return info
