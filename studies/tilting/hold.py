"""How still parts are held at their goals above the plane: ``python -m studies.tilting hold``.

Align, its end put off: rms of the errors over the second half of eight seconds.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vibgym.envs import VibgymVectorEnv
from vibgym.policies import make_policy

CASES: dict[str, Any] = {
    "planar": "planar",
    "tilting": "tilting",
    "ramps of 1 mm": {"kind": "tilting", "ramp_mm": 1.0},
    "restitution 0.5": {"kind": "tilting", "restitution": 0.5},
}
STEPS = 200


def held(policy: str, model: Any, part: str, worlds: int) -> tuple[float, float]:
    """rms of position (mm) and heading (deg)."""
    settings: dict[str, Any] = {"parts": [part], "task_settings": {"hold": 250}}
    spoken = make_policy(policy, VibgymVectorEnv("Align", num_envs=1, **settings))
    env = VibgymVectorEnv(
        "Align", num_envs=worlds, model=model, action=spoken.action, observation=spoken.observation, **settings
    )
    seen, _ = env.reset(seed=list(range(300_000, 300_000 + worlds)))
    state, start, errors = None, np.ones(worlds, dtype=bool), []
    for _ in range(STEPS):
        action, state = spoken.predict(seen, state, start)
        seen, _, terminated, truncated, info = env.step(action)
        start = terminated | truncated
        errors.append((info["position_error"], info["heading_error"]))
    position, heading = np.sqrt((np.array(errors[STEPS // 2 :]) ** 2).mean(axis=(0, 2)))
    return 1e3 * float(position), math.degrees(float(heading))


def main(worlds: int = 64) -> None:
    """Print the table."""
    for part, policies in {"aluminium_block": ("pose", "learned"), "steel_block": ("pose",)}.items():
        for policy in policies:
            for name, model in CASES.items():
                position, heading = held(policy, model, part, worlds)
                print(f"{part:16} {policy:8} {name:16} {position:.3f} mm {heading:.3f} deg", flush=True)
