"""Images of an environment's state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibgym.envs.shared import SharedInterface
from vibgym.rendering import Scenery, Side, Window, Zone
from vibgym.tasks.base import kinds_by_name


def scenery_of(env: SharedInterface, world: int = 0) -> Scenery:
    """Return the static content of images of a world."""
    surface, task = env.surface, env.task
    names, _ = kinds_by_name(env.core.kinds.parts(world))  # drawn parts have other names in every episode
    zones = () if task.zones is None else zip(names, task.zones.tolist(), strict=True)
    return Scenery(
        surface.rows,
        surface.columns,
        surface.element_size,
        tuple(np.array(part.outline) for part in env.core.kinds.parts(world)),
        kinds=tuple(task.kind.tolist()),
        walls=tuple(env.walls),
        zones=tuple(
            Zone((zone[0], zone[1]), (zone[2], zone[3]), kind, name.replace("_", " "))
            for kind, (name, zone) in enumerate(zones)
        ),
        scored=tuple(task.scored.tolist()),
        goal_size=(3 if task.has_heading else 2) if task.has_goal else 0,
        tolerance=task.position_tolerance if task.has_goal else None,
    )


def has_side(env: SharedInterface) -> bool:
    """Return whether images include a side view: with models in which parts may tilt."""
    return not env.core.simulator.flat


def side_of(env: SharedInterface, world: int) -> Side | None:
    """Return bottoms of the parts and plates in the rows under their centres at the end of a period; None if all are flat."""
    if not has_side(env):
        return None
    core, surface = env.core, env.surface
    amplitude, size = surface.max_amplitude or 0.0, surface.element_size
    heights = amplitude * core.phasors(world)[..., 0]
    bottoms, plates = core.simulator.bottoms(world), []
    for k, bottom in enumerate(bottoms):
        if not core.episode.present[world, k]:
            bottom[:] = np.nan
            continue
        row = min(max(int(core.simulator.state.pose[world, k, 1] / size), 0), surface.rows - 1)
        low, high = (int(edge / size) for edge in (bottom[:, 0].min(), bottom[:, 0].max()))
        for column in range(max(low, 0), min(high, surface.columns - 1) + 1):
            plates.append((column * size, (column + 1) * size, heights[row, column]))
    return Side(bottoms, np.array(plates).reshape(-1, 3))


class Viewer:
    """Painter of the worlds of an environment, with the trails of their parts."""

    def __init__(self, env: SharedInterface, title: str, worlds: int = 1) -> None:
        self.env = env
        self._sceneries = [self._scenery(0)] * worlds
        self._painters = [self._sceneries[0].painter()] * worlds
        self.window = Window(self._painters[0], 1.0 / env.step_time, title)
        self.trails: list[list[np.ndarray]] = [[] for _ in range(worlds)]  # (parts, 2) at each step

    def _scenery(self, world: int) -> Scenery:
        return replace(scenery_of(self.env, world), side=has_side(self.env))

    def begin(self, world: int) -> None:
        """Clear the trails of a world whose episode starts, and draw its parts from now on."""
        self.trails[world] = []
        if self.env.core.kinds.vary:
            self._sceneries[world] = self._scenery(world)
            self._painters[world] = self._sceneries[world].painter()
        self.follow(world)

    def follow(self, world: int) -> None:
        """Extend the trails by the present positions."""
        trail = self.trails[world]
        trail.append(self.env.core.simulator.state.pose[world, :, :2].copy())
        del trail[: -self._sceneries[world].trail]

    def frame(self, world: int) -> np.ndarray:
        """Return an image (height, width, 3) uint8 of a world."""
        core, episode = self.env.core, self.env.core.episode
        pose = core.simulator.state.pose[world]
        trail = np.array(self.trails[world]).reshape(-1, *pose[:, :2].shape)
        present, goal = episode.present[world], episode.goal[world]
        caption = self.env.caption(world)
        lines = self.env.paths(world)
        view = self._sceneries[world].view(
            pose, present, goal, core.phasors(world), trail, caption, lines, side_of(self.env, world)
        )
        return self._painters[world].paint(view)

    def show(self, world: int) -> None:
        """Show a world in the window."""
        self.window.show(self.frame(world))

    def close(self) -> None:
        """Close the window."""
        self.window.close()
