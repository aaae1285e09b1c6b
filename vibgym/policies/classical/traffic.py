"""Velocities that keep parts out of one another's way: who has right of way chooses first, those after it beside what it chose.

A velocity is as good as it is near the one that a part would like, and as long as it lasts until the part would meet another
one or the border, if that keeps the velocity that it has chosen, or had (velocity obstacles, see van den Berg, Lin & Manocha,
ICRA 2008; by sampling, with an order instead of reciprocity). Two parts cannot meet before the rectangles about them do, nor
before the gap along the direction that separates their outlines is used up: the later of both counts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing, jit
from vibgym.physics.contacts.hulls import hull_gap, place_hulls

DIRECTIONS = 20
SPEEDS = (1.0, 0.6, 0.25)
"""Over the top speed: velocities that are looked at besides the one that a part would like, half of that, and rest."""

CLOSE = 0.040
"""m between the circles of parts whose outlines are looked at."""

AT_ONCE, PUSHING = 0.08, 4.0
"""s, minimum time to collision of every part, with or without right of way, and the price of less, relative to contact now."""

COSINES = np.cos(2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)
SINES = np.sin(2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)


class Rules(NamedTuple):
    """How parts keep out of one another's way."""

    width: float  # m, of the surface
    depth: float  # m
    top: float  # m/s
    edge: float  # m, that rectangles may stick out of the surface
    near: float  # m, distance that parts keep
    brake: float  # 1/s, most speed towards the border over the room that is left
    ahead: float  # s that parts look ahead
    meeting: (
        float  # price of meeting at once, over that of doing nothing for one that would like to go at the top speed
    )
    yielding: float  # share of that which a part reckons for those over which it has right of way
    faithful: float  # price of a velocity that is the top speed away from the last one


class Crowd(NamedTuple):
    """The parts of all worlds at this instant."""

    present: np.ndarray  # (worlds, parts) bool
    centre: np.ndarray  # (worlds, parts, 2) m
    reach: np.ndarray  # (worlds, parts, 2) m, how far they reach from their centres along x and y
    wanted: np.ndarray  # (worlds, parts, 2) m/s, what they would like
    order: np.ndarray  # (worlds, parts) int64: the first has right of way over all others
    pose: np.ndarray  # (worlds, parts, 3) m, m, rad


class Gaps(NamedTuple):
    """How the parts of the world at hand lie to one another: (parts, parts), of parts whose circles are near."""

    size: np.ndarray  # m, between outlines; infinite of others
    x: np.ndarray  # of the unit vector from the first part to the second along which it is
    y: np.ndarray


@borrowing
def time_to_meet(dx, dy, ex, ey, vx, vy):
    """s until two rectangles meet; infinite where they do not, 0 where they overlap.

    Args:
        dx, dy: centre of the other one minus own, m.
        ex, ey: sum of both reaches and the distance to keep, m.
        vx, vy: own velocity minus the other one's, m/s.
    """
    enter, leave = 0.0, math.inf
    for axis in range(2):
        d, e, v = (dx, ex, vx) if axis == 0 else (dy, ey, vy)
        if v == 0.0:
            if abs(d) >= e:
                return math.inf
            continue
        first, last = (d - e) / v, (d + e) / v
        enter, leave = max(enter, min(first, last)), min(leave, max(first, last))
    return enter if enter < leave else math.inf


@borrowing
def measure_gaps(hulls, placed, crowd, rank, w, gaps):
    """Write down the gaps between the present parts of a world whose circles are nearer than :data:`CLOSE`."""
    parts = rank.shape[0]
    for p in range(parts):
        if rank[p] >= 0:
            place_hulls(hulls, p, crowd.pose[w, p, 0], crowd.pose[w, p, 1], crowd.pose[w, p, 2], placed)
    for p in range(parts):
        for q in range(p):
            gaps.size[p, q] = gaps.size[q, p] = math.inf
            if rank[p] < 0 or rank[q] < 0:
                continue
            dx, dy = crowd.centre[w, q, 0] - crowd.centre[w, p, 0], crowd.centre[w, q, 1] - crowd.centre[w, p, 1]
            far = hulls.radius[p] + hulls.radius[q] + CLOSE
            if dx * dx + dy * dy >= far * far:
                continue
            for a in range(hulls.owner[p], hulls.owner[p + 1]):
                for b in range(hulls.owner[q], hulls.owner[q + 1]):
                    gap, nx, ny = hull_gap(hulls, placed, a, b)
                    if gap < gaps.size[p, q]:
                        gaps.size[p, q] = gaps.size[q, p] = gap
                        gaps.x[p, q], gaps.y[p, q], gaps.x[q, p], gaps.y[q, p] = nx, ny, -nx, -ny


