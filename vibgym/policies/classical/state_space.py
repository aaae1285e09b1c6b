"""The thesis's state space controller of the reduced plant: a gain R on what the observer says (section 5.3, fig. 5.23)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.policies.classical.design import DOUBLE_INTEGRATOR, ackermann, riccati
from vibgym.policies.classical.law import Law
from vibgym.policies.classical.measured import Measured, wrap
from vibgym.policies.classical.observer import Estimate, Observer
from vibgym.policies.task_info import TaskInfo

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


class StateSpaceMemory(NamedTuple):
    """What the law remembers of an episode."""

    estimate: Estimate  # (batch, parts, 3) each: x, y, heading (not wrapped)
    known: np.ndarray  # (batch, parts) bool, whether there has been a measurement


class StateSpaceLaw(Law):
    """State feedback for x, y and heading of every part, by measured positions only, through an observer of its own.

    Args:
        info: task, scene and step time.
        poles, state_weights, control_weight: of :class:`StateFeedback`.
        observer_gains, observer_poles: of :class:`vibgym.policies.classical.observer.Observer`.

    Raises:
        ValueError: a bad argument.
    """

    def __init__(
        self,
        info: TaskInfo,
        *,
        poles: Any = None,
        state_weights: Any = None,
        control_weight: float = 1.0,
        observer_gains: Any = None,
        observer_poles: Any = None,
    ) -> None:
        self.feedback = StateFeedback(poles=poles, state_weights=state_weights, control_weight=control_weight)
        self.observer = Observer(info.step_time, gains=observer_gains, poles=observer_poles)
        self.lead = float(self.feedback.gains[1] / self.feedback.gains[0])
        self.symmetry = np.array([part.symmetry for part in info.parts])

    def initial(self, batch: int) -> StateSpaceMemory:
        """Before the first measurement."""
        shape = (batch, len(self.symmetry))
        return StateSpaceMemory(Estimate(*np.zeros((2, *shape, 3))), np.zeros(shape, dtype=bool))

    def wanted(
        self, measured: Measured, way: np.ndarray, turn: np.ndarray, memory: StateSpaceMemory
    ) -> tuple[np.ndarray, StateSpaceMemory]:
        """See :meth:`vibgym.policies.classical.law.Law.wanted`."""
        position = self._position(measured, memory)
        known = memory.known[..., None]
        estimate = Estimate(
            np.where(known, memory.estimate.position, position), np.where(known, memory.estimate.velocity, 0.0)
        )
        target = position + np.concatenate([way, turn[..., None]], axis=-1)
        return self.feedback.output(target, estimate), StateSpaceMemory(estimate, np.ones_like(memory.known))

    def applied(self, measured: Measured, acceleration: np.ndarray, memory: StateSpaceMemory) -> StateSpaceMemory:
        """See :meth:`vibgym.policies.classical.law.Law.applied`."""
        position = self._position(measured, memory)
        return memory._replace(estimate=self.observer.update(memory.estimate, position, acceleration))

    def _position(self, measured: Measured, memory: StateSpaceMemory) -> np.ndarray:
        """What is measured, (batch, parts, 3), headings in the turn that is nearest to the estimate."""
        guess = np.where(memory.known, memory.estimate.position[..., 2], measured.heading)
        heading = guess + wrap(measured.heading - guess, self.symmetry)
        return np.concatenate([measured.centre, heading[..., None]], axis=-1)
