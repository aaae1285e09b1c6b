"""Motions that a part may make next, what each leads to, and which is best beside the others: the planner's kernel.

A part's candidates are a few simple motions (:func:`set_velocity`): straight to the target at several speeds, to it along one
of the lanes that run the length of the table, out of the way in one of several directions, or to stay where it is for a while.
Each is followed for two seconds by a simple model of the part, beside the motions that the others have chosen, and priced in
seconds: the time to the target that is left, and the time spent too near others (:func:`nearness`) or too near the border.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.physics.core.jit import jit

STEPS, STEP = 25, 0.08
"""Number of a prediction's steps, and their length, s."""

LANES, DIRECTIONS = 6, 12
WAIT, LANE, ASIDE = 3, 6, 6 + 2 * LANES
MOTIONS = ASIDE + 2 * DIRECTIONS
"""From 0 on: three speeds straight to the target; three waits; every lane at two speeds; every direction at two speeds."""

STAY = WAIT + 2
WAITS = 0.3  # s, the first wait; the second is twice that, the third lasts
ASIDE_TIME = 0.4  # s
LANE_END = 0.08  # m before the target, along the table, where a part leaves its lane for it
LANE_SLOPE = 2.0  # steepest way into a lane
SLACK = 0.002  # m that a part may be too near the border for nothing
OUTSIDE = 0.005  # m too near the border that cost as much as being as near to another part as can be
FADING = 0.6  # share by which what is near in place counts less at the end of a prediction
DEEPEST = 4.0  # in safe distances, the lack of distance beyond which the price grows no more


class Rules(NamedTuple):
    """What the planner knows and wants."""

    width: float  # m, of the surface
    height: float  # m
    edge: float  # m, distance that centres keep from the border
    top_speed: float  # m/s
    acceleration: float  # m/s^2 that the model of a part can do
    braking: float  # m/s^2 that the stopping law counts on
    approach: float  # 1/s
    spacing: float  # m, distance between parts that the thesis asks for
    safe: float  # m, distance that is kept where there is no room for more
    soft: float  # price of a second in touch for breaking the spacing rule, s
    hard: float  # the same for breaking the safe distance
    yielding: float  # share of these prices that a part reckons for those over which it has right of way


@jit
def set_velocity(rules, motion, time, x, y, target_x, target_y):
    """Set velocity (m/s) of a motion ``time`` seconds after it was chosen, at a place."""
    speed = 1.0
    if motion < WAIT:
        speed = 1.0 - 0.35 * motion
    elif motion < LANE:
        if motion == STAY or time < WAITS * (1 + motion - WAIT):
            return 0.0, 0.0
    elif motion < ASIDE:
        speed = 1.0 if motion < LANE + LANES else 0.5
        ahead = target_x - x
        if abs(ahead) > LANE_END:
            lane = (motion - LANE) % LANES
            lane_y = rules.edge + (rules.height - 2.0 * rules.edge) * lane / (LANES - 1.0)
            slope = min(max((lane_y - y) / 0.03, -LANE_SLOPE), LANE_SLOPE)
            along = speed * rules.top_speed / math.sqrt(1.0 + slope * slope)
            return math.copysign(along, ahead), slope * along
    elif time < ASIDE_TIME:
        angle = 2.0 * math.pi * ((motion - ASIDE) % DIRECTIONS) / DIRECTIONS
        speed = rules.top_speed * (1.0 if motion < ASIDE + DIRECTIONS else 0.4)
        return speed * math.cos(angle), speed * math.sin(angle)
    dx, dy = target_x - x, target_y - y
    distance = math.sqrt(dx * dx + dy * dy)
    rate = min(math.sqrt(2.0 * rules.braking * distance), rules.approach * distance)
    rate = speed * min(rate, rules.top_speed) / max(distance, 1e-9)
    return rate * dx, rate * dy


@jit
def follow(rules, motion, x, y, vx, vy, target_x, target_y, path):
    """Predict a motion: ``path`` (STEPS, 2) is overwritten with the places after 1, 2, ... steps."""
    for k in range(path.shape[0]):
        wx, wy = set_velocity(rules, motion, k * STEP, x, y, target_x, target_y)
        ax, ay = wx - vx, wy - vy
        change = math.sqrt(ax * ax + ay * ay)
        share = min(rules.acceleration * STEP / max(change, 1e-12), 1.0)
        nx, ny = vx + share * ax, vy + share * ay
        x, y = x + 0.5 * STEP * (vx + nx), y + 0.5 * STEP * (vy + ny)
        vx, vy = nx, ny
        path[k, 0], path[k, 1] = x, y


@jit
def reach(hulls, part, cosine, sine, nx, ny):
    """How far a part with this heading reaches from its centre along a unit vector, m."""
    bx, by = cosine * nx + sine * ny, cosine * ny - sine * nx
    most = -math.inf
    for a in range(hulls.owner[part], hulls.owner[part + 1]):
        for k in range(hulls.first[a], hulls.first[a + 1]):
            most = max(most, bx * hulls.corner[k, 0] + by * hulls.corner[k, 1] + hulls.rounding[a])
    return most


