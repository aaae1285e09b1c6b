"""The camera without its images: a fixed function of the pose as its error, and a little that is new at each look.

The function is smooth noise: standard normal numbers, hashed from the corners of a lattice over (x, y, heading), are blended
between the corners and scaled so that their variance is one everywhere. So the error freezes while a part is at rest.
"""

from __future__ import annotations

import math

import numpy as np

from vibgym.physics.core.jit import borrowing, jit
from vibgym.physics.core.noise import normals
from vibgym.sensing.camera.fitting import ErrorModel
from vibgym.sensing.camera.look import Track

WHITE = 1
"""Last word of the counters of what is new at each look."""

GAP = 0.8
"""px of surface between two parts below which the threshold leaves them in one piece."""


@borrowing
def _mixed(value):
    """A whole number, scrambled (the finaliser of splitmix64, G. Steele et al. 2014)."""
    value = np.uint64(value)
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@borrowing
def _nearly_normal(word):
    """Sum of the four quarters of a word, scaled to variance one: normal to 2 % within two sigma, and at most 3.5."""
    total = 0.0
    for k in range(4):
        total += float((word >> np.uint64(16 * k)) & np.uint64(0xFFFF))
    return (total / 65535.0 - 2.0) * math.sqrt(3.0)


@borrowing
def smooth_noise(x, y, z, kind):
    """Three independent smooth functions of a place in lattice units, of mean 0 and variance 1."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    u, v, w = x - i, y - j, z - k
    first, second, third, squares = 0.0, 0.0, 0.0, 0.0
    for di in range(2):
        for dj in range(2):
            for dk in range(2):
                weight = (u if di else 1.0 - u) * (v if dj else 1.0 - v) * (w if dk else 1.0 - w)
                corner = np.uint64((i + di) & 0x1FFFFF) | (np.uint64((j + dj) & 0x1FFFFF) << np.uint64(21))
                corner |= np.uint64((k + dk) & 0x3FFFFF) << np.uint64(42)
                word = _mixed(corner + np.uint64(kind + 1) * np.uint64(0x9E3779B97F4A7C15))
                first += weight * _nearly_normal(word)
                word = _mixed(word + np.uint64(0x9E3779B97F4A7C15))
                second += weight * _nearly_normal(word)
                word = _mixed(word + np.uint64(0x9E3779B97F4A7C15))
                third += weight * _nearly_normal(word)
                squares += weight * weight
    scale = 1.0 / math.sqrt(squares)
    return scale * first, scale * second, scale * third


@jit
def noise_at(places: np.ndarray, kind: int, values: np.ndarray) -> None:
    """:func:`smooth_noise` for ``places`` (n, 3) into ``values`` (n, 3)."""
    for n in range(places.shape[0]):
        values[n, 0], values[n, 1], values[n, 2] = smooth_noise(places[n, 0], places[n, 1], places[n, 2], kind)


@borrowing
def _to_edge(px, py, ax, ay, bx, by):
    """Squared distance of a point to an edge."""
    ex, ey = bx - ax, by - ay
    t = min(max(((px - ax) * ex + (py - ay) * ey) / (ex * ex + ey * ey), 0.0), 1.0)
    dx, dy = px - ax - t * ex, py - ay - t * ey
    return dx * dx + dy * dy


@borrowing
def _gap(mine, here, theirs, there):
    """Distance of two outlines (n, 2) at poses (3,) that do not overlap, from corners of the one to edges of the other."""
    best = math.inf
    for turn in range(2):
        points, at, edges, on = (mine, here, theirs, there) if turn == 0 else (theirs, there, mine, here)
        c, s = math.cos(at[2]), math.sin(at[2])
        co, so = math.cos(on[2]), math.sin(on[2])
        for k in range(points.shape[0]):
            x = at[0] - on[0] + c * points[k, 0] - s * points[k, 1]
            y = at[1] - on[1] + s * points[k, 0] + c * points[k, 1]
            px, py = co * x + so * y, co * y - so * x
            for n in range(edges.shape[0]):
                best = min(best, _to_edge(px, py, edges[n - 1, 0], edges[n - 1, 1], edges[n, 0], edges[n, 1]))
    return math.sqrt(best)


@borrowing
def _clipped(pose, outline, radius, height, frame, foot):
    """Whether a part's top is seen beyond the frame (4,): least and largest x, least and largest y, m."""
    far = foot[2] / (foot[2] - height)
    x, y = foot[0] + far * (pose[0] - foot[0]), foot[1] + far * (pose[1] - foot[1])
    r = far * radius
    if x - r > frame[0] and x + r < frame[1] and y - r > frame[2] and y + r < frame[3]:
        return False
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(outline.shape[0]):
        cx = x + far * (c * outline[k, 0] - s * outline[k, 1])
        cy = y + far * (s * outline[k, 0] + c * outline[k, 1])
        if not (frame[0] < cx < frame[1] and frame[2] < cy < frame[3]):
            return True
    return False


