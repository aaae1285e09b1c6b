"""Bridges: to models that have ``predict`` alone, such as those of Stable-Baselines3, and to environments of another action."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym import checks
from vibgym.envs.actions import ACTIONS
from vibgym.policies.protocol import Policy
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import element_code


class ModelPolicy:
    """A model as a policy that reads ``"state"`` observations.

    Args:
        model: has ``predict``; where it has ``action_space`` or ``observation_space``, their shapes must fit.
        info: task and scene.
        action: the environment's ``action=`` that the model speaks; None: its own attribute ``action``, or, where it has none,
            the one that its ``action_space`` fits.
        usual: which one, where several fit.

    Raises:
        ValueError: the model's spaces fit no action or observation, or several actions, so that it must be told which.
    """

    observation = "state"

    def __init__(self, model: Any, info: TaskInfo, *, action: str | None = None, usual: str | None = None) -> None:
        self.model, kind = model, type(model).__name__
        checks.choice("policy.observation", getattr(model, "observation", "state"), ("state",))
        seen = getattr(getattr(model, "observation_space", None), "shape", (info.layout.size,))
        if seen != (info.layout.size,):
            allowed = f"shape {(info.layout.size,)}, the state observation of {info.name}"
            raise checks.refuse("policy", f"{kind} that reads observations of shape {seen}", allowed)
        action = getattr(model, "action", None) if action is None else action
        if action is not None:
            ACTIONS.choose("policy.action", action)
        shape = getattr(getattr(model, "action_space", None), "shape", None)
        known = {name: make(info.surface, info.parts) for name, make in ACTIONS.items()}
        fitting = [name for name, each in known.items() if shape in ((each.size,), each.shape)]
        if shape is None and action is not None:
            fitting = [action]
        got = f"{kind} with actions of shape {shape}"
        if not fitting or action not in (None, *fitting):
            shapes = {name: (each.size,) for name, each in known.items() if action in (None, name)}
            raise checks.refuse("policy", got, f"attributes 'action' and 'observation', or an action_space of {shapes}")
        if action is None and usual in fitting:
            action = usual
        if action is None and len(fitting) > 1:
            which = " or ".join(f"'action': {name!r}" for name in fitting)
            allowed = f"{{'policy': model, {which}}}, or an attribute 'action': both would fit"
            raise checks.refuse("policy", got, allowed)
        self.action = fitting[0] if action is None else action

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """The model's action, flat."""
        action, state = self.model.predict(observation, state, episode_start, deterministic)
        return np.reshape(action, (*np.shape(observation)[:-1], -1)), state


class InElements:
    """A policy that speaks ``"phasor"``, for an environment that was made with ``action="element"``.

    Args:
        policy: it.

    Attributes:
        policy: likewise.
    """

    action = "element"

    def __init__(self, policy: Policy) -> None:
        self.policy, self.observation = policy, policy.observation

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """The same phasors by amplitude and phase."""
        phasors, state = self.policy.predict(observation, state, episode_start, deterministic)
        coded = element_code(phasors.reshape(-1, 1, phasors.shape[-1] // 2, 2))
        return coded.reshape(phasors.shape), state
