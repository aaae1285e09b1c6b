"""Routes: paths made of straight lines and arcs, run through with a trapezoidal profile of speed.

A route is an array (rows, 6). Its first row is a header (:data:`HEADER`), the others are its pieces (:data:`PIECE`) in order,
and the last ones are straight pieces of no length at the end, so that routes of all kinds have as many rows. Along the path,
``s`` m from its beginning, the direction phi has slope kappa, the curvature: u m into a piece

    position = (x, y) + u sinc(kappa u / 2) (cos, sin)(phi + kappa u / 2).

The speed grows from rest with the header's acceleration, stays, and falls to rest in the same way at the end. Where a part
shall turn with its path, its heading is the mean direction of the path over a window about its centre, so that heading and
spin are continuous where a line meets an arc:

    heading(s) = (Phi(s + w / 2) - Phi(s - w / 2)) / w,   Phi = integral of phi over s,

which is a difference of two quadratic functions. Beyond its ends the path goes straight on for that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing

HEADER = ("length", "speed", "acceleration", "window", "heading", "along")
"""- length: m, of the whole path; speed: m/s; acceleration: m/s^2; window: m
- heading: rad, of the part, or what is added to the path's; along: 1 where the part turns with the path, else 0
"""
LENGTH, SPEED, ACCELERATION, WINDOW, HEADING, ALONG = range(len(HEADER))

PIECE = ("start", "x", "y", "direction", "curvature", "turned")
"""- start: m, s at its beginning; x, y: m, direction: rad, there; curvature: 1/m, to the left; turned: m rad, Phi there"""
START, X, Y, DIRECTION, CURVATURE, TURNED = range(len(PIECE))

MOTION = ("x", "y", "heading", "vx", "vy", "spin", "along", "across", "turning")
"""Of a route at an instant: m, m, rad; m/s, m/s, rad/s; acceleration along the path and to its left, m/s^2; rad/s^2."""


SMALL = 1e-9
"""m, of a path that stands still."""


class Course(NamedTuple):
    """Where a path begins and the pieces that it is made of."""

    start: Sequence[float]  # x, y (m), direction (rad)
    lengths: Sequence[float]  # m
    curvatures: Sequence[float]  # 1/m


def routes(start: np.ndarray, lengths: np.ndarray, curvatures: np.ndarray, header: np.ndarray) -> np.ndarray:
    """Routes (n, pieces + 2, 6) from their pieces.

    Args:
        start: (n, 3) x, y (m), direction (rad).
        lengths, curvatures: (n, pieces) m, 1/m; pieces of no length count for nothing.
        header: (n, 6) whose lengths are overwritten.
    """
    n, pieces = lengths.shape
    turn = lengths * curvatures
    route = np.zeros((n, pieces + 2, 6))
    begin = np.concatenate([np.zeros((n, 1)), lengths.cumsum(axis=1)], axis=1)
    direction = start[:, 2:] + np.concatenate([np.zeros((n, 1)), turn.cumsum(axis=1)], axis=1)
    chord = lengths * np.sinc(0.5 * turn / np.pi)
    middle = direction[:, :-1] + 0.5 * turn
    step = np.stack([chord * np.cos(middle), chord * np.sin(middle), lengths * middle], axis=2)
    place = np.concatenate([np.zeros((n, 1, 3)), step.cumsum(axis=1)], axis=1)
    route[:, 0] = header
    route[:, 0, LENGTH] = begin[:, -1]
    route[:, 1:, START], route[:, 1:, DIRECTION] = begin, direction
    route[:, 1:, X : Y + 1] = start[:, None, :2] + place[..., :2]
    route[:, 1:-1, CURVATURE] = curvatures
    route[:, 1:, TURNED] = place[..., 2]
    return route


def padded(route: np.ndarray, rows: int) -> np.ndarray:
    """A route (k, 6) with as many as ``rows`` rows."""
    return np.concatenate([route, np.repeat(route[-1:], rows - len(route), axis=0)])


@borrowing
def peak_speed(header):
    """m/s that the route reaches: its speed, unless it is too short for that."""
    return min(header[SPEED], math.sqrt(header[ACCELERATION] * header[LENGTH]))


@borrowing
def duration(header):
    """s from rest at the beginning to rest at the end."""
    speed = peak_speed(header)
    return header[LENGTH] / speed + speed / header[ACCELERATION]


@borrowing
def progress(header, time):
    """Place s (m), speed and acceleration along the path at ``time`` (s); at rest before and after."""
    speed, rate = peak_speed(header), header[ACCELERATION]
    ramp, end = speed / rate, header[LENGTH] / speed + speed / rate
    if time <= 0.0:
        return 0.0, 0.0, 0.0
    if time >= end:
        return header[LENGTH], 0.0, 0.0
    if time < ramp:
        return 0.5 * rate * time * time, rate * time, rate
    left = end - time
    if left < ramp:
        return header[LENGTH] - 0.5 * rate * left * left, rate * left, -rate
    return speed * (time - 0.5 * ramp), speed, 0.0


@borrowing
def piece_at(route, s):
    """Row of the piece in which ``s`` lies, the first or the last one beyond the ends."""
    low, high = 1, route.shape[0] - 1
    while low < high:
        middle = (low + high + 1) // 2
        if route[middle, START] <= s:
            low = middle
        else:
            high = middle - 1
    return low


@borrowing
def directed(route, s):
    """Direction (rad), curvature (1/m) and Phi (m rad) of the path at ``s``; straight on beyond its ends."""
    row = route[piece_at(route, s)]
    u = s - row[START]
    curvature = row[CURVATURE] if u >= 0.0 else 0.0
    return row[DIRECTION] + curvature * u, curvature, row[TURNED] + u * (row[DIRECTION] + 0.5 * curvature * u)


@borrowing
def motion_at(route, time, motion):
    """Write the :data:`MOTION` of a route (rows, 6) at ``time`` (s) into ``motion`` (9,)."""
    header = route[0]
    s, speed, rate = progress(header, time)
    row = route[piece_at(route, s)]
    u = s - row[START]
    half = 0.5 * row[CURVATURE] * u
    chord = u * (math.sin(half) / half) if half != 0.0 else u
    motion[0] = row[X] + chord * math.cos(row[DIRECTION] + half)
    motion[1] = row[Y] + chord * math.sin(row[DIRECTION] + half)
    direction = row[DIRECTION] + row[CURVATURE] * u
    motion[3], motion[4] = speed * math.cos(direction), speed * math.sin(direction)
    motion[6], motion[7] = rate, row[CURVATURE] * speed * speed
    window, along = header[WINDOW], header[ALONG]
    ahead, bend_ahead, turned_ahead = directed(route, s + 0.5 * window)
    behind, bend_behind, turned_behind = directed(route, s - 0.5 * window)
    slope = (ahead - behind) / window
    motion[2] = header[HEADING] + along * ((turned_ahead - turned_behind) / window)
    motion[5] = along * (speed * slope)
    motion[8] = along * (rate * slope + speed * speed * ((bend_ahead - bend_behind) / window))


@borrowing
def first_poses(paths, motion, pose):
    """Where routes (n, parts, rows, 6) begin: ``pose`` (n, parts, 3), overwritten; ``motion`` (9,) is scratch."""
    for world in range(paths.shape[0]):
        for i in range(paths.shape[1]):
            motion_at(paths[world, i], 0.0, motion)
            for axis in range(3):
                pose[world, i, axis] = motion[axis]


@borrowing
def sample_route(route, times, motion):
    """:data:`MOTION` (n, 9) of a route at ``times`` (n,)."""
    for k in range(times.shape[0]):
        motion_at(route, times[k], motion[k])


def sample(route: np.ndarray, times: np.ndarray) -> np.ndarray:
    """:data:`MOTION` of a route (rows, 6) at ``times`` (n,), s: array (n, 9)."""
    motion = np.empty((len(times), len(MOTION)))
    sample_route(np.ascontiguousarray(route), np.ascontiguousarray(times, dtype=np.float64), motion)
    return motion
