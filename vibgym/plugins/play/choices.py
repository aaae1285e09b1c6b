"""Settings that a visitor can select: task, policy, hardware, model, disturbance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

from vibgym import checks
from vibgym.config import part_from
from vibgym.envs.drawn import drawn_shapes, fixed_scenes
from vibgym.envs.vector import environment_id
from vibgym.policies import TaskInfo
from vibgym.policies.applicable import parts_with

HARDWARE: dict[str, dict[str, Any]] = {
    "ideal": {},
    "prototype": {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}},
    "camera": {"actuators": "prototype", "sensor": {"kind": "camera", "statistical": True, "estimator": "model"}},
}
"""Keyword arguments of environments, by hardware."""

MODELS = ("planar", "averaged", "tilting")

MOST_RATE, MOST_TILT = 5.0, math.radians(10.0)
"""Largest rate (1/s) and tilt (rad) of disturbances."""


@dataclass(frozen=True)
class Settings:
    """Settings of a world.

    Attributes:
        id: of the environment.
        policy: a name of :func:`vibgym.policies.applicable.policies_of`; ``"zero"``: only painted elements move.
        hardware: a key of :data:`HARDWARE`.
        model: among :data:`MODELS`; None: the environment's default.
        rate: disturbances of each part, 1/s.
        tilt: rad, size of a disturbance.
        part: mapping of a part instead of the task's own (:func:`vibgym.policies.applicable.parts_with`).

    Raises:
        ValueError: an unknown name or a bad value; policies are checked with the world.
    """

    id: str
    policy: str = ""
    hardware: str = "ideal"
    model: str | None = None
    rate: float = 0.0
    tilt: float = math.radians(2.0)
    part: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "id", environment_id(self.id, "id"))
        if self.id not in gym.registry:
            raise checks.refuse("id", self.id, "the id of a registered environment")
        if self.policy:
            checks.label("policy", self.policy)
        checks.choice("hardware", self.hardware, tuple(HARDWARE))
        if self.model is not None:
            checks.choice("model", self.model, MODELS)
        object.__setattr__(self, "rate", checks.number("rate", self.rate, least=0.0, most=MOST_RATE))
        if self.part is not None:
            part_from(self.part, "part")
            if "split" in gym.spec(self.id).kwargs:
                raise checks.conflict(f"shapes of {self.id} are drawn: a part cannot be set")
        object.__setattr__(self, "tilt", checks.number("tilt", self.tilt, above=0.0, most=MOST_TILT))

    def arguments(self) -> dict[str, Any]:
        """Return the keyword arguments of the environment, whose actions are the phasors of all elements."""
        found: dict[str, Any] = {"action": "phasor", "observation": "state", **HARDWARE[self.hardware]}
        if self.part is not None:
            found["parts"] = parts_with(self.id, self.part)
        if self.model is not None:
            found["model"] = self.model
        if self.rate > 0.0:
            drawn = gym.spec(self.id).kwargs.get("randomize") or {}
            found["randomize"] = {**drawn, "disturbance": {"rate": self.rate, "tilt": self.tilt}}
        return found

    def environment(self) -> Any:
        """Return the environment, without a time limit; where shapes are drawn, with the first ones of the split.

        Raises:
            ValueError: a model or hardware that does not support the task.
        """
        arguments = self.arguments()
        drawn = drawn_shapes(self.id, arguments)
        fixed = {} if drawn is None else fixed_scenes(drawn)[0]
        return gym.make(self.id, disable_env_checker=True, **arguments, **fixed).unwrapped


def usual_policy(names: Any, info: TaskInfo) -> str:
    """Return the initial policy of a world: a specialised one, else a general controller."""
    crossing = info.has_goal and len(info.parts) > 1 and not info.goal_moves
    made_for = ("push", *(("lanes",) if info.flows else ("two_phases",) if crossing else ()), "pose", "zero")
    return next(name for name in made_for if name in names)
