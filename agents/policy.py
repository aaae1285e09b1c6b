"""The protocol every policy follows, and how one is made from its name.

A policy has the call that Stable-Baselines3 models have, for one environment or a batch. It sees observations only; of the
scene it may know what an engineer would: the surface, the parts, their zones and the task, never the state behind the
observation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from vibgym import checks
from vibgym.envs.actions import ACTIONS
from vibgym.envs.crowd_observations import BLOCK_SIZE
from vibgym.envs.observations import STATE_SIZE
from vibgym.scene import Part, Surface
from vibgym.tasks import MANY_TASKS, POSE_TASKS, ManyTask, Task


class Policy(Protocol):
    """What can act in an environment."""

    action: str
    """Value of the environment's ``action=`` that the policy speaks."""

    observation: str
    """Value of the environment's ``observation=`` that the policy reads."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Actions for one observation or a batch, and the state to hand back at the next call.

        Args:
            observation: one observation or a batch of them.
            state: what the last call returned; None at the very start.
            episode_start: (batch,) bool, where an episode has just begun; None means state is None.
            deterministic: False lets a stochastic policy explore.
        """
        ...


@dataclass(frozen=True)
class Situation:
    """What a policy may know beforehand: what an engineer would tell it of the machine and the job."""

    task: str  # "Transport", "Align", "Rotate", "Sort", "Singulate", or an environment's name such as "SortTwelve"
    surface: Surface
    part: Part  # the first part
    parts: tuple[Part, ...] = ()  # all parts of a world; filled in for one
    kind: tuple[int, ...] = ()  # of each part, of tasks for several parts
    zones: np.ndarray | None = None  # (kinds, 4) m: x_low, y_low, x_high, y_high; None: parts shall only be apart
    slots: int = 0  # blocks of the state observation of tasks for several parts; 0: the task is one for one part

    def __post_init__(self) -> None:
        if not self.parts:
            object.__setattr__(self, "parts", (self.part,))

    @classmethod
    def of(cls, task: Task, name: str | None = None) -> Situation:
        """What is public of an environment's task.

        Args:
            task: ``env.unwrapped.core.task``.
            name: of the environment without ``vibgym/`` and version; None: the task's own.
        """
        name = type(task).__name__ if name is None else name
        if not isinstance(task, ManyTask):
            return cls(name, task.surface, task.parts[0])
        return cls(name, task.surface, task.parts[0], task.parts, tuple(task.kind.tolist()), task.zones, task.slots)

    @property
    def many(self) -> bool:
        """Whether the task is one for several parts."""
        return self.slots > 0

    def check_served(self, policy: str, many: bool) -> None:
        """Refuse a task that a policy does not serve.

        Args:
            policy: its name.
            many: whether it is for tasks with several parts.

        Raises:
            ValueError: the task is of the other sort.
        """
        if self.many != many:
            served = ", ".join(MANY_TASKS if many else POSE_TASKS)
            allowed = f"tasks for {'several parts' if many else 'one part'} ({served})"
            raise checks.refuse(f"policy {policy!r}", f"the task {self.task}", allowed)

    @property
    def state_size(self) -> int:
        """Length of one state observation."""
        return self.slots * BLOCK_SIZE if self.many else STATE_SIZE


class Foreign:
    """A model that has ``predict`` alone, such as one of Stable-Baselines3: its spaces tell what it speaks.

    Args:
        model: has ``predict``, and ``action_space`` whose shape is that of an action, flattened or not. Where element and
            phasor actions would both fit, it is taken for ``"element"``. It reads ``"state"`` observations.
        situation: surface and parts.

    Raises:
        ValueError: no action has that shape.
    """

    observation = "state"

    def __init__(self, model: Any, situation: Situation) -> None:
        self.model = model
        got = getattr(getattr(model, "action_space", None), "shape", None)
        shapes = {name: make(situation.surface, situation.parts).shape for name, make in ACTIONS.items()}
        fitting = [name for name, shape in shapes.items() if got in (shape, (math.prod(shape),))]
        if not fitting:
            allowed = "attributes 'action' and 'observation', or an action_space of a shape among "
            raise checks.refuse("policy", f"{type(model).__name__} with actions of shape {got}", f"{allowed}{shapes}")
        self.action = fitting[0]
        self.shape = shapes[self.action]

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """The model's action in the environment's shape."""
        action, state = self.model.predict(observation, state, episode_start, deterministic)
        return np.reshape(action, (*np.shape(observation)[:-1], *self.shape)), state


def make_policy(policy: Any, situation: Situation, seed: int = 0) -> Policy:
    """A policy from a name, the path of a trained one's JSON file, a mapping ``{"kind": name, **arguments}``, or anything that
    has ``predict``.

    Names: ``"zero"`` and ``"random"`` for all tasks, ``"open_loop"`` and ``"local_field"`` for one part, ``"local_fields"`` and
    ``"planner"`` for several.

    ``{"kind": "trained", "path": "agents/learned/shipped/{task}.json"}``: ``{task}`` is replaced by the task's name in
    lower case.

    Raises:
        ValueError: unknown name or arguments, a policy that does not serve this task, or a file that holds none for it.
    """
    from agents.control import CLASSICAL
    from agents.learned.trained import load_trained

    if hasattr(policy, "predict"):
        return policy if hasattr(policy, "action") and hasattr(policy, "observation") else Foreign(policy, situation)
    if isinstance(policy, str):
        policy = {"kind": "trained", "path": policy} if policy.endswith(".json") else {"kind": policy}
    if not isinstance(policy, Mapping):
        raise checks.refuse("policy", policy, "a name, a path, a mapping with 'kind', or an object with predict()")
    arguments = dict(policy)
    kind = checks.choice("policy.kind", arguments.pop("kind", None), (*CLASSICAL, "trained"))
    if kind == "trained":
        if set(arguments) != {"path"} or not isinstance(arguments["path"], str):
            raise checks.refuse("policy", dict(policy), "exactly 'kind' and 'path' for a trained policy")
        return load_trained(Path(arguments["path"].replace("{task}", situation.task.lower())), situation)
    if kind == "random":
        arguments.setdefault("seed", seed)
    try:
        return CLASSICAL[kind](situation, **arguments)
    except TypeError as error:
        raise checks.refuse(f"policy {kind!r}", arguments, f"its own arguments ({error})") from None
