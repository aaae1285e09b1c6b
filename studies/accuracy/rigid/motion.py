"""Motion of a rigid body on compliant contact points: explicit midpoint steps of a few microseconds.

Every contact point is a unilateral spring and damper with Coulomb friction. Its stiffness is its share of the bottom's, so that
the whole part sags by ``sag`` under its weight. The time constant of damping is the same for all points, such that a single
impact of the outermost one has the restitution ``restitution``; simultaneous impacts of many points are damped more. Friction
is ``mu N`` against slip. Below a slip that vanishes with the step it is viscous, so that points can stick.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from studies.accuracy.rigid.body import Body

compiled = njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp", "nsz"})
"""Decorator of the reference's kernels; fast math except for infinities and NaN."""


class Plates(NamedTuple):
    """Square plates with a common horizontal circular motion and separate vertical motions.

    Plate (i, j) covers ``[j L, (j+1) L] x [i L, (i+1) L]``, has the height ``(C cos wt - S sin wt)/w^2``, and moves
    horizontally at ``a_h w (-sin wt, cos wt)``. Borders stay where they are. Within ``ramp`` of one, heights are blended
    (smoothstep), so that a point climbs to the next plate over ``2 ramp``. The contact force stays vertical there.
    """

    c: np.ndarray  # (rows, columns) m/s^2: ``a_v w^2`` times the cosine of the phase
    s: np.ndarray  # times its sine
    size: float = 0.026  # L, m
    amplitude: float = 2.7e-3  # a_h, m
    frequency: float = 2.0 * math.pi * 25.0  # w, rad/s
    gravity: float = 9.81  # m/s^2
    ramp: float = 3e-3  # m, at most L/2; 0 is a step

    @property
    def period(self) -> float:
        """s."""
        return 2.0 * math.pi / self.frequency

    @property
    def highest(self) -> float:
        """Largest height of any plate at any time, m."""
        return float(np.hypot(self.c, self.s).max()) / self.frequency**2


def level(rows: int = 8, columns: int = 32, c: float = 0.0, s: float = 0.0, **properties: float) -> Plates:
    """Return plates with equal motion; see :class:`Plates`."""
    return Plates(np.full((rows, columns), float(c)), np.full((rows, columns), float(s)), **properties)


@compiled
def blend(place, size, ramp, count):
    """Return the plate under a position along one axis, its blended neighbour, and the neighbour's share and slope (1/m)."""
    own = min(max(int(math.floor(place / size)), 0), count - 1)
    within = place - own * size
    if within < ramp and own > 0:
        p = 0.5 - 0.5 * within / ramp
        return own, own - 1, p * p * (3.0 - 2.0 * p), -3.0 * p * (1.0 - p) / ramp
    if size - within < ramp and own < count - 1:
        p = 0.5 - 0.5 * (size - within) / ramp
        return own, own + 1, p * p * (3.0 - 2.0 * p), 3.0 * p * (1.0 - p) / ramp
    return own, own, 0.0, 0.0


@compiled
def under(c, s, size, ramp, cosine, sine, w, x, y):
    """Return height (m) and vertical velocity (m/s) of the plates at a point, and the slope along x and y."""
    i, k, q, dq = blend(y, size, ramp, c.shape[0])
    j, m, p, dp = blend(x, size, ramp, c.shape[1])
    a, b = c[i, j], s[i, j]
    if j == m and i == k:
        return (a * cosine - b * sine) / w**2, (-a * sine - b * cosine) / w, 0.0, 0.0
    ax, bx = c[i, m] - a, s[i, m] - b
    ay, by = c[k, j] - a, s[k, j] - b
    axy, bxy = c[k, m] - a - ax - ay, s[k, m] - b - bx - by
    real, imaginary = a + p * ax + q * ay + p * q * axy, b + p * bx + q * by + p * q * bxy
    height_x = dp * ((ax + q * axy) * cosine - (bx + q * bxy) * sine) / w**2
    height_y = dq * ((ay + p * axy) * cosine - (by + p * bxy) * sine) / w**2
    height = (real * cosine - imaginary * sine) / w**2
    return height, (-real * sine - imaginary * cosine) / w, height_x, height_y


# -- motion ------------------------------------------------------------------------------------------------------------

