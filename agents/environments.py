"""Environments by the names that configuration files have for them, a user's own among them."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from pydantic_core import PydanticCustomError

from vibgym import checks
from vibgym.envs import VibgymVectorEnv
from vibgym.tasks import TASKS


def environment_id(task: str) -> str:
    """Under which Gymnasium may know it: ``"Align"`` is short for ``"vibgym/Align-v0"``."""
    return task if "/" in task else f"vibgym/{task}-v0"


def allowed_tasks() -> tuple[str, ...]:
    """All names that :func:`make_batch` takes: environments of vibgym, those that a user has registered, and tasks."""
    specs = list(gym.registry.values())
    own = [spec.name for spec in specs if spec.namespace == "vibgym"]
    brought = [spec.id for spec in specs if spec.namespace not in ("vibgym", None) and _is_ours(spec)]
    return tuple(dict.fromkeys((*own, *brought, *TASKS)))


def _is_ours(spec: Any) -> bool:
    """Whether the environment is registered with our own classes, or with such as a user has derived."""
    entry = spec.vector_entry_point
    return (isinstance(entry, str) and entry.startswith("vibgym.")) or (
        isinstance(entry, type) and issubclass(entry, VibgymVectorEnv)
    )


def check_task(task: str) -> str:
    """For validators of settings: a name that :func:`make_batch` takes, or an error that names all."""
    if task not in TASKS and environment_id(task) not in gym.registry:
        raise PydanticCustomError("task", ", ".join(map(repr, allowed_tasks())))  # type: ignore[arg-type]
    return task


def make_batch(task: str, **arguments: Any) -> Any:
    """The batch environment of this name.

    Args:
        task: the name of an environment of vibgym without version, such as ``"SortTwelve"``; the whole id of one that is
            registered, such as ``"mine/Park-v0"``; or a name in :data:`vibgym.tasks.TASKS`.
        arguments: of the environment.

    Raises:
        ValueError: arguments that it refuses, or does not have.
    """
    name = environment_id(task)
    try:
        return gym.make_vec(name, **arguments) if name in gym.registry else VibgymVectorEnv(task, **arguments)
    except TypeError as error:
        raise checks.refuse("arguments", sorted(arguments), f"those of the environment ({error})") from None
