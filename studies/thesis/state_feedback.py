"""State feedback and observer of the thesis for the reduced plant (sections 5.2.2 and 5.3, fig. 5.23).

    u = R1 (set position - position) - R2 velocity
    x^' = A x^ + B a + L (y - C x^)        x = [position, velocity],  a: acceleration after saturation

With the acceleration before saturation as its input the observer diverges while the elements are at their limit (fig. 5.18).

``vibgym.policies.POLICIES.register("state_space", StateSpaceLaw)`` makes it a controller.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym.policies.classical.law import Law
from vibgym.policies.classical.linear_laws import discretize
from vibgym.policies.classical.measured import Measured, wrap
from vibgym.policies.task_info import TaskInfo

DOUBLE_INTEGRATOR = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
"""A and B of the thesis's reduced plant, one axis (eqs. 5.52 and 5.53): position and velocity, driven by acceleration."""

FEEDBACK_GAINS = (4.0, 4.0)
"""R, 1/s^2 and 1/s: both poles at -2 rad/s."""

OBSERVER_GAINS = (10.0, 25.0)
"""L, 1/s and 1/s^2: both poles at -5 rad/s."""


class Estimate(NamedTuple):
    """State of the reduced plant: arrays of equal shape, one element per axis."""

    position: np.ndarray  # m or rad
    velocity: np.ndarray  # m/s or rad/s


class Observer:
    """Observer of independent axes with one update per period and inputs held in between (eqs. 5.69 to 5.72).

    Args:
        period: s, between updates.
        gains: L, 1/s and 1/s^2, positive.
    """

    def __init__(self, period: float, gains: Sequence[float] = OBSERVER_GAINS) -> None:
        a, b = DOUBLE_INTEGRATOR
        self.f, self.g = discretize(a - np.outer(gains, [1.0, 0.0]), np.column_stack([b, gains]), period)

    def update(self, estimate: Estimate, position: np.ndarray, acceleration: np.ndarray) -> Estimate:
        """Return the estimate for the next instant.

        Args:
            estimate: for this instant.
            position: measured at this instant.
            acceleration: after saturation, held until the next instant.
        """
        # Relative to the estimated position, so that angles need not be in a fixed range.
        off = position - estimate.position
        f, g = self.f, self.g
        return Estimate(
            estimate.position + f[0, 1] * estimate.velocity + g[0, 0] * acceleration + g[0, 1] * off,
            f[1, 1] * estimate.velocity + g[1, 0] * acceleration + g[1, 1] * off,
        )


def feedback(target: np.ndarray, estimate: Estimate) -> np.ndarray:
    """Return the wanted accelerations for set positions ``target``; set velocities are zero."""
    return FEEDBACK_GAINS[0] * (target - estimate.position) - FEEDBACK_GAINS[1] * estimate.velocity


class StateSpaceMemory(NamedTuple):
    """Memory of the law in an episode."""

    estimate: Estimate  # (batch, parts, 3) each: x, y, heading (not wrapped)
    known: np.ndarray  # (batch, parts) bool, whether there has been a measurement


class StateSpaceLaw(Law):
    """State feedback for x, y and heading of every part, from measured positions alone, with an observer."""

    lead = FEEDBACK_GAINS[1] / FEEDBACK_GAINS[0]

    def __init__(self, info: TaskInfo, settings: Law.Settings | None = None) -> None:
        super().__init__(info, settings)
        self.observer = Observer(info.step_time)
        self.symmetry = np.array([part.symmetry for part in info.parts])

    def initial(self, batch: int) -> StateSpaceMemory:
        """Return the memory before the first measurement."""
        shape = (batch, len(self.symmetry))
        return StateSpaceMemory(Estimate(*np.zeros((2, *shape, 3))), np.zeros(shape, dtype=bool))

    def wanted(
        self, measured: Measured, displacement: np.ndarray, heading_error: np.ndarray, memory: StateSpaceMemory
    ) -> tuple[np.ndarray, StateSpaceMemory]:
        """See :meth:`vibgym.policies.classical.law.Law.wanted`."""
        position = self._position(measured, memory)
        known = memory.known[..., None]
        estimate = Estimate(
            np.where(known, memory.estimate.position, position), np.where(known, memory.estimate.velocity, 0.0)
        )
        target = position + np.concatenate([displacement, heading_error[..., None]], axis=-1)
        return feedback(target, estimate), StateSpaceMemory(estimate, np.ones_like(memory.known))

    def applied(self, measured: Measured, acceleration: np.ndarray, memory: StateSpaceMemory) -> StateSpaceMemory:
        """See :meth:`vibgym.policies.classical.law.Law.applied`."""
        position = self._position(measured, memory)
        return memory._replace(estimate=self.observer.update(memory.estimate, position, acceleration))

    def _position(self, measured: Measured, memory: StateSpaceMemory) -> np.ndarray:
        """Return measured poses (batch, parts, 3), with the equivalent heading nearest to the estimate."""
        guess = np.where(memory.known, memory.estimate.position[..., 2], measured.heading)
        heading = guess + wrap(measured.heading - guess, self.symmetry)
        return np.concatenate([measured.centre, heading[..., None]], axis=-1)
