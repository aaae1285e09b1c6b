"""Make policies from names, mappings, files and objects."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from vibgym import checks, extras
from vibgym.envs.actions import ACTIONS
from vibgym.policies.classical.lanes import CrossingPolicy, FeedingPolicy
from vibgym.policies.classical.open_loop import OpenLoopPolicy, RandomPolicy, ZeroPolicy
from vibgym.policies.classical.planner import PlannerPolicy
from vibgym.policies.classical.pushing import PushingPolicy
from vibgym.policies.classical.steering import LAWS, OUTPUTS, LocalFieldPolicy, Steering
from vibgym.policies.classical.two_phases import TwoPhasesPolicy
from vibgym.policies.foreign import InElements, ModelPolicy
from vibgym.policies.mpc import MPCPolicy
from vibgym.policies.parallel_rollout import ParallelRolloutPolicy
from vibgym.policies.protocol import Policy
from vibgym.policies.task_info import TaskInfo
from vibgym.registry import Registry
from vibgym.settings import BaseSettings, read

Maker = Callable[..., Policy]
"""``make(info, settings=settings)``, or ``make(info, **arguments)`` if it has no ``Settings``."""

EXTRA = ("safetensors", "scipy")  # modules of the extra ``policies``
STEERED = ("local_field", "planner", "lanes", "two_phases", "push")  # with a law, and any action of steering.OUTPUTS
FILES = ("trained", "residual", "learned")  # loaded from files, with the action that they were trained with only
NEED_MORE = ("trained", "residual", "by_task", "parallel_rollout")  # with arguments only, such as a file
DEFAULT = "element"  # the environment's default action, which requires no action of the policy


def lawful(law: str) -> Maker:
    """Return the maker of policies under one of :data:`.steering.LAWS`.

    Single parts with goals, and parts with moving goals, go straight there (:class:`LocalFieldPolicy`), others by the planner.
    """

    def make(info: TaskInfo, /, **arguments: Any) -> Policy:
        if "law" in arguments:
            raise checks.conflict(f"policy {law!r} names its controller, so 'law' cannot be set")
        straight = (info.has_goal and len(info.parts) == 1) or info.goal_moves
        return steered(LocalFieldPolicy if straight else PlannerPolicy, info, {"law": law, **arguments})

    return make


def lanes(info: TaskInfo, /, **arguments: Any) -> Policy:
    """Return lanes through gates where parts come and go (:class:`FeedingPolicy`), else :class:`CrossingPolicy`."""
    return steered(FeedingPolicy if info.flows else CrossingPolicy, info, arguments)


def steered(policy: type[Steering], info: TaskInfo, arguments: dict[str, Any]) -> Policy:
    """Return a policy that was chosen by the task."""
    return policy(info, read(policy.Settings, arguments, "policy"))


def file_of(path: str | Path, info: TaskInfo) -> Path:
    """Return the file at a path in which ``{task}`` stands for the task's name in lower case.

    Raises:
        ValueError: a model of Stable-Baselines3.
    """
    if str(path).endswith(".zip"):
        reason = "a model of Stable-Baselines3 is loaded by its own load(), and given as {'policy': model}"
        raise checks.conflict(f"policy.path {str(path)!r}: {reason}")
    return Path(str(path).replace("{task}", info.name.lower()))


# The modules of trained policies require the extra "policies", so makers import them.


class Trained:
    """Maker of trained policies."""

    class Settings(BaseSettings):
        """Settings of a trained policy."""

        path: str | Path
        """JSON file; ``{task}`` in it stands for the task's name in lower case."""

    def __new__(cls, info: TaskInfo, settings: Settings) -> Policy:
        """Load the policy."""
        from vibgym.policies.trained.trained import load_trained

        return load_trained(file_of(settings.path, info), info)


class Residual:
    """Maker of base policies with a learned correction (:class:`vibgym.policies.trained.residual.ResidualPolicy`)."""

    class Settings(Trained.Settings):
        """Settings of a correction, whose file contains its base and its scale."""

        base: Any = None
        """None, or the same policy as in the file: a name or a mapping."""

        scale: float | None = None
        """None, or the same as in the file."""

    def __new__(cls, info: TaskInfo, settings: Settings) -> Policy:
        """Load the correction and make its base."""
        from vibgym.policies.trained.residual import ResidualPolicy, load_correction

        found = load_correction(file_of(settings.path, info), info, settings.base, settings.scale)
        return ResidualPolicy(info, make_policy(found.base, info), found.learned, scale=found.scale)


