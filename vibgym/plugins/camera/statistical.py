"""Statistical camera: measurement errors as a fixed function of the pose plus white noise, without images.

The function is smooth noise: standard normal numbers, hashed from the corners of a lattice over (x, y, heading), are blended
between the corners and scaled to variance one everywhere. So the error is constant while a part is at rest. The effect of
motion on interlaced lines is computed, as are parts that merge or leave the image.
"""

from __future__ import annotations

import functools
import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.physics.core.noise import philox
from vibgym.plugins.camera.fitting import ErrorModel
from vibgym.plugins.camera.image import Shapes
from vibgym.plugins.camera.sampling import LOSSES, MERGES, Track
from vibgym.plugins.camera.shapes import Traits, load_kinds

WHITE = 1
"""Last word of the counters of white noise."""

GAP = 0.8
"""px of surface between two parts below which they appear as one object."""

LEVELS = 1024
"""Entries of the table of normal numbers: ten bits."""

_ALONG_X, _ALONG_Y, _ALONG_Z = 0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9
"""Odd increments of a corner's hash along the axes of the lattice."""


class Statistics(NamedTuple):
    """Constants of the camera and its error model, for kernels."""

    shapes: Shapes
    kind: np.ndarray  # (worlds, parts), or one row for all worlds, see vibgym.scene.kinds
    traits: Traits
    model: ErrorModel
    frame: np.ndarray  # (4,) m, visible part of the surface: least and largest x, least and largest y
    foot: np.ndarray  # (3,) m, position of the lens
    pixel: np.ndarray  # (2,) m, size of a pixel on the surface along columns and lines
    step: float  # s from sample to sample
    lag: float  # s by which the odd lines are taken before the even ones
    quantiles: np.ndarray  # (LEVELS,)


@functools.cache
def normal_levels() -> np.ndarray:
    """Return (LEVELS,) normal numbers of equal probability, of variance one."""
    levels = np.array([NormalDist().inv_cdf((k + 0.5) / LEVELS) for k in range(LEVELS)])
    return levels / levels.std()


@jit
def _mixed(value):
    """Return the hash of an integer (the finaliser of splitmix64, G. Steele et al. 2014)."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@jit
def _level(word, bits, quantiles):
    """Return the normal number of ten bits of a word."""
    return quantiles[np.int64((word >> np.uint64(bits)) & np.uint64(LEVELS - 1))]


@jit
def smooth_noise(x, y, z, kind, quantiles):
    """Return three independent smooth functions of a position in lattice units, of mean 0 and variance 1.

    A cube of the lattice is cut into six simplices, in which the numbers at four corners are blended linearly (K. Perlin 2001).
    """
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    u, v, w = x - i, y - j, z - k
    ax, ay, az = np.uint64(_ALONG_X), np.uint64(_ALONG_Y), np.uint64(_ALONG_Z)
    here = np.uint64(i) * ax + np.uint64(j) * ay + np.uint64(k) * az + _mixed(np.uint64(kind + 1))
    # From the first corner along the axis of the largest coordinate, then the next, then the last.
    largest = ax if u >= v and u >= w else (ay if v >= w else az)
    least = az if w <= v and w <= u else (ay if v <= u else ax)
    high, low = max(u, v, w), min(u, v, w)
    middle = u + v + w - high - low
    there = here + ax + ay + az
    a, b, c, d = _mixed(here), _mixed(here + largest), _mixed(there - least), _mixed(there)
    p, q, r, s = 1.0 - high, high - middle, middle - low, low
    scale = 1.0 / math.sqrt(p * p + q * q + r * r + s * s)
    p, q, r, s = scale * p, scale * q, scale * r, scale * s
    first = p * _level(a, 0, quantiles) + q * _level(b, 0, quantiles)
    first += r * _level(c, 0, quantiles) + s * _level(d, 0, quantiles)
    second = p * _level(a, 10, quantiles) + q * _level(b, 10, quantiles)
    second += r * _level(c, 10, quantiles) + s * _level(d, 10, quantiles)
    third = p * _level(a, 20, quantiles) + q * _level(b, 20, quantiles)
    third += r * _level(c, 20, quantiles) + s * _level(d, 20, quantiles)
    return first, second, third


@jit
def white_noise(key, sample, part, quantiles):
    """Return three independent normal numbers of variance 1, new at each sample; each is a sum of two from the table."""
    a, b, c, _ = philox(key, sample, part, 0, WHITE)
    scale = math.sqrt(0.5)
    return (
        scale * (quantiles[a & (LEVELS - 1)] + quantiles[a >> 22]),
        scale * (quantiles[b & (LEVELS - 1)] + quantiles[b >> 22]),
        scale * (quantiles[c & (LEVELS - 1)] + quantiles[c >> 22]),
    )


@jit
def turned(order, strength, phase, along, across, turn):
    """Return the measured rotation of an image of two halves, of which one is shifted and rotated.

    With n-fold symmetry E[(z + e)^n], averaged over +e and -e, is E[z^n] + e^n for even n: the moment that defines the heading
    (:func:`vibgym.plugins.camera.edges.complex_moment`) is that of both halves about their common centre.

    Args:
        order: n.  strength, phase: of E[z^n] at heading 0, m^n and rad.
        along, across: e, half of the shift, along the heading and across it, m.
        turn: negative rotation of that half, rad.
    """
    re, im = 0.5 * (1.0 + math.cos(order * turn)), -0.5 * math.sin(order * turn)
    if order % 2 == 0:
        a, b = 1.0, 0.0
        for _ in range(order):
            a, b = a * along - b * across, a * across + b * along
        c, s = math.cos(phase) / strength, math.sin(phase) / strength
        re += c * a + s * b
        im += c * b - s * a
    return math.atan2(im, re) / order


@jit
def _to_edge(px, py, ax, ay, bx, by):
    """Return squared distance of a point to an edge."""
    ex, ey = bx - ax, by - ay
    t = min(max(((px - ax) * ex + (py - ay) * ey) / (ex * ex + ey * ey), 0.0), 1.0)
    dx, dy = px - ax - t * ex, py - ay - t * ey
    return dx * dx + dy * dy


@jit
def _gap(mine, here, theirs, there):
    """Return the distance of two disjoint outlines (n, 2) at poses (3,), corners to edges."""
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


@jit
def _clipped(pose, outline, radius, height, frame, foot):
    """Return whether a part's top appears beyond the frame (4,): least and largest x, least and largest y, m."""
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


