"""Keyword arguments of environments and options of a reset: defaults, names, and joint checks."""

from __future__ import annotations

import inspect
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.actuators.stage import ActuatorStage
from vibgym.registration import Periods
from vibgym.scene import overlaps
from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import Part, part_from
from vibgym.scene.surface import Surface
from vibgym.sensing import Sensor
from vibgym.settings import BaseSettings, Given, read
from vibgym.tasks import Follow, Start, Task

NAMED = ("start", "zones", "slots", "paths", "randomize")
"""Settings of tasks that are keyword arguments of the environment; others are in ``task_settings``."""

RESET_OPTIONS = ("pose", "goal", "paths", "parts")
"""Keys of ``reset(options=...)``."""

MAX_EPISODE = 10**12
"""Most steps or periods of an episode."""

MAX_PERIODS = 1_000_000
"""Most periods of a step: eleven hours of simulated time."""


class Options(BaseSettings):
    """Settings of an environment. Components check the values that are not numbers of this class."""

    task: str
    """``"Transport"``, ``"Align"``, ``"Rotate"``, ``"Follow"``, ``"Sort"``, ``"Singulate"``, ``"Pack"``, ``"Swap"``,
    ``"Push"``, ``"Feed"``, or a registered name."""

    surface: Given[str | Mapping[str, Any] | Surface] = "prototype"
    """``"prototype"``, a mapping of :class:`vibgym.Surface`'s fields (keys may end in ``_mm``), or a Surface."""

    parts: Given[Sequence[str | Mapping[str, Any] | Part] | None] = None
    """List of names of shipped parts (``"aluminium_block"``, ``"steel_block"``), mappings with ``shape`` and its fields, or
    :class:`vibgym.Part`; exactly one for Transport, Align and Rotate."""

    model: Given[str | Mapping[str, Any]] = "planar"
    """``"planar"``, ``"averaged"``, ``"tilting"`` or ``"auto"``, see :class:`vibgym.Simulator`; or a mapping with ``kind`` and
    the model's settings."""

    action: str = "element"
    """Name of the action, see :class:`vibgym.envs.VibgymEnv`, or a registered one."""

    observation: str = "state"
    """Name of the observation, likewise."""

    actuators: Given[str | Mapping[str, Any]] = "ideal"
    """``"ideal"``, ``"prototype"`` (:class:`vibgym.actuators.PrototypeActuators`), a registered name, or a mapping with
    ``kind`` and settings."""

    sensor: Given[str | Mapping[str, Any]] = "ideal"
    """``"ideal"``, ``"pose"`` (noise), ``"camera"``, a registered name, or a mapping with ``kind``, settings, ``estimator``
    (``"none"``, ``"kalman"``, ``"model"``) and ``report``, features to add to observations (``"age"``, ``"sigma"``,
    ``"contacts"``); see docs/hardware.md."""

    randomize: Given[Mapping[str, Any] | None] = None
    """Mapping of values drawn for every episode. ``"friction"``, ``"mass"``: [low, high] factors per part; ``"patches"``:
    [low, high] friction factors per element; ``"incline"``: largest angle or [low, high], rad; ``"parts"``: [low, high]
    number of parts (Sort, Singulate, Pack, Swap); ``"disturbance"``: mapping with ``rate`` (1/s) and ``tilt`` (rad, or
    ``tilt_deg``); settings of the actuators: [low, high]."""

    walls: Given[Sequence[str] | None] = None
    """Of tasks with several parts except Follow: among ``"left"``, ``"right"``, ``"bottom"``, ``"top"``."""

    start: Given[str | Mapping[str, Any] | None] = None
    """Of Sort and Pack: ``"scattered"``, ``"crowded"``, ``"pattern"``, or a mapping with ``kind`` and settings
    (:data:`vibgym.tasks.starts.STARTS`)."""

    zones: Given[Mapping[str, Sequence[float]] | None] = None
    """Of Sort: mapping from kind to [x_low, y_low, x_high, y_high], m."""

    slots: Given[int | None] = None
    """Of tasks with several parts: blocks of the state observation, at least the number of parts."""

    paths: Given[Any] = None
    """Of Follow, see :class:`vibgym.tasks.Follow`."""

    split: Given[str | None] = None
    """Parts ``{"shape": "drawn"}`` get a shape of this split for each episode: ``"train"``, ``"validation"``, ``"test"``,
    ``"held_out"`` (:func:`vibgym.scene.shapes`, :mod:`vibgym.envs.drawn`)."""

    shapes: Given[Sequence[int] | None] = None
    """Indices of the split's parts instead of drawn ones, one for each different shape."""

    costs: Given[Mapping[str, Any] | None] = None
    """Costs beside the reward, see :mod:`vibgym.envs.costs`: a mapping from ``"impulse"``, ``"fallen"``, ``"clearance"``,
    ``"effort"`` or a registered name to a weight, or to a mapping with ``weight`` and settings."""

    task_settings: Given[Mapping[str, Any] | None] = None
    """Further settings of the task, such as ``hold`` (periods) and ``weights``."""

    periods_per_step: int = Field(default=1, ge=1, le=MAX_PERIODS)
    """Oscillation periods per step. Hold, time cost and limit count periods."""

    max_episode_periods: int | None = Field(default=None, ge=1, le=MAX_EPISODE)
    """Periods after which an episode is truncated, unless ``gym.make`` gets ``max_episode_steps`` (steps; -1: no limit)."""

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of all options except the task."""
        return tuple(cls.model_fields)[1:]

    @classmethod
    def of(cls, task: str, settings: Mapping[str, Any], more: tuple[str, ...] = ()) -> Options:
        """Return the options of an environment; ``more``: further keyword arguments of it, for errors.

        Raises:
            ValueError: an unknown name, or a bad number.
        """
        for name in settings:
            if name not in cls.names():
                raise checks.unknown("keyword argument", name, (*cls.names(), *more))
        return read(cls, {"task": task, **settings}, "")

    def identity(self, surface: Surface, parts: Sequence[Part], walls: Sequence[str], worlds: int) -> str:
        """Return the settings that a snapshot depends on, as JSON: all except the limit of an episode."""

        def plain(value: Any) -> Any:
            return value.tolist() if isinstance(value, np.ndarray | np.generic) else repr(value)

        scene = {
            "surface": vars(surface),
            "parts": [part.to_dict() for part in parts],
            "walls": walls,
            "worlds": worlds,
        }
        settings = {name: value for name, value in vars(self).items() if name != "max_episode_periods"}
        return json.dumps(settings | scene, sort_keys=True, default=plain)


def with_options(init: Callable[..., None]) -> Callable[..., None]:
    """Add the options and their defaults to the signature of a constructor with ``**options``, for help and completion."""
    own = inspect.signature(init)
    *first, rest = own.parameters.values()
    options = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=field.annotation)
        for name, field in Options.model_fields.items()
        if name not in own.parameters
    ]
    init.__signature__ = own.replace(parameters=[*first, *options, rest])  # type: ignore[attr-defined]
    return init


def first_difference(theirs: Any, mine: str) -> tuple[str, str]:
    """Return the first setting that differs in two identities, as given in a snapshot and as required, for errors."""
    try:
        other, own = json.loads(theirs), json.loads(mine)
        if missing := [key for key in own if key not in other]:
            return f"a state of another version, without {', '.join(missing)}", "one of this version"
        name = next(key for key in own if other[key] != own[key])
        return f"a state of another environment, with {name}={other[name]!r}", f"{name}={own[name]!r}"
    except (TypeError, ValueError, AttributeError, StopIteration, RecursionError):
        return checks.shown(theirs), "the description of an environment with these settings"


def step_limit(max_episode_steps: Any, periods_per_step: int, max_episode_periods: int | None) -> int | None:
    """Return the steps after which episodes are truncated, or None, with the meaning of ``gym.make``.

    Args:
        max_episode_steps: None or :class:`Periods`: the limit in periods; -1: no limit; else steps.
    """
    if max_episode_steps is None or isinstance(max_episode_steps, Periods):
        periods = max_episode_steps if max_episode_periods is None else max_episode_periods
        return None if periods is None else math.ceil(periods / periods_per_step)
    if isinstance(max_episode_steps, int) and max_episode_steps == -1:
        return None
    return checks.count("max_episode_steps", max_episode_steps, most=MAX_EPISODE)


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


def parts_from(parts: Any, task: type[Task], surface: Surface) -> tuple[Part, ...]:
    """Return the parts of a world from the keyword argument, or the task's default parts."""
    parts = task.DEFAULT_PARTS if parts is None else parts
    one = task.MAX_PARTS == 1
    if isinstance(parts, str) or not isinstance(parts, Sequence) or not parts or (len(parts) != 1 and one):
        allowed = "a list with one part" if one else "a list of parts"
        raise checks.refuse("parts", parts, f"{allowed}: a shipped part's name or a mapping")
    return tuple(part_from(part, "parts" if one else f"parts[{k}]", surface) for k, part in enumerate(parts))