@jit
def distance_at_least(hulls, p, q, turned, dx, dy):
    """Lower bound of the distance between two parts, m: the gap along the line of their centres.

    Args:
        turned: (parts, 2) cos and sin of the headings.
        dx, dy: centre of ``q`` minus that of ``p``, m.
    """
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return -hulls.radius[p] - hulls.radius[q]
    nx, ny = dx / length, dy / length
    own = reach(hulls, p, turned[p, 0], turned[p, 1], nx, ny)
    return length - own - reach(hulls, q, turned[q, 0], turned[q, 1], -nx, -ny)


@jit
def nearness(rules, gap, patience):
    """Price of a second at a distance between two parts: below the spacing rule, and much more below the safe distance.

    Args:
        patience: share of the spacing rule's price that still counts.
    """
    price = 0.0
    if gap < rules.spacing:
        lack = (rules.spacing - gap) / rules.spacing
        price += patience * rules.soft * lack * lack
    if gap < rules.safe:
        price += rules.hard * min((rules.safe - gap) / rules.safe, DEEPEST)
    return price


@jit
def price_of(rules, hulls, p, motion, rank, here, paths, turned, velocity, target, patience, trial, limit):
    """Price of a motion of part ``p``, s; its path is left in ``trial``. One dearer than ``limit`` is not priced to the end.

    Args:
        rank: (parts,) lower: has right of way; -1: absent.
        here, velocity, target: (parts, 2).  paths: (parts, STEPS, 2) m, of the others.  turned: (parts, 2).
        patience: of this part, see :func:`nearness`; those over which it has right of way count that much less as well.
    """
    follow(
        rules, motion, here[p, 0], here[p, 1], velocity[p, 0], velocity[p, 1], target[p, 0], target[p, 1], trial
    )  # fmt: skip
    price = 0.0
    for k in range(STEPS):
        x, y = trial[k, 0], trial[k, 1]
        dx, dy = target[p, 0] - x, target[p, 1] - y
        left = math.sqrt(dx * dx + dy * dy) / rules.top_speed
        price += left if k == STEPS - 1 else left / STEPS
        out = max(rules.edge - x, x - rules.width + rules.edge, rules.edge - y, y - rules.height + rules.edge)
        if out > SLACK:  # targets may lie on that line
            price += rules.hard * STEP * out / OUTSIDE
    for q in range(rank.shape[0]):
        if price > limit:
            return price
        if q == p or rank[q] < 0:
            continue
        share = STEP if rank[q] < rank[p] else STEP * rules.yielding * patience
        far = hulls.radius[p] + hulls.radius[q] + rules.spacing
        for k in range(STEPS):
            dx, dy = paths[q, k, 0] - trial[k, 0], paths[q, k, 1] - trial[k, 1]
            if dx * dx + dy * dy < far * far:
                gap = distance_at_least(hulls, p, q, turned, dx, dy)
                price += share * nearness(rules, gap, patience) * (1.0 - FADING * k / STEPS)
    return price


@jit
def choose_motions(
    rules, hulls, present, order, here, turned, velocity, target, patience, faithful, motion, chosen
):  # fmt: skip
    """Let the parts of every world choose in turn, each beside the motions of those before and the last ones of those after.

    Args:
        present: (worlds, parts) bool.
        order: (worlds, parts) int64: order[w, 0] has right of way over all others.
        here, velocity, target: (worlds, parts, 2) m, m/s, m.  turned: (worlds, parts, 2) cos and sin of the headings.
        patience: (worlds, parts) see :func:`nearness`.
        faithful: s, what another motion must be better than the last one.
        motion: (worlds, parts) int64, the last ones; overwritten.
        chosen: (worlds, parts, 2) m/s, overwritten with the set velocities; 0 for absent parts.
    """
    parts = here.shape[1]
    paths, trial = np.empty((parts, STEPS, 2)), np.empty((STEPS, 2))
    rank = np.empty(parts, np.int64)
    for w in range(here.shape[0]):
        at, speed, aim = here[w], velocity[w], target[w]
        for k in range(parts):
            p = order[w, k]
            rank[p] = k if present[w, p] else -1
            follow(
                rules, motion[w, p], at[p, 0], at[p, 1], speed[p, 0], speed[p, 1], aim[p, 0], aim[p, 1], paths[p]
            )  # fmt: skip
        for k in range(parts):
            p = order[w, k]
            chosen[w, p] = 0.0
            if rank[p] < 0:
                continue
            last, best, least = motion[w, p], STAY, math.inf
            # Waits and steps aside have no such advantage: taken anew every time, they put off what they lead to for ever.
            if last < WAIT or (LANE <= last and last < ASIDE):
                best = last
                least = price_of(
                    rules, hulls, p, last, rank, at, paths, turned[w], speed, aim, patience[w, p], trial, math.inf
                )  # fmt: skip
                least -= faithful
            for m in range(MOTIONS):
                price = price_of(
                    rules, hulls, p, m, rank, at, paths, turned[w], speed, aim, patience[w, p], trial, least
                )  # fmt: skip
                if price < least:
                    best, least = m, price
            motion[w, p] = best
            follow(rules, best, at[p, 0], at[p, 1], speed[p, 0], speed[p, 1], aim[p, 0], aim[p, 1], paths[p])
            wx, wy = set_velocity(rules, best, 0.0, at[p, 0], at[p, 1], aim[p, 0], aim[p, 1])
            chosen[w, p, 0], chosen[w, p, 1] = wx, wy
