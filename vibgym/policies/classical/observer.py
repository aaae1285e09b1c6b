"""Velocities of parts whose positions alone are measured: Luenberger's observer of the reduced plant (thesis 5.2.2).

    x^' = A x^ + B a + L (y - C x^)        x = [position, velocity],  a: acceleration after saturation

Fed with what was asked for instead, the estimate would run away while the elements are at their limit (fig. 5.18).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.policies.classical.design import DOUBLE_INTEGRATOR, polynomial, sampled, weights

GAINS = (10.0, 25.0)
"""1/s and 1/s^2, the thesis's: both poles at -5 rad/s."""


class Estimate(NamedTuple):
    """State of the reduced plant, arrays of any one shape, an axis each."""

    position: np.ndarray  # m or rad
    velocity: np.ndarray  # m/s or rad/s


class Observer:
    """Observer of any number of independent axes, stepped once a period, its inputs held in between (eqs. 5.69 to 5.72).

    Args:
        period: s, from step to step.
        gains: L, 1/s and 1/s^2.
        poles: of the estimate's error, rad/s, instead of gains.

    Raises:
        ValueError: gains that are not positive, poles that are not stable or not conjugate, or both given.
    """

    def __init__(self, period: float, *, gains: Any = None, poles: Any = None) -> None:
        period = checks.number("period", period, above=0.0)
        if gains is not None and poles is not None:
            raise checks.refuse("observer poles", poles, "either gains or poles")
        if poles is not None:
            self.gains = polynomial("observer poles", poles, 2)[1:]
        else:
            self.gains = weights("observer gains", GAINS if gains is None else gains, 2)  # as good as stable poles
        a, b = DOUBLE_INTEGRATOR
        self.f, self.g = sampled(a - np.outer(self.gains, [1.0, 0.0]), np.column_stack([b, self.gains]), period)

    def update(self, estimate: Estimate, position: np.ndarray, acceleration: np.ndarray) -> Estimate:
        """The estimate for the next instant, from what was measured at this one and what acts from it on.

        Args:
            estimate: for this instant.
            position: measured at this instant.
            acceleration: after saturation, held until the next instant.
        """
        # From the estimated place: an angle's difference then counts, whichever of its turns it is measured in.
        off = position - estimate.position
        f, g = self.f, self.g
        return Estimate(
            estimate.position + f[0, 1] * estimate.velocity + g[0, 0] * acceleration + g[0, 1] * off,
            f[1, 1] * estimate.velocity + g[1, 0] * acceleration + g[1, 1] * off,
        )
