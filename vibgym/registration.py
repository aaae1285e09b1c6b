"""Registration of the environments with Gymnasium."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

BLOCKS = ["steel_block", "aluminium_block"]
DISC = {"shape": "disc", "radius": 0.020, "friction": 0.6, "name": "disc"}

PUSHER = {"shape": "disc", "radius": 0.020, "friction": 0.6, "name": "pusher"}
BAR, STEM, WIDE, LONG = 0.012, 0.012, 0.036, 0.072
TEE = {
    "shape": "polygon", "friction": 0.58, "coupling": 0.0, "name": "tee",
    "vertices": [
        [-STEM, 0.0], [STEM, 0.0], [STEM, LONG - 2 * BAR], [WIDE, LONG - 2 * BAR], [WIDE, LONG], [-WIDE, LONG],
        [-WIDE, LONG - 2 * BAR], [-STEM, LONG - 2 * BAR],
    ],
}  # fmt: skip
"""72 mm wide and long, with bar and stem of 24 mm; on a soft foot that absorbs the elements' motion."""

PUSHED = {"shape": "drawn", "size": 0.084, "friction": 0.58, "coupling": 0.0}
NEAR = {"task_settings": {"near_mm": 150.0, "near_deg": 60.0}}
PUSHING = {"task": "Push", "parts": [PUSHER, PUSHER, TEE], "walls": ["left", "right", "bottom", "top"]}

SHAPE = {"shape": "drawn"}
TWO_SHAPES = [{"shape": "drawn", "which": which, "size": 0.045} for which in (0, 1)]
SHAPES = {"split": "train"}
"""Parts whose shapes are drawn for each episode, and the split that they are drawn from (:mod:`vibgym.envs.drawn`)."""

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
    "Push": (1000, {**PUSHING, **NEAR}),
    "PushAny": (1000, PUSHING),
    "Feed": (1500, {"task": "Feed"}),
    "FeedHeaps": (1500, {"task": "Feed", "parts": BLOCKS * 9, "task_settings": {"heap": 6}}),
    "AlignShapes": (250, {"task": "Align", "parts": [SHAPE], **SHAPES}),
    "SortShapes": (750, {"task": "Sort", "parts": TWO_SHAPES * 3, **SHAPES}),
    "PackShapes": (750, {"task": "Pack", "parts": [SHAPE] * 6, **SHAPES}),
    "PushShapes": (1000, {**PUSHING, "parts": [PUSHER, PUSHER, PUSHED], **NEAR, **SHAPES}),
}
"""Limit in oscillation periods (steps, with one period per step), and keyword arguments of each environment."""


class Periods(int):
    """Registered limit of an episode: oscillation periods, whereas any other ``max_episode_steps`` counts steps."""


def register_environments() -> None:
    """Register ``vibgym/<name>-v0``; repeated calls have no effect."""
    for environment, (limit, settings) in ENVIRONMENTS.items():
        name = f"vibgym/{environment}-v0"
        if name not in gym.registry:
            gym.register(
                id=name,
                entry_point="vibgym.envs:VibgymEnv",
                vector_entry_point="vibgym.envs:VibgymVectorEnv",
                max_episode_steps=Periods(limit),
                kwargs={**settings, "max_episode_periods": limit},
                # The environments check the order of calls themselves, and are tested with Gymnasium's checker.
                disable_env_checker=True,
                order_enforce=False,
            )
