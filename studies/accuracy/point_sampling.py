"""Peer: point sampling with classical Runge-Kutta steps, compiled and vectorised.

Weighted points cover the contact area and move with the part; at every stage the friction at all points is summed. Forces jump
when a point crosses an element's edge, so the error decreases slowly with the number of points. The kernel is optimised: a
branch-free inner loop over points, normal accelerations once a stage and only for elements under the part, one rotation of the
part a stage without trigonometry, ``1/|u|`` from the single-precision estimate and one Newton step, worlds one after the other
for the cache.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vibgym.kernels.jit import jit

_TINY = 1e-30  # (m/s)^2; avoids 0/0 at a point at rest relative to the table


def strew(outline: Any, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return about ``n x n`` points x, y and weights (sum 1) over a simple polygon; moments exact to second order in ``1/n``.

    The polygon is sliced at its corners' heights; each slice is cut into strips and every strip's chords into equal
    cells.
    """
    outline = np.asarray(outline, dtype=float)
    there = np.roll(outline, -1, axis=0)
    levels = np.unique(outline[:, 1])
    total = levels[-1] - levels[0]
    xs, ys, weights = [], [], []
    for low, high in zip(levels[:-1], levels[1:], strict=True):
        strips = max(2, round(n * (high - low) / total))
        for y in low + (np.arange(strips) + 0.5) * (high - low) / strips:
            a, b = outline[:, 1], there[:, 1]
            cut = (a > y) != (b > y)
            at = outline[cut, 0] + (y - a[cut]) / (b[cut] - a[cut]) * (there[cut, 0] - outline[cut, 0])
            at.sort()
            chords = at.reshape(-1, 2)
            for left, right in chords:
                cells = max(2, round(n / len(chords)))
                xs.append(left + (np.arange(cells) + 0.5) * (right - left) / cells)
                ys.append(np.full(cells, y))
                weights.append(np.full(cells, (right - left) * (high - low) / strips / cells))
    weight = np.concatenate(weights)
    return np.concatenate(xs), np.concatenate(ys), weight / weight.sum()


