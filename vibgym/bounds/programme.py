"""Kernels of the tables: dynamic programming on a grid of two state variables, and the effect of one oscillation period.

The programme finds the largest gain in a number of periods. Its moves are the effect of a period on spin and heading, and on
the velocity of a part without spin, which integrates the thesis's eqs. 3.26 and 3.27 in time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit


class Moves(NamedTuple):
    """Transitions of one period from every node of the grid.

    Attributes:
        gain: (n, m, controls) increase of the objective.
        reached: (n, m, controls, 2) resulting state, in grid indices.
        cyclic: whether the first axis is periodic.
    """

    gain: np.ndarray
    reached: np.ndarray
    cyclic: bool


@jit
def _weights(at):
    """Return the Lagrange weights of four nodes at -1, 0, 1, 2 for a position ``at`` in [0, 1]."""
    below, above, far = at + 1.0, 1.0 - at, 2.0 - at
    return -at * above * far / 6.0, below * above * far / 2.0, below * at * far / 2.0, -below * at * above / 6.0


@jit
def interpolated(value, cyclic, row, column):
    """Interpolate ``value`` (n, m) at fractional indices by cubics; indices beyond non-periodic edges are clamped."""
    n, m = value.shape
    if cyclic:
        low = math.floor(row)
        first, u = int(low) - 1, row - low
    else:
        inside = min(max(row, 0.0), n - 1.0)
        first = min(max(int(inside) - 1, 0), n - 4)
        u = inside - first - 1.0
    inside = min(max(column, 0.0), m - 1.0)
    left = min(max(int(inside) - 1, 0), m - 4)
    v0, v1, v2, v3 = _weights(inside - left - 1.0)
    w = _weights(u)
    total = 0.0
    for k in range(4):
        i = (first + k) % n
        total += w[k] * (
            v0 * value[i, left] + v1 * value[i, left + 1] + v2 * value[i, left + 2] + v3 * value[i, left + 3]
        )
    return total


@jit
def best(gain, reached, cyclic, sign, value, result):
    """Compute ``max over controls of sign * gain + value(reached)`` for every node.

    Args:
        gain, reached, cyclic: see :class:`Moves`.
        value: (n, m) value function.  result: (n, m), overwritten.
    """
    for i in range(value.shape[0]):
        for j in range(value.shape[1]):
            most = -math.inf
            for k in range(gain.shape[2]):
                there = interpolated(value, cyclic, reached[i, j, k, 0], reached[i, j, k, 1])
                most = max(most, sign * gain[i, j, k] + there)
            result[i, j] = most


def overshoots(moves: Moves, instants: int, stride: int) -> np.ndarray:
    """Return the least overshoot before the state can be held, (n, m).

    Gains count at ``instants`` moments only, ``stride`` periods apart; the first one is now and counts as zero.
    """
    room = np.zeros(moves.gain.shape[:2])
    result = np.empty_like(room)
    for _ in range(instants - 1):
        for _ in range(stride):
            best(moves.gain, moves.reached, moves.cyclic, -1.0, room, result)
            room, result = result, room
        np.minimum(room, 0.0, out=room)
    return -room


def furthest(moves: Moves, overshoot: np.ndarray, allowed: float, price: float, periods: int) -> np.ndarray:
    """Return the largest gain in 0, 1, ..., ``periods`` periods before the state can be held within ``allowed``.

    The constraint on the overshoot is relaxed: each unit beyond ``allowed`` costs ``price``. For every price the result is
    therefore an upper bound of the constrained problem.

    Returns:
        (periods + 1, n, m) by initial state.
    """
    value = np.empty((periods + 1, *overshoot.shape))
    value[0] = -price * np.maximum(overshoot - allowed, 0.0)
    for k in range(periods):
        best(moves.gain, moves.reached, moves.cyclic, 1.0, value[k], value[k + 1])
    return value


# -- one period -------------------------------------------------------------------------------------------------------


class Turner(NamedTuple):
    """A part on a table, for the kernels of this module."""

    points: np.ndarray  # (n, 2) m, of equal share, about the centre of mass
    lever: float  # friction over gyration, m^-2
    gravity: float  # m/s^2
    most: float  # m/s^2, largest phasor
    speed: float  # m/s, of the table
    idle: np.ndarray  # (2,) m/s, velocity at the start of a period of a part that slides in place
    element: float  # m
    reach: int  # elements that the part may touch, on each side of the one under its centre
    period: float  # s


class Scratch(NamedTuple):
    """Scratch memory of one period, divided into ``steps``."""

    spin: np.ndarray  # (steps,) rad/s in the middle of each step
    heading: np.ndarray  # (steps,) rad
    c: np.ndarray  # ((2 reach + 1)^2,) phasors, m/s^2
    s: np.ndarray


@jit
def _torque(turner, x, y, vx, vy, spin, tx, ty):
    """Return the angular acceleration from friction at a point, per unit of load: ``r x n mu / k^2``."""
    ux, uy = tx - vx + spin * y, ty - vy - spin * x
    return turner.lever * (x * uy - y * ux) / math.sqrt(ux * ux + uy * uy + 1e-12)


@jit
def _element(turner, x, y):
    """Return the index of the element at a point, m from the corner of the element under the centre."""
    row, column = int(math.floor(y / turner.element)), int(math.floor(x / turner.element))
    return (2 * turner.reach + 1) * (row + turner.reach) + column + turner.reach


@jit
def aim(turner, scratch, ox, oy, early, late):
    """Set the phasors that maximise the weighted angular acceleration along the path in ``scratch``.

    The weights are ``early`` at the start and ``late`` at the end of the period. The objective is linear in the phasors along a
    given path, so each element's phasor is its gradient at full amplitude.
    """
    steps, n = scratch.spin.shape[0], turner.points.shape[0]
    c, s = scratch.c, scratch.s
    for e in range(c.shape[0]):
        c[e], s[e] = 0.0, 0.0
    for k in range(steps):
        at = (k + 0.5) / steps
        co, si = math.cos(2.0 * math.pi * at), math.sin(2.0 * math.pi * at)
        vx, vy = co * turner.idle[0] - si * turner.idle[1], si * turner.idle[0] + co * turner.idle[1]
        weight, spin = early * (1.0 - at) + late * at, scratch.spin[k]
        cp, sp = math.cos(scratch.heading[k]), math.sin(scratch.heading[k])
        for i in range(n):
            px, py = turner.points[i, 0], turner.points[i, 1]
            x, y = cp * px - sp * py, sp * px + cp * py
            torque = weight * _torque(turner, x, y, vx, vy, spin, -turner.speed * si, turner.speed * co)
            e = _element(turner, x + ox, y + oy)
            c[e] -= co * torque
            s[e] += si * torque
    for e in range(c.shape[0]):
        size = math.sqrt(c[e] * c[e] + s[e] * s[e])
        scale = turner.most / size if size > 0.0 else 0.0
        c[e], s[e] = scale * c[e], scale * s[e]


@jit
def follow(turner, scratch, ox, oy, heading, spin, share):
    """Integrate a period with a share of the phasors in ``scratch``; write the path there, return turn and spin."""
    steps, n = scratch.spin.shape[0], turner.points.shape[0]
    h = turner.period / steps
    turned = 0.0
    rate = 0.0
    for k in range(steps):
        at = (k + 0.5) / steps
        co, si = math.cos(2.0 * math.pi * at), math.sin(2.0 * math.pi * at)
        vx, vy = co * turner.idle[0] - si * turner.idle[1], si * turner.idle[0] + co * turner.idle[1]
        middle = spin + 0.5 * h * rate
        there = heading + turned + 0.5 * h * spin + 0.125 * h * h * rate
        scratch.spin[k], scratch.heading[k] = middle, there
        cp, sp = math.cos(there), math.sin(there)
        rate = 0.0
        for i in range(n):
            px, py = turner.points[i, 0], turner.points[i, 1]
            x, y = cp * px - sp * py, sp * px + cp * py
            torque = _torque(turner, x, y, vx, vy, middle, -turner.speed * si, turner.speed * co)
            e = _element(turner, x + ox, y + oy)
            rate += torque * (turner.gravity + share * (scratch.s[e] * si - scratch.c[e] * co))
        rate /= n
        turned += h * spin + 0.5 * h * h * rate
        spin += h * rate
    return turned, spin


@jit
def turns(turner, scratch, offsets, weights, shares, headings, spins, gain, after):
    """Compute turn and spin after a period from every heading and spin, for every control at its best offset.

    Args:
        offsets: (m, 2) m, positions of the centre of mass in its element.
        weights: (controls, 2) early and late weights, see :func:`aim`.
        shares: (controls,) shares of the amplitude.
        headings, spins: (h,), (w,) rad, rad/s.
        gain, after: (h, w, controls) overwritten: rad, rad/s.
    """
    h = turner.period
    steps = scratch.spin.shape[0]
    for a in range(headings.shape[0]):
        for b in range(spins.shape[0]):
            for k in range(weights.shape[0]):
                best = -math.inf
                early, late = weights[k, 0], weights[k, 1]
                for m in range(offsets.shape[0]):
                    ox, oy = offsets[m, 0], offsets[m, 1]
                    for i in range(steps):
                        scratch.spin[i] = spins[b]
                        scratch.heading[i] = headings[a] + (i + 0.5) / steps * h * spins[b]
                    for _ in range(2):
                        aim(turner, scratch, ox, oy, early, late)
                        turned, spin = follow(turner, scratch, ox, oy, headings[a], spins[b], shares[k])
                    # integral of the weights, by parts: late times the spin, the difference times the turn
                    worth = late * (spin - spins[b]) + (early - late) * (turned / h - spins[b])
                    if worth > best:
                        best = worth
                        gain[a, b, k], after[a, b, k] = turned, spin


@jit
def _friction(load, speed, co, si, c, s, vx, vy):
    """Return the acceleration of a part on elements in unison; ``load``: friction, and friction times gravity."""
    ux, uy = -speed * si - vx, speed * co - vy
    pull = (load[1] + load[0] * (s * si - c * co)) / math.sqrt(ux * ux + uy * uy + 1e-12)
    return pull * ux, pull * uy


@jit
def moves(friction, gravity, speed, period, cosine, sine, velocity, phasor, travelled, after):
    """Compute displacement and velocity after a period by the classical Runge-Kutta method.

    Args:
        cosine, sine: (2 steps + 1,) of wt at the start, the middle and the end of every step.
        velocity: (n, 2) m/s at the start of the period.
        phasor: (controls, 2) C and S of all elements, m/s^2.
        travelled, after: (n, controls, 2) overwritten: m, m/s.
    """
    steps = cosine.shape[0] // 2
    h, load = period / steps, (friction, friction * gravity)
    for i in range(velocity.shape[0]):
        for j in range(phasor.shape[0]):
            c, s, vx, vy, x, y = phasor[j, 0], phasor[j, 1], velocity[i, 0], velocity[i, 1], 0.0, 0.0
            for k in range(0, 2 * steps, 2):
                c0, s0, c1, s1, c2, s2 = cosine[k], sine[k], cosine[k + 1], sine[k + 1], cosine[k + 2], sine[k + 2]
                ax, ay = _friction(load, speed, c0, s0, c, s, vx, vy)
                bx, by = _friction(load, speed, c1, s1, c, s, vx + 0.5 * h * ax, vy + 0.5 * h * ay)
                dx, dy = _friction(load, speed, c1, s1, c, s, vx + 0.5 * h * bx, vy + 0.5 * h * by)
                ex, ey = _friction(load, speed, c2, s2, c, s, vx + h * dx, vy + h * dy)
                x += h * (vx + h / 6.0 * (ax + bx + dx))
                y += h * (vy + h / 6.0 * (ay + by + dy))
                vx += h / 6.0 * (ax + 2.0 * (bx + dx) + ex)
                vy += h / 6.0 * (ay + 2.0 * (by + dy) + ey)
            travelled[i, j, 0], travelled[i, j, 1] = x, y
            after[i, j, 0], after[i, j, 1] = vx, vy
