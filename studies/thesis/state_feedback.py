"""State feedback and observer of the thesis for the reduced plant (sections 5.2.2 and 5.3, fig. 5.23).

    x^' = A x^ + B a + L (y - C x^)        x = [position, velocity],  a: acceleration after saturation

An observer that gets the acceleration before saturation diverges while the elements are at their limit (fig. 5.18).

``vibgym.policies.LAWS.register("state_space", StateSpaceLaw)`` makes it a controller.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.policies.classical.law import Law
from vibgym.policies.classical.lqr import discretize, weights
from vibgym.policies.classical.measured import Measured, wrap
from vibgym.policies.classical.pid import polynomial
from vibgym.policies.task_info import TaskInfo

DOUBLE_INTEGRATOR = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
"""A and B of the thesis's reduced plant, one axis (eqs. 5.52 and 5.53): position and velocity, driven by acceleration."""

POLES = (-2.0, -2.0)
"""rad/s, the thesis's: R = [4, 4]."""

OBSERVER_GAINS = (10.0, 25.0)
"""1/s and 1/s^2, the thesis's: both poles at -5 rad/s."""


def ackermann(a: np.ndarray, b: np.ndarray, poles: Any, name: str = "poles") -> np.ndarray:
    """Gains (n,) of the feedback ``u = -gains x`` that gives ``x' = A x + B u`` these poles (Ackermann's formula).

    Args:
        a, b: (n, n) and (n, 1), controllable.
        poles, name: see :func:`polynomial`.

    Raises:
        ValueError: as there.
    """
    order = len(a)
    wanted = polynomial(name, poles, order)
    reach = np.hstack([np.linalg.matrix_power(a, k) @ b for k in range(order)])
    value = sum(c * np.linalg.matrix_power(a, order - k) for k, c in enumerate(wanted))
    return np.linalg.solve(reach.T, np.eye(order)[-1]) @ value


def riccati(a: np.ndarray, b: np.ndarray, state: Sequence[float], control: float) -> np.ndarray:
    """Gains (n,) of the feedback ``u = -gains x`` that makes the integral of ``x' Q x + S u^2`` least (eqs. 5.86, 5.87).

    Args:
        a, b: (n, n) and (n, 1) of ``x' = A x + B u``.
        state, control: diagonal of Q (n,), and S; all > 0.

    Raises:
        ValueError: weights that are not positive.
    """
    from scipy import linalg  # of the extra "policies"

    q, s = np.diag(weights("state_weights", state, len(a))), checks.number("control_weight", control, above=0.0)
    return (b.T @ linalg.solve_continuous_are(a, b, q, np.array([[s]])) / s)[0]


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
            raise checks.conflict("observer poles and observer gains exclude one another")
        if poles is not None:
            self.gains = polynomial("observer poles", poles, 2)[1:]
        else:
            self.gains = weights(
                "observer gains", OBSERVER_GAINS if gains is None else gains, 2
            )  # as good as stable poles
        a, b = DOUBLE_INTEGRATOR
        self.f, self.g = discretize(a - np.outer(self.gains, [1.0, 0.0]), np.column_stack([b, self.gains]), period)

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
            raise checks.conflict("poles and state_weights exclude one another")
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
        observer_gains, observer_poles: of :class:`Observer`.

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
