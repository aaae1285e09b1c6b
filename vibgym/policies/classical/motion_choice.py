"""Kernels of the planner: candidate motions of a part, their prediction, and the choice of the best beside the others.

Candidates are a few simple motions (:func:`set_velocity`): straight to the target at several speeds, to it through one of the
aisles that run the length of the table, aside in one of several directions, or a wait. Each is predicted for two seconds by a
simple model of the part, beside the motions that the others have chosen, and priced in seconds: the remaining time to the
target, and the time spent too near others (:func:`nearness`) or too near the border.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit

INSTANTS, INTERVAL = 25, 0.08
"""Number of a prediction's instants, and the time between them, s."""

AISLES, DIRECTIONS = 6, 12
FIRST_WAIT, FIRST_AISLE, FIRST_ASIDE = 3, 6, 6 + 2 * AISLES
MOTIONS = FIRST_ASIDE + 2 * DIRECTIONS
"""From 0 on: three speeds straight to the target; three waits; every aisle at two speeds; every direction at two speeds."""

STAY = FIRST_WAIT + 2
WAITS = 0.3  # s, the first wait; the second is twice that, the third lasts
ASIDE_TIME = 0.4  # s
AISLE_END = 0.08  # m before the target, along the table, where a part leaves its aisle for it
AISLE_SLOPE = 2.0  # steepest way into an aisle
SLACK = 0.002  # m that a part may be too near the border at no price
OUTSIDE = 0.005  # m too near the border, with the same price as contact with another part
FADING = 0.6  # share by which prices are lower at the end of a prediction
ROUNDING = 1e-9  # s, rounding error of a bound
DEEPEST = 4.0  # in safe distances, the lack of distance beyond which the price is constant


def _each_motion() -> tuple[np.ndarray, ...]:
    """Return the parameters of all motions, (MOTIONS,) each.

    They are the share of the top speed towards the target; the aisle, -1: none; and a first phase: its end (s), and its
    velocity over the top speed as magnitude, cosine and sine.
    """
    speed, aisle, until = np.ones(MOTIONS), -np.ones(MOTIONS), np.zeros(MOTIONS)
    aside, along, across = np.zeros(MOTIONS), np.zeros(MOTIONS), np.zeros(MOTIONS)
    speed[:FIRST_WAIT] = 1.0 - 0.35 * np.arange(FIRST_WAIT)
    until[FIRST_WAIT:FIRST_AISLE] = WAITS * (1 + np.arange(FIRST_AISLE - FIRST_WAIT))
    until[STAY] = np.inf
    aisle[FIRST_AISLE:FIRST_ASIDE] = np.tile(np.arange(AISLES), 2)
    speed[FIRST_AISLE + AISLES : FIRST_ASIDE] = 0.5
    until[FIRST_ASIDE:] = ASIDE_TIME
    aside[FIRST_ASIDE:] = np.repeat([1.0, 0.4], DIRECTIONS)
    direction = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    along[FIRST_ASIDE:], across[FIRST_ASIDE:] = np.tile(np.cos(direction), 2), np.tile(np.sin(direction), 2)
    return speed, aisle, until, aside, along, across


SPEED, AISLE, UNTIL, ASIDE, ALONG, ACROSS = _each_motion()


class Preferences(NamedTuple):
    """Scene and prices, the same for all parts."""

    width: float  # m, of the surface
    depth: float  # m
    edge: float  # m, distance that centres keep from the border
    top_speed: float  # m/s
    acceleration: float  # m/s^2, of the model of a part
    braking: float  # m/s^2, for stopping
    approach: float  # 1/s
    soft: float  # price of a second in touch for breaking the spacing rule, s
    hard: float  # the same for breaking the safe distance
    yielding: float  # share of these prices for a part that has right of way over the other


