"""The thesis's state space controller of the reduced plant: a gain R on what the observer says (section 5.3, fig. 5.23)."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym import checks
from vibgym.policies.classical.design import DOUBLE_INTEGRATOR, ackermann, riccati
from vibgym.policies.classical.observer import Estimate

POLES = (-2.0, -2.0)
"""rad/s, the thesis's: R = [4, 4]."""


class StateFeedback:
    """``u = R1 (set position - position) - R2 velocity`` for any number of independent axes.

    Args:
        poles: of the closed loop in continuous time, rad/s, by Ackermann's formula; None: the thesis's.
        state_weights: instead of poles, of position and velocity squared in the cost, Q (Riccati, eqs. 5.86 to 5.88).
        control_weight: of the acceleration squared, S.

    Attributes:
        gains: R, 1/s^2 and 1/s.

    Raises:
        ValueError: poles that are not stable or not conjugate, weights that are not positive, or both given.
    """

    def __init__(self, *, poles: Any = None, state_weights: Any = None, control_weight: float = 1.0) -> None:
        if poles is not None and state_weights is not None:
            raise checks.refuse("poles", poles, "either poles or state_weights")
        if state_weights is None:
            self.gains = ackermann(*DOUBLE_INTEGRATOR, POLES if poles is None else poles)
        else:
            self.gains = riccati(*DOUBLE_INTEGRATOR, state_weights, control_weight)

    def output(self, target: np.ndarray, estimate: Estimate) -> np.ndarray:
        """Wanted accelerations for set positions; set velocities are zero."""
        return self.gains[0] * (target - estimate.position) - self.gains[1] * estimate.velocity
