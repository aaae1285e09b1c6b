"""Keyword arguments of environments: defaults, names, and checks that combine several of them."""

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
"""Settings of tasks that are keyword arguments of the environment; others are in ``task_settings``."""

MOST_EPISODE = 10**12
"""Steps or periods of an episode."""


class Keywords(TypedDict, total=False):
    """Keyword arguments of :class:`Options` except the task, for type checkers: ``**options: Unpack[Keywords]``."""

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
    """Settings of an environment, see :class:`vibgym.envs.VibgymEnv`; the core checks their values."""

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
        """Return the names of all options except the task."""
        return tuple(field.name for field in fields(cls))[1:]

    @classmethod
    def from_mapping(cls, name: str, mapping: Mapping[str, Any], more: tuple[str, ...] = ()) -> Options:
        """Return the options in a mapping, with defaults for missing keys.

        Args:
            name: of the mapping, for errors.
            more: further keys, for errors.

        Raises:
            ValueError: not a mapping, no task, or an unknown key.
        """
        known = (*cls.names(), *more)
        if not isinstance(mapping, Mapping) or "task" not in mapping:
            raise checks.refuse(name, mapping, f"a mapping with 'task' and keys among {', '.join(known)}")
        for key in mapping:
            if key not in ("task", *cls.names()):
                raise checks.unknown(f"key of {name}", key, known)
        return cls(**mapping)

    def of_state(self) -> dict[str, Any]:
        """Return the options that a snapshot depends on: all except the limit of an episode."""
        return {name: value for name, value in vars(self).items() if name != "max_episode_periods"}


def step_limit(periods_per_step: int, max_episode_periods: Any) -> int | None:
    """Return the steps after which the environment truncates an episode, or None.

    With one period per step, Gymnasium's ``max_episode_steps`` applies, which users may change. With longer steps the same
    number of steps would be a longer time.
    """
    if max_episode_periods is None:
        return None
    limit = checks.count("max_episode_periods", max_episode_periods, most=MOST_EPISODE)
    return None if periods_per_step == 1 else math.ceil(limit / periods_per_step)


def longest_paths(task: Task, actuators: ActuatorStage, sensor: Sensor, max_episode_periods: int | None) -> float:
    """Return the longest duration of an episode's paths, s.

    Raises:
        ValueError: a sensor delay, an actuator latency, a hold or paths that do not fit in an episode.
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
    """Return the parts of a world from the keyword argument, or the task's default parts."""
    parts = task.DEFAULT_PARTS if parts is None else parts
    one = task.MOST_PARTS == 1
    if isinstance(parts, str) or not isinstance(parts, Sequence) or not parts or (len(parts) != 1 and one):
        allowed = "a list with one part" if one else "a list of parts"
        raise checks.refuse("parts", parts, f"{allowed}: a shipped part's name or a mapping")
    return tuple(part_from(part, "parts" if one else f"parts[{k}]") for k, part in enumerate(parts))


def task_settings(
    options: Options, cls: type[Task], randomize: Mapping[str, Any]
) -> tuple[dict[str, Any], Mapping[str, Any]]:
    """Return the keyword arguments of the task, and the weights of its reward terms.

    Args:
        options: of the environment; those in :data:`NAMED` go to tasks that have them.
        cls: of the task.
        randomize: the keys of ``randomize`` that the task draws itself.
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
        raise checks.refuse("task_settings", more, f"a mapping with keys among {', '.join(known)}, not set elsewhere")
    own = {name: value for name, value in more.items() if name != "weights"}
    return {**settings, **own}, more.get("weights", {})