STEP = 4e-6  # s
SAG = 5e-8  # m
RESTITUTION = 0.2
LANDED_TILT = math.radians(0.05)
TOPPLED_TILT = math.radians(60.0)

STICKING = 0.125
"""Largest impulse of viscous friction in a step, over the impulse that stops the whole mass."""


class Start(NamedTuple):
    """Initial state of a body."""

    position: np.ndarray  # (3,) of the centre of mass, m
    attitude: np.ndarray  # (4,) unit quaternion (w, x, y, z), rotation from the body's axes to the world's
    velocity: np.ndarray  # (3,) m/s
    spin: np.ndarray  # (3,) angular velocity in the world's axes, rad/s


class Track(NamedTuple):
    """Motion of a body, at the start and after every interval."""

    time: np.ndarray  # (n,) s
    position: np.ndarray  # (n, 3) m
    velocity: np.ndarray  # (n, 3) m/s
    attitude: np.ndarray  # (n, 4)
    spin: np.ndarray  # (n, 3) rad/s, in the world's axes
    heading: np.ndarray  # (n,) rad, of the body's x axis, unwrapped
    tilt: np.ndarray  # (n,) rad, between the body's axis and the vertical
    landing: float  # s, start of the first whole period with a tilt below :data:`LANDED_TILT`; infinite if none
    landing_spin: float  # rad/s about the vertical at landing
    toppled: bool  # whether the tilt exceeded :data:`TOPPLED_TILT`; the track is frozen there
    largest_tilt: float  # rad


def attitude_of(heading: float, tilt: float = 0.0, towards: float = 0.0) -> np.ndarray:
    """Return the quaternion of a rotation by ``heading`` about the vertical, then by ``tilt`` ``towards`` a direction (rad)."""
    axis = np.array([-math.sin(towards), math.cos(towards), 0.0])
    a, b = math.cos(tilt / 2), math.sin(tilt / 2) * axis
    c, d = math.cos(heading / 2), math.sin(heading / 2)
    return np.array([a * c, b[0] * c + b[1] * d, b[1] * c - b[0] * d, a * d])