class Scene(NamedTuple):
    """The parts of all worlds at this instant."""

    present: np.ndarray  # (worlds, parts) bool
    centre: np.ndarray  # (worlds, parts, 2) m
    velocity: np.ndarray  # (worlds, parts, 2) m/s
    facing: np.ndarray  # (worlds, parts, 2) cos and sin of the headings
    target: np.ndarray  # (worlds, parts, 2) m
    patience: np.ndarray  # (worlds, parts) see nearness()
    order: np.ndarray  # (worlds, parts) int64: the first has right of way over all others
    spacing: np.ndarray  # (worlds, parts, parts) m, the thesis's distance, or that of the goals
    safe: np.ndarray  # (worlds, parts, parts) m, distance that is kept where there is no room for more
    inner: np.ndarray  # (parts,) m, radius of the inscribed circle about the centre


@jit(inline=True)
def set_velocity(wants, motion, time, x, y, target_x, target_y):
    """Return the set velocity (m/s) of a motion ``time`` seconds after it was chosen, at a place; without branches."""
    dx, dy = target_x - x, target_y - y
    distance = math.sqrt(dx * dx + dy * dy)
    rate = min(math.sqrt(2.0 * wants.braking * distance), wants.approach * distance)
    rate = SPEED[motion] * min(rate, wants.top_speed) / max(distance, 1e-9)
    wx, wy = rate * dx, rate * dy
    aisle_y = wants.edge + (wants.depth - 2.0 * wants.edge) * AISLE[motion] / (AISLES - 1.0)
    slope = min(max((aisle_y - y) / 0.03, -AISLE_SLOPE), AISLE_SLOPE)
    along = SPEED[motion] * wants.top_speed / math.sqrt(1.0 + slope * slope)
    in_aisle = AISLE[motion] >= 0.0 and abs(dx) > AISLE_END
    wx, wy = math.copysign(along, dx) if in_aisle else wx, slope * along if in_aisle else wy
    aside = time < UNTIL[motion]
    speed = ASIDE[motion] * wants.top_speed
    wx, wy = speed * ALONG[motion] if aside else wx, speed * ACROSS[motion] if aside else wy
    return wx, wy


@jit
def beyond(wants, x, y):
    """Return by how much a place is too near the border, m; negative: it is not."""
    return max(wants.edge - x, x - wants.width + wants.edge, wants.edge - y, y - wants.depth + wants.edge)


@jit
def follow(wants, centre, velocity, target, state, paths):
    """Predict all motions of one part: places after 1, 2, ... intervals into ``paths`` (MOTIONS, 2, INSTANTS).

    The inner loop runs over motions, so that it is vectorized; a single motion is a chain of dependent roots and quotients.

    Args:
        centre, velocity, target: (2,) m, m/s, m.
        state: (4, MOTIONS) scratch.
    """
    for m in range(MOTIONS):
        state[0, m], state[1, m], state[2, m], state[3, m] = centre[0], centre[1], velocity[0], velocity[1]
    for k in range(INSTANTS):
        time = k * INTERVAL
        for m in range(MOTIONS):
            x, y, vx, vy = state[0, m], state[1, m], state[2, m], state[3, m]
            wx, wy = set_velocity(wants, m, time, x, y, target[0], target[1])
            ax, ay = wx - vx, wy - vy
            change = math.sqrt(ax * ax + ay * ay)
            share = min(wants.acceleration * INTERVAL / max(change, 1e-12), 1.0)
            nx, ny = vx + share * ax, vy + share * ay
            x, y = x + 0.5 * INTERVAL * (vx + nx), y + 0.5 * INTERVAL * (vy + ny)
            state[0, m], state[1, m], state[2, m], state[3, m] = x, y, nx, ny
        for m in range(MOTIONS):
            paths[m, 0, k], paths[m, 1, k] = state[0, m], state[1, m]


@jit
def reach(hulls, part, cosine, sine, nx, ny):
    """Return the extent of a part with this heading from its centre along a unit vector, m."""
    bx, by = cosine * nx + sine * ny, cosine * ny - sine * nx
    most = -math.inf
    for a in range(hulls.owner[part], hulls.owner[part + 1]):
        for k in range(hulls.first[a], hulls.first[a + 1]):
            most = max(most, bx * hulls.corner[k, 0] + by * hulls.corner[k, 1] + hulls.rounding[a])
    return most


