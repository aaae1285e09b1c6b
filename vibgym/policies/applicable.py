"""Policies that support a task: those that can be made for it."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Mapping
from typing import Any

import gymnasium as gym

from vibgym import checks
from vibgym.policies.registry import NEED_MORE, make_policy
from vibgym.policies.task_info import POLICIES, Policy, TaskInfo
from vibgym.policies.trained.catalogue import shipped_agents
from vibgym.registration import ENVIRONMENTS
from vibgym.tasks import TASKS


def _named(info: TaskInfo) -> dict[str, Any]:
    """Return policies by the names shown to visitors: controllers, planners, and the shipped agents of the task."""
    variants = {agent.variant for agent in shipped_agents() if info.name in agent.tasks and agent.variant}
    known: dict[str, Any] = {name: name for name in POLICIES if name not in NEED_MORE}
    return known | {f"learned ({name})": {"kind": "learned", "variant": name} for name in sorted(variants)}


def policies_of(info: TaskInfo) -> tuple[str, ...]:
    """Return the names of the policies that support a task."""
    return tuple(name for name, policy in _named(info).items() if _made(policy, info) is not None)


def policy_for(name: str, info: TaskInfo) -> Policy:
    """Return the policy of this name.

    Raises:
        ValueError: there is none for this task.
    """
    known = _named(info)
    made = _made(known[name], info) if name in known else None
    if made is None:
        raise checks.unknown("policy", name, policies_of(info))
    return made


def _made(policy: Any, info: TaskInfo) -> Policy | None:
    """Return a policy, or None if it does not support the task or an extra is missing."""
    try:
        with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
            warnings.simplefilter("ignore")  # warnings about a policy's performance are for reports
            return make_policy(policy, info)
    except (ValueError, ModuleNotFoundError):
        return None


def usual_parts(id: str) -> list[Any]:
    """Return the parts of a registered environment: names or mappings."""
    kwargs = gym.spec(id).kwargs
    return kwargs.get("parts") or list(TASKS[kwargs["task"]].DEFAULT_PARTS)


def parts_with(id: str, part: Any) -> list[Any]:
    """Return the parts of an environment with some of them replaced: those that are pushed, or else those of the first kind.

    Args:
        id: of a registered environment.
        part: a mapping, see :func:`vibgym.scene.parts.part_from`; one that is pushed has its ``coupling``.
    """
    usual = usual_parts(id)
    pushed = [isinstance(entry, Mapping) and entry.get("coupling") == 0.0 for entry in usual]
    ours = [here if any(pushed) else entry == usual[0] for here, entry in zip(pushed, usual, strict=True)]
    mine = {**part, "coupling": 0.0} if any(pushed) else part
    return [mine if here else entry for here, entry in zip(ours, usual, strict=True)]


def tasks_with(part: Any, surface: Any = "prototype", **hardware: Any) -> dict[str, tuple[str, ...] | str]:
    """Return the policies that support each shipped environment with a part (:func:`parts_with`), or why it does not accept it.

    Args:
        part: a mapping, see :func:`vibgym.scene.parts.part_from`.
        surface, **hardware: arguments of the environments, such as ``actuators``.

    Environments whose shapes are drawn are left out.
    """
    tasks: dict[str, tuple[str, ...] | str] = {}
    for name, (_, settings) in ENVIRONMENTS.items():
        if "split" in settings:
            continue
        id = f"vibgym/{name}-v0"
        try:
            env = gym.make(id, parts=parts_with(id, part), surface=surface, **hardware)
        except checks.Refused as error:
            tasks[name] = str(error)
            continue
        tasks[name] = policies_of(TaskInfo.of(env))
        env.close()
    return tasks
