"""From a name, a mapping, a file or an object to a policy."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from vibgym import checks, extras
from vibgym.envs.actions import ACTIONS
from vibgym.policies.classical.lanes import CrossingPolicy, FeedingPolicy
from vibgym.policies.classical.open_loop import OpenLoopPolicy, RandomPolicy, ZeroPolicy
from vibgym.policies.classical.planner import PlannerPolicy
from vibgym.policies.classical.pushing import PushingPolicy
from vibgym.policies.classical.steering import LAWS, OUTPUTS, LocalFieldPolicy
from vibgym.policies.classical.two_phases import TwoPhasesPolicy
from vibgym.policies.foreign import InElements, ModelPolicy
from vibgym.policies.mpc import MPCPolicy
from vibgym.policies.protocol import Policy
from vibgym.policies.task_info import TaskInfo
from vibgym.registry import Registry

Maker = Callable[..., Policy]
"""``make(info, **arguments)``."""

EXTRA = ("safetensors", "scipy")
"""What the extra ``policies`` installs: files of trained policies, and the planner's and some laws' algebra."""

STEERED = ("local_field", "planner", "lanes", "two_phases", "push")
"""Policies that steer parts by a law, and speak any action that steering knows."""

FILES = ("trained", "residual", "learned")
"""Policies that are read from files and act in environments with the action that they were trained with alone."""


def lawful(law: str) -> Maker:
    """Maker of a policy under one of :data:`.laws.LAWS`: parts with goal poses go straight there, as
    :class:`LocalFieldPolicy` has them, others by the :class:`PlannerPolicy`."""

    def make(info: TaskInfo, **arguments: Any) -> Policy:
        if "law" in arguments:
            raise checks.conflict(f"policy {law!r} names its controller, so 'law' cannot be set")
        straight = (info.has_goal and len(info.parts) == 1) or info.goal_moves
        return (LocalFieldPolicy if straight else PlannerPolicy)(info, law=law, **arguments)

    return make


def lanes(info: TaskInfo, **arguments: Any) -> Policy:
    """Lanes to the gates where parts come and go (:class:`FeedingPolicy`), else both ways past one another
    (:class:`CrossingPolicy`)."""
    return (FeedingPolicy if info.flows else CrossingPolicy)(info, **arguments)


def file_of(path: Any, info: TaskInfo) -> Path:
    """The file at a path in which ``{task}`` stands for the task's name in lower case.

    Raises:
        ValueError: no text.
    """
    if not isinstance(path, str | os.PathLike):
        raise checks.refuse("policy.path", path, "the path of a policy's JSON file")
    if str(path).endswith(".zip"):
        reason = "a model of Stable-Baselines3 is loaded by its own load(), and given as {'policy': model}"
        raise checks.conflict(f"policy.path {str(path)!r}: {reason}")
    return Path(str(path).replace("{task}", info.name.lower()))


def trained(info: TaskInfo, *, path: str) -> Policy:
    """The trained policy in a JSON file (:func:`file_of`).

    Raises:
        ValueError: the file holds no policy for this task.
    """
    from vibgym.policies.trained.trained import load_trained  # safetensors is an extra

    return load_trained(file_of(path, info), info)


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

    found = load_correction(file_of(path, info), info, base, scale)
    return ResidualPolicy(info, make_policy(found.base, info), found.learned, scale=found.scale)


def learned(
    info: TaskInfo, *, action: str | None = None, hardware: str | None = None, variant: str | None = None
) -> Policy:
    """The agent that is shipped for this task and hardware (:func:`vibgym.policies.trained.catalogue.shipped_agent`).

    Raises:
        ValueError: there is none.
    """
    from vibgym.policies.trained.catalogue import shipped_agent  # safetensors is an extra

    agent = shipped_agent(info, action=action, hardware=hardware, variant=variant)
    return CONTROLLERS[agent.kind](info, path=str(agent.path))


def by_task(info: TaskInfo, **policies: Any) -> Policy:
    """Another policy for every task: ``{"kind": "by_task", "Swap": "lanes", "Pack": {"kind": "two_phases"}}``.

    Args:
        info: task and scene.
        **policies: by the names of environments, each as :func:`make_policy` takes it.

    Raises:
        ValueError: none for this task, or one that does not serve it.
    """
    if info.name not in policies:
        raise checks.refuse("policy 'by_task'", f"the task {info.name}", f"tasks that it names: {', '.join(policies)}")
    return make_policy(policies[info.name], info)


def mpc(info: TaskInfo, *, base: Any = None, action: str | None = None, seed: int = 0, **settings: Any) -> Policy:
    """Plans by sampling in a simulation (:class:`vibgym.policies.mpc.MPCPolicy`).

    Args:
        info: task and scene.
        base: None, or a policy whose actions plans begin with, as :func:`make_policy` takes it.
        action, seed, **settings: of the search.

    Raises:
        ValueError: a bad argument, or a policy that does not serve this task.
    """
    if base is not None:
        named = dict(base) if isinstance(base, Mapping) else {"kind": base}
        kind = named.get("kind")
        spoken = {"action": action or "wrench"} if kind in STEERED or kind in LAWS else {}
        base = make_policy(spoken | named, info, seed)
    return MPCPolicy(info, base=base, action=action, seed=seed, **settings)


def schedule(info: TaskInfo, *, path: str) -> Policy:
    """The sensorless schedule in a JSON file.

    Raises:
        ValueError: the file holds none, or none for this surface.
    """
    from vibgym.policies.trained.schedule import load_schedule  # safetensors is an extra

    return load_schedule(file_of(path, info), info)


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
        "mpc": mpc,
        "by_task": by_task,
        "learned": learned,
        "trained": trained,
        "residual": residual,
        "schedule": schedule,
    },
)
"""Policies by name; ``CONTROLLERS.register(name, cls)`` adds one of your own, made as ``cls(info, **arguments)``.