class Learned:
    """Maker of the shipped agent for a task and hardware (:func:`vibgym.policies.trained.catalogue.shipped_agent`)."""

    class Settings(BaseSettings):
        """Choice of the agent."""

        action: str | None = None
        """Of the agent. None: any."""

        hardware: str | None = None
        """``"ideal"`` or ``"prototype"``. None: by the data sheet of the scene's actuators."""

        variant: str | None = None
        """Such as ``"cloned"``. None: any, the usual agent before its variants."""

    def __new__(cls, info: TaskInfo, settings: Settings) -> Policy:
        """Load the agent."""
        from vibgym.policies.trained.catalogue import shipped_agent

        agent = shipped_agent(info, action=settings.action, hardware=settings.hardware, variant=settings.variant)
        return CONTROLLERS.make("policy", {"kind": agent.kind, "path": str(agent.path)}, info)


def by_task(info: TaskInfo, **policies: Any) -> Policy:
    """Return the policy for the task: ``{"kind": "by_task", "Swap": "lanes", "Pack": {"kind": "two_phases"}}``.

    Args:
        info: task and scene.
        **policies: by the names of environments, each as :func:`make_policy` takes it.
    """
    if info.name not in policies:
        raise checks.refuse("policy 'by_task'", f"the task {info.name}", f"tasks that it names: {', '.join(policies)}")
    return make_policy(policies[info.name], info)


class MPC:
    """Maker of model-predictive control (:class:`vibgym.policies.mpc.MPCPolicy`)."""

    Settings = MPCPolicy.Settings

    def __new__(cls, info: TaskInfo, settings: MPCPolicy.Settings) -> Policy:
        """Make the base and the policy."""
        base = settings.base
        if base is not None:
            base = _policy(base, info, settings.seed, settings.action or "wrench")
        return MPCPolicy(info, base, settings)


class ParallelRollout:
    """Maker of choices among policies (:class:`vibgym.policies.parallel_rollout.ParallelRolloutPolicy`)."""

    Settings = ParallelRolloutPolicy.Settings

    def __new__(cls, info: TaskInfo, settings: ParallelRolloutPolicy.Settings) -> Policy:
        """Make the policies and the choice among them."""
        made: list[Policy] = []
        for policy in settings.policies:
            made.append(_policy(policy, info, 0, settings.action or (made[0].action if made else None)))
        return ParallelRolloutPolicy(info, made, settings)


class Controllers(Registry[Maker]):
    """Makers of policies by name, and one for every law, under the law's name."""

    def __getitem__(self, name: str) -> Maker:
        return self._items[name] if name in self._items or name not in LAWS else lawful(name)

    def __iter__(self) -> Iterator[str]:
        return iter((*self._items, *LAWS))

    def __len__(self) -> int:
        return len(self._items) + len(LAWS)


CONTROLLERS = Controllers(
    "controller",
    {
        "zero": ZeroPolicy,
        "random": RandomPolicy,
        "open_loop": OpenLoopPolicy,
        "local_field": LocalFieldPolicy,
        "planner": PlannerPolicy,
        "lanes": lanes,
        "two_phases": TwoPhasesPolicy,
        "push": PushingPolicy,
        "mpc": MPC,
        "parallel_rollout": ParallelRollout,
        "by_task": by_task,
        "learned": Learned,
        "trained": Trained,
        "residual": Residual,
    },
)
"""Policies by name; ``CONTROLLERS.register(name, cls)`` adds a custom one, made as ``cls(info, settings=settings)``.

``"zero"`` and ``"random"`` serve all tasks, ``"open_loop"`` those for one part with a goal pose. ``"local_field"`` and
``"planner"`` serve tasks with goals, zones or a distance to keep; the first takes every part straight there, the second past
the others. ``"mpc"`` and ``"parallel_rollout"`` serve all tasks whose goals stay, ``"by_task"`` those that it names.
``"learned"`` is the shipped agent.
A law's name is that of the first with one part, of the second with several:
``vibgym.policies.classical.steering.LAWS.register(name, cls)`` adds a custom law.
"""
LAWS.taken = CONTROLLERS


