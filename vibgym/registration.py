"""Registers the environments with Gymnasium."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

BLOCKS = ["steel_block", "aluminium_block"]
DISC = {"shape": "disc", "radius": 0.020, "friction": 0.6, "name": "disc"}

ENVIRONMENTS: dict[str, tuple[int, dict[str, Any]]] = {
    "Transport": (250, {"task": "Transport"}),
    "Align": (250, {"task": "Align"}),
    "Rotate": (250, {"task": "Rotate"}),
    "Follow": (500, {"task": "Follow"}),
    "Sort": (750, {"task": "Sort"}),
    "SortTwelve": (1500, {"task": "Sort", "parts": BLOCKS * 6}),
    "SortThreeKinds": (750, {"task": "Sort", "parts": [*BLOCKS, DISC] * 2}),
    "SortCrowded": (750, {"task": "Sort", "start": "crowded"}),
    "Singulate": (500, {"task": "Singulate"}),
    "Pack": (750, {"task": "Pack"}),
    "PackFull": (1000, {"task": "Pack", "parts": ["aluminium_block"] * 20}),
    "Swap": (750, {"task": "Swap"}),
    "SwapCrowded": (1000, {"task": "Swap", "parts": BLOCKS * 12}),
    "Feed": (1500, {"task": "Feed"}),
    "FeedHeaps": (1500, {"task": "Feed", "parts": BLOCKS * 9, "task_settings": {"heap": 6}}),
}
"""Limit, in oscillation periods (steps, with one a step), and keyword arguments of each environment."""


def register_environments() -> None:
    """Register ``vibgym/<name>-v0`` once, however often it is called."""
    for environment, (limit, settings) in ENVIRONMENTS.items():
        name = f"vibgym/{environment}-v0"
        if name not in gym.registry:
            gym.register(
                id=name,
                entry_point="vibgym.envs:VibgymEnv",
                vector_entry_point="vibgym.envs:VibgymVectorEnv",
                max_episode_steps=limit,
                kwargs={**settings, "max_episode_periods": limit},
                # It refuses what would be out of order itself, and is tested against Gymnasium's checks.
                disable_env_checker=True,
                order_enforce=False,
            )
