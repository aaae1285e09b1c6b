"""What the settings of an evaluation list by name: policies, the hardware that they run on, and single effects of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vibgym import checks

HARDWARE_KEYS = ("actuators", "sensor", "randomize")
"""Arguments of the environments that say what machine a policy runs on."""

WORLD_KEYS = (*HARDWARE_KEYS, "model")
"""Those that a case of an evaluation may have: also by which physics the machine is simulated."""

MOST_NAME = 40
"""Characters of a name in the report's tables."""


@dataclass(frozen=True)
class PolicyEntry:
    """One policy of an evaluation."""

    name: str  # in the report
    content: Any  # what :func:`vibgym.policies.registry.make_policy` takes
    tasks: tuple[str, ...] | None  # on which it runs; None: on all that it serves
    hardware: tuple[str, ...] | None  # on which it runs; None: on all

    @property
    def limits(self) -> dict[str, tuple[str, ...]]:
        """Tasks and hardware, where the settings name them."""
        return {key: names for key in ("tasks", "hardware") if (names := getattr(self, key)) is not None}


@dataclass(frozen=True)
class HardwareEntry:
    """One machine of an evaluation."""

    name: str  # in the report
    arguments: dict[str, Any]  # of the environments, see WORLD_KEYS
    tasks: tuple[str, ...]  # that run on it
    episodes: int | None  # at most so many of each task; None: as many as anywhere

    def runs(self, policy: PolicyEntry, task: str) -> bool:
        """Whether nobody has said that a policy does not run on a task on this hardware."""
        wanted = policy.tasks is None or task in policy.tasks
        return wanted and task in self.tasks and (policy.hardware is None or self.name in policy.hardware)


@dataclass(frozen=True)
class Column:
    """One policy of a study."""

    name: str  # in the table
    policy: str  # name of the evaluation's policy
    sensor: dict[str, Any]  # settings that it has of its own in every case
    trained_on: str = ""  # in words, where the study tells it


def policy_entry(policy: Any, field: str, tasks: Sequence[str], hardware: Sequence[str]) -> PolicyEntry:
    """A policy of the settings: an object, a name, a path, or a mapping.

    Raises:
        ValueError: it is none of these, or a mapping with other keys or values; names the field.
    """
    if hasattr(policy, "predict"):
        return PolicyEntry(_object_name(policy), policy, None, None)
    if isinstance(policy, str):
        return PolicyEntry(Path(policy).stem if policy.endswith(".json") else policy, policy, None, None)
    if not isinstance(policy, Mapping):
        raise checks.refuse(field, policy, "a name, the path of a trained policy, or a mapping with 'kind'")
    content = dict(policy)
    own = {
        key: None if (value := content.pop(key, None)) is None else some_of(f"{field}.{key}", value, known, key)
        for key, known in (("tasks", tasks), ("hardware", hardware))
    }
    subject: Any = content
    default = content.get("kind")
    if "policy" in content:
        model = content["policy"]
        if not hasattr(model, "predict") or set(content) - {"policy", "action", "name"}:
            allowed = "an object with predict() as 'policy', beside 'action', 'name', 'tasks' and 'hardware' alone"
            raise checks.refuse(field, policy, allowed)
        default = _object_name(model)
        if "action" not in content:
            subject = model
    name = content.pop("name", default)
    checks.label(f"{field}.name", name, most=MOST_NAME)
    return PolicyEntry(name, subject, **own)


def _object_name(policy: Any) -> str:
    return str(getattr(policy, "name", type(policy).__name__))


def hardware_entry(where: str, name: str, content: Any, tasks: Sequence[str]) -> HardwareEntry:
    """A machine of the settings ``where``: arguments of the environments, beside ``tasks`` and ``episodes``.

    Raises:
        ValueError: names the field.
    """
    field = f"{where}.{named(where, name)}"
    arguments = arguments_among(field, content, (*WORLD_KEYS, "tasks", "episodes"))
    own, episodes = arguments.pop("tasks", None), arguments.pop("episodes", None)
    chosen = tuple(tasks) if own is None else some_of(f"{field}.tasks", own, tasks, "tasks")
    most = None if episodes is None else checks.count(f"{field}.episodes", episodes, most=100_000)
    return HardwareEntry(name, arguments, chosen, most)


