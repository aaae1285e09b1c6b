"""Worlds that runs train in: one batch of all scenes, corrections of a classical policy, and PPO's curriculum."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from agents.checkpoint import arrays
from agents.training_settings import TrainSettings
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.envs import VibgymVectorEnv
from vibgym.envs.vector import batch_of
from vibgym.policies.registry import make_policy
from vibgym.policies.simulated import rows_of
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.policies.trained.coding import Coding, Inputs
from vibgym.policies.trained.residual import SCALE, Base
from vibgym.seeds import training_seed

WINDOW = 100
"""Finished episodes over which success and logs are averaged."""


def make_worlds(settings: TrainSettings, observation: str) -> VecEnv:
    """Return all worlds of a run as one batch, seeded for the first reset; with ``residual`` in :class:`ResidualEnv`.

    Args:
        settings: of the run.
        observation: the environment's ``observation=``.

    Raises:
        ValueError: fewer worlds than scenes, or an environment without a native batch.
    """
    envs, scenes = [], settings.all_scenes
    if settings.worlds < len(scenes):
        raise checks.refuse("worlds", settings.worlds, f"at least {len(scenes)}, one for each scene")
    for scene, share in zip(scenes, np.array_split(np.arange(settings.worlds), len(scenes)), strict=True):
        arguments = {"autoreset_mode": "SameStep", **settings.environment, **scene, "observation": observation}
        env = batch_of(settings.task, num_envs=len(share), **arguments)
        if not isinstance(env.unwrapped, VibgymVectorEnv):
            allowed = "a task or an id whose batch is a VibgymVectorEnv, wrapped or not"
            raise checks.refuse("task", settings.task, allowed)
        if settings.residual is not None:
            with checks.within("residual"):
                base = make_policy(settings.residual.base, TaskInfo.of(env))
                env = ResidualEnv(env, base, settings.residual.scale, settings.adds_velocities)
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
        velocities: see :class:`.residual.Base`.

    Attributes:
        parts_layout: of a row.
        parts, surface, autoreset_mode: of the environment.
    """

    keeps_rewards = True  # see vibgym.adapters.credit

    def __init__(self, env: VectorEnv, base: Policy, scale: float = SCALE, velocities: bool = False) -> None:
        inner: Any = env.unwrapped
        space = env.single_observation_space
        if inner.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise checks.refuse("env.autoreset_mode", inner.autoreset_mode, f"{AutoresetMode.SAME_STEP}")
        if not isinstance(space, spaces.Dict) or set(space.spaces) != {"parts", "mask", "state"}:
            raise checks.refuse("env.single_observation_space", space, "that of observation='parts_and_state'")
        super().__init__(env)
        self.base = Base(base, TaskInfo.of(env), scale, velocities)
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
        """Apply the base's action, corrected by ``actions`` (worlds, n) in [-1, 1], then query the base again."""
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
        """Continue from what :meth:`get_state` returned; tuples of a memory may have become lists."""
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
        return {"parts": self.base.rows(seen["parts"], self._action, self._memory), "mask": seen["mask"]}

    def _finish(self, final: np.ndarray, worlds: np.ndarray) -> None:
        """Add the base's action to the final observations of episodes, in place."""
        state = np.stack([final[world]["state"] for world in worlds])
        rows = np.stack([final[world]["parts"] for world in worlds])
        action, memory = self.base.policy.predict(state, rows_of(self._memory, worlds))
        for world, wide in zip(worlds, self.base.rows(rows, action, memory), strict=True):
            final[world] = {"parts": wide, "mask": final[world]["mask"]}


def _in_form(pattern: Any, tree: Any) -> Any:
    """Return ``tree`` with tuples, including named ones, where ``pattern`` has them; raise ValueError if they differ."""
    if isinstance(pattern, tuple):
        values = [_in_form(*pair) for pair in zip(pattern, tree, strict=True)]
        return type(pattern)(*values) if hasattr(pattern, "_fields") else tuple(values)
    if np.shape(pattern) != np.shape(tree):
        raise ValueError(f"expected an array of shape {np.shape(pattern)}, got {np.shape(tree)}")
    return tree