def strew_disc(radius: float, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points and weights over a disc: ``n / 2`` rings of equal width with ``2 n`` points each."""
    rings, spokes = max(2, n // 2), 2 * n
    ring = (np.arange(rings) + 0.5) / rings
    angle = (np.arange(spokes) + 0.5) * 2.0 * math.pi / spokes
    r, phi = np.meshgrid(ring, angle)
    return radius * (r * np.cos(phi)).ravel(), radius * (r * np.sin(phi)).ravel(), (r / r.sum()).ravel()


def simulate(
    surface: Any,
    part: Any,
    pose: Any,
    velocity: Any,
    amplitude: Any,
    phase: Any,
    periods: int,
    *,
    points: int = 12,
    steps: int = 12,
) -> tuple[np.ndarray, np.ndarray]:
    """Return pose and velocity, each (worlds, 3), of sliding parts after whole periods under a held drive; one thread.

    A part that passes a whole element in one step is not covered by the scheme and becomes NaN.

    Args:
        surface, part: a ``Surface`` and a ``Part`` of ``vibgym.scene``.
        pose, velocity: (worlds, 3) at the start, m and rad, m/s and rad/s.
        amplitude, phase: broadcastable to (worlds, rows, columns), m and rad.
        periods: duration.
        points: per side: ``points x points`` over the part.
        steps: Runge-Kutta steps per period.
    """
    shape = (len(pose), surface.rows, surface.columns)
    amplitude, phase = np.broadcast_to(amplitude, shape), np.broadcast_to(phase, shape)
    turns = part.symmetry != 0
    x, y, weight = strew(part.outline, points) if turns else strew_disc(math.sqrt(part.area / math.pi), points)
    acceleration = amplitude * surface.angular_frequency**2
    angle = np.arange(2 * steps + 1) * (math.pi / steps)
    state = np.concatenate([pose, velocity], axis=1, dtype=float)
    _advance(
        state, acceleration * np.cos(phase), acceleration * np.sin(phase), x, y, weight, float(np.hypot(x, y).max()),
        part.friction, part.gyration, turns, surface.element_size, surface.gravity, surface.table_speed,
        surface.period / steps, periods, np.cos(angle), np.sin(angle),
    )  # fmt: skip
    return state[:, :3], state[:, 3:]


@jit
def _turn(cosine, sine, angle):
    """Return the unit vector rotated by an angle, by a series for small angles."""
    if abs(angle) > 0.25:
        c, s = math.cos(angle), math.sin(angle)
    else:
        q = angle * angle
        c = 1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0 * (1.0 - q / 90.0))))
        s = angle * (1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0))))
    return c * cosine - s * sine, s * cosine + c * sine


@jit
def _friction(
    left, low, cosine, sine, slip_x, slip_y, spin, drive_c, drive_s, px, py, weight, pitch, across, down, inside, still,
    element_c, element_s, normal,
):  # fmt: skip
    """Return force and torque per unit mass and friction coefficient.

    ``left, low`` is the centre of mass in units of elements from the corner of the box of elements ``across x down``.
    """
    for e in range(across * down):
        normal[e] = still[e] - drive_c * element_c[e] + drive_s * element_s[e]
    force_x, force_y, torque = 0.0, 0.0, 0.0
    stride = np.int32(across)
    for k in range(px.shape[0]):
        rx = cosine * px[k] - sine * py[k]
        ry = sine * px[k] + cosine * py[k]
        element = np.int32(left + rx * pitch) + stride * np.int32(low + ry * pitch)
        ux = slip_x + spin * ry
        uy = slip_y - spin * rx
        square = ux * ux + uy * uy + _TINY
        inverse = np.float64(np.float32(1.0) / np.sqrt(np.float32(square)))
        inverse *= 1.5 - 0.5 * square * inverse * inverse
        stress = weight[k] * normal[element] * inverse
        ux *= stress
        uy *= stress
        force_x += ux
        force_y += uy
        torque += rx * uy - ry * ux
    if not inside:
        carried = 0.0
        for k in range(px.shape[0]):
            rx = cosine * px[k] - sine * py[k]
            ry = sine * px[k] + cosine * py[k]
            if still[np.int32(left + rx * pitch) + stride * np.int32(low + ry * pitch)] > 0.0:
                carried += weight[k]
        share = 1.0 / carried if carried > 0.0 else 0.0
        return force_x * share, force_y * share, torque * share
    return force_x, force_y, torque


@jit(allocates=True)
def _advance(
    state,
    phasor_c,
    phasor_s,
    px,
    py,
    weight,
    reach,
    mu,
    gyration,
    turns,
    size,
    gravity,
    speed,
    h,
    periods,
    cosines,
    sines,
):
    """Advance all worlds, changing ``state`` (worlds, 6) in place."""
    most = int(2.0 * reach / size) + 5  # an element more on either side, for the displacement in a step
    normal, still = np.empty(most * most), np.empty(most * most)
    element_c, element_s = np.empty(most * most), np.empty(most * most)
    pitch = 1.0 / size
    rows, columns = phasor_c.shape[1], phasor_c.shape[2]
    steps = cosines.shape[0] // 2
    lever = mu / gyration
    for world in range(state.shape[0]):
        x, y, heading = state[world, 0], state[world, 1], state[world, 2]
        vx, vy, spin = state[world, 3], state[world, 4], state[world, 5]
        for _ in range(periods):
            cosine, sine = 1.0, 0.0
            if turns:
                cosine, sine = math.cos(heading), math.sin(heading)
            for step in range(steps):
                c0, s0 = cosines[2 * step], sines[2 * step]
                c1, s1 = cosines[2 * step + 1], sines[2 * step + 1]
                c2, s2 = cosines[2 * step + 2], sines[2 * step + 2]
                half = 0.5 * h
                # The elements that the part can touch during the step. An acceleration is at most 2 mu g.
                margin = h * (math.sqrt(vx * vx + vy * vy) + 2.0 * h * mu * gravity)
                if not margin < size or not abs(heading + spin) < math.inf:
                    x, y, heading, vx, vy, spin = math.nan, math.nan, math.nan, math.nan, math.nan, math.nan
                    break  # the periods that follow end here as well
                box = reach + margin
                column0, row0 = int(math.floor((x - box) * pitch)), int(math.floor((y - box) * pitch))
                across = int(math.floor((x + box) * pitch)) - column0 + 1
                down = int(math.floor((y + box) * pitch)) - row0 + 1
                inside = row0 >= 0 and column0 >= 0 and row0 + down <= rows and column0 + across <= columns
                for i in range(down):
                    row = row0 + i
                    for j in range(across):
                        e, column = i * across + j, column0 + j
                        element_c[e], element_s[e], still[e] = 0.0, 0.0, 0.0
                        if row >= 0 and column >= 0 and row < rows and column < columns:
                            element_c[e], element_s[e] = phasor_c[world, row, column], phasor_s[world, row, column]
                            still[e] = gravity
                ax, ay, aw = _friction(
                    x * pitch - column0, y * pitch - row0, cosine, sine, -speed * s0 - vx, speed * c0 - vy, spin, c0, s0,
                    px, py, weight, pitch, across, down, inside, still, element_c, element_s, normal,
                )  # fmt: skip
                ax, ay, aw = mu * ax, mu * ay, lever * aw
                c, s = cosine, sine
                if turns:
                    c, s = _turn(cosine, sine, half * spin)
                ux, uy, uw = vx + half * ax, vy + half * ay, spin + half * aw
                bx, by, bw = _friction(
                    (x + half * vx) * pitch - column0, (y + half * vy) * pitch - row0, c, s,
                    -speed * s1 - ux, speed * c1 - uy, uw, c1, s1,
                    px, py, weight, pitch, across, down, inside, still, element_c, element_s, normal,
                )  # fmt: skip
                bx, by, bw = mu * bx, mu * by, lever * bw
                if turns:
                    c, s = _turn(cosine, sine, half * uw)
                wx, wy, ww = vx + half * bx, vy + half * by, spin + half * bw
                dx, dy, dw = _friction(
                    (x + half * ux) * pitch - column0, (y + half * uy) * pitch - row0, c, s,
                    -speed * s1 - wx, speed * c1 - wy, ww, c1, s1,
                    px, py, weight, pitch, across, down, inside, still, element_c, element_s, normal,
                )  # fmt: skip
                dx, dy, dw = mu * dx, mu * dy, lever * dw
                if turns:
                    c, s = _turn(cosine, sine, h * ww)
                ex, ey, ew = _friction(
                    (x + h * wx) * pitch - column0, (y + h * wy) * pitch - row0, c, s,
                    -speed * s2 - (vx + h * dx), speed * c2 - (vy + h * dy), spin + h * dw, c2, s2,
                    px, py, weight, pitch, across, down, inside, still, element_c, element_s, normal,
                )  # fmt: skip
                ex, ey, ew = mu * ex, mu * ey, lever * ew
                turn = h * (spin + h / 6.0 * (aw + bw + dw))
                x += h * (vx + h / 6.0 * (ax + bx + dx))
                y += h * (vy + h / 6.0 * (ay + by + dy))
                heading += turn
                vx += h / 6.0 * (ax + 2.0 * (bx + dx) + ex)
                vy += h / 6.0 * (ay + 2.0 * (by + dy) + ey)
                spin += h / 6.0 * (aw + 2.0 * (bw + dw) + ew)
                if turns:
                    cosine, sine = _turn(cosine, sine, turn)
        state[world, 0], state[world, 1], state[world, 2] = x, y, heading
        state[world, 3], state[world, 4], state[world, 5] = vx, vy, spin
