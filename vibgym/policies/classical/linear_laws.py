"""Linear laws: the thesis's PID controller and a linear-quadratic regulator.

PID, pole placement, discrete form and windup (thesis 5.3, 7.3.2):
With the reduced plant 1 / s^2 the closed loop is ``(kI + kP s + kD s^2) / (kI + kP s + kD s^2 + s^3)`` (eq. 5.74), so that
three poles give three gains. In discrete time, with errors of zero before the first one,

    u_k = kP e_k + kI T (e_0 + ... + e_k) + kD (e_k - e_k-1) / T

which is eq. 5.81 with ``z^2 - z`` below; the thesis has ``z^3 - z^2``, one more period of latency.

LQR: near rest friction brakes a part at the rate ``c = mu g / (2 a_h w)``, positions and headings alike (first-order averages,
thesis eqs. 5.60 and 5.61). With a push that alone would accelerate it by ``u``

    p' = v        v' = -c v + u

The gains on [p, v] minimise the sum over steps of ``q_p p^2 + q_v v^2 + s u^2``, u held for a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from annotated_types import Gt
from pydantic import Field, field_validator

from vibgym import checks
from vibgym.policies.classical.law import Law
from vibgym.policies.classical.measured import Measured, wrap
from vibgym.policies.task_info import TaskInfo

# -- PID ---------------------------------------------------------------------------------------------------------------

Pole = float | tuple[float, float] | complex

POLES = (-2.0, -2.0, -2.0)  # rad/s, the thesis's
ROUNDING = 1e-6  # m/s^2 or rad/s^2, error of the inverse of the frictional process without saturation
CONJUGATE = 1e-9  # rounding error of imaginary parts, relative to the largest coefficient


class PidGains(NamedTuple):
    """Gains of a PID controller."""

    proportional: float  # kP, 1/s^2
    integral: float  # kI, 1/s^3
    derivative: float  # kD, 1/s


class PidMemory(NamedTuple):
    """Memory of a PID controller: arrays of one shape, an element per axis."""

    total: np.ndarray  # sum of all errors so far, times the period
    error: np.ndarray  # the last error
    late: np.ndarray  # the output for it, which a late controller returns one period later
    requested: np.ndarray  # the last output returned


def polynomial(name: str, poles: Any, count: int) -> np.ndarray:
    """Return the coefficients (count + 1,) of the monic polynomial with these roots, highest power first.

    Args:
        name: of the argument, for errors.
        poles: ``count`` poles of a continuous system, rad/s: real numbers, complex ones, or pairs [real, imaginary].
        count: number of poles.

    Raises:
        ValueError: another number of poles, a real part that is not negative, or complex poles without their conjugates.
    """
    allowed = f"{count} poles with negative real parts, complex ones in conjugate pairs"
    try:
        values = [complex(*pole) if checks.listed(pole) else complex(pole) for pole in poles]
    except (TypeError, ValueError, OverflowError):
        raise checks.refuse(name, poles, allowed) from None
    roots = np.array(values, dtype=np.complex128)
    if len(roots) != count or not np.isfinite(roots).all() or not (roots.real < 0.0).all():
        raise checks.refuse(name, poles, allowed)
    coefficients = np.atleast_1d(np.poly(roots))
    if np.abs(coefficients.imag).max() > CONJUGATE * np.abs(coefficients).max():
        raise checks.refuse(name, poles, allowed)
    return coefficients.real


def gains_for(poles: Any = POLES) -> PidGains:
    """Return the gains that place the three poles of the closed loop with the reduced plant (eqs. 5.74 to 5.80).

    Raises:
        ValueError: poles that are not stable, or complex ones without their conjugates.
    """
    _, derivative, proportional, integral = polynomial("poles", poles, 3).tolist()
    return PidGains(proportional, integral, derivative)


class Pid:
    """PID controllers of any number of independent axes.

    Args:
        period: s.
        poles: of the closed loop in continuous time, rad/s.
        late: whether outputs are delayed by one period, as in eq. 5.81.
        anti_windup: whether errors are not summed while the output is saturated in their direction.

    Raises:
        ValueError: poles that are not stable, or complex ones without their conjugates.
    """

    def __init__(self, period: float, *, poles: Any = POLES, late: bool = True, anti_windup: bool = False) -> None:
        self.period, self.gains, self.late, self.anti_windup = period, gains_for(poles), late, anti_windup

    def initial(self, shape: tuple[int, ...]) -> PidMemory:
        """Return the memory before the first error. Earlier errors are 0, so a step in the set value has a derivative."""
        return PidMemory(*np.zeros((4, *shape)))

    def output(
        self, error: np.ndarray, memory: PidMemory, change: np.ndarray | None = None
    ) -> tuple[np.ndarray, PidMemory]:
        """Return wanted accelerations and the new memory.

        Args:
            error: set value minus measured value.
            memory: of :meth:`initial`, or what the last call returned.
            change: of the error since the last one; None: the difference of the errors.
        """
        gains, period = self.gains, self.period
        total = memory.total + period * error
        change = error - memory.error if change is None else change
        now = gains.proportional * error + gains.integral * total + gains.derivative / period * change
        output = memory.late if self.late else now
        return output, PidMemory(total, error, now, output)

    def applied(self, acceleration: np.ndarray, memory: PidMemory) -> PidMemory:
        """Return the memory, given the accelerations that the elements can give.

        With anti-windup, an error is subtracted from the sum if the output was saturated in its direction.
        """
        if not self.anti_windup:
            return memory
        short = (memory.requested - acceleration) * np.sign(memory.error) > ROUNDING
        return memory._replace(total=memory.total - np.where(short, self.period * memory.error, 0.0))


class PidLawMemory(NamedTuple):
    """Memory of :class:`PidLaw`."""

    pid: PidMemory  # (batch, parts, 3) each
    heading: np.ndarray  # (batch, parts) rad, the last one
    known: np.ndarray  # (batch, parts) bool, whether there is one


class PidLaw(Law):
    """One PID controller for x, y and heading of every part, from measured positions only.

    The derivative of the heading error is that of the measured heading. The error itself jumps with the part's symmetry, and is
    0 where headings do not count, where spin must be braked too.
    """

    class Settings(Law.Settings):
        """Settings of the PID controllers."""

        poles: tuple[Pole, Pole, Pole] = POLES
        """Of the closed loop in continuous time, rad/s; complex ones are pairs [real, imaginary]."""

        late: bool = True
        """Whether outputs are delayed by one period, as in eq. 5.81."""

        anti_windup: bool = True
        """Whether errors are not summed while the output is saturated in their direction; the thesis has none, and solves Align
        in 72 % of the episodes."""

        @field_validator("poles")
        @classmethod
        def _stable(cls, poles: tuple[Pole, Pole, Pole]) -> tuple[Pole, Pole, Pole]:
            gains_for(poles)
            return poles

    settings: Settings

    def __init__(self, info: TaskInfo, settings: Settings | None = None) -> None:
        super().__init__(info, settings)
        own = self.settings
        self.pid = Pid(info.step_time, poles=own.poles, late=own.late, anti_windup=own.anti_windup)
        self.lead = self.pid.gains.derivative / self.pid.gains.proportional
        self.symmetry = np.array([part.symmetry for part in info.parts])

    def initial(self, batch: int) -> PidLawMemory:
        """Return the memory before the first measurement."""
        shape = (batch, len(self.symmetry))
        return PidLawMemory(self.pid.initial((*shape, 3)), np.zeros(shape), np.zeros(shape, dtype=bool))

    def wanted(
        self, measured: Measured, displacement: np.ndarray, heading_error: np.ndarray, memory: PidLawMemory
    ) -> tuple[np.ndarray, PidLawMemory]:
        """See :meth:`vibgym.policies.classical.law.Law.wanted`."""
        error = np.concatenate([displacement, heading_error[..., None]], axis=-1)
        change = error - memory.pid.error
        turned = wrap(measured.heading - memory.heading, self.symmetry)
        change[..., 2] = np.where(memory.known, -turned, 0.0)
        wanted, pid = self.pid.output(error, memory.pid, change)
        return wanted, PidLawMemory(pid, measured.heading, np.ones_like(memory.known))

    def applied(self, measured: Measured, acceleration: np.ndarray, memory: PidLawMemory) -> PidLawMemory:
        """See :meth:`vibgym.policies.classical.law.Law.applied`."""
        return memory._replace(pid=self.pid.applied(acceleration, memory.pid))


# -- LQR ---------------------------------------------------------------------------------------------------------------

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

    def wanted(
        self, measured: Measured, displacement: np.ndarray, heading_error: np.ndarray, memory: Any
    ) -> tuple[np.ndarray, Any]:
        """See :meth:`vibgym.policies.classical.law.Law.wanted`."""
        push = self.gains[:, 0, :1] * displacement - self._rate[:, :1] * measured.velocity
        torque = self.gains[:, 1, 0] * heading_error - self._rate[:, 1] * measured.spin
        return np.concatenate([push, torque[..., None]], axis=-1), memory
