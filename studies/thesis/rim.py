"""A cylinder on its rim on a moving table, rolling without slip or sliding (eqs. 3.43 to 3.92), integrated by RK4.

The frame is that of the table, which does not rotate: its acceleration counts as gravity. Forces and velocities have components
along three unit vectors that lean with the cylinder but do not spin with it:

- ``k``, the axis, upwards; with the vertical it makes the tilt ``nu``, and it leans towards the azimuth ``alpha``,
- ``u``, across the axis, from it to the lowest point P of the rim (eq. 3.47), so that ``r_P = -h k + r u``,
- ``w = k x u``, horizontal: direction in which P moves along the rim.

With spins ``(n, a, b)`` about them, ``nu' = b`` and ``alpha' = -a / sin(nu)``; the vectors rotate with
``W = (-a cot(nu), a, b)``. Per unit of mass, with the force ``F`` of the table at P and ``L = (j3 n, j1 a, j1 b)``:

    L' = r_P x F - W x L,        v' = F + g_eff

Only ``F`` depends on the mode. Without slip (3.70), ``v = -omega x r_P`` is differentiated and solved for ``F``. When sliding,
``F = N (z - mu s/|s|)`` with the slip ``s`` of P, and N keeps P on the table: ``z_C = h cos(nu) + r sin(nu)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vibgym import checks
from vibgym.kernels.jit import jit

TILT, AZIMUTH, SPIN, LEANING, NODDING, V_X, V_Y, X, Y, WORK = range(10)
"""State: nu, alpha, n, a, b, velocity and position of the centre of mass, work of all but gravity (per unit mass)."""

STATES = 10

SLOWEST = 1e-300
"""m/s, divisor for a rim at rest, where friction has no direction."""


class Rim(NamedTuple):
    """Cylinder on its rim, per unit of mass, and the table under it, SI units."""

    radius: float
    height: float  # of the centre of mass above the bottom
    across: float  # moment of inertia j1, m^2
    along: float  # j3, m^2
    friction: float  # infinite: no slip
    gravity: float
    table_radius: float  # a_h; the table moves by a_h (cos wt, sin wt)
    rate: float  # w


@jit
def pull(rim: Rim, time: float, azimuth: float) -> tuple[float, float, float]:
    """Return gravity minus the table's acceleration: towards the lean, across it, upwards; m/s^2."""
    angle = rim.rate * time
    out = rim.table_radius * rim.rate**2
    return out * math.cos(angle - azimuth), out * math.sin(angle - azimuth), -rim.gravity


@jit
def slip(rim: Rim, state: np.ndarray) -> tuple[float, float]:
    """Return the slip velocity of P on the table: towards the lean and across it, m/s."""
    sine, cosine = math.sin(state[TILT]), math.cos(state[TILT])
    over, across = math.cos(state[AZIMUTH]), math.sin(state[AZIMUTH])
    v_f, v_w = state[V_X] * over + state[V_Y] * across, state[V_Y] * over - state[V_X] * across
    return (
        v_f - state[NODDING] * (rim.radius * sine + rim.height * cosine),
        v_w + state[SPIN] * rim.radius + state[LEANING] * rim.height,
    )


@jit
def gyroscopic(rim: Rim, state: np.ndarray) -> tuple[float, float]:
    """Return ``W x L`` along u and w; it is zero along k."""
    spin, leaning = rim.along * state[SPIN], rim.across * state[LEANING] / math.tan(state[TILT])
    return state[NODDING] * (spin + leaning), -state[LEANING] * (spin + leaning)


@jit
def holding_force(rim: Rim, time: float, state: np.ndarray) -> tuple[float, float, float]:
    """Return the table's force without slip, per unit of mass: towards the lean, across it, upwards."""
    r, h, n, a, b = rim.radius, rim.height, state[SPIN], state[LEANING], state[NODDING]
    sine, cosine = math.sin(state[TILT]), math.cos(state[TILT])
    turn = -a * cosine / sine  # W_k
    v_k, v_u, v_w = b * r, b * h, -(n * r + a * h)
    g_f, g_w, g_z = pull(rim, time, state[AZIMUTH])
    # W x v - g_eff: the force for constant spins
    f_k = a * v_w - b * v_u - (g_f * sine + g_z * cosine)
    f_u = b * v_k - turn * v_w - (g_f * cosine - g_z * sine)
    f_w = turn * v_u - a * v_k - g_w
    l_u, l_w = gyroscopic(rim, state)
    f_w = (f_w + h * l_u / rim.across) / (1.0 + r * r / rim.along + h * h / rim.across)
    nodding = -(l_w + h * f_u + r * f_k) / (rim.across + r * r + h * h)  # b'
    f_k, f_u = f_k + r * nodding, f_u + h * nodding
    return f_k * sine + f_u * cosine, f_w, f_k * cosine - f_u * sine


