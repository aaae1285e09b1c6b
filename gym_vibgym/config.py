"""LeRobot's settings of the environment type ``vibgym``. Requires LeRobot."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
from lerobot.configs.types import FeatureType, PolicyFeature  # pyright: ignore[reportMissingImports]
from lerobot.envs.configs import EnvConfig  # pyright: ignore[reportMissingImports]
from lerobot.utils.constants import ACTION  # pyright: ignore[reportMissingImports]

import gym_vibgym  # noqa: F401  registers the environments
from vibgym.adapters.lerobot import AGENT, KEYS, WORLD

TYPES = {AGENT: FeatureType.STATE, WORLD: FeatureType.ENV}


@EnvConfig.register_subclass("vibgym")
@dataclass
class VibgymEnvConfig(EnvConfig):
    """Environment ``gym_vibgym/<task>``; rate and shapes are those of the environment.

    Attributes:
        action, observation: as for ``gym.make("vibgym/...")``.
        settings: its other keyword arguments.
    """

    task: str | None = "Push-v0"
    action: str = "velocity"
    observation: str = "parts"
    settings: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        env: Any = gym.make(self.gym_id, **self.gym_kwargs)
        self.fps = round(1.0 / env.unwrapped.step_time)
        self.features = {ACTION: PolicyFeature(FeatureType.ACTION, env.action_space.shape)}
        self.features_map = {ACTION: ACTION}
        for key, space in env.observation_space.items():
            self.features[key] = PolicyFeature(TYPES[key], space.shape)
            self.features_map[key] = KEYS[key]
        env.close()

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Keyword arguments of ``gym.make``."""
        return {"action": self.action, "observation": self.observation, "render_mode": "rgb_array", **self.settings}
