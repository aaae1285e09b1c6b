"""Options of a reset: ``reset(options={"pose": ..., "goal": ..., "paths": ..., "parts": ...})``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.scene import overlaps
from vibgym.simulation.simulator import Simulator
from vibgym.tasks import Start, Task

KEYS = ("pose", "goal", "paths", "parts")


@dataclass(frozen=True)
class StartOverride:
    """Values that replace drawn ones at the start of episodes in all worlds; None: drawn.

    Attributes:
        pose: (worlds, parts, 3) x, y (m), heading (rad).
        goal: (worlds, parts, 3) likewise, for tasks with goal poses.
        present: (worlds, parts) bool, which parts are present.
        draw: :meth:`vibgym.tasks.Task.start`, or the task's method for given paths.
    """

    pose: np.ndarray | None
    goal: np.ndarray | None
    present: np.ndarray | None
    draw: Callable[[np.ndarray, np.ndarray | None], Start]

    def start(self, task: Task, simulator: Simulator, worlds: np.ndarray, uniform: np.ndarray) -> Start:
        """Return the start of ``worlds`` (index array) with these values.

        Raises:
            ValueError: parts off the surface, overlapping one another or a wall, or where the task cannot start.
        """
        present = None if self.present is None else self.present[worlds]
        start = self.draw(uniform, present)
        if self.pose is not None:
            there = start.present
            pose = np.where(there[..., None], self.pose[worlds], start.pose)
            where = (simulator.hulls, simulator.surface, simulator.parts, simulator.walls, pose, ~there)
            overlaps.check("options['pose']", *where, overlaps.AT_REST)
            start = task.put_down(start, pose)
        return start if self.goal is None else start._replace(goal=self.goal[worlds])


def parse_reset_options(
    options: Any, task: Task, worlds: int, longest: float, more: tuple[str, ...] = ()
) -> StartOverride | None:
    """Parse the options of a reset; None if they set nothing of the start.

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
        raise checks.refuse("options", options, f"None or a mapping with keys among {', '.join((*KEYS, *more))}")
    for name in options:
        if name not in (*KEYS, *more):
            raise checks.unknown("key of options", name, (*KEYS, *more))
    given = {name: value for name, value in options.items() if value is not None and name in KEYS}
    if not given:
        return None
    shape = (worlds, len(task.parts), 3)
    pose = goal = present = None
    draw = task.start
    if "pose" in given:
        if task.flows:
            raise checks.conflict(f"options['pose'] cannot be set for {task.name}: its parts arrive at an inlet")
        pose = _on_surface("options['pose']", given["pose"], shape, task)
    if "goal" in given:
        if not task.has_goal or task.goal_moves:
            why = "its goals move" if task.goal_moves else "it has no goal poses"
            raise checks.conflict(f"options['goal'] cannot be set for {task.name}: {why}")
        goal = _goals(given["goal"], shape, task)
    if "paths" in given:
        draw = task.starts_along("options['paths']", given["paths"], longest)
    if "parts" in given:
        present = _present(given["parts"], shape[:2])
    return StartOverride(pose, goal, present, draw)


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
        given = np.asarray(value)
    except ValueError:
        raise checks.refuse(name, value, allowed) from None
    if given.dtype == bool:
        present = np.array(checks.array(name, given, shape, dtype=bool))
    else:
        if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray) or given.ndim != 1 or not len(given):
            raise checks.refuse(name, value, allowed)
        numbers = [checks.count(f"{name}[{k}]", each, least=0, most=parts - 1) for k, each in enumerate(given.tolist())]
        if len(set(numbers)) < len(numbers):
            raise checks.refuse(name, value, allowed)
        present = np.zeros(shape, dtype=bool)
        present[:, numbers] = True
    if not present.any(axis=1).all():
        raise checks.refuse(name, value, allowed)
    return present
