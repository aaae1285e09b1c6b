"""From the core's state to a picture: the only place where environments meet rendering."""

from __future__ import annotations

import numpy as np

from vibgym.envs.core import Core
from vibgym.rendering import SurfacePainter, View, Window

TRAIL_STEPS = 250


class Viewer:
    """Draws worlds of a core and keeps their trails."""

    def __init__(self, core: Core, title: str, worlds: int = 1) -> None:
        surface = core.surface
        self.core = core
        self.painter = SurfacePainter(
            surface.rows, surface.columns, surface.element_size, [np.array(core.part.outline)]
        )
        self.window = Window(self.painter, 1.0 / (surface.period * core.periods), title)
        self.trails: list[list[np.ndarray]] = [[] for _ in range(worlds)]

    def begin(self, world: int) -> None:
        """Forget the trail of a world whose episode starts."""
        self.trails[world] = [self.core.simulator.state.pose[world, 0, :2].copy()]

    def follow(self, world: int) -> None:
        """Extend the trail by the present position."""
        trail = self.trails[world]
        trail.append(self.core.simulator.state.pose[world, 0, :2].copy())
        del trail[:-TRAIL_STEPS]

    def frame(self, world: int) -> np.ndarray:
        """uint8 (height, width, 3) picture of a world."""
        core, task = self.core, self.core.task
        goal = core.goal[world] if task.has_heading else core.goal[world, :2]
        caption = f"{type(task).__name__}   distance {1e3 * core.score.distance[world]:.1f} mm"
        if task.has_heading:
            caption += f"   heading {np.degrees(core.score.error[world, 2]):+.1f} deg to go"
        view = View(
            pose=core.simulator.state.pose[world].copy(),
            phasors=core.phasors(world),
            goal_pose=goal.copy(),
            goal_tolerance=task.position_tolerance,
            trail=np.array(self.trails[world]).reshape(-1, 2),
            caption=caption,
        )
        return self.painter.paint(view)

    def show(self, world: int) -> None:
        """Show a world in the window."""
        self.window.show(self.frame(world))

    def close(self) -> None:
        """Close the window, if one is open."""
        self.window.close()