@borrowing
def _merged(pose, gone, p, shapes, radius, pixel):
    """Whether a part is too near to another one to be told from it."""
    kind = shapes.kind[p]
    mine = shapes.outline[shapes.first[kind] : shapes.first[kind + 1]]
    for other in range(pose.shape[0]):
        if other == p or gone[other]:
            continue
        dx, dy = pose[other, 0] - pose[p, 0], pose[other, 1] - pose[p, 1]
        away = math.hypot(dx, dy)
        theirs = shapes.kind[other]
        least = GAP * math.hypot(pixel[0] * dx, pixel[1] * dy) / max(away, 1e-12)
        if away < radius[kind] + radius[theirs] + least:
            outline = shapes.outline[shapes.first[theirs] : shapes.first[theirs + 1]]
            if _gap(mine, pose[p], outline, pose[other]) < least:
                return True
    return False


@jit
def guess(
    worlds: np.ndarray, pose: np.ndarray, gone: np.ndarray, shapes, radius: np.ndarray, frame: np.ndarray,
    foot: np.ndarray, pixel: np.ndarray, step: float, model: ErrorModel, key: np.ndarray, looks: np.ndarray,
    track: Track, read_pose: np.ndarray, read_velocity: np.ndarray, read_seen: np.ndarray,
) -> None:  # fmt: skip
    """What a look of the camera would say, by the error model; arguments as of :func:`vibgym.sensing.camera.look.look_at`.

    Args:
        frame: (4,) m, what is seen: least and largest x, least and largest y, on the surface.
        pixel: (2,) m, size of a pixel on the surface along columns and lines.
    """
    for w in worlds:
        track.count[w] = 0
        for p in range(pose.shape[1]):
            kind = shapes.kind[p]
            seen = not gone[w, p]
            if seen:
                outline = shapes.outline[shapes.first[kind] : shapes.first[kind + 1]]
                if _clipped(pose[w, p], outline, radius[kind], shapes.height[kind], frame, foot):
                    track.count[w, 2] += 1
                    seen = False
                elif _merged(pose[w], gone[w], p, shapes, radius, pixel):
                    track.count[w, 1] += 1
                    seen = False
            read_seen[w, p] = seen
            if not seen:
                track.missed[w, p] += 1
                for axis in range(3):
                    read_pose[w, p, axis], read_velocity[w, p, axis] = track.pose[w, p, axis], 0.0
                continue
            cell = model.cell[kind]
            x, y, heading = pose[w, p, 0], pose[w, p, 1], pose[w, p, 2]
            f0, f1, f2 = smooth_noise(x / cell[0], y / cell[1], heading / cell[2], kind)
            n0, n1, n2, _ = normals(key[w], looks[w], p, 0, WHITE)
            mean, fixed, white = model.mean[kind], model.fixed[kind], model.white[kind]
            read_pose[w, p, 0] = x + mean[0] + fixed[0] * f0 + white[0] * n0
            read_pose[w, p, 1] = y + mean[1] + fixed[1] * f1 + white[1] * n1
            read_pose[w, p, 2] = heading + mean[2] + fixed[2] * f2 + white[2] * n2
            since = step * (1 + track.missed[w, p])
            for axis in range(3):
                moved = read_pose[w, p, axis] - track.pose[w, p, axis]
                read_velocity[w, p, axis] = moved / since if looks[w] > 0 else 0.0
                track.pose[w, p, axis] = read_pose[w, p, axis]
            track.missed[w, p] = 0