@jit
def distance_at_least(hulls, p, q, facing, dx, dy):
    """Return a lower bound of the distance between two parts, m: the gap along the line of their centres.

    Args:
        facing: (parts, 2) cos and sin of the headings.
        dx, dy: centre of ``q`` minus that of ``p``, m.
    """
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return -hulls.radius[p] - hulls.radius[q]
    nx, ny = dx / length, dy / length
    own = reach(hulls, p, facing[p, 0], facing[p, 1], nx, ny)
    return length - own - reach(hulls, q, facing[q, 0], facing[q, 1], -nx, -ny)


@jit
def nearness(wants, spacing, safe, gap, patience):
    """Return the price of a second at a distance between two parts.

    Args:
        spacing, safe, gap: m.
        patience: factor of the spacing rule's price.
    """
    price = 0.0
    if gap < spacing:
        lack = (spacing - gap) / spacing
        price += patience * wants.soft * lack * lack
    if gap < safe:
        price += wants.hard * min((safe - gap) / safe, DEEPEST)
    return price


@jit
def price_of_place(wants, path, target):
    """Return the price of a path (2, INSTANTS) by itself, s: the remaining time to the target, and the border."""
    price, allowed = 0.0, beyond(wants, target[0], target[1])
    allowed = allowed if allowed > SLACK else 0.0  # a centre may be as near the border as its target
    for k in range(INSTANTS):
        x, y = path[0, k], path[1, k]
        dx, dy = target[0] - x, target[1] - y
        left = math.sqrt(dx * dx + dy * dy) / wants.top_speed
        price += left if k == INSTANTS - 1 else left / INSTANTS
        out = beyond(wants, x, y) - allowed
        if out > SLACK:  # targets may lie on that line
            price += wants.hard * INTERVAL * out / OUTSIDE
    return price


@jit
def ever_near(path, other, far):
    """Return whether two paths (2, INSTANTS) are less than ``far`` (m) apart at any instant; vectorized."""
    near = 0
    for k in range(INSTANTS):
        dx, dy = other[0, k] - path[0, k], other[1, k] - path[1, k]
        near += dx * dx + dy * dy < far * far
    return near > 0


@jit
def with_price_beside(wants, hulls, scene, world, p, q, rank, paths, trial, price, limit):
    """Return ``price`` (s) plus that of the path ``trial`` of part ``p`` beside that of ``q``; incomplete above ``limit``."""
    patience = scene.patience[world, p]
    share = INTERVAL if rank[q] < rank[p] else INTERVAL * wants.yielding * patience
    spacing, safe = scene.spacing[world, p, q], scene.safe[world, p, q]
    far = hulls.radius[p] + hulls.radius[q] + spacing
    if not ever_near(trial, paths[q], far):
        return price
    for k in range(INSTANTS):
        dx, dy = paths[q, 0, k] - trial[0, k], paths[q, 1, k] - trial[1, k]
        if dx * dx + dy * dy < far * far:
            if price > limit:
                return price
            gap = distance_at_least(hulls, p, q, scene.facing[world], dx, dy)
            price += share * nearness(wants, spacing, safe, gap, patience) * (1.0 - FADING * k / INSTANTS)
    return price


@jit
def least_price_beside(wants, scene, world, p, q, rank, other, trial):
    """Return a lower bound of the price of the path ``trial`` of part ``p`` beside ``other``, that of ``q``, s.

    It is the price of their inscribed circles, computed without branches.
    """
    patience, total = scene.patience[world, p], 0.0
    share = INTERVAL if rank[q] < rank[p] else INTERVAL * wants.yielding * patience
    spacing, safe, both = scene.spacing[world, p, q], scene.safe[world, p, q], scene.inner[p] + scene.inner[q]
    for k in range(INSTANTS):
        dx, dy = other[0, k] - trial[0, k], other[1, k] - trial[1, k]
        gap = math.sqrt(dx * dx + dy * dy) - both
        lack, much = max(spacing - gap, 0.0) / spacing, min(max(safe - gap, 0.0) / safe, DEEPEST)
        total += (patience * wants.soft * lack * lack + wants.hard * much) * (1.0 - FADING * k / INSTANTS)
    return share * total