def effect_arguments(name: str, content: Any) -> dict[str, Any]:
    """Arguments of the environments of one case of the study of effects; see :func:`hardware_entry`."""
    field = f"evaluation.effects.cases.{named('evaluation.effects.cases', name)}"
    return arguments_among(field, content, WORLD_KEYS)


def columns(entries: Sequence[Any], where: str, policies: Sequence[str], told: bool = False) -> list[Column]:
    """The policies of a study, each with a name of its own; see :func:`_column`.

    Raises:
        ValueError: names the field, which begins with ``where``.
    """
    found: list[Column] = []
    for index, entry in enumerate(entries):
        each = _column(entry, f"{where}.{index}", policies, told)
        if any(each.name == other.name for other in found):
            raise checks.refuse(f"{where}.{index}.name", each.name, "a name that no other policy of the table has")
        found.append(each)
    return found


def _column(entry: Any, field: str, policies: Sequence[str], told: bool) -> Column:
    """The name of a policy, or a mapping with ``policy``, ``name``, ``sensor`` and, where it is ``told``, ``trained_on``."""
    if not isinstance(entry, Mapping):
        return Column(checks.choice(field, entry, tuple(policies)), entry, {})
    for key in entry:
        checks.choice(field, key, ("policy", "name", "sensor", *(["trained_on"] if told else [])))
    policy = checks.choice(f"{field}.policy", entry.get("policy"), tuple(policies))
    name = checks.label(f"{field}.name", entry.get("name", policy), most=MOST_NAME)
    sensor = entry.get("sensor", {})
    if not isinstance(sensor, Mapping):
        raise checks.refuse(f"{field}.sensor", sensor, "a mapping of settings of the sensor")
    trained_on = checks.label(f"{field}.trained_on", entry["trained_on"]) if "trained_on" in entry else ""
    return Column(name, policy, dict(sensor), trained_on)


def laid_over(environment: Mapping[str, Any], arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an environment on some hardware: what is randomized comes together, all else is replaced."""
    result = {**environment, **arguments}
    both = [each.get("randomize") for each in (environment, arguments)]
    if all(isinstance(each, Mapping) for each in both):
        result["randomize"] = {**both[0], **both[1]}  # type: ignore[dict-item]
    return result


def with_sensor(environment: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an environment whose sensor has some settings of its own, key by key."""
    if not settings:
        return dict(environment)
    sensor = environment.get("sensor", "ideal")
    return {**environment, "sensor": {**(sensor if isinstance(sensor, Mapping) else {"kind": sensor}), **settings}}


def some_of(field: str, value: Any, known: Sequence[str], what: str) -> tuple[str, ...]:
    """A list of different names among those that are known."""
    allowed = f"a list of different {what} among {', '.join(known)}"
    if not isinstance(value, list | tuple) or not value:
        raise checks.refuse(field, value, allowed)
    if any(each not in known or value.count(each) > 1 for each in value):
        raise checks.refuse(field, value, allowed)
    return tuple(value)


def named(field: str, name: str) -> str:
    """A key that is a name in the report, checked."""
    return checks.label(f"{field} (a name)", name, most=MOST_NAME)


def arguments_among(field: str, content: Any, allowed: tuple[str, ...]) -> dict[str, Any]:
    """A mapping of the settings with some keys alone.

    Raises:
        ValueError: names the field.
    """
    if not isinstance(content, Mapping):
        raise checks.refuse(field, content, f"a mapping with keys among {', '.join(map(repr, allowed))}")
    for key in content:
        checks.choice(field, key, allowed)
    return dict(content)