def task_settings(options: Options, cls: type[Task], randomize: Mapping[str, Any]) -> Task.Settings:
    """Return the settings of the task.

    Args:
        options: of the environment; those in :data:`NAMED` are settings of tasks that have them.
        cls: of the task.
        randomize: the entries of ``randomize`` that the task draws.

    Raises:
        ValueError: an option that the task does not have, one that is given twice, or a bad value.
    """
    named = {name: getattr(options, name) for name in NAMED if name != "randomize"}
    named = {name: value for name, value in {**named, "randomize": randomize or None}.items() if value is not None}
    known = cls.Settings.model_fields
    for name in named:
        if name not in known:
            own = ", ".join(setting for setting in known if setting in NAMED)
            raise checks.conflict(f"{name} cannot be set for task {options.task!r} (its settings: {own or 'none'})")
    more = {} if options.task_settings is None else options.task_settings
    if not isinstance(more, Mapping) or any(name in named for name in more):
        raise checks.refuse("task_settings", more, f"a mapping with keys among {', '.join(known)}, not set elsewhere")
    try:
        return read(cls.Settings, {**named, **more}, "task_settings")
    except checks.Refused as error:  # name options of the environment without the prefix
        message = str(error)
        for name in named:
            message = message.replace(f"task_settings.{name}", name)
        raise checks.Refused(message) from None


