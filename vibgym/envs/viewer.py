"""From an environment's state to a picture: the only place where environments meet rendering."""

from __future__ import annotations

import numpy as np

from vibgym.envs.shared import SharedInterface
from vibgym.rendering import SurfacePainter, View, Window, Zone

TRAIL_STEPS = 250


class Viewer:
    """Draws worlds of an environment and keeps their trails."""

    def __init__(self, env: SharedInterface, title: str, worlds: int = 1) -> None:
        surface, task = env.surface, env.task
        self.env = env
        self.zones: tuple[Zone, ...] = ()
        if task.zones is not None:
            self.zones = tuple(
                Zone((zone[0], zone[1]), (zone[2], zone[3]), kind, name.replace("_", " "))
                for kind, (name, zone) in enumerate(zip(task.kinds, task.zones.tolist(), strict=True))
            )
        self.painter = SurfacePainter(
            surface.rows,
            surface.columns,
            surface.element_size,
            [np.array(part.outline) for part in env.parts],
            kinds=task.kind.tolist(),
            walls=env.walls,
        )
        self.window = Window(self.painter, 1.0 / env.step_time, title)
        self.trails: list[list[np.ndarray]] = [[] for _ in range(worlds)]  # (parts, 2) at each step

    def begin(self, world: int) -> None:
        """Forget the trails of a world whose episode starts."""
        self.trails[world] = [self._pose(world)[:, :2]]

    def follow(self, world: int) -> None:
        """Extend the trails by the present positions."""
        trail = self.trails[world]
        trail.append(self._pose(world)[:, :2])
        del trail[:-TRAIL_STEPS]

    def frame(self, world: int) -> np.ndarray:
        """uint8 (height, width, 3) picture of a world."""
        core, task = self.env.core, self.env.task
        trails = np.array(self.trails[world]).reshape(-1, len(core.parts), 2)
        goal = tolerance = None
        if task.has_goal:
            goal = core.episode.goal[world, 0, : 3 if task.has_heading else 2].copy()
            tolerance = task.position_tolerance
        view = View(
            pose=self._pose(world),
            phasors=core.phasors(world),
            goal_pose=goal,
            goal_tolerance=tolerance,
            trail=trails[:, 0] if goal is not None else np.zeros((0, 2)),
            caption=self.env.caption(world),
            zones=self.zones,
            trails=() if goal is not None else list(np.moveaxis(trails, 1, 0)),
        )
        return self.painter.paint(view)

    def show(self, world: int) -> None:
        """Show a world in the window."""
        self.window.show(self.frame(world))

    def close(self) -> None:
        """Close the window, if one is open."""
        self.window.close()

    def _pose(self, world: int) -> np.ndarray:
        """(parts, 3) a copy; not a number where a part is absent, which is then not drawn."""
        core = self.env.core
        pose = core.simulator.state.pose[world].copy()
        pose[~core.episode.present[world]] = np.nan
        return pose