@jit
def _merged(pose, gone, p, shapes, radius, pixel):
    """Return whether a part is too near to another one to be resolved."""
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


@jit(allocates=True)
def guess(
    worlds: np.ndarray, pose: np.ndarray, mean_velocity: np.ndarray, gone: np.ndarray, known: Statistics,
    key: np.ndarray, samples: np.ndarray, track: Track, read_pose: np.ndarray, read_velocity: np.ndarray,
    read_seen: np.ndarray,
) -> None:  # fmt: skip
    """Sample poses by the error model; arguments as of :func:`vibgym.plugins.camera.sampling.take_samples`.

    Args:
        pose, mean_velocity: (worlds, parts, 3) true ones.  gone: (worlds, parts) bool, parts that are not on the surface.
    """
    shapes, model, traits, quantiles = known.shapes, known.model, known.traits, known.quantiles
    for w in worlds:
        load_kinds(known.kind, w, shapes.kind)
        track.count[w] = 0
        for p in range(pose.shape[1]):
            kind = shapes.kind[p]
            x, y, heading = pose[w, p, 0], pose[w, p, 1], pose[w, p, 2]
            seen = not gone[w, p] and abs(x) + abs(y) + abs(heading) < math.inf
            if seen:
                outline = shapes.outline[shapes.first[kind] : shapes.first[kind + 1]]
                if _clipped(pose[w, p], outline, traits.radius[kind], shapes.height[kind], known.frame, known.foot):
                    track.count[w, LOSSES] += 1
                    seen = False
                elif pose.shape[1] > 1 and _merged(pose[w], gone[w], p, shapes, traits.radius, known.pixel):
                    track.count[w, MERGES] += 1
                    seen = False
            read_seen[w, p] = seen
            if not seen:
                track.missed[w, p] += 1
                for axis in range(3):
                    read_pose[w, p, axis], read_velocity[w, p, axis] = track.pose[w, p, axis], 0.0
                continue
            cell, mean, fixed, white = model.cell[kind], model.mean[kind], model.fixed[kind], model.white[kind]
            f0, f1, f2 = smooth_noise(x / cell[0], y / cell[1], heading / cell[2], kind, quantiles)
            n0, n1, n2 = white_noise(key[w], samples[w], p, quantiles)
            if known.lag > 0.0:
                dx, dy = 0.5 * known.lag * mean_velocity[w, p, 0], 0.5 * known.lag * mean_velocity[w, p, 1]
                x, y = x - dx, y - dy
                if traits.order[kind] > 0:
                    c, s = math.cos(heading), math.sin(heading)
                    heading += turned(
                        traits.order[kind], traits.strength[kind], traits.phase[kind], c * dx + s * dy, c * dy - s * dx,
                        known.lag * mean_velocity[w, p, 2],
                    )  # fmt: skip
            read_pose[w, p, 0] = x + mean[0] + fixed[0] * f0 + white[0] * n0
            read_pose[w, p, 1] = y + mean[1] + fixed[1] * f1 + white[1] * n1
            read_pose[w, p, 2] = heading + mean[2] + fixed[2] * f2 + white[2] * n2
            rate = 1.0 / (known.step * (1 + track.missed[w, p])) if samples[w] > 0 else 0.0
            for axis in range(3):
                read_velocity[w, p, axis] = rate * (read_pose[w, p, axis] - track.pose[w, p, axis])
                track.pose[w, p, axis] = read_pose[w, p, axis]
            track.missed[w, p] = 0
