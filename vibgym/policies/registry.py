"""From a name, a mapping, a file or an object to a policy."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from vibgym import checks
from vibgym.policies.classical.constant import RandomPolicy, ZeroPolicy
from vibgym.policies.classical.local_field import LocalFieldPolicy
from vibgym.policies.classical.open_loop import OpenLoopPolicy
from vibgym.policies.classical.planner import PlannerPolicy
from vibgym.policies.foreign import Foreign
from vibgym.policies.protocol import Policy
from vibgym.policies.task_info import TaskInfo
from vibgym.registry import Registry


def local_field(info: TaskInfo, **arguments: Any) -> Policy:
    """:class:`LocalFieldPolicy` where every part has a goal pose of its own."""
    if not info.has_goal:
        raise checks.refuse(
            "policy 'local_field'", f"the task {info.name}", "tasks with goal poses; see 'local_fields'"
        )
    return LocalFieldPolicy(info, **arguments)


def local_fields(info: TaskInfo, **arguments: Any) -> Policy:
    """:class:`LocalFieldPolicy` where parts share zones, or shall be apart."""
    if info.has_goal:
        raise checks.refuse(
            "policy 'local_fields'", f"the task {info.name}", "tasks without goal poses; see 'local_field'"
        )
    return LocalFieldPolicy(info, **arguments)


def lawful(law: str) -> Callable[..., Policy]:
    """Maker of a policy under one of :data:`.laws.LAWS`: parts with goal poses go straight there, as
    :class:`LocalFieldPolicy` has them, others by the :class:`PlannerPolicy`."""

    def make(info: TaskInfo, **arguments: Any) -> Policy:
        if "law" in arguments:
            raise checks.refuse(f"policy {law!r}", "the argument 'law'", "its own arguments: this policy is its law")
        straight = (info.has_goal and len(info.parts) == 1) or info.goal_moves
        return (LocalFieldPolicy if straight else PlannerPolicy)(info, law=law, **arguments)

    make.__name__ = law
    return make


def trained(info: TaskInfo, *, path: str) -> Policy:
    """The trained policy in a JSON file; ``{task}`` in its path is replaced by the task's name in lower case.

    Raises:
        ValueError: the file holds no policy for this task.
    """
    from vibgym.policies.trained.trained import load_trained  # safetensors is an extra

    if not isinstance(path, str):
        raise checks.refuse("policy.path", path, "the path of a trained policy's JSON file")
    return load_trained(Path(path.replace("{task}", info.name.lower())), info)


def residual(info: TaskInfo, *, path: str, base: Any = None, scale: float | None = None) -> Policy:
    """A base policy with a learned correction (:class:`vibgym.policies.trained.residual.ResidualPolicy`).

    Args:
        info: task and scene.
        path: as for :func:`trained`; the file says what is corrected, and by how much.
        base, scale: of these, where they are given, nothing else than the file's: a name or a mapping, and a number.

    Raises:
        ValueError: another base or scale than the file's, or a file that holds no correction for this task.
    """
    from vibgym.policies.trained.residual import ResidualPolicy, load_correction  # safetensors is an extra

    if not isinstance(path, str):
        raise checks.refuse("policy.path", path, "the path of a trained correction's JSON file")
    found = load_correction(Path(path.replace("{task}", info.name.lower())), info, base, scale)
    return ResidualPolicy(info, make_policy(found.base, info), found.learned, scale=found.scale)


def schedule(info: TaskInfo, *, path: str) -> Policy:
    """The sensorless schedule in a JSON file.

    Raises:
        ValueError: the file holds none, or none for this surface.
    """
    from vibgym.policies.trained.schedule import load_schedule  # safetensors is an extra

    if not isinstance(path, str):
        raise checks.refuse("policy.path", path, "the path of a schedule's JSON file")
    return load_schedule(Path(path), info)


CONTROLLERS: Registry[Callable[..., Policy]] = Registry(
    "controller",
    {
        "zero": ZeroPolicy,
        "random": RandomPolicy,
        "open_loop": OpenLoopPolicy,
        "local_field": local_field,
        "local_fields": local_fields,
        "planner": PlannerPolicy,
        "pose": lawful("pose"),
        "lqr": lawful("lqr"),
        "pid": lawful("pid"),
        "state_space": lawful("state_space"),
        "trained": trained,
        "residual": residual,
        "schedule": schedule,
    },
)
"""Policies by name; ``CONTROLLERS.register(name, cls)`` adds one of your own, made as ``cls(info, **arguments)``.

``"zero"`` and ``"random"`` serve all tasks, ``"open_loop"`` those for one part with a goal pose, ``"planner"`` those that ask
for places: goals, zones, or a distance to keep. ``"local_field"`` and ``"local_fields"`` are one law under the names of its two
uses: parts with goal poses of their own, and parts that share zones or shall be apart. ``"pose"``, ``"lqr"``, ``"pid"`` and
``"state_space"`` are other laws in the same place, or under the planner where several parts have to keep apart.
"""


def make_policy(policy: Any, info: TaskInfo, seed: int = 0) -> Policy:
    """A policy from a name, the path of a trained one's JSON file, a mapping, or anything that has ``predict``.

    - ``{"kind": name, **arguments}``: one of :data:`CONTROLLERS`. ``{"kind": "trained", "path":
      "vibgym/policies/trained/shipped/{task}.json"}``: ``{task}`` is replaced by the task's name in lower case.
    - ``{"policy": model, "action": name}``: a model that has ``predict`` alone, and the actions that it speaks; see
      :class:`vibgym.policies.foreign.Foreign`. One that has both ``action`` and ``observation`` is a policy as it is.

    Args:
        seed: of policies that draw random numbers, where the mapping has none.

    Raises:
        ValueError: unknown name or arguments, a policy that does not serve this task, or a file that holds none for it.
    """
    if hasattr(policy, "predict"):
        return policy if hasattr(policy, "action") and hasattr(policy, "observation") else Foreign(policy, info)
    if isinstance(policy, str):
        policy = {"kind": "trained", "path": policy} if policy.endswith(".json") else {"kind": policy}
    if not isinstance(policy, Mapping):
        raise checks.refuse("policy", policy, "a name, a path, a mapping with 'kind', or an object with predict()")
    arguments = dict(policy)
    if "policy" in arguments:
        model = arguments.pop("policy")
        if not hasattr(model, "predict") or not set(arguments) <= {"action"}:
            raise checks.refuse(
                "policy", dict(policy), "'policy', an object with predict(), and 'action', what it speaks"
            )
        return Foreign(model, info, **arguments)
    kind = arguments.pop("kind", None)
    make = CONTROLLERS.choose("policy.kind", kind)
    if "seed" in inspect.signature(make).parameters:
        arguments.setdefault("seed", seed)
    try:
        return make(info, **arguments)
    except TypeError as error:
        raise checks.refuse(f"policy {kind!r}", arguments, f"its own arguments ({error})") from error
