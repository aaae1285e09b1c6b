"""Environments by id or short name, custom ones included."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import load_env_creator

from vibgym import checks
from vibgym.envs.vector import VibgymVectorEnv
from vibgym.tasks import TASKS


def environment_id(task: Any, field: str = "task") -> str:
    """Return the Gymnasium id of an environment: ``vibgym/Sort-v0`` for ``Sort``; ids are returned unchanged.

    Args:
        task: an id, a short name, or a name in :data:`vibgym.tasks.TASKS` without a registered environment (unchanged).
        field: name of the setting, for errors.

    Raises:
        ValueError: not registered, or not an environment of vibgym.
    """
    name = task if task in gym.registry else f"vibgym/{task}-v0"
    if not isinstance(task, str) or name not in gym.registry:
        if task in TASKS:
            return task
        own = [repr(spec.name) for spec in gym.registry.values() if spec.namespace == "vibgym"]
        raise checks.refuse(field, task, f"{', '.join(own)}, or the id of another registered environment")
    entry = gym.registry[name].vector_entry_point
    made = load_env_creator(entry) if isinstance(entry, str) else entry
    if made is None or (isinstance(made, type) and not issubclass(made, VibgymVectorEnv)):
        raise checks.refuse(field, task, "environments with 'vibgym.envs:VibgymVectorEnv' as vector_entry_point")
    return name


def batch_of(task: str, **arguments: Any) -> Any:
    """Create a vector environment.

    Args:
        task: see :func:`environment_id`.
        **arguments: of the environment.

    Raises:
        ValueError: an unknown environment or argument, or an invalid value.
    """
    name = environment_id(task)
    try:
        return gym.make_vec(name, **arguments) if name in gym.registry else VibgymVectorEnv(name, **arguments)
    except TypeError as error:
        raise checks.refuse("arguments", sorted(arguments), f"those of the environment ({error})") from None
