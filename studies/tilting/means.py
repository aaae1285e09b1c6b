"""What a rigid part gets of the force and torque that even pressure promises: ``python -m studies.tilting means``.

Wrenches of several sizes in random directions, held for five periods from rest, with both models: means of the velocity that
    they make.
"""

from __future__ import annotations

import math

import numpy as np

from vibgym.envs import VibgymVectorEnv

PARTS = ("aluminium_block", "steel_block")
SIZES = (0.1, 0.25, 0.5, 1.0)
STEPS = 5


def gained(part: str, model: str, size: float, turning: bool, worlds: int) -> np.ndarray:
    """(worlds,) m/s along the force that is asked for, or rad/s."""
    env = VibgymVectorEnv("Align", num_envs=worlds, model=model, parts=[part], action="wrench")
    env.reset(seed=list(range(worlds)))
    way = np.random.default_rng(1).uniform(-math.pi, math.pi, worlds)
    action = np.zeros((worlds, 3), np.float32)
    if turning:
        action[:, 2] = size
    else:
        action[:, 0], action[:, 1] = size * np.cos(way), size * np.sin(way)
    for _ in range(STEPS):
        env.step(action)
    velocity = env.truth.mean_velocity[:, 0]
    return velocity[:, 2] if turning else velocity[:, 0] * np.cos(way) + velocity[:, 1] * np.sin(way)


def main(worlds: int = 96) -> None:
    """Print the shares."""
    print("part, wrench, size | planar | tilting, its deviation | share delivered")
    for part in PARTS:
        for name, turning, unit in (("force", False, "m/s"), ("torque", True, "rad/s")):
            for size in SIZES:
                flat, rigid = (gained(part, model, size, turning, worlds) for model in ("planar", "tilting"))
                print(
                    f"{part:16} {name:6} {size:4.2f} | {flat.mean():6.3f} {unit} | {rigid.mean():6.3f} +- {rigid.std():.3f} "
                    f"| {rigid.mean() / flat.mean():.2f}",
                    flush=True,
                )
