"""Make policies from names, mappings, files and objects."""

from __future__ import annotations

import inspect
import os
from collections.abc import Collection, Mapping
from typing import Any

from vibgym import checks, extras
from vibgym.envs.actions import ACTIONS
from vibgym.policies.by_parts import ByParts
from vibgym.policies.classical.law import laws
from vibgym.policies.foreign import InElements, ModelPolicy
from vibgym.policies.task_info import POLICIES, Policy, TaskInfo

EXTRA = ("safetensors", "scipy")  # modules of the extra ``policies``
FILES = ("trained", "residual", "learned")  # loaded from files, with the action that they were trained with only
NEED_MORE = ("trained", "residual", "by_task", "parallel_rollout")  # with arguments only, such as a file
DEFAULT = "element"  # the environment's default action, which requires no action of the policy


def make_policy(policy: Any, env: Any, seed: int = 0, action: str | None = None) -> Policy:
    """Return a policy from a name, the path of a trained one's JSON file, a mapping, or an object with ``predict``.

    - ``{"kind": name, **settings}``: one of :data:`.task_info.POLICIES`. A law moves single parts with goals, and parts with
      moving goals, straight there (``"local_field"``), others under the planner. ``{"kind": "trained", "path":
      "vibgym/policies/trained/shipped/{task}.json"}``: ``{task}`` is replaced by the task's name in lower case.
    - ``"learned"``, or ``{"kind": "learned", "hardware": "prototype", "variant": "cloned", "action": "wrench"}``: the shipped
      agent for this task and hardware.
    - ``{"policy": model, "action": name, "observation": name}``: a model that has only ``predict``; see
      :class:`vibgym.policies.foreign.ModelPolicy`. An object with ``action`` and ``observation`` is returned unchanged.

    Make the environment with ``policy.action`` and ``policy.observation``.

    Args:
        policy: see above.
        env: single or vector environment, wrapped or not; or a :class:`TaskInfo`.
        seed: of policies that draw random numbers, unless the mapping has one.
        action: of the policy, if it supports several; None: that of ``env``.

    Raises:
        ValueError: unknown name or settings, a policy that does not serve this task, or a file without one for it.
        ModuleNotFoundError: the policy requires the extra ``policies``.
    """
    info = env if isinstance(env, TaskInfo) else TaskInfo.of(env)
    if action is None and not isinstance(env, TaskInfo):
        acting = type(env.unwrapped.core.action)
        action = next((name for name, item in ACTIONS.items() if item is acting), None)
    if hasattr(policy, "predict"):
        complete = hasattr(policy, "action") and hasattr(policy, "observation")
        return policy if complete else ModelPolicy(policy, info, usual=action)
    if isinstance(policy, os.PathLike):
        policy = {"kind": "trained", "path": os.fspath(policy)}
    if isinstance(policy, str):
        policy = {"kind": "trained", "path": policy} if policy.endswith((".json", ".zip")) else {"kind": policy}
    if not isinstance(policy, Mapping):
        raise checks.refuse("policy", policy, "a name, a path, a mapping with 'kind', or an object with predict()")
    if "policy" in policy:
        settings = {name: value for name, value in policy.items() if name != "policy"}
        if not hasattr(policy["policy"], "predict") or not set(settings) <= {"action", "observation"}:
            allowed = "a mapping with 'policy', an object with predict(), and perhaps 'action' and 'observation'"
            raise checks.refuse("policy", dict(policy), allowed)
        return ModelPolicy(policy["policy"], info, usual=action, **settings)
    made: Policy
    if info.worlds is None:
        made = _made(policy, info, seed, action)
    else:
        made = ByParts(lambda info: _made(policy, info, seed, action), info)
    return InElements(made) if (action, made.action) == ("element", "phasor") else made


def _made(policy: Mapping[str, Any], info: TaskInfo, seed: int, action: str | None) -> Policy:
    """Return one of :data:`.task_info.POLICIES`, with this action if it supports several; see :func:`make_policy`."""
    settings = dict(policy)
    name = kind = checks.choice("policy.kind", settings.pop("kind", None), POLICIES)
    if kind in laws():
        if "law" in settings:
            raise checks.conflict(f"policy {kind!r} names its controller, so 'law' cannot be set")
        straight = (info.has_goal and len(info.parts) == 1) or info.goal_moves
        settings["law"], kind = kind, "local_field" if straight else "planner"
    required = None if action == DEFAULT else action
    if required is not None and getattr(POLICIES[kind], "supports", lambda action: False)(required):
        settings.setdefault("action", required)
    if "seed" in settings_of(kind):
        settings.setdefault("seed", seed)
    try:
        made = POLICIES.make("policy", {"kind": kind, **settings}, info)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in EXTRA:
            raise
        raise extras.missing(f"policy {name!r}", error, "policies") from None
    if kind in FILES and required not in (None, made.action):
        raise checks.conflict(f"policy {kind!r} requires action {made.action!r}, got {required!r}")
    return made


def settings_of(kind: str) -> Collection[str]:
    """Return the names of a policy's settings: its fields, or arguments if it has no ``Settings``."""
    make: Any = POLICIES[kind]
    return make.Settings.model_fields if hasattr(make, "Settings") else inspect.signature(make).parameters


def by_task(info: TaskInfo, **policies: Any) -> Policy:
    """Return the policy for the task: ``{"kind": "by_task", "Swap": "lanes", "Pack": {"kind": "two_phases"}}``.

    Args:
        info: task and scene.
        **policies: by the names of environments, each as :func:`make_policy` takes it.
    """
    if info.name not in policies:
        raise checks.refuse("policy 'by_task'", f"the task {info.name}", f"tasks that it names: {', '.join(policies)}")
    return make_policy(policies[info.name], info)