@jit
def price_of(wants, hulls, scene, world, p, rank, paths, trial, limit, suspect):
    """Compute the price of a path ``trial`` (2, INSTANTS) of part ``p``, s; incomplete above ``limit``.

    Args:
        rank: (parts,) the lower one has right of way; -1: absent.
        paths: (parts, 2, INSTANTS) m, of the others.
        suspect: part beside which the last motion exceeded its limit, -1: none; usually this one does as well.

    Returns:
        The price, and the next suspect.
    """
    price = price_of_place(wants, trial, scene.target[world, p])
    if suspect >= 0:
        least = least_price_beside(wants, scene, world, p, suspect, rank, paths[suspect], trial)
        if price + least > limit + ROUNDING:
            return math.inf, suspect
    for q in range(rank.shape[0]):
        if price > limit:
            break
        if q != p and rank[q] >= 0:
            price = with_price_beside(wants, hulls, scene, world, p, q, rank, paths, trial, price, limit)
            if price > limit:
                suspect = q
    return price, suspect


@jit
def best_motion(wants, hulls, scene, world, p, last, faithful, rank, paths, trials):
    """Return the motion of part ``p`` with the lowest price, of predictions ``trials`` (MOTIONS, 2, INSTANTS).

    A motion that is not the last one must be better by ``faithful`` (s).
    """
    best, least, suspect = STAY, math.inf, -1
    # Not for waits and steps aside: restarted every step, they would go on forever.
    if last < FIRST_WAIT or (FIRST_AISLE <= last and last < FIRST_ASIDE):
        best = last
        price, suspect = price_of(wants, hulls, scene, world, p, rank, paths, trials[last], math.inf, suspect)
        least = price - faithful
    for motion in range(MOTIONS):
        price, suspect = price_of(wants, hulls, scene, world, p, rank, paths, trials[motion], least, suspect)
        if price < least:
            best, least = motion, price
    return best


@jit(allocates=True)
def choose_motions(start, stop, wants, hulls, scene, faithful, motion, chosen):
    """Choose the motions of the parts of each world in order, beside the present or else the last motions of the others.

    Args:
        start, stop: first world, and the one after the last.
        wants: the :class:`Preferences`.
        faithful: s, see :func:`best_motion`.
        motion: (worlds, parts) int64, the last ones; overwritten.
        chosen: (worlds, parts, 2) m/s, overwritten with the set velocities; 0 for absent parts.
    """
    parts = scene.present.shape[1]
    trials, paths = np.empty((parts, MOTIONS, 2, INSTANTS)), np.empty((parts, 2, INSTANTS))
    state = np.empty((4, MOTIONS))
    rank = np.empty(parts, np.int64)
    for w in range(start, stop):
        centre, velocity, target = scene.centre[w], scene.velocity[w], scene.target[w]
        for k in range(parts):
            p = scene.order[w, k]
            rank[p] = k if scene.present[w, p] else -1
            follow(wants, centre[p], velocity[p], target[p], state, trials[p])
            paths[p] = trials[p, motion[w, p]]
        for k in range(parts):
            p = scene.order[w, k]
            chosen[w, p] = 0.0
            if rank[p] < 0:
                continue
            best = best_motion(wants, hulls, scene, w, p, motion[w, p], faithful, rank, paths, trials[p])
            motion[w, p] = best
            paths[p] = trials[p, best]
            wx, wy = set_velocity(wants, best, 0.0, centre[p, 0], centre[p, 1], target[p, 0], target[p, 1])
            chosen[w, p, 0], chosen[w, p, 1] = wx, wy
