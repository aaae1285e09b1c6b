"""Attitudes of a rigid body: swing and twist in the state, quaternion during motion, matrix for points."""

from __future__ import annotations

import math

from vibgym.kernels.jit import jit
from vibgym.plugins.tilting.records import (
    LX,
    LY,
    LZ,
    MXX,
    MXY,
    MXZ,
    MYY,
    MYZ,
    MZZ,
    QW,
    QX,
    QY,
    QZ,
    WX,
    WY,
    WZ,
)


@jit
def enter_attitude(lean_x, lean_y, heading, motion):
    """Write the quaternion of a rotation by the heading followed by the swing ``lean`` (rad)."""
    angle = math.sqrt(lean_x * lean_x + lean_y * lean_y)
    share = 0.5 if angle < 1e-8 else math.sin(0.5 * angle) / angle
    sx, sy, sw = share * lean_x, share * lean_y, math.cos(0.5 * angle)
    cosine, sine = math.cos(0.5 * heading), math.sin(0.5 * heading)
    motion[QW], motion[QX] = sw * cosine, sx * cosine + sy * sine
    motion[QY], motion[QZ] = sy * cosine - sx * sine, sw * sine


@jit
def leave_attitude(motion, heading):
    """Return lean x and y of the quaternion, and its heading nearest to ``heading``."""
    w, x, y, z = motion[QW], motion[QX], motion[QY], motion[QZ]
    half = math.atan2(z, w)
    cosine, sine = math.cos(half), math.sin(half)
    sx, sy, sw = x * cosine - y * sine, x * sine + y * cosine, math.sqrt(w * w + z * z)
    size = math.sqrt(sx * sx + sy * sy)
    share = 2.0 if size < 1e-8 else 2.0 * math.atan2(size, sw) / size
    turns = (heading - 2.0 * half) / (2.0 * math.pi)
    return share * sx, share * sy, 2.0 * half + 2.0 * math.pi * math.floor(turns + 0.5)


@jit
def rotate(motion, span):
    """Rotate by the angular velocity for ``span`` s: Cayley's map, of second order in the step."""
    x, y, z = 0.5 * span * motion[WX], 0.5 * span * motion[WY], 0.5 * span * motion[WZ]
    qw, qx, qy, qz = motion[QW], motion[QX], motion[QY], motion[QZ]
    a = qw - x * qx - y * qy - z * qz
    b = qx + x * qw + y * qz - z * qy
    c = qy + y * qw + z * qx - x * qz
    d = qz + z * qw + x * qy - y * qx
    share = 1.0 / math.sqrt(a * a + b * b + c * c + d * d)
    motion[QW], motion[QX], motion[QY], motion[QZ] = a * share, b * share, c * share, d * share


@jit
def write_frame(motion, frame):
    """Write the attitude as a matrix, whose columns are the part's axes."""
    w, x, y, z = motion[QW], motion[QX], motion[QY], motion[QZ]
    frame[0], frame[1], frame[2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    frame[3], frame[4], frame[5] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    frame[6], frame[7], frame[8] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


@jit
def conjugated(frame, xx, yy, xy, zz, i, j):
    """Return entry (i, j) of ``R M R^T`` for a matrix ``M`` with principal axis z."""
    a, b, c = frame[3 * i], frame[3 * i + 1], frame[3 * i + 2]
    d, e, f = frame[3 * j], frame[3 * j + 1], frame[3 * j + 2]
    return a * (xx * d + xy * e) + b * (xy * d + yy * e) + c * zz * f


@jit
def write_inverse_inertia(motion, frame, xx, yy, xy, zz):
    """Write the inverse of the inertia in the world's axes, and the angular velocity.

    Args:
        xx, yy, xy, zz: the inertia over mass in the part's axes, m^2.
    """
    determinant = xx * yy - xy * xy
    ixx, iyy, ixy, izz = yy / determinant, xx / determinant, -xy / determinant, 1.0 / zz
    motion[MXX] = conjugated(frame, ixx, iyy, ixy, izz, 0, 0)
    motion[MYY] = conjugated(frame, ixx, iyy, ixy, izz, 1, 1)
    motion[MZZ] = conjugated(frame, ixx, iyy, ixy, izz, 2, 2)
    motion[MXY] = conjugated(frame, ixx, iyy, ixy, izz, 0, 1)
    motion[MXZ] = conjugated(frame, ixx, iyy, ixy, izz, 0, 2)
    motion[MYZ] = conjugated(frame, ixx, iyy, ixy, izz, 1, 2)
    spin_up(motion)


@jit
def spin_up(motion):
    """Compute the angular velocity from the angular momentum."""
    x, y, z = motion[LX], motion[LY], motion[LZ]
    motion[WX] = motion[MXX] * x + motion[MXY] * y + motion[MXZ] * z
    motion[WY] = motion[MXY] * x + motion[MYY] * y + motion[MYZ] * z
    motion[WZ] = motion[MXZ] * x + motion[MYZ] * y + motion[MZZ] * z


@jit
def enter_spin(motion, frame, xx, yy, xy, zz, spin_x, spin_y, spin_z):
    """Compute the angular momentum from an angular velocity (rad/s)."""
    for i in range(3):
        motion[LX + i] = (
            conjugated(frame, xx, yy, xy, zz, i, 0) * spin_x
            + conjugated(frame, xx, yy, xy, zz, i, 1) * spin_y
            + conjugated(frame, xx, yy, xy, zz, i, 2) * spin_z
        )
