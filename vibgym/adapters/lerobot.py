"""Observations, names and task texts in LeRobot's format, and environments with them. Requires gymnasium alone.

:mod:`gym_vibgym` registers the environments; ``python -m agents export`` writes data sets with the same observations.
"""

from __future__ import annotations

import inspect
from typing import Any

import gymnasium as gym
import numpy as np

from vibgym import checks
from vibgym.envs.shared import SharedInterface
from vibgym.tasks import Task

AGENT, WORLD = "agent_pos", "environment_state"
"""Keys of an observation that ``lerobot.envs.utils.preprocess_observation`` renames to those in :data:`KEYS`."""

KEYS = {AGENT: "observation.state", WORLD: "observation.environment_state"}
"""Key of an observation -> key of a feature in data sets and policies of LeRobot."""

KINDS = ("parts", "state")
"""Observations that have this format."""


def observation_from(kind: str, seen: Any) -> dict[str, np.ndarray]:
    """Return an observation, or an array of them, as float32 vectors.

    Args:
        kind: one of :data:`KINDS`.
        seen: (..., n) for ``"state"``; ``parts`` (..., slots, n) and ``mask`` (..., slots) for ``"parts"``.

    Returns:
        ``agent_pos``: the state, or the rows of all slots, slot after slot. ``environment_state``: the same, followed for
        ``"parts"`` by the mask: 1 for slots with a part, 0 for empty ones, whose rows are 0. LeRobot's ACT and diffusion
        policies require a feature of each type.
    """
    if kind == "state":
        state = np.asarray(seen, dtype=np.float32)
        return {AGENT: state, WORLD: state}
    rows = np.asarray(seen["parts"], dtype=np.float32)
    rows = rows.reshape(*rows.shape[:-2], -1)
    return {AGENT: rows, WORLD: np.concatenate((rows, np.asarray(seen["mask"], dtype=np.float32)), axis=-1)}


def names_of(env: SharedInterface, kind: str) -> dict[str, list[str]]:
    """Return the names of the values of :func:`observation_from`: part, feature, and index in features of several values."""

    def values(prefix: str, name: str, width: int) -> list[str]:
        return [f"{prefix}.{name}" if width == 1 else f"{prefix}.{name}.{k}" for k in range(width)]

    slots = env.core.task.slots
    if kind == "state":
        rows, block = env.observation_layout, env.core.observation.layout.block
        named = [name for row in rows for name in values(f"part_{row.start // block}", row.name, row.width)]
        return {AGENT: named, WORLD: named}
    named = [
        name for p in range(slots) for row in env.parts_layout for name in values(f"part_{p}", row.name, row.width)
    ]
    return {AGENT: named, WORLD: named + [f"part_{p}.mask" for p in range(slots)]}


def text_of(task: type[Task]) -> str:
    """Return the instruction for language-conditioned policies: name and summary of the task, from its docstring."""
    summary = " ".join((inspect.getdoc(task) or "").partition("\n\n")[0].split())
    return f"{task.__name__}: {summary}" if summary else task.__name__


class LeRobotEnv(gym.Wrapper[dict[str, np.ndarray], Any, Any, Any]):
    """A single environment with observations in LeRobot's format, and the attributes that its rollouts read.

    Args:
        name: id of an environment of vibgym with a step limit.
        observation: one of :data:`KINDS`.
        settings: further keyword arguments of ``gym.make``.

    Attributes:
        kind: the observation.  task: name of the task.  task_description: see :func:`text_of`.

    Raises:
        ValueError: another observation, or an invalid setting.
    """

    def __init__(self, name: str, *, observation: str = "parts", **settings: Any) -> None:
        self.kind = checks.choice("observation", observation, KINDS)
        env = gym.make(name, observation=observation, **settings)
        super().__init__(env)
        core = env.unwrapped.core  # type: ignore[attr-defined]
        self.task_description = text_of(type(core.task))
        self.task = type(core.task).__name__
        self._max_episode_steps = env.get_wrapper_attr("_max_episode_steps")
        named = names_of(env.unwrapped, self.kind)  # type: ignore[arg-type]
        self.observation_space: Any = gym.spaces.Dict(
            {key: gym.spaces.Box(-1.0, 1.0, (len(names),), np.float32) for key, names in named.items()}
        )

    def reset(self, **arguments: Any) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """See :class:`vibgym.envs.VibgymEnv`."""
        seen, info = self.env.reset(**arguments)
        return observation_from(self.kind, seen), info

    def step(self, action: Any) -> tuple[dict[str, np.ndarray], Any, bool, bool, dict[str, Any]]:
        """See :class:`vibgym.envs.VibgymEnv`."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        return observation_from(self.kind, seen), float(reward), terminated, truncated, info


def make_env(name: str, **settings: Any) -> LeRobotEnv:
    """Make :class:`LeRobotEnv`; a function, since ``gym.make`` cannot read the metadata of a wrapper's class."""
    return LeRobotEnv(name, **settings)