def make_policy(policy: Any, env: Any, seed: int = 0) -> Policy:
    """Return a policy from a name, the path of a trained one's JSON file, a mapping, or an object with ``predict``.

    - ``{"kind": name, **arguments}``: one of :data:`CONTROLLERS`. ``{"kind": "trained", "path":
      "vibgym/policies/trained/shipped/{task}.json"}``: ``{task}`` is replaced by the task's name in lower case.
    - ``"learned"``, or ``{"kind": "learned", "hardware": "prototype", "variant": "cloned", "action": "wrench"}``: the shipped
      agent for this task and hardware.
    - ``{"policy": model, "action": name, "observation": name}``: a model that has only ``predict``; see
      :class:`vibgym.policies.foreign.ModelPolicy`. An object with ``action`` and ``observation`` is returned unchanged.

    Make the environment with ``policy.action`` and ``policy.observation``. A policy that supports several actions takes that of
    ``env``.

    Args:
        policy: see above.
        env: single or vector environment, wrapped or not; or a :class:`TaskInfo`.
        seed: of policies that draw random numbers, unless the mapping has one.

    Raises:
        ValueError: unknown name or arguments, a policy that does not serve this task, or a file without one for it.
        ModuleNotFoundError: the policy requires the extra ``policies``.
    """
    if isinstance(env, TaskInfo):
        return _policy(policy, env, seed, None)
    return _policy(policy, TaskInfo.of(env), seed, action_of(env))


def _policy(policy: Any, info: TaskInfo, seed: int, spoken: str | None) -> Policy:
    """Return the policy of :func:`make_policy` with this action, if it supports several."""
    if hasattr(policy, "predict"):
        complete = hasattr(policy, "action") and hasattr(policy, "observation")
        return policy if complete else ModelPolicy(policy, info, usual=spoken)
    if isinstance(policy, os.PathLike):
        policy = {"kind": "trained", "path": os.fspath(policy)}
    if isinstance(policy, str):
        policy = {"kind": "trained", "path": policy} if policy.endswith((".json", ".zip")) else {"kind": policy}
    if not isinstance(policy, Mapping):
        raise checks.refuse("policy", policy, "a name, a path, a mapping with 'kind', or an object with predict()")
    arguments = dict(policy)
    if "policy" in arguments:
        model = arguments.pop("policy")
        if not hasattr(model, "predict") or not set(arguments) <= {"action", "observation"}:
            allowed = "a mapping with 'policy', an object with predict(), and perhaps 'action' and 'observation'"
            raise checks.refuse("policy", dict(policy), allowed)
        return ModelPolicy(model, info, usual=spoken, **arguments)
    kind = arguments.pop("kind", None)
    CONTROLLERS.choose("policy.kind", kind)
    if spoken not in (None, DEFAULT) and "action" not in arguments and _takes_action(kind, spoken):
        arguments["action"] = spoken
    chosen = _made(kind, arguments, info, seed)
    if kind in FILES and spoken not in (None, DEFAULT, chosen.action):
        raise checks.conflict(f"policy {kind!r} requires action {chosen.action!r}, got {spoken!r}")
    return InElements(chosen) if (spoken, chosen.action) == ("element", "phasor") else chosen


def action_of(env: Any) -> str | None:
    """Return the name of an environment's action; None for one without a name."""
    acting = type(env.unwrapped.core.action)
    return next((name for name, each in ACTIONS.items() if each is acting), None)


def _takes_action(kind: str, action: str) -> bool:
    """Return whether a controller supports this action among several."""
    if kind in STEERED or kind in LAWS:
        return action in OUTPUTS
    return ACTIONS[action].by_part if kind == "mpc" else kind in ("learned", "parallel_rollout")


def settings_of(kind: str) -> Collection[str]:
    """Return the names of a controller's settings: its fields, or arguments if it has no ``Settings``."""
    make: Any = CONTROLLERS[kind]
    return make.Settings.model_fields if hasattr(make, "Settings") else inspect.signature(make).parameters


def _made(kind: str, arguments: dict[str, Any], info: TaskInfo, seed: int) -> Policy:
    """Return one of :data:`CONTROLLERS`; raise the errors of :func:`make_policy`."""
    if "seed" in settings_of(kind):
        arguments.setdefault("seed", seed)
    try:
        return CONTROLLERS.make("policy", {"kind": kind, **arguments}, info)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in EXTRA:
            raise
        raise extras.missing(f"policy {kind!r}", error, "policies") from None
