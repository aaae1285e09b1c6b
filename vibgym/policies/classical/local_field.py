"""Local fields steered by the measured pose: every part straight to its own target, as if it were alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym import checks
from vibgym.policies.classical.measured import Measured, recall
from vibgym.policies.classical.steering import Steering
from vibgym.policies.task_info import TaskInfo


class LocalFieldPolicy(Steering):
    """Policy that steers every part straight to its target, without regard to obstacles.

    The target is the goal position; or the point of the own zone nearest to the part, a margin inside; or, where parts shall
    only be apart, it lies straight away from the other parts that are too near.

    Args:
        info: task and scene.
        margin: m, how far inside zones and borders targets lie.
        **law: ``law`` and ``action`` of :class:`Steering`, and that law's settings.

    Raises:
        ValueError: a task that asks for no place, or a bad argument.
    """

    def __init__(self, info: TaskInfo, *, margin: float = 0.03, **law: Any) -> None:
        super().__init__(info, **law)
        self.margin = checks.number("margin", margin, least=0.0)
        info.check_places("local_field")

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions from the measured poses and mean velocities; the state is :class:`.steering.Memory`."""
        measured = Measured.of(observation, self.info)
        batch = len(measured.centre)
        memory, _ = recall(state, episode_start, self.begin(1), batch, measured.arrived)
        measured = self.expected(measured, memory)
        return self.steer(measured, self.targets(measured) - measured.centre, memory)

    def targets(self, measured: Measured) -> np.ndarray:
        """Where the parts are heading, (batch, parts, 2) m."""
        info, centre = self.info, measured.centre
        if info.has_goal:
            return centre + measured.way
        if info.zones is not None:
            zone = info.zones[list(info.kind)]
            inset = np.minimum(self.margin, 0.5 * (zone[:, 2:] - zone[:, :2]))
            return np.clip(centre, zone[:, :2] + inset, zone[:, 2:] - inset)
        assert info.apart is not None
        between = centre[:, :, None] - centre[:, None]
        distance = np.sqrt((between**2).sum(axis=-1))
        radius = np.array([part.radius for part in info.parts])
        enough = radius[:, None] + radius + (info.apart + 2.0 * self.slack)
        lack = np.maximum(enough - distance, 0.0) * measured.present[:, None] * ~np.eye(len(radius), dtype=bool)
        away = (lack / np.maximum(distance, 1e-9))[..., None] * between
        size = np.array([info.surface.width, info.surface.depth])
        edge = min(self.margin, 0.5 * size.min())
        return np.clip(centre + away.sum(axis=2), edge, size - edge)
