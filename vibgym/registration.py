"""Registers the environments with Gymnasium."""

from __future__ import annotations

import gymnasium as gym

STEP_LIMITS = {"Transport": 250, "Align": 250, "Rotate": 250}


def register_environments() -> None:
    """Register ``vibgym/<Task>-v0`` once, however often it is called."""
    for task, limit in STEP_LIMITS.items():
        name = f"vibgym/{task}-v0"
        if name not in gym.registry:
            gym.register(
                id=name,
                entry_point="vibgym.envs:VibgymEnv",
                vector_entry_point="vibgym.envs:VibgymVectorEnv",
                max_episode_steps=limit,
                kwargs={"task": task},
            )