def axes_of(attitude: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a unit quaternion."""
    matrix = np.empty((3, 3))
    _axes(attitude, matrix)
    return matrix


def touching(
    body: Body, plates: Plates, x: float, y: float, heading: float, tilt: float = 0.0, towards: float = 0.0,
    velocity: tuple[float, float] = (0.0, 0.0), sag: float = SAG,
) -> Start:  # fmt: skip
    """Return a start at time 0 with the lowest contact point on its plate, moving with it vertically.

    A flat part (tilt 0) starts in its static sag.
    """
    attitude = attitude_of(heading, tilt, towards)
    places = body.points @ axes_of(attitude).T + [x, y, 0.0]
    w = plates.frequency
    below = [
        under(plates.c, plates.s, plates.size, plates.ramp, 1.0, 0.0, w, float(px), float(py)) for px, py, _ in places
    ]
    gaps = places[:, 2] - [plate[0] for plate in below]
    first = int(np.argmin(gaps))
    z = -float(gaps[first]) - (sag if tilt == 0.0 else 0.0)
    return Start(np.array([x, y, z]), attitude, np.array([*velocity, below[first][1]]), np.zeros(3))


def damping_ratio(restitution: float) -> float:
    """Return the damping ratio of a unilateral spring and damper for a restitution.

    Contact ends when the force is zero: ``e = exp(-zeta (pi - psi) / sqrt(1 - zeta^2))``, ``psi = 2 asin(zeta)``.
    """
    low, high = 0.0, 0.999999
    for _ in range(60):
        zeta = 0.5 * (low + high)
        angle = math.pi - 2.0 * math.asin(zeta)
        bounce = math.exp(-zeta * angle / math.sqrt(1.0 - zeta**2))
        low, high = (zeta, high) if bounce > restitution else (low, zeta)
    return 0.5 * (low + high)


def contact(body: Body, gravity: float, sag: float, restitution: float) -> tuple[np.ndarray, float]:
    """Return the stiffness of every contact point, N/m, and the time constant of damping, s."""
    stiffness = body.shares * body.mass * gravity / sag
    outermost = int(np.argmax(np.hypot(body.points[:, 0], body.points[:, 1])))
    frequency = math.sqrt(stiffness[outermost] * body.inverse_mass(outermost))
    return stiffness, 2.0 * damping_ratio(restitution) / frequency


def simulate(
    body: Body, plates: Plates, start: Start, duration: float, *, step: float = STEP, interval: float | None = None,
    sag: float = SAG, restitution: float = RESTITUTION,
) -> Track:  # fmt: skip
    """Simulate a body from time 0.

    Args:
        body: the part.  plates: the table.  start: see :func:`touching`.
        duration: s.
        step: s, shortened so that an interval is a whole number of steps.
        interval: s between samples; None is a period.
        sag: m, static deflection of the contact points under the weight of the part.
        restitution: of a single impact of the outermost contact point.
    """
    interval = plates.period if interval is None else interval
    samples, per = round(duration / interval), math.ceil(interval / step - 1e-9)
    stiffness, damping = contact(body, plates.gravity, sag, restitution)
    state = np.concatenate([start.position, start.attitude, start.velocity, start.spin])
    rows = np.empty((samples + 1, 13))
    quiet = max(1, round(plates.period * per / interval))
    landing, spin, largest, toppled = _simulate(
        body.points, stiffness, body.mass, body.inertia, np.linalg.inv(body.inertia), body.friction, damping, plates.c,
        plates.s, plates.size, plates.ramp, plates.amplitude, plates.frequency, plates.gravity, plates.highest, state, rows,
        per, interval / per, quiet,
    )  # fmt: skip
    axes = np.array([axes_of(row) for row in rows[:, 3:7]])
    heading = np.unwrap(np.arctan2(axes[:, 1, 0], axes[:, 0, 0]))
    tilt = np.arctan2(np.hypot(axes[:, 0, 2], axes[:, 1, 2]), axes[:, 2, 2])
    time = interval * np.arange(samples + 1)
    return Track(
        time,
        rows[:, :3],
        rows[:, 7:10],
        rows[:, 3:7],
        rows[:, 10:],
        heading,
        tilt,
        landing,
        spin,
        bool(toppled),
        largest,
    )


@compiled
def _axes(q, out):
    a, b, c, d = q[0], q[1], q[2], q[3]
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (c * c + d * d), 2 * (b * c - a * d), 2 * (b * d + a * c)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (b * c + a * d), 1 - 2 * (b * b + d * d), 2 * (c * d - a * b)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (b * d - a * c), 2 * (c * d + a * b), 1 - 2 * (b * b + c * c)


@compiled
def _turn(q, turned, wx, wy, wz, h):
    """Rotate an attitude by ``w h`` in the world's axes; second order, for rotations of microradians."""
    a, b, c, d = q[0], q[1], q[2], q[3]
    x, y, z = 0.5 * h * wx, 0.5 * h * wy, 0.5 * h * wz
    a, b, c, d = (
        a - x * b - y * c - z * d,
        b + x * a + y * d - z * c,
        c + y * a + z * b - x * d,
        d + z * a + x * c - y * b,
    )
    length = math.sqrt(a * a + b * b + c * c + d * d)
    turned[0], turned[1], turned[2], turned[3] = a / length, b / length, c / length, d / length


@compiled
def _through(axes, tensor, x, y, z):
    """Apply a tensor in the body's axes to a vector in the world's axes."""
    a = axes[0, 0] * x + axes[1, 0] * y + axes[2, 0] * z
    b = axes[0, 1] * x + axes[1, 1] * y + axes[2, 1] * z
    c = axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z
    p = tensor[0, 0] * a + tensor[0, 1] * b + tensor[0, 2] * c
    q = tensor[1, 0] * a + tensor[1, 1] * b + tensor[1, 2] * c
    r = tensor[2, 0] * a + tensor[2, 1] * b + tensor[2, 2] * c
    return (
        axes[0, 0] * p + axes[0, 1] * q + axes[0, 2] * r,
        axes[1, 0] * p + axes[1, 1] * q + axes[1, 2] * r,
        axes[2, 0] * p + axes[2, 1] * q + axes[2, 2] * r,
    )


@compiled
def _simulate(
    points, stiffness, mass, inertia, inverse, friction, damping, c, s, size, ramp, amplitude, w, gravity, highest, state, rows,
    per, h, quiet,
):  # fmt: skip
    """Fill ``rows`` with states (position, attitude, velocity, spin); return landing, spin then, largest tilt, toppled.

    The angular momentum about the centre of mass is integrated, so that a free body conserves it exactly.
    """
    axes = np.empty((3, 3))
    q, middle = state[3:7].copy(), np.empty(4)
    x, y, z = state[0], state[1], state[2]
    vx, vy, vz = state[7], state[8], state[9]
    wx, wy, wz = state[10], state[11], state[12]
    _axes(q, axes)
    lx, ly, lz = _through(axes, inertia, wx, wy, wz)
    rows[0] = state
    n, touched = len(points), 1
    width, depth = c.shape[1] * size, c.shape[0] * size
    landing, landing_spin, largest = math.inf, 0.0, 1.0
    began, spin_then, calm = 0.0, wz, 0
    flat, fallen = math.cos(LANDED_TILT), math.cos(TOPPLED_TILT)
    toppled = False
    for sample in range(1, len(rows)):
        for k in range(per):
            if toppled:
                break
            t = ((sample - 1) * per + k + 0.5) * h
            x, y, z = x + 0.5 * h * vx, y + 0.5 * h * vy, z + 0.5 * h * vz
            _turn(q, middle, wx, wy, wz, 0.5 * h)
            _axes(middle, axes)
            wx, wy, wz = _through(axes, inverse, lx, ly, lz)
            cosine, sine = math.cos(w * t), math.sin(w * t)
            table_x, table_y = -amplitude * w * sine, amplitude * w * cosine
            most = STICKING * mass / (h * touched)
            fx, fy, fz, tx, ty, tz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            touched = 0
            for i in range(n):
                a, b, d = points[i, 0], points[i, 1], points[i, 2]
                rz = axes[2, 0] * a + axes[2, 1] * b + axes[2, 2] * d
                if z + rz > highest:
                    continue
                rx = axes[0, 0] * a + axes[0, 1] * b + axes[0, 2] * d
                ry = axes[1, 0] * a + axes[1, 1] * b + axes[1, 2] * d
                px, py = x + rx, y + ry
                if px < 0.0 or py < 0.0 or px > width or py > depth:
                    continue
                height, rise, slope_x, slope_y = under(c, s, size, ramp, cosine, sine, w, px, py)
                gap = z + rz - height
                if gap >= 0.0:
                    continue
                ux, uy = vx + wy * rz - wz * ry, vy + wz * rx - wx * rz
                rate = vz + wx * ry - wy * rx - rise - ux * slope_x - uy * slope_y
                push = -stiffness[i] * (gap + damping * rate)
                if push <= 0.0:
                    continue
                touched += 1
                ux, uy = ux - table_x, uy - table_y
                grip = min(most, friction * push / math.sqrt(ux * ux + uy * uy + 1e-30))
                gx, gy = -grip * ux, -grip * uy
                fx, fy, fz = fx + gx, fy + gy, fz + push
                tx, ty, tz = tx + ry * push - rz * gy, ty + rz * gx - rx * push, tz + rx * gy - ry * gx
            touched = max(touched, 1)
            vx, vy, vz = vx + h * fx / mass, vy + h * fy / mass, vz + h * (fz / mass - gravity)
            wx, wy, wz = _through(axes, inverse, lx + 0.5 * h * tx, ly + 0.5 * h * ty, lz + 0.5 * h * tz)
            lx, ly, lz = lx + h * tx, ly + h * ty, lz + h * tz
            _turn(q, q, wx, wy, wz, h)
            _axes(q, axes)
            wx, wy, wz = _through(axes, inverse, lx, ly, lz)
            x, y, z = x + 0.5 * h * vx, y + 0.5 * h * vy, z + 0.5 * h * vz
            upright = axes[2, 2]
            largest = min(largest, upright)
            if upright < flat:
                calm = 0
            else:
                if calm == 0:
                    began, spin_then = t - 0.5 * h, wz
                calm += 1
                if calm == quiet and landing == math.inf:
                    landing, landing_spin = began, spin_then
            toppled = upright < fallen
        row = rows[sample]
        row[0], row[1], row[2] = x, y, z
        row[3], row[4], row[5], row[6] = q[0], q[1], q[2], q[3]
        row[7], row[8], row[9] = vx, vy, vz
        row[10], row[11], row[12] = wx, wy, wz
    return landing, landing_spin, math.acos(min(1.0, largest)), toppled
