"""The keyword arguments of environments, once: for single and vector ones, specs, settings files and snapshots."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypedDict

from vibgym import checks
from vibgym.actuators.stage import ActuatorStage
from vibgym.config import part_from
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing import Sensor
from vibgym.tasks import Task

NAMED = ("start", "zones", "slots", "paths", "randomize")
"""Settings of tasks that are keyword arguments of the environment; the others come as ``task_settings``."""

MOST_EPISODE = 10**12
"""Steps or periods of an episode."""


class Keywords(TypedDict, total=False):
    """Keyword arguments of :class:`Options` but the task, for type checkers: ``**options: Unpack[Keywords]``."""

    surface: str | Mapping[str, Any] | Surface
    parts: Sequence[Any] | None
    model: str | Mapping[str, Any]
    action: str
    observation: str
    actuators: str | Mapping[str, Any]
    sensor: str | Mapping[str, Any]
    randomize: Mapping[str, Any] | None
    walls: Sequence[str] | None
    start: str | Mapping[str, Any] | None
    zones: Mapping[str, Sequence[float]] | None
    slots: int | None
    paths: Any
    task_settings: Mapping[str, Any] | None
    periods_per_step: int
    max_episode_periods: int | None


@dataclass(frozen=True)
class Options:
    """What an environment is made of, see :class:`vibgym.envs.VibgymEnv`; values as they are given, checked by the core."""

    task: str
    surface: str | Mapping[str, Any] | Surface = "prototype"
    parts: Sequence[Any] | None = None
    model: str | Mapping[str, Any] = "planar"
    action: str = "element"
    observation: str = "state"
    actuators: str | Mapping[str, Any] = "ideal"
    sensor: str | Mapping[str, Any] = "ideal"
    randomize: Mapping[str, Any] | None = None
    walls: Sequence[str] | None = None
    start: str | Mapping[str, Any] | None = None
    zones: Mapping[str, Sequence[float]] | None = None
    slots: int | None = None
    paths: Any = None
    task_settings: Mapping[str, Any] | None = None
    periods_per_step: int = 1
    max_episode_periods: int | None = None

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of all options but the task."""
        return tuple(field.name for field in fields(cls))[1:]

    @classmethod
    def from_mapping(cls, name: str, mapping: Mapping[str, Any], more: tuple[str, ...] = ()) -> Options:
        """The options in a mapping; those that it does not name are the defaults.

        Args:
            name: what errors call the mapping.
            more: other keys that its owner takes, for errors.

        Raises:
            ValueError: no mapping, no task, or a key that no environment has.
        """
        known = ", ".join((*cls.names(), *more))
        if not isinstance(mapping, Mapping) or "task" not in mapping:
            raise checks.refuse(name, mapping, f"a mapping with 'task' and keys among {known}")
        unknown = [each for each in mapping if each not in ("task", *cls.names())]
        if unknown:
            raise checks.refuse(name, sorted(map(str, unknown)), known)
        return cls(**mapping)

    def of_state(self) -> dict[str, Any]:
        """Those that a snapshot depends on, by name: all but the limit, which ends an episode and changes nothing in it."""
        return {name: value for name, value in vars(self).items() if name != "max_episode_periods"}


def step_limit(periods_per_step: int, max_episode_periods: Any) -> int | None:
    """Steps after which an episode is truncated by the environment itself.

    With one period a step that is left to Gymnasium's limit in steps, which users may change. With longer steps that limit, the
    same number, would be one on another time.
    """
    if max_episode_periods is None:
        return None
    limit = checks.count("max_episode_periods", max_episode_periods, most=MOST_EPISODE)
    return None if periods_per_step == 1 else math.ceil(limit / periods_per_step)


def longest_paths(task: Task, actuators: ActuatorStage, sensor: Sensor, max_episode_periods: int | None) -> float:
    """s that the paths of an episode may last.

    Raises:
        ValueError: a machine of which an episode shows nothing, or that does nothing in it (a delay or a latency that lasts as
            long), a hold that lasts longer, or paths that do with it.
    """
    if max_episode_periods is None:
        return math.inf
    latency = "randomize['latency']" if "latency" in actuators.drawn() else "actuators.latency"
    for name, periods in (("sensor.delay", sensor.delay), (latency, actuators.most_latency)):
        if periods >= max_episode_periods:
            raise checks.refuse(name, f"{periods} periods", f"less than an episode, {max_episode_periods} periods")
    if task.hold > max_episode_periods:
        raise checks.refuse("task_settings['hold']", task.hold, f"at most an episode, {max_episode_periods} periods")
    longest = (max_episode_periods - task.hold) * task.surface.period
    if task.lasts > longest:
        allowed = f"at most {longest:.4g} s: an episode without the hold"
        raise checks.refuse("paths", f"{task.lasts:.4g} s", allowed)
    return longest


def parts_from(parts: Any, task: type[Task]) -> tuple[Part, ...]:
    """The parts of a world from the keyword argument."""
    parts = task.DEFAULT_PARTS if parts is None else parts
    one = task.MOST_PARTS == 1
    if isinstance(parts, str) or not isinstance(parts, Sequence) or not parts or (len(parts) != 1 and one):
        allowed = "a list with one part" if one else "a list of parts"
        raise checks.refuse("parts", parts, f"{allowed}: a shipped part's name or a mapping")
    return tuple(part_from(part, "parts" if one else f"parts[{k}]") for k, part in enumerate(parts))


def task_settings(
    options: Options, cls: type[Task], randomize: Mapping[str, Any]
) -> tuple[dict[str, Any], Mapping[str, Any]]:
    """Keyword arguments of the task: those that the environment names, where the task has them, and the task's own.

    ``randomize``: the task's share of it. Also the weights of reward terms, which every task has, whatever its arguments.
    """
    settings = {name: getattr(options, name) for name in NAMED if name != "randomize"}
    settings = {
        name: value for name, value in {**settings, "randomize": randomize or None}.items() if value is not None
    }
    known = checks.keywords(cls)
    for name in settings:
        if name not in known:
            own = ", ".join(each for each in known if each in NAMED)
            raise checks.conflict(f"{name} cannot be set for task {options.task!r} (its settings: {own or 'none'})")
    more = {} if options.task_settings is None else options.task_settings
    known = tuple(dict.fromkeys((*known, "weights")))
    if not isinstance(more, Mapping) or any(name not in known or name in settings for name in more):
        raise checks.refuse("task_settings", more, f"a mapping with keys among {', '.join(known)}, each once")
    own = {name: value for name, value in more.items() if name != "weights"}
    return {**settings, **own}, more.get("weights", {})
