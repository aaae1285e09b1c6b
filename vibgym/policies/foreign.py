"""Adapters for models that have only ``predict``, such as those of Stable-Baselines3, and for another action."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym.envs.actions import ACTIONS
from vibgym.envs.observations import OBSERVATIONS
from vibgym.policies.task_info import Policy, TaskInfo

DICTIONARIES = {
    frozenset({"observation", "achieved_goal", "desired_goal"}): "goal",
    frozenset({"parts", "mask"}): "parts",
    frozenset({"parts", "mask", "state"}): "parts_and_state",
}
"""Observation by the keys of its dictionary."""


class ModelPolicy:
    """Policy that wraps a model.

    Args:
        model: object with ``predict``. Its ``action_space`` and ``observation_space``, where it has them, must fit the task.
        info: task and scene.
        action: the environment's ``action=``; None: the model's attribute ``action``, else the action that fits its
            ``action_space``.
        observation: the environment's ``observation=``; None: the model's attribute ``observation``, else the observation
            that fits its ``observation_space``, preferably that of the environment of ``info``.
        usual: action to choose if several fit.

    Raises:
        ValueError: the model's spaces fit no action or observation, or several.
    """

    def __init__(
        self,
        model: Any,
        info: TaskInfo,
        *,
        action: str | None = None,
        observation: str | None = None,
        usual: str | None = None,
    ) -> None:
        self.model = model
        self.action = _action_of(model, info, action, usual)
        self.observation = _observation_of(model, info, observation)
        self._space = getattr(model, "observation_space", None)
        if not isinstance(self._space, spaces.Space):
            self._space = info.observation_space if self.observation == info.observation else None

    def check(self, space: spaces.Space) -> None:
        """Raise ValueError if the model has an ``observation_space`` of other shapes."""
        own = getattr(self.model, "observation_space", None)
        if own is not None and not _fits(own, space):
            raise _misfit(self.model, _shapes(space))

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return the model's action as (n,) or (batch, n), and its state."""
        action, state = self.model.predict(observation, state, episode_start, deterministic)
        return np.reshape(action, (*self._batch_shape(observation), -1)), state

    def _batch_shape(self, observation: Any) -> tuple[int, ...]:
        """Return () for one observation and (batch,) for a batch."""
        space = self._space
        if isinstance(observation, Mapping):
            name, observation = next(iter(observation.items()))
            space = space[name] if isinstance(space, spaces.Dict) else None
        shape, own = np.shape(observation), getattr(space, "shape", None)
        return shape[: len(shape) - (1 if own is None else len(own))]


def _action_of(model: Any, info: TaskInfo, action: str | None, usual: str | None) -> str:
    """Return the action of a model; see :class:`ModelPolicy`."""
    action = getattr(model, "action", None) if action is None else action
    if action is not None:
        ACTIONS.choose("policy.action", action)
    shape = getattr(getattr(model, "action_space", None), "shape", None)
    if shape is None and action is not None:
        return action
    known = {name: make(info.surface, info.parts) for name, make in ACTIONS.items() if action in (None, name)}
    fitting = [name for name, kind in known.items() if shape in ((kind.size,), kind.shape)]
    if usual in fitting:
        return usual
    if len(fitting) == 1:
        return fitting[0]
    allowed = " or ".join(f"'action': {name!r}" for name in fitting)
    allowed = f"{{'policy': model, {allowed}}}, or have an attribute 'action': both would fit"
    if not fitting:
        shapes = {name: (kind.size,) for name, kind in known.items()}
        allowed = f"a model with an attribute 'action', or an action_space of {shapes}"
    raise checks.refuse("policy", f"{type(model).__name__} with actions of shape {shape}", allowed)


def _observation_of(model: Any, info: TaskInfo, observation: str | None) -> str:
    """Return the observation of a model; see :class:`ModelPolicy`."""
    observation = getattr(model, "observation", None) if observation is None else observation
    if observation is not None:
        OBSERVATIONS.choose("policy.observation", observation)
    space = getattr(model, "observation_space", None)
    if space is None:
        return observation or info.observation
    if observation in (None, info.observation) and _fits(space, info.observation_space):
        return info.observation
    if isinstance(space, spaces.Dict):
        fitting = DICTIONARIES.get(frozenset(space.spaces))
    else:
        fitting = "state" if getattr(space, "shape", None) == (info.layout.size,) else None
    if observation in (None, fitting) and fitting is not None:
        return fitting
    if observation in (None, "state"):
        raise _misfit(model, f"shape {(info.layout.size,)}, the state observation of {info.name}")
    return observation  # images and custom observations: checked against the environment's


def _misfit(model: Any, allowed: str) -> checks.Refused:
    shapes = _shapes(model.observation_space)
    return checks.refuse(
        "policy", f"{type(model).__name__} that reads observations of {shapes}", f"one that reads {allowed}"
    )


def _shapes(space: Any) -> str:
    """Return the shapes of a space, or of the entries of a dictionary, as text."""
    if isinstance(space, spaces.Dict):
        return str({name: inner.shape for name, inner in space.items()})
    return f"shape {getattr(space, 'shape', None)}"


def _fits(own: Any, space: Any) -> bool:
    """Return whether two spaces have the same shapes; SB3 moves the channels of images first."""
    if isinstance(own, spaces.Dict) or isinstance(space, spaces.Dict):
        both = isinstance(own, spaces.Dict) and isinstance(space, spaces.Dict)
        return both and own.keys() == space.keys() and all(_fits(own[name], space[name]) for name in space)
    one, other = getattr(own, "shape", None), getattr(space, "shape", None)
    channels_first = other is not None and len(other) == 3 and one == (other[2], *other[:2])
    return one is not None and (one == other or channels_first)


def element_code(table: np.ndarray) -> np.ndarray:
    """Return ``"element"`` actions, amplitude and phase in [-1, 1], for phasors (worlds, rows, columns, 2)."""
    coded = np.zeros(table.shape, dtype=np.float32)
    coded[..., 0] = -1.0  # most elements rest
    moves = np.nonzero((table[..., 0] != 0.0) | (table[..., 1] != 0.0))
    c, s = table[moves].T
    coded[(*moves, 0)] = 2.0 * np.minimum(np.hypot(c, s), 1.0) - 1.0
    coded[(*moves, 1)] = np.arctan2(s, c) / math.pi
    return coded.reshape(len(table), -1)


class InElements:
    """Policy that converts the ``"phasor"`` actions of another one for an environment with ``action="element"``."""

    action = "element"

    def __init__(self, policy: Policy) -> None:
        self.policy, self.observation = policy, policy.observation

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return the same phasors as amplitude and phase."""
        phasors, state = self.policy.predict(observation, state, episode_start, deterministic)
        coded = element_code(phasors.reshape(-1, 1, phasors.shape[-1] // 2, 2))
        return coded.reshape(phasors.shape), state