@jit
def sliding_force(rim: Rim, time: float, state: np.ndarray) -> tuple[float, float, float]:
    """Return the same for a sliding rim."""
    r, h, b = rim.radius, rim.height, state[NODDING]
    sine, cosine = math.sin(state[TILT]), math.cos(state[TILT])
    s_f, s_w = slip(rim, state)
    speed = max(math.hypot(s_f, s_w), SLOWEST)
    d_f, d_w = -rim.friction * s_f / speed, -rim.friction * s_w / speed
    lever = r * cosine - h * sine  # of N about the axis w; z_C' = b times this
    torque = -lever - d_f * (r * sine + h * cosine)  # about w, by N = 1
    below = -pull(rim, time, state[AZIMUTH])[2] - b * b * (r * sine + h * cosine)
    normal = (below - lever * gyroscopic(rim, state)[1] / rim.across) / (1.0 - lever * torque / rim.across)
    return normal * d_f, normal * d_w, normal


@jit
def table_force(rim: Rim, time: float, state: np.ndarray) -> tuple[float, float, float]:
    """Return the same for the mode given by the friction."""
    if math.isinf(rim.friction):
        return holding_force(rim, time, state)
    return sliding_force(rim, time, state)


@jit
def rates(rim: Rim, time: float, state: np.ndarray, out: np.ndarray) -> None:
    """Compute the time derivative of the state into ``out``."""
    sine, cosine = math.sin(state[TILT]), math.cos(state[TILT])
    over, across = math.cos(state[AZIMUTH]), math.sin(state[AZIMUTH])
    f_f, f_w, f_z = table_force(rim, time, state)
    g_f, g_w, _ = pull(rim, time, state[AZIMUTH])
    s_f, s_w = slip(rim, state)
    l_u, l_w = gyroscopic(rim, state)
    f_k, f_u = f_f * sine + f_z * cosine, f_f * cosine - f_z * sine
    a_f, a_w = f_f + g_f, f_w + g_w
    v_f, v_w = state[V_X] * over + state[V_Y] * across, state[V_Y] * over - state[V_X] * across
    out[TILT] = state[NODDING]
    out[AZIMUTH] = -state[LEANING] / sine
    out[SPIN] = rim.radius * f_w / rim.along
    out[LEANING] = (rim.height * f_w - l_u) / rim.across
    out[NODDING] = -(rim.height * f_u + rim.radius * f_k + l_w) / rim.across
    out[V_X], out[V_Y] = a_f * over - a_w * across, a_f * across + a_w * over
    out[X], out[Y] = state[V_X], state[V_Y]
    out[WORK] = g_f * v_f + g_w * v_w + f_f * s_f + f_w * s_w


@jit(allocates=True)
def march(rim: Rim, times: np.ndarray, step: float, arc: float, states: np.ndarray, forces: np.ndarray) -> int:
    """Integrate from the first of ``states`` (t, 10) through ``times`` (t,) s by RK4.

    Returns the number of times reached: integration ends when the axis is horizontal and the cylinder lies on its side.

    Args:
        step: s, largest step.
        arc: rad, largest motion of P along the rim in a step.
        states, forces: results; forces (t, 3) as in :func:`table_force`.
    """
    state, tried = states[0].copy(), np.empty(STATES)
    slopes = np.empty((4, STATES))
    for k in range(len(times)):
        time = times[max(k - 1, 0)]
        while time < times[k]:
            h = min(step, times[k] - time)
            runs = abs(state[LEANING] / math.sin(state[TILT]))
            if h * runs > arc:
                h = arc / runs
            last = time + h
            if not last < times[k] or last == time:
                last = times[k]
            rates(rim, time, state, slopes[0])
            for stage in range(1, 4):
                part = h if stage == 3 else 0.5 * h
                for i in range(STATES):
                    tried[i] = state[i] + part * slopes[stage - 1, i]
                rates(rim, time + part, tried, slopes[stage])
            for i in range(STATES):
                state[i] += h / 6.0 * (slopes[0, i] + 2.0 * slopes[1, i] + 2.0 * slopes[2, i] + slopes[3, i])
            time = last
        if state[TILT] > 0.5 * math.pi:
            return k
        states[k] = state
        forces[k] = table_force(rim, time, state)
    return len(times)


STEP, ARC = 2e-5, 0.03
"""s and rad, default limits of a step, see :func:`march`."""


