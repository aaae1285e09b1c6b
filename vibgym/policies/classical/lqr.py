"""Linear-quadratic regulator on the parts' local model.

Near rest friction brakes a part at the rate ``c = mu g / (2 a_h w)``, positions and headings alike (first-order averages,
thesis eqs. 5.60 and 5.61). With a push that alone would accelerate it by ``u``

    p' = v        v' = -c v + u

The gains on [p, v] minimise the sum over steps of ``q_p p^2 + q_v v^2 + s u^2``, u held for a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt
from pydantic import Field

from vibgym.policies.classical.law import Law
from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo

Weight = Annotated[float, Gt(0.0)]


def discretize(a: np.ndarray, b: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Return F and G of ``x_k+1 = F x_k + G u_k`` for ``x' = A x + B u`` with u held for ``period`` s (eqs. 5.69 to 5.72).

    Eq. 5.72 needs the inverse of A, which an integrator does not have; the exponential of the joint matrix does not.
    """
    from scipy import linalg  # of the extra "policies"

    order, inputs = b.shape
    both = np.zeros((order + inputs, order + inputs))
    both[:order, :order], both[:order, order:] = a, b
    result = linalg.expm(period * both)
    return result[:order, :order], result[:order, order:]


def discrete_lqr(f: np.ndarray, g: np.ndarray, state: Sequence[float], control: float) -> np.ndarray:
    """Return the gains (n,) of the feedback ``u_k = -gains x_k`` that minimises the sum of ``x' Q x + S u^2``.

    Args:
        f, g: (n, n) and (n, 1) of ``x_k+1 = F x_k + G u_k``, see :func:`discretize`.
        state: (n,) diagonal of Q.
        control: S.
    """
    from scipy import linalg  # of the extra "policies"

    p = linalg.solve_discrete_are(f, g, np.diag(state), np.array([[control]]))
    return np.linalg.solve(control + g.T @ p @ g, g.T @ p @ f)[0]


class LqrLaw(Law):
    """Linear-quadratic regulator of positions and headings; see the module.

    Attributes:
        gains: (parts, 2, 2) of positions and of headings: 1/s^2 and 1/s.
    """

    class Settings(Law.Settings):
        """Settings of the regulator."""

        state_weights: tuple[Weight, Weight] = (30000.0, 1.0)
        """Of squared position (m) and velocity (m/s), 1/s^4 and 1/s^2."""

        heading_weights: tuple[Weight, Weight] = (30000.0, 1.0)
        """Of squared heading (rad) and spin (rad/s)."""

        control_weight: float = Field(default=1.0, gt=0.0)
        """Of squared accelerations by pushes (m/s^2 and rad/s^2)."""

    settings: Settings

    def __init__(self, info: TaskInfo, settings: Settings | None = None) -> None:
        super().__init__(info, settings)
        own = self.settings
        self.drag = info.plant.drag
        gains = {}
        for drag in set(self.drag.tolist()):
            plant = discretize(np.array([[0.0, 1.0], [0.0, -drag]]), np.array([[0.0], [1.0]]), info.step_time)
            gains[drag] = [
                discrete_lqr(*plant, own.state_weights, own.control_weight),
                discrete_lqr(*plant, own.heading_weights, own.control_weight),
            ]
        self.gains = np.array([gains[drag] for drag in self.drag.tolist()])
        # Laws request accelerations net of friction.
        self._rate = self.gains[:, :, 1] + self.drag[:, None]
        self.lead = float((self._rate[:, 0] / self.gains[:, 0, 0]).max())

    def wanted(self, measured: Measured, way: np.ndarray, turn: np.ndarray, memory: Any) -> tuple[np.ndarray, Any]:
        """See :meth:`vibgym.policies.classical.law.Law.wanted`."""
        push = self.gains[:, 0, :1] * way - self._rate[:, :1] * measured.velocity
        torque = self.gains[:, 1, 0] * turn - self._rate[:, 1] * measured.spin
        return np.concatenate([push, torque[..., None]], axis=-1), memory
