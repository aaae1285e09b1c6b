"""The worlds that a run trains on, dealt out to its scenes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from agents.training.train_settings import TrainSettings
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.envs import VibgymVectorEnv
from vibgym.envs.named import batch_of


def make_worlds(settings: TrainSettings, observation: str, wrapped: Callable[[Any], Any] = lambda env: env) -> VecEnv:
    """All worlds as one batch.

    Args:
        settings: of the run.
        observation: what the environment shows.
        wrapped: around the batch of each scene.

    Raises:
        ValueError: settings that the environment refuses, or fewer worlds than scenes.
    """
    scenes = settings.all_scenes
    if settings.worlds < len(scenes):
        raise checks.refuse("worlds", settings.worlds, f"at least {len(scenes)}, one for each scene")
    shares = [len(each) for each in np.array_split(np.arange(settings.worlds), len(scenes))]
    envs = []
    for scene, share in zip(scenes, shares, strict=True):
        own = {"autoreset_mode": "SameStep", **settings.environment, **scene}
        own |= {"num_envs": share, "observation": observation}
        env = batch_of(settings.task, **own)
        if not isinstance(env.unwrapped, VibgymVectorEnv):
            raise checks.refuse(
                "task", settings.task, "a task or an id whose batch is a VibgymVectorEnv, wrapped or not"
            )
        envs.append(wrapped(env))
    return VecEnv(*envs)