@dataclass(frozen=True)
class Motion:
    """Motion: times (t,) s, states (t, 10) and forces (t, 3) of the table, see :func:`holding_force`, m/s^2."""

    rim: Rim
    times: np.ndarray
    states: np.ndarray
    forces: np.ndarray

    @property
    def tilt(self) -> np.ndarray:
        """Tilt of the axis (t,) rad."""
        return self.states[:, TILT]

    @property
    def normal(self) -> np.ndarray:
        """Normal force (t,) m/s^2; negative where the table would have to pull."""
        return self.forces[:, 2]

    @property
    def needed_friction(self) -> np.ndarray:
        """Ratio |F_R| / |F_N| (t,)."""
        return np.hypot(self.forces[:, 0], self.forces[:, 1]) / np.abs(self.normal)

    @property
    def phi_rate(self) -> np.ndarray:
        """Rate of the thesis's third angle (t,) rad/s."""
        nu, alpha, spin, a, b = self.states[:, [TILT, AZIMUTH, SPIN, LEANING, NODDING]].T
        k = np.array([np.sin(nu) * np.cos(alpha), np.sin(nu) * np.sin(alpha), np.cos(nu)])
        u = np.array([np.cos(nu) * np.cos(alpha), np.cos(nu) * np.sin(alpha), -np.sin(nu)])
        k_rate = b * u - a * np.array([-np.sin(alpha), np.cos(alpha), np.zeros_like(nu)])
        theta_rate = (k_rate[0] * k[2] - k[0] * k_rate[2]) / (k[0] ** 2 + k[2] ** 2)
        return spin - theta_rate * k[1]  # sin(psi) = -k_y

    @property
    def slip(self) -> np.ndarray:
        """Slip speed of the rim (t,) m/s."""
        return np.array([math.hypot(*slip(self.rim, state)) for state in self.states])

    @property
    def tilt_energy(self) -> np.ndarray:
        """Potential energy of the tilt (t,) J/kg."""
        rim, nu = self.rim, self.tilt
        return rim.gravity * (rim.height * (np.cos(nu) - 1.0) + rim.radius * np.sin(nu))

    @property
    def energy(self) -> np.ndarray:
        """Energy (t,) J/kg in the table's frame, zero upright at rest, minus the work of friction and the table."""
        rim, nu, b = self.rim, self.tilt, self.states[:, NODDING]
        v_z = b * (rim.radius * np.cos(nu) - rim.height * np.sin(nu))
        turning = rim.along * self.states[:, SPIN] ** 2 + rim.across * (self.states[:, LEANING] ** 2 + b**2)
        moving = self.states[:, V_X] ** 2 + self.states[:, V_Y] ** 2 + v_z**2
        return 0.5 * (turning + moving) + self.tilt_energy - self.states[:, WORK]

    @property
    def energy_error(self) -> float:
        """Range of the energy, relative to the initial energy of the tilt."""
        return float(np.ptp(self.energy) / self.tilt_energy[0])

    @property
    def frequency(self) -> float:
        """Frequency of the tilt, Hz, from its first to its last maximum; NaN with fewer than two."""
        b, t = self.states[:, NODDING], self.times
        at = np.nonzero((b[:-1] > 0.0) & (b[1:] <= 0.0))[0]
        tops = t[at] + (t[at + 1] - t[at]) * b[at] / (b[at] - b[at + 1])
        if abs(b[0]) < 1e-9 and b[1] < 0.0:  # released at rest
            tops = np.append(t[:1], tops)
        return (len(tops) - 1) / float(tops[-1] - tops[0]) if len(tops) > 1 else math.nan


def follow(
    rim: Rim, state: np.ndarray, duration: float, *, sampled: float = 1e-4, step: float = STEP, arc: float = ARC
) -> Motion:
    """Integrate from a state (10,) for ``duration`` s, sampled every ``sampled`` s, or until the cylinder lies on its side.

    With finite ``rim.friction`` the rim always slides: sticking at zero slip is not simulated.

    Raises:
        ValueError: a start with finite friction but without slip, where friction has no direction; a motion that reaches an
            upright axis, where the rim has no lowest point.
    """
    if 0.0 < rim.friction < math.inf and math.hypot(*slip(rim, state)) < 1e-9:
        raise checks.refuse("state", state.tolist(), "one in which the rim slides, as friction is finite")
    times = np.linspace(0.0, duration, round(duration / sampled) + 1)
    states, forces = np.empty((len(times), STATES)), np.empty((len(times), 3))
    states[0] = state
    reached = march(rim, times, step, arc, states, forces)
    if not np.isfinite(states[:reached]).all() or states[:reached, TILT].min() <= 0.0:
        raise checks.refuse("state", state.tolist(), "one from which the axis does not come upright")
    return Motion(rim, times[:reached], states[:reached], forces[:reached])
