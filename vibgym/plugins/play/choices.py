"""Settings that a visitor can select: task, policy, hardware, model, disturbance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import gymnasium as gym
from pydantic import Field, model_validator

from vibgym import checks
from vibgym.envs.drawn import drawn_shapes, fixed_scenes
from vibgym.envs.vector import environment_id
from vibgym.policies import TaskInfo
from vibgym.policies.applicable import parts_with
from vibgym.scene.parts import part_from
from vibgym.settings import Angle, BaseSettings, read

HARDWARE: dict[str, dict[str, Any]] = {
    "ideal": {},
    "prototype": {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}},
    "camera": {"actuators": "prototype", "sensor": {"kind": "camera", "statistical": True, "estimator": "model"}},
}
"""Keyword arguments of environments, by hardware."""

MODELS = ("planar", "averaged", "tilting")

MAX_RATE, MAX_TILT = 5.0, math.radians(10.0)
"""Largest rate (1/s) and tilt (rad) of disturbances."""


class Settings(BaseSettings):
    """Settings of a world."""

    id: str
    """Id of a registered environment."""

    policy: str = Field(default="", max_length=checks.MAX_LABEL)
    """A name of :func:`vibgym.policies.applicable.policies_of`; ``"zero"``: only painted elements move."""

    hardware: Literal["ideal", "prototype", "camera"] = "ideal"
    """A key of :data:`HARDWARE`."""

    model: Literal[MODELS] | None = None  # type: ignore[valid-type]
    """Model; None: the environment's default."""

    rate: float = Field(default=0.0, ge=0.0, le=MAX_RATE)
    """Disturbances of each part, 1/s."""

    tilt: Angle = Field(default=math.radians(2.0), gt=0.0, le=MAX_TILT)
    """Size of a disturbance."""

    part: Mapping[str, Any] | None = None
    """Mapping of a part instead of the task's own (:func:`vibgym.policies.applicable.parts_with`)."""

    @model_validator(mode="after")
    def _check(self) -> Settings:
        if self.id not in gym.registry:
            raise checks.refuse("id", self.id, "the id of a registered environment")
        if self.part is not None:
            part_from(self.part, "part")
            if "split" in gym.spec(self.id).kwargs:
                raise checks.conflict(f"shapes of {self.id} are drawn: a part cannot be set")
        return self

    def arguments(self) -> dict[str, Any]:
        """Return the keyword arguments of the environment, whose actions are the phasors of all elements."""
        arguments: dict[str, Any] = {"action": "phasor", "observation": "state", **HARDWARE[self.hardware]}
        if self.part is not None:
            arguments["parts"] = parts_with(self.id, self.part)
        if self.model is not None:
            arguments["model"] = self.model
        if self.rate > 0.0:
            drawn = gym.spec(self.id).kwargs.get("randomize") or {}
            arguments["randomize"] = {**drawn, "disturbance": {"rate": self.rate, "tilt": self.tilt}}
        return arguments

    def environment(self) -> Any:
        """Return the environment, without a time limit; where shapes are drawn, with the first ones of the split.

        Raises:
            ValueError: a model or hardware that does not support the task.
        """
        arguments = self.arguments()
        drawn = drawn_shapes(self.id, arguments)
        fixed = {} if drawn is None else fixed_scenes(drawn)[0]
        return gym.make(self.id, disable_env_checker=True, **arguments, **fixed).unwrapped


def settings_of(id: str, **settings: Any) -> Settings:
    """Return the settings of a world; ``id``: of the environment, or its short name.

    Raises:
        ValueError: an unknown name or a bad value; policies are checked with the world.
    """
    return read(Settings, {"id": environment_id(id, "id"), **settings}, "")


def usual_policy(names: Any, info: TaskInfo) -> str:
    """Return the initial policy of a world: a specialised one, else a general controller."""
    crossing = info.has_goal and len(info.parts) > 1 and not info.goal_moves
    made_for = ("push", *(("lanes",) if info.continuous_feed else ("two_phases",) if crossing else ()), "pose", "zero")
    return next(name for name in made_for if name in names)