``"zero"`` and ``"random"`` serve all tasks, ``"open_loop"`` those for one part with a goal pose, ``"local_field"`` and
``"planner"`` those that ask for places: goals, zones, or a distance to keep; the first takes every part straight there, the
second past the others. ``"mpc"`` serves all tasks whose goals stay, ``"by_task"`` those that it names. The names of laws are in
the first one's place with one part, in the second one's with several:
``vibgym.policies.classical.steering.LAWS.register(name, cls)`` adds one of your own. ``"learned"`` is the shipped agent.
"""
LAWS.taken = CONTROLLERS


def make_policy(policy: Any, env: Any, seed: int = 0) -> Policy:
    """A policy from a name, the path of a trained one's JSON file, a mapping, or anything that has ``predict``.

    - ``{"kind": name, **arguments}``: one of :data:`CONTROLLERS`. ``{"kind": "trained", "path":
      "vibgym/policies/trained/shipped/{task}.json"}``: ``{task}`` is replaced by the task's name in lower case.
    - ``"learned"``, or ``{"kind": "learned", "hardware": "prototype", "variant": "cloned", "action": "wrench"}``: the agent
      that is shipped for this task and hardware.
    - ``{"policy": model, "action": name, "observation": name}``: a model with ``predict`` alone; see
      :class:`vibgym.policies.foreign.ModelPolicy`. An object with ``action`` and ``observation`` is a policy already.

    What a policy speaks and reads says ``policy.action`` and ``policy.observation``: an environment is made with these. Where
    ``env`` has an action already and the policy knows several, it speaks that one.

    Args:
        policy: see above.
        env: that it shall act in, single or vector, wrapped or not; or a :class:`TaskInfo`.
        seed: of policies that draw random numbers, where the mapping has none.

    Raises:
        ValueError: unknown name or arguments, a policy that does not serve this task, or a file that holds none for it.
        ModuleNotFoundError: it needs the extra ``policies``.
    """
    info = env if isinstance(env, TaskInfo) else TaskInfo.of(env)
    spoken = None if env is info else action_of(env)
    if hasattr(policy, "predict"):
        known = hasattr(policy, "action") and hasattr(policy, "observation")
        return policy if known else ModelPolicy(policy, info, usual=spoken)
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
    assert isinstance(kind, str)
    chosen = _made(kind, arguments | _spoken(kind, arguments, spoken), info, seed)
    if kind in FILES and spoken not in (None, UNSAID, chosen.action):
        raise checks.conflict(f"policy {kind!r} requires action {chosen.action!r}, got an environment with {spoken!r}")
    return InElements(chosen) if (spoken, chosen.action) == ("element", "phasor") else chosen


UNSAID = "element"
"""Action of environments for which none has been chosen: it asks a policy for nothing."""


def action_of(env: Any) -> str | None:
    """Name of an environment's action; None of one without a name."""
    acting = type(env.unwrapped.core.action)
    return next((name for name, each in ACTIONS.items() if each is acting), None)


def _spoken(kind: str, arguments: Mapping[str, Any], spoken: str | None) -> dict[str, str]:
    """The argument by which a policy that knows several actions speaks that of its environment."""
    if spoken is None or "action" in arguments:
        return {}
    steers = kind in STEERED or kind in LAWS
    if not (spoken in OUTPUTS if steers else ACTIONS[spoken].by_part if kind == "mpc" else kind == "learned"):
        return {}
    return {} if spoken == UNSAID else {"action": spoken}


def _made(kind: str, arguments: dict[str, Any], info: TaskInfo, seed: int) -> Policy:
    """One of :data:`CONTROLLERS`.

    Raises:
        ValueError: see :func:`make_policy`.
        ModuleNotFoundError: likewise.
    """
    make = CONTROLLERS[kind]
    if "seed" in inspect.signature(make).parameters:
        arguments.setdefault("seed", seed)
    try:
        return make(info, **arguments)
    except TypeError as error:
        raise checks.conflict(f"policy {kind!r}: {error}, got {checks.shown(arguments)}") from error
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in EXTRA:
            raise
        raise extras.missing(f"policy {kind!r}", error, "policies") from None