@dataclass(frozen=True)
class StartOverride:
    """Values that replace drawn ones at the start of episodes in all worlds; None: drawn.

    Attributes:
        pose: (worlds, parts, 3) x, y (m), heading (rad).
        goal: (worlds, parts, 3) likewise, for tasks with goal poses.
        present: (worlds, parts) bool, which parts are present.
        paths: along which goals move, a mapping for each part, for Follow.
        longest: s, largest duration of the paths.
    """

    pose: np.ndarray | None
    goal: np.ndarray | None
    present: np.ndarray | None
    paths: Any
    longest: float

    def start(self, task: Task, walls: Sequence[str], worlds: np.ndarray, uniform: np.ndarray) -> Start:
        """Return the start of ``worlds`` (index array) with these values.

        Raises:
            ValueError: parts off the surface, overlapping one another or a wall, or where the task cannot start.
        """
        present = None if self.present is None else self.present[worlds]
        if self.paths is None:
            start = task.start(uniform, present)
        else:
            assert isinstance(task, Follow)
            start = task.start_along("options['paths']", self.paths, self.longest, uniform, present)
        if self.pose is not None:
            there = start.present
            pose = np.where(there[..., None], self.pose[worlds], start.pose)
            parts = task.part_kinds
            overlaps.check(
                "options['pose']", hulls_of(parts), task.surface, parts, walls, pose, ~there, overlaps.AT_REST
            )
            start = task.place(start, pose)
        return start if self.goal is None else start._replace(goal=self.goal[worlds])


def parse_reset_options(
    options: Any, task: Task, worlds: int, longest: float, more: tuple[str, ...] = ()
) -> StartOverride | None:
    """Parse the options of a reset; None if they do not affect the start.

    Args:
        options: of the call.
        longest: duration of paths, s.
        more: further known names.

    Raises:
        ValueError: an unknown option, or an invalid value.
    """
    if options is None:
        return None
    if not isinstance(options, Mapping):
        raise checks.refuse(
            "options", options, f"None or a mapping with keys among {', '.join((*RESET_OPTIONS, *more))}"
        )
    for name in options:
        if name not in (*RESET_OPTIONS, *more):
            raise checks.unknown("key", name, (*RESET_OPTIONS, *more), of="options")
    requested = {name: value for name, value in options.items() if value is not None and name in RESET_OPTIONS}
    if not requested:
        return None
    shape = (worlds, len(task.parts), 3)
    pose = goal = present = paths = None
    if "pose" in requested:
        if task.continuous_feed:
            raise checks.conflict(f"options['pose'] cannot be set for {task.name}: its parts arrive at an inlet")
        pose = _on_surface("options['pose']", requested["pose"], shape, task)
    if "goal" in requested:
        if not task.has_goal or task.goal_moves:
            why = "its goals move" if task.goal_moves else "it has no goal poses"
            raise checks.conflict(f"options['goal'] cannot be set for {task.name}: {why}")
        goal = _goals(requested["goal"], shape, task)
    if "paths" in requested:
        if not isinstance(task, Follow):
            raise checks.conflict(f"options['paths'] cannot be set for {task.name}: its goals do not follow paths")
        paths = requested["paths"]
    if "parts" in requested:
        present = _present(requested["parts"], shape[:2])
    return StartOverride(pose, goal, present, paths, longest)


def _on_surface(name: str, value: Any, shape: tuple[int, ...], task: Task) -> np.ndarray:
    pose = np.array(checks.array(name, value, shape))
    overlaps.check_centres(name, pose, task.surface)
    return pose


def _goals(value: Any, shape: tuple[int, ...], task: Task) -> np.ndarray:
    """Return goal poses; positions suffice where headings do not count."""
    name = "options['goal']"
    try:
        width = np.shape(value)[-1:]
    except ValueError:
        width = ()
    if width == (2,) and not task.has_heading:
        value = np.concatenate([checks.array(name, value, np.shape(value)), np.zeros((*np.shape(value)[:-1], 1))], -1)
    return _on_surface(name, value, shape, task)


def _present(value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return which parts are present, from a list of indices or from booleans."""
    name, parts = "options['parts']", shape[1]
    allowed = f"different numbers of parts from 0 to {parts - 1}, at least one, or booleans that broadcast to {shape}"
    try:
        array = np.asarray(value)
    except ValueError:
        raise checks.refuse(name, value, allowed) from None
    if array.dtype == bool:
        present = np.array(checks.array(name, array, shape, dtype=bool))
    else:
        if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray) or array.ndim != 1 or not len(array):
            raise checks.refuse(name, value, allowed)
        numbers = [checks.count(f"{name}[{k}]", part, least=0, most=parts - 1) for k, part in enumerate(array.tolist())]
        if len(set(numbers)) < len(numbers):
            raise checks.refuse(name, value, allowed)
        present = np.zeros(shape, dtype=bool)
        present[:, numbers] = True
    if not present.any(axis=1).all():
        raise checks.refuse(name, value, allowed)
    return present
