"""Stable-Baselines3's ``VecEnv`` over the native vector environment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common import vec_env
from stable_baselines3.common.monitor import Monitor

from vibgym import checks
from vibgym.adapters.credit import credits_parts, keeps_rewards


class VecEnv(vec_env.VecEnv):
    """Stable-Baselines3's ``VecEnv`` over one or several ``VibgymVectorEnv`` in same-step autoreset mode.

        VecEnv("vibgym/Align-v0", num_envs=256, action="field")

    Several environments may differ in their scene, such as the part or its friction, but not in their spaces.

    The info of a finished world holds that of the environment except ``parts``, ``terminal_observation``,
    ``TimeLimit.truncated``, and ``episode`` (return, length, and with ``costs`` their sum ``"c"``), like SB3's Monitor, which
    :meth:`env_is_wrapped` reports. Infos of running worlds are empty. ``reset_infos`` are those of the last resets.
    ``set_options`` takes options of a single environment, or a list with those of each world, different poses and goals only.

    Rewards are those of the outermost wrapper. Wrappers with a state are part of :meth:`get_state` only if they define
    ``get_state`` and ``set_state``, which include the state of the environment.

    Args:
        envs: the id of a registered environment, or vector environments, possibly wrapped, with
            ``autoreset_mode="SameStep"`` and a box or a dictionary of boxes as observation.
        num_envs: number of worlds; requires an id.
        wrappers: of vector environments, the innermost first, applied to each of ``envs``.
        settings: of :func:`gymnasium.make_vec`; require an id.

    Attributes:
        envs: the environments, wrapped.  env: the first one, without outer wrappers that hide ``parts_layout``.
        keeps_rewards, credits_parts: see :mod:`vibgym.adapters.credit`.
        part_reward: (worlds, parts) rewards of the parts in the last step, or of their world unless :attr:`credits_parts`.
        part_cost: (worlds, parts) costs of the parts in the last step; zeros in environments without ``costs``.

    Raises:
        ValueError: another mode or observation, spaces that differ, or settings without an id.
    """

    def __init__(
        self,
        *envs: Any,
        num_envs: int | None = None,
        wrappers: Sequence[Callable[[VectorEnv], VectorEnv]] = (),
        **settings: Any,
    ) -> None:
        if len(envs) == 1 and isinstance(envs[0], str):
            worlds = checks.count("num_envs", 1 if num_envs is None else num_envs)
            envs = (gym.make_vec(envs[0], num_envs=worlds, **{"autoreset_mode": "SameStep", **settings}),)
        elif num_envs is not None or settings or not envs:
            got = sorted([*settings, *(["num_envs"] if num_envs is not None else [])])
            raise checks.conflict(f"settings {got} require the name of an environment, not environments")
        for wrap in wrappers:
            envs = tuple(map(wrap, envs))
        self.envs, self._scenes = envs, [_outermost(env, "parts_layout") for env in envs]
        self.env = self._scenes[0]
        space, actions = envs[0].single_observation_space, envs[0].single_action_space
        for env in envs:
            mode = env.metadata.get("autoreset_mode")
            if mode is not AutoresetMode.SAME_STEP:
                raise checks.refuse("env.autoreset_mode", mode, "AutoresetMode.SAME_STEP")
            if env.single_observation_space != space or env.single_action_space != actions:
                got = f"{env.single_observation_space} and {env.single_action_space}"
                raise checks.refuse("scenes", got, f"scenes with the same spaces, {space} and {actions}")
        boxes = space.values() if isinstance(space, gym.spaces.Dict) else (space,)
        if not all(isinstance(box, gym.spaces.Box | gym.spaces.MultiBinary) for box in boxes):
            raise checks.Refused(
                f"env: observation is {space}; allowed: a box, or a dictionary of boxes and binary arrays"
            )
        super().__init__(sum(env.num_envs for env in envs), space, actions)
        self.metadata["render_fps"] = envs[0].metadata.get("render_fps", 30)  # SB3's default
        first = np.cumsum([0, *(env.num_envs for env in envs)])
        self._slices = [slice(a, b) for a, b in zip(first[:-1], first[1:], strict=True)]
        self._seed: int | None = None
        self._actions = np.zeros((self.num_envs, *(actions.shape or ())), dtype=np.float32)
        self._return = np.zeros(self.num_envs)
        self._length = np.zeros(self.num_envs, dtype=np.int64)
        self.keeps_rewards, self.credits_parts = all(map(keeps_rewards, envs)), all(map(credits_parts, envs))
        self.part_reward = np.zeros((self.num_envs, len(self.env.parts)))
        self.part_cost = np.zeros_like(self.part_reward)
        self._costs = all(getattr(getattr(env.unwrapped, "core", None), "costs", None) is not None for env in envs)
        self._cost = np.zeros(self.num_envs)

    def reset(self) -> Any:
        observations = []
        if len(self._options) != self.num_envs:
            raise checks.refuse("options", f"{len(self._options)} mappings", f"one mapping, or {self.num_envs}")
        options = [_joint(self._options[own]) for own in self._slices]
        for env, own, start in zip(self.envs, self._slices, options, strict=True):
            seen, info = env.reset(seed=None if self._seed is None else self._seed + own.start, options=start)
            observations.append(seen)
            self.reset_infos[own] = _of_worlds(info, list(range(env.num_envs)))
        self._seed = None
        self._reset_options()
        for values in (self._return, self._length, self._cost):
            values[:] = 0
        return _joined(observations)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed world k with ``seed + k`` at the next reset."""
        self._seed = seed
        return [None if seed is None else seed + k for k in range(self.num_envs)]

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> Any:
        steps = [env.step(self._actions[own]) for env, own in zip(self.envs, self._slices, strict=True)]
        reward, terminated, truncated = (_joined([step[k] for step in steps]) for k in (1, 2, 3))
        done = terminated | truncated
        self._return += reward
        self._length += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        self.part_reward = np.repeat(reward[:, None], len(self.env.parts), axis=1)
        if self.credits_parts:
            self.part_reward = _joined([step[4]["parts"]["reward"] for step in steps])
        if self._costs:
            self.part_cost = _joined([step[4]["parts"]["cost"] for step in steps])
            for own, step in zip(self._slices, steps, strict=True):
                self._cost[own] += np.where(done[own], 0.0, step[4]["cost"])
        for own, (_, _, _, _, info) in zip(self._slices, steps, strict=True):
            ended = np.flatnonzero(done[own]).tolist()
            if not ended:
                continue
            final, started = info["final_info"], _of_worlds(info, ended)
            for k, last, self.reset_infos[own.start + k] in zip(ended, _of_worlds(final, ended), started, strict=True):
                world = own.start + k
                if self.credits_parts:
                    self.part_reward[world] = final["parts"]["reward"][k]
                infos[world] = {
                    **last,
                    "terminal_observation": info["final_obs"][k],
                    "TimeLimit.truncated": bool(truncated[world] and not terminated[world]),
                    "episode": {"r": float(self._return[world]), "l": int(self._length[world]), "t": 0.0},
                }
                if self._costs:
                    self.part_cost[world] = final["parts"]["cost"][k]
                    infos[world]["episode"]["c"] = float(self._cost[world] + final["cost"][k])
        for values in (self._return, self._length, self._cost):
            values[done] = 0
        return _joined([step[0] for step in steps]), reward.astype(np.float32), done, infos

    def get_state(self) -> dict[str, Any]:
        """Return a snapshot that continues bit for bit."""
        own = {"return": self._return.copy(), "length": self._length.copy(), "seed": self._seed}
        own |= {"cost": self._cost.copy()} if self._costs else {}
        return {"scenes": [_outermost(env, "get_state").get_state() for env in self.envs], **own}

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore a snapshot.

        Raises:
            ValueError: a snapshot of other scenes.
        """
        if len(state["scenes"]) != len(self.envs):
            raise checks.refuse("state['scenes']", len(state["scenes"]), f"{len(self.envs)} states")
        for env, own in zip(self.envs, state["scenes"], strict=True):
            _outermost(env, "set_state").set_state(own)
        self._return[:], self._length[:], self._seed = state["return"], state["length"], state["seed"]
        if self._costs:
            self._cost[:] = state["cost"]

    def close(self) -> None:
        for env in self.envs:
            env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return self._of([value for env in self._scenes for value in env.get_attr(attr_name)], indices)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute for all worlds, which share one environment per scene."""
        for env in self._scenes:
            setattr(env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Return a method's result for each world; for ``compute_reward`` the whole batch for each of them."""
        if method_name == "compute_reward":
            return [self.env.compute_reward(*args, **kwargs) for _ in self._get_indices(indices)]
        return self._of([value for env in self._scenes for value in env.call(method_name, *args, **kwargs)], indices)

    def _of(self, values: Sequence[Any], indices: Any) -> list[Any]:
        return [values[world] for world in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return whether each world has a wrapper of this class; true for SB3's ``Monitor``, whose infos the adapter has."""
        wrapped = [
            wrapper_class is Monitor or _is_wrapped(env, wrapper_class)
            for env in self.envs
            for _ in range(env.num_envs)
        ]
        return self._of(wrapped, indices)

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return an image (height, width, 3) of each world; the environments need ``render_mode="rgb_array"``."""
        return [image for env in self.envs for image in env.render() or [None] * env.num_envs]


def _of_worlds(info: dict[str, Any], worlds: list[int]) -> list[dict[str, Any]]:
    """Return the info of some worlds of a batch, except that of their parts and final values."""
    columns: dict[str, list[Any]] = {}
    for name, values in info.items():
        if isinstance(values, dict) and name != "parts" and not name.startswith("final_"):
            columns[name] = _of_worlds(values, worlds)
        elif isinstance(values, np.ndarray) and values.dtype != object and name[0] != "_":
            columns[name] = values[worlds].tolist() if values.ndim == 1 else list(values[worlds])
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)] or [{} for _ in worlds]


def _joint(options: list[dict[str, Any]]) -> dict[str, Any] | None:
    """Return options of single worlds as those of their batch; raise ValueError unless all but poses and goals are equal."""
    shared, placed = options[0], {"pose", "goal"}
    joint = {name: value for name, value in shared.items() if name not in placed}
    for own in options:
        if set(own) != set(shared) or any(not np.array_equal(own[name], joint[name]) for name in joint):
            raise checks.refuse("options", own, f"those of the first world except 'pose' and 'goal': {shared}")
    joint |= {name: np.stack([np.atleast_2d(own[name]) for own in options]) for name in placed & set(shared)}
    return joint or None


def _is_wrapped(env: Any, cls: Any) -> bool:
    """Return whether a wrapper of this class is around an environment."""
    while env is not env.unwrapped:
        if isinstance(env, cls):
            return True
        env = env.env
    return False


def _outermost(env: Any, name: str) -> Any:
    """Return the outermost of an environment and its wrappers that has an attribute of this name."""
    while not hasattr(env, name) and env is not env.unwrapped:
        env = env.env
    return env


def _joined(batches: list[Any]) -> Any:
    """Return the batches of all scenes as one."""
    if len(batches) == 1:
        return batches[0]
    if isinstance(batches[0], dict):
        return {name: np.concatenate([batch[name] for batch in batches]) for name in batches[0]}
    return np.concatenate(batches)