@borrowing
def meeting_time(rules, gaps, p, q, dx, dy, ex, ey, ux, uy):
    """s before which two parts cannot meet, see :func:`time_to_meet`; by the gap of their outlines as well."""
    time, gap = time_to_meet(dx, dy, ex, ey, ux, uy), gaps.size[p, q]
    if gap < math.inf:
        closing = ux * gaps.x[p, q] + uy * gaps.y[p, q]
        time = max(time, max(gap - rules.near, 0.0) / closing if closing > 0.0 else math.inf)
    return time


@borrowing
def price_of(rules, crowd, gaps, chosen, rank, w, p, last_x, last_y, vx, vy, limit):
    """Price of a velocity (m/s) of part ``p``, infinite of those that lead over the border; one dearer than ``limit`` is not
    priced to the end."""
    wx, wy = crowd.wanted[w, p, 0] - vx, crowd.wanted[w, p, 1] - vy
    lx, ly = last_x - vx, last_y - vy
    price = (math.sqrt(wx * wx + wy * wy) + rules.faithful * math.sqrt(lx * lx + ly * ly)) / rules.top
    x, y = crowd.centre[w, p, 0], crowd.centre[w, p, 1]
    for axis in range(2):
        at, v, size = (x, vx, rules.width) if axis == 0 else (y, vy, rules.depth)
        reach = crowd.reach[w, p, axis] - rules.edge
        room = size - reach - at if v > 0.0 else at - reach
        if abs(v) > rules.brake * max(room, 0.0):
            return math.inf
    for q in range(rank.shape[0]):
        if price > limit:
            return price
        if q == p or rank[q] < 0:
            continue
        dx, dy = crowd.centre[w, q, 0] - x, crowd.centre[w, q, 1] - y
        ex = crowd.reach[w, p, 0] + crowd.reach[w, q, 0] + rules.near
        ey = crowd.reach[w, p, 1] + crowd.reach[w, q, 1] + rules.near
        far = 2.0 * rules.top * rules.ahead
        if abs(dx) > ex + far or abs(dy) > ey + far:
            continue
        ux, uy = vx - chosen[w, q, 0], vy - chosen[w, q, 1]
        time = meeting_time(rules, gaps, p, q, dx, dy, ex, ey, ux, uy)
        if time < AT_ONCE:
            price += PUSHING * rules.meeting * (1.0 - time / AT_ONCE)
        share = 1.0 if rank[q] < rank[p] else rules.yielding
        if rank[q] < rank[p]:  # who has right of way is made way for, also where it has had to stop
            ux, uy = vx - crowd.wanted[w, q, 0], vy - crowd.wanted[w, q, 1]
            time = min(time, meeting_time(rules, gaps, p, q, dx, dy, ex, ey, ux, uy))
        if time < rules.ahead:
            left = 1.0 - time / rules.ahead
            price += share * rules.meeting * left * left
    return price


@jit
def choose_velocities(start, stop, rules, hulls, crowd, chosen):
    """Let the parts of each world choose in turn.

    Args:
        start, stop: first world, and the one after the last.
        chosen: (worlds, parts, 2) m/s, velocities of the last step; overwritten.
    """
    parts = crowd.present.shape[1]
    rank, placed = np.empty(parts, np.int64), np.empty_like(hulls.corner)
    gaps = Gaps(np.empty((parts, parts)), np.empty((parts, parts)), np.empty((parts, parts)))
    for w in range(start, stop):
        for k in range(parts):
            p = crowd.order[w, k]
            rank[p] = k if crowd.present[w, p] else -1
        measure_gaps(hulls, placed, crowd, rank, w, gaps)
        for k in range(parts):
            p = crowd.order[w, k]
            last_x, last_y = chosen[w, p, 0], chosen[w, p, 1]
            chosen[w, p, 0] = chosen[w, p, 1] = 0.0
            if rank[p] < 0:
                continue
            wx, wy = crowd.wanted[w, p, 0], crowd.wanted[w, p, 1]
            best_x, best_y = wx, wy
            least = price_of(rules, crowd, gaps, chosen, rank, w, p, last_x, last_y, wx, wy, math.inf)
            for k in range(2 + DIRECTIONS * len(SPEEDS)):
                if k < 2:
                    vx, vy = 0.5 * k * wx, 0.5 * k * wy
                else:
                    speed = rules.top * SPEEDS[(k - 2) // DIRECTIONS]
                    vx, vy = speed * COSINES[(k - 2) % DIRECTIONS], speed * SINES[(k - 2) % DIRECTIONS]
                price = price_of(rules, crowd, gaps, chosen, rank, w, p, last_x, last_y, vx, vy, least)
                if price < least:
                    least, best_x, best_y = price, vx, vy
            chosen[w, p, 0], chosen[w, p, 1] = best_x, best_y
