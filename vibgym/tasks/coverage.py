"""How much of a part's goal the part covers: the area of two outlines' intersection, piece by convex piece."""

from __future__ import annotations

import math

import numpy as np

from vibgym.kernels.jit import borrowing, jit
from vibgym.kernels.reference import reference


@borrowing
def place_piece(hulls, piece, pose, corners):
    """Write the corners of a convex piece at a pose (3,) into ``corners``; returns how many."""
    cosine, sine, first = math.cos(pose[2]), math.sin(pose[2]), hulls.first[piece]
    for k in range(hulls.first[piece + 1] - first):
        x, y = hulls.corner[first + k, 0], hulls.corner[first + k, 1]
        corners[k, 0], corners[k, 1] = pose[0] + cosine * x - sine * y, pose[1] + sine * x + cosine * y
    return hulls.first[piece + 1] - first


@borrowing
def clip(corners, count, ax, ay, bx, by, result):
    """Cut off of a convex polygon what lies to the right of the line from a to b (Sutherland & Hodgman, 1974); returns how many
    corners are left."""
    left = 0
    for k in range(count):
        px, py = corners[k, 0], corners[k, 1]
        qx, qy = corners[(k + 1) % count, 0], corners[(k + 1) % count, 1]
        p = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
        q = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
        if p >= 0.0:
            result[left, 0], result[left, 1] = px, py
            left += 1
        if (p > 0.0 and q < 0.0) or (p < 0.0 and q > 0.0):
            share = p / (p - q)
            result[left, 0], result[left, 1] = px + share * (qx - px), py + share * (qy - py)
            left += 1
    return left


@borrowing
def area(corners, count):
    """m^2 of a polygon, counter-clockwise."""
    total = 0.0
    for k in range(count):
        j = (k + 1) % count
        total += corners[k, 0] * corners[j, 1] - corners[k, 1] * corners[j, 0]
    return 0.5 * total


@borrowing
def shared_area(hulls, a, pose, b, goal, one, other, spare):
    """m^2 that piece ``a`` at a pose and piece ``b`` at another share; the last three are scratch."""
    count, edges = place_piece(hulls, a, pose, one), place_piece(hulls, b, goal, other)
    for k in range(edges):
        j = (k + 1) % edges
        count = clip(one, count, other[k, 0], other[k, 1], other[j, 0], other[j, 1], spare)
        for corner in range(count):
            one[corner, 0], one[corner, 1] = spare[corner, 0], spare[corner, 1]
    return area(one, count) if count > 2 else 0.0


@borrowing
def shared_by_discs(radius, distance):
    """m^2 that two discs of the same radius share."""
    if distance >= 2.0 * radius:
        return 0.0
    half = 0.5 * distance
    return 2.0 * radius * radius * math.acos(half / radius) - distance * math.sqrt(radius * radius - half * half)


@jit
def goal_coverage(hulls, part, pose, goal, coverage, worlds):
    """Share of a part's goal that it covers, (worlds,), of ``worlds`` (n,), overwritten.

    Args:
        part: which.
        pose, goal: (worlds, parts, 3) m, m, rad.
    """
    hulls = reference(hulls)
    first, last, whole = hulls.owner[part], hulls.owner[part + 1], 0.0
    most = 2 * (hulls.first[last] - hulls.first[first])  # cutting adds a corner for every edge at most
    one, other, spare = np.empty((most, 2)), np.empty((most, 2)), np.empty((most, 2))
    for piece in range(first, last):
        count = place_piece(hulls, piece, np.zeros(3), one)
        whole += area(one, count)
    round_off = hulls.rounding[first]
    for k in range(worlds.shape[0]):
        w, shared = worlds[k], 0.0
        for a in range(first, last):
            for b in range(first, last):
                shared += shared_area(hulls, a, pose[w, part], b, goal[w, part], one, other, spare)
        if whole > 0.0:
            coverage[w] = shared / whole
        else:  # a disc: one corner, rounded
            distance = math.hypot(goal[w, part, 0] - pose[w, part, 0], goal[w, part, 1] - pose[w, part, 1])
            coverage[w] = shared_by_discs(round_off, distance) / (math.pi * round_off * round_off)
