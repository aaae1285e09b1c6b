"""What one oscillation period does to the velocity of a part without spin: the thesis's eqs. 3.26 and 3.27, in time."""

from __future__ import annotations

import math

from vibgym.kernels.jit import borrowing, jit


@borrowing
def _friction(load, speed, co, si, c, s, vx, vy):
    """Acceleration of a part on elements that all do the same; ``load``: friction and friction times gravity."""
    ux, uy = -speed * si - vx, speed * co - vy
    pull = (load[1] + load[0] * (s * si - c * co)) / math.sqrt(ux * ux + uy * uy + 1e-12)
    return pull * ux, pull * uy


@jit
def moves(friction, gravity, speed, period, cosine, sine, velocity, phasor, travelled, after):
    """Way and velocity after a period, by the classic Runge-Kutta rule.

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
