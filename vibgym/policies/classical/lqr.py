"""State feedback on the parts' local model: what friction brakes by itself need not be braked by the elements.

Near rest friction brakes a part at the rate ``c = mu g / (2 a_h w)``, positions and headings alike (first-order averages,
thesis eqs. 5.60 and 5.61), so that with a push that would accelerate it by ``u``

    p' = v        v' = -c v + u

The gains on [p, v] make the sum over periods of ``q_p p^2 + q_v v^2 + s u^2`` least, u held for a step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym.policies.classical.design import sampled, sampled_riccati
from vibgym.policies.classical.law import Law
from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo

WEIGHTS = (30000.0, 1.0)
"""1/s^4 and 1/s^2, of position and velocity squared beside accelerations squared."""


class LqrLaw(Law):
    """Linear-quadratic regulator of positions and headings by measured positions and velocities; it has no memory.

    Args:
        info: task, scene and step time.
        state_weights: of position and velocity squared, (m, m/s).
        heading_weights: of heading and spin squared, (rad, rad/s).
        control_weight: of what pushes would give squared, (m/s^2) and (rad/s^2).

    Attributes:
        gains: (parts, 2, 2) of positions and of headings: 1/s^2 and 1/s.

    Raises:
        ValueError: weights that are not positive.
    """

    def __init__(
        self,
        info: TaskInfo,
        *,
        state_weights: Any = WEIGHTS,
        heading_weights: Any = WEIGHTS,
        control_weight: float = 1.0,
    ) -> None:
        self.drag = info.plant.drag
        self.gains = np.empty((len(info.parts), 2, 2))
        for part, drag in enumerate(self.drag):
            same = int(np.flatnonzero(self.drag == drag)[0])
            if same < part:
                self.gains[part] = self.gains[same]
                continue
            plant = sampled(np.array([[0.0, 1.0], [0.0, -drag]]), np.array([[0.0], [1.0]]), info.step_time)
            self.gains[part, 0] = sampled_riccati(*plant, state_weights, control_weight, "state_weights")
            self.gains[part, 1] = sampled_riccati(*plant, heading_weights, control_weight, "heading_weights")
        # Net of friction, as laws count: what brakes by itself is not to be made up for.
        self._rate = self.gains[:, :, 1] + self.drag[:, None]
        self.lead = float((self._rate[:, 0] / self.gains[:, 0, 0]).max())

    def wanted(self, measured: Measured, way: np.ndarray, turn: np.ndarray, memory: Any) -> tuple[np.ndarray, Any]:
        """See :meth:`vibgym.policies.classical.law.Law.wanted`."""
        push = self.gains[:, 0, :1] * way - self._rate[:, :1] * measured.velocity
        torque = self.gains[:, 1, 0] * turn - self._rate[:, 1] * measured.spin
        return np.concatenate([push, torque[..., None]], axis=-1), memory