class Worlds:
    """All worlds of a run. It trains in the easier environments of its curriculum first, each until its condition holds.

    Args:
        settings: of the run.
        observation: the environments' ``observation=``.

    Attributes:
        env: the worlds of the present stage.
        stage: index of the stage; the number of stages once the run trains in its own environment.
        began: steps of the run at which the stage began.
        observation: present one; None before the first reset.
        start: (worlds,) bool, where it is the first one of an episode.
        inputs: network inputs of the step before; None after a reset of all worlds.
        episodes: return, length, success and cost of the last finished ones.
    """

    def __init__(self, settings: TrainSettings, observation: str) -> None:
        self.settings, self._named = settings, observation
        self.began = 0
        self._generator = torch.Generator().manual_seed(settings.seed)
        self._noise = torch.zeros(1, 1, 1)
        self.episodes: deque[tuple[float, int, bool, float]] = deque(maxlen=WINDOW)
        self.env = self._made(len(settings.curriculum))
        for self.stage in reversed(range(len(settings.curriculum))):  # the first stage remains
            former, self.env = self.env, self._made(self.stage)
            former.close()
            if (self.env.observation_space, self.env.action_space) != (former.observation_space, former.action_space):
                self.env.close()
                where = f"curriculum[{self.stage}].environment"
                raise checks.conflict(f"{where} has other observations or actions than the run's environment")
        self.stage = 0
        self._forget()

    def _forget(self) -> None:
        self.observation: Any = None
        self.start = np.ones(self.env.num_envs, dtype=bool)
        self.inputs: Inputs | None = None
        self.episodes.clear()

    def _made(self, stage: int) -> VecEnv:
        last = stage == len(self.settings.curriculum)
        with checks.within("environment" if last else f"curriculum[{stage}].environment"):
            settings = self.settings.model_copy(update={"environment": self.environment(stage)})
            return make_worlds(settings, self._named)

    def environment(self, stage: int) -> dict[str, Any]:
        """Return the arguments of the environment of a stage. Mappings in it and in the run's environment are merged."""
        merged = dict(self.settings.environment)
        changes = {} if stage == len(self.settings.curriculum) else self.settings.curriculum[stage].environment
        for name, value in changes.items():
            both = isinstance(value, dict) and isinstance(merged.get(name), dict)
            merged[name] = {**merged[name], **value} if both else value
        return merged

    def begin(self, steps: int) -> None:
        """Reset new worlds, and go to the next stage if this one is over after so many steps of the run."""
        if self.observation is None:
            self._reset(steps)
        if self.is_over(steps):
            self.stage, self.began = self.stage + 1, steps
            self.env.close()
            self.env = self._made(self.stage)
            self._forget()
            self._reset(steps)

    def _reset(self, steps: int) -> None:
        """Reset all worlds with seeds of no other reset of the run."""
        # The stage, since imitation may already have made all steps of one.
        self.env.seed(training_seed(self.settings.seed, f"{steps} steps, stage {self.stage}"))
        self.observation = self.env.reset()

    def is_over(self, steps: int) -> bool:
        """Return whether the present stage of the curriculum has ended after so many steps of the run.

        Its success counts after as many steps as all worlds need for an episode that fails: successful ones finish first.
        """
        if self.stage == len(self.settings.curriculum):
            return False
        until, done = self.settings.curriculum[self.stage].until, steps - self.began
        if until.steps is not None and done >= until.steps:
            return True
        least = (self.env.env.unwrapped.max_episode_steps or 0) * self.env.num_envs
        if until.success is None or done < least or len(self.episodes) < WINDOW:
            return False
        return float(np.mean([success for _, _, success, _ in self.episodes])) >= until.success

    def encode(self, coding: Coding) -> Inputs:
        """Return the network inputs of the present observation."""
        return coding.encode(self.observation, self.inputs, self.start)

    def noise(self, shape: tuple[int, ...], correlation: float) -> torch.Tensor:
        """Return standard normal noise (worlds, parts, values); ``correlation`` is that with the step before in an episode."""
        noise = torch.randn(shape, generator=self._generator)
        if correlation:
            share = correlation * torch.from_numpy(~self.start).to(noise)[:, None, None]
            noise = self._noise = share * self._noise + (1.0 - share**2).sqrt() * noise
        return noise

    def step(self, coding: Coding, inputs: Inputs, action: np.ndarray) -> dict[int, Inputs]:
        """Make a step in all worlds.

        Args:
            coding: of the network.
            inputs: of the present observation.
            action: (worlds, parts, values) of the network.

        Returns:
            Inputs of the final observation in worlds whose episode the limit has cut off; :attr:`start` has all that ended.
        """
        self.observation, _, self.start, infos = self.env.step(coding.decode(inputs, action))
        self.inputs, cut = inputs, {}
        for world in np.flatnonzero(self.start).tolist():
            info, episode = infos[world], infos[world]["episode"]
            if info["TimeLimit.truncated"]:
                cut[world] = coding.encode(info["terminal_observation"], inputs.of(world))
            self.episodes.append((episode["r"], episode["l"], info["is_success"], episode.get("c", 0.0)))
        return cut

    def metrics(self) -> dict[str, float]:
        """Return means over the last episodes, and the stage of a curriculum."""
        if not self.episodes:
            return {}
        means = np.mean(self.episodes, axis=0)
        metrics = {name: float(mean) for name, mean in zip(("return", "length", "success", "cost"), means, strict=True)}
        return metrics | ({"stage": self.stage} if self.settings.curriculum else {})

    def get_state(self) -> dict[str, Any]:
        """Return everything needed to continue bit for bit."""
        plain = {name: getattr(self, name) for name in ("stage", "began", "observation", "start", "inputs")}
        noise = {"generator": self._generator.get_state(), "noise": self._noise}
        return {**plain, **noise, "episodes": list(self.episodes), "env": self.env.get_state()}

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue from what :meth:`get_state` returned."""
        self._generator.set_state(state["generator"])
        self._noise = state["noise"]
        state = arrays(state)
        if state["stage"] != self.stage:
            self.env.close()
            self.env = self._made(state["stage"])
        self.env.set_state(state["env"])
        self.stage, self.began = state["stage"], state["began"]
        self.observation, self.start = state["observation"], state["start"]
        self.inputs = None if state["inputs"] is None else Inputs(*state["inputs"])
        self.episodes = deque(map(tuple, state["episodes"]), maxlen=WINDOW)
