"""Starts of episodes: parts, poses and goals, drawn from uniform numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibgym import checks
from vibgym.envs.drawn import DrawnShapes
from vibgym.envs.options import StartOverride
from vibgym.scene.kinds import Kinds, groups_of
from vibgym.tasks import Start, Task

MAX_TASKS = 256
"""Tasks that are kept for worlds with drawn shapes; one takes 0.1 to some ms to make."""


class Starts:
    """Draws the shapes of the parts, where they are not fixed, then what the task draws for worlds with these parts.

    Args:
        task: of the environment.
        kinds: parts of its worlds.
        shapes: what draws them; None: they are fixed.
        first: uniform numbers of an episode for its shapes, which come before those of the task.
        walls: names of the borders with a wall.

    Attributes:
        draws: uniform numbers of an episode.
    """

    def __init__(self, task: Task, kinds: Kinds, shapes: DrawnShapes | None, first: int, walls: Sequence[str]) -> None:
        self._task, self._kinds, self._shapes, self._first, self._walls = task, kinds, shapes, first, walls
        self._tasks: dict[bytes, Task] = {}  # by the kinds of a world
        self.draws = first + task.draws

    def draw(self, worlds: np.ndarray, uniform: np.ndarray, override: StartOverride | None) -> tuple[Start, np.ndarray]:
        """Return a checked start of ``worlds`` (index array), and the kinds (n, parts) of their parts, or one row for all.

        Args:
            uniform: (n, draws) in [0, 1).
            override: reset options that replace drawn values.

        Raises:
            ValueError: a start that the task or an option does not allow.
        """
        own = uniform[:, self._first :]
        if self._shapes is None:
            return self._checked(self._draw(self._task, worlds, own, override), len(worlds)), self._kinds.kind
        kinds = self._shapes.kind_of(self._shapes.draw(uniform[:, : self._first]))
        groups = groups_of(kinds)
        starts = [self._draw(self._task_of(row), worlds[some], own[some], override) for row, some in groups]
        return self._checked(joined(starts, [some for _, some in groups]), len(worlds)), kinds

    def _task_of(self, kinds: np.ndarray) -> Task:
        """Return the task of worlds with parts of these kinds (parts,)."""
        key = kinds.tobytes()
        if key not in self._tasks:
            if len(self._tasks) == MAX_TASKS:
                self._tasks.clear()
            parts = [self._kinds.every[kind] for kind in kinds.tolist()]
            self._tasks[key] = type(self._task)(self._task.surface, parts, settings=self._task.settings)
        return self._tasks[key]

    def _draw(self, task: Task, worlds: np.ndarray, uniform: np.ndarray, override: StartOverride | None) -> Start:
        """Return a start of worlds with the parts of a task."""
        return task.start(uniform) if override is None else override.start(task, self._walls, worlds, uniform)

    def _checked(self, start: Start, worlds: int) -> Start:
        """Return a start whose poses are on the surface."""
        task, surface = self._task, self._task.surface
        shape, present = (worlds, len(self._kinds)), start.present
        checks.shaped(f"{task.name}: present", present, (shape,), "booleans", kinds="b")
        placed = present & (not task.continuous_feed)  # parts of a flow arrive later
        aimed = present & task.scored & task.has_goal
        least, most = (0.0, 0.0, -1e9), (surface.width, surface.depth, 1e9)
        for name, poses, counted in (("pose", start.pose, placed), ("goal", start.goal, aimed)):
            poses = checks.shaped(f"{task.name}: {name}", poses, ((*shape, 3),), "an array")
            off = ~((poses >= least) & (poses <= most)).all(axis=-1) & counted
            if off.any():
                allowed = f"on the surface, x in [0, {most[0]:g}] m and y in [0, {most[1]:g}] m, with a finite heading"
                raise checks.refuse(f"{task.name}: {name}", poses[off][0].tolist(), allowed)
        return start


def joined(starts: Sequence[Start], groups: Sequence[np.ndarray]) -> Start:
    """Return the starts of groups of worlds as one; ``groups``: indices of the worlds of each."""
    back = np.argsort(np.concatenate(groups))
    fields = (np.concatenate(values) for values in zip(*starts, strict=True))
    return Start(*(values[back] if len(values) else values for values in fields))
