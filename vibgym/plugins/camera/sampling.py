"""A sample of the camera: image, objects, measurements, and assignment of objects to parts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.physics.core.assignment import assign
from vibgym.plugins.camera.calibration import Grid, at_height, locate
from vibgym.plugins.camera.edges import Grey, complex_moment, share_moments, shares
from vibgym.plugins.camera.image import Canvas, Exposure, Shapes, draw, wipe
from vibgym.plugins.camera.objects import Found, Interest, find, new_found
from vibgym.plugins.camera.optics import Optics
from vibgym.plugins.camera.shapes import Traits, load_kinds

FAR = 1e9
"""Cost of impossible pairs."""

NO_PAIR = 60.0
"""Cost of a part without an object, and therefore the largest cost of a pair."""

X, Y, M00, XX, XY, YY, JACOBIAN = 0, 1, 2, 3, 4, 5, 6
"""Columns of :class:`Seen`'s ``measure``."""

MISHAPS = ("swaps", "merges", "losses")
"""Errors of a sample, columns of :class:`Track`'s ``count``: parts mistaken for others, that appear as one object, lost."""

SWAPS, MERGES, LOSSES = range(len(MISHAPS))

COASTING = 2
"""Samples over which a part's velocity is extrapolated."""


class Rig(NamedTuple):
    """Camera and scene."""

    optics: Optics
    shapes: Shapes
    exposure: Exposure
    background: np.ndarray  # (lines, columns) uint8, the empty surface
    kind: np.ndarray  # (worlds, parts), or one row for all worlds, see vibgym.scene.kinds


class Knowledge(NamedTuple):
    """Data of the image processing: nominal camera, calibration by the template's image, and parts."""

    interest: Interest
    meaning: Grey
    grid: Grid
    traits: Traits
    foot: np.ndarray  # (3,) m, position of the lens
    grain: float  # m, size of a pixel on the surface, the larger of both
    aperture: np.ndarray  # (2,) px^2, variance added by the pixel size and the blur, columns and lines
    reach: float  # m, largest distance of a part from its expected position
    speed: float  # m/s, growth of that distance with the time since the part was last seen
    step: float  # s from sample to sample


class Seen(NamedTuple):
    """Working arrays of a sample of one world."""

    canvas: Canvas
    found: Found
    boxes: np.ndarray  # (parts, 2, 4) int64
    measure: np.ndarray  # (objects, 10): position on the surface, area in px, central moments over area, Jacobian
    expected: np.ndarray  # (parts, 3) predicted pose
    cost: np.ndarray  # (parts, objects + parts)
    column_of: np.ndarray  # (parts,) object of each part, -1 for none


class Track(NamedTuple):
    """Tracks of the parts."""

    pose: np.ndarray  # (worlds, parts, 3) when it was last seen
    velocity: np.ndarray  # (worlds, parts, 3) then, m/s, m/s, rad/s
    missed: np.ndarray  # (worlds, parts) int64 samples since then
    count: np.ndarray  # (worlds, 3) int64 errors of the last sample, see :data:`MISHAPS`


def new_seen(shape: tuple[int, int], parts: int, background: np.ndarray) -> Seen:
    """Return working arrays for an image of ``shape`` with ``parts`` parts."""
    objects = 4 * parts + 16
    canvas = Canvas(np.ones(shape, dtype=np.float32), background.copy())
    return Seen(
        canvas,
        new_found(shape, objects),
        np.zeros((parts, 2, 4), dtype=np.int64),
        np.zeros((objects, 10)),
        np.zeros((parts, 3)),
        np.zeros((parts, objects + parts)),
        np.zeros(parts, dtype=np.int64),
    )


def new_track(worlds: int, parts: int) -> Track:
    """Return empty tracks."""
    shape = (worlds, parts)
    return Track(
        np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape, dtype=np.int64), np.zeros((worlds, 3), np.int64)
    )


@jit(allocates=True)
def measure_object(grey: np.ndarray, known: Knowledge, blobs: Found, number: int, measure: np.ndarray) -> None:
    """Write the measurements of an object, see :class:`Seen`; moments are transformed by the Jacobian at the centroid."""
    moment = blobs.moment[number]
    if known.meaning.fine:
        share, top, left = shares(grey, known.meaning, blobs, number)
        share_moments(share, top, left, moment)
    u, v = moment[1] / moment[0], moment[2] / moment[0]
    measure[X], measure[Y] = locate(known.grid, u, v, measure[JACOBIAN:])
    measure[M00] = moment[0]
    measure[XX] = moment[3] / moment[0] - u * u - known.aperture[0]
    measure[XY] = moment[4] / moment[0] - u * v
    measure[YY] = moment[5] / moment[0] - v * v - known.aperture[1]


@jit
def on_surface(measure, nearer):
    """Return area (m^2) and second moments over it (m^2: xx, xy, yy) at a height with scale ``nearer``."""
    a, b, c, d = measure[JACOBIAN], measure[JACOBIAN + 1], measure[JACOBIAN + 2], measure[JACOBIAN + 3]
    uu, uv, vv = measure[XX], measure[XY], measure[YY]
    scale = nearer * nearer
    xx = scale * (a * a * uu + 2.0 * a * b * uv + b * b * vv)
    xy = scale * (a * c * uu + (a * d + b * c) * uv + b * d * vv)
    yy = scale * (c * c * uu + 2.0 * c * d * uv + d * d * vv)
    return scale * abs(a * d - b * c) * measure[M00], xx, xy, yy


@jit(allocates=True)
def heading_of(grey: np.ndarray, known: Knowledge, blobs: Found, number: int, measure: np.ndarray, kind: int) -> float:
    """Return the heading of an object that is a part of this kind, modulo the symmetry."""
    order = known.traits.order[kind]
    if order == 2:
        _, xx, xy, yy = on_surface(measure, 1.0)
        return 0.5 * (math.atan2(2.0 * xy, xx - yy) - known.traits.phase[kind])
    share, top, left = shares(grey, known.meaning, blobs, number)
    m = blobs.moment[number]
    re, im = complex_moment(share, top, left, m[1] / m[0], m[2] / m[0], measure[JACOBIAN:], order)
    return (math.atan2(im, re) - known.traits.phase[kind]) / order


@jit
def _place(known, measure, kind):
    """Return (x, y) of an object, assuming a part of this kind."""
    foot = known.foot
    return at_height(measure[X], measure[Y], foot[0], foot[1], foot[2], known.traits.height[kind])


@jit
def _match(known, missed, shown, seen):
    """Assign an object to every part: ``seen.column_of``, -1 for none."""
    objects, parts = seen.found.count[0], shown.shape[0]
    traits = known.traits
    # Each part has an extra column for "no object".
    cost = seen.cost[:, : objects + parts]
    for p in range(parts):
        kind = traits.kind[p]
        gate = known.reach + known.speed * known.step * (1 + missed[p])
        nearer = (known.foot[2] - traits.height[kind]) / known.foot[2]
        for k in range(objects + parts):
            cost[p, k] = FAR
        cost[p, objects + p] = NO_PAIR
        if shown[p]:
            for k in range(objects):
                if not seen.found.clipped[k]:
                    measure = seen.measure[k]
                    x, y = _place(known, measure, kind)
                    away = math.hypot(x - seen.expected[p, 0], y - seen.expected[p, 1])
                    area, xx, xy, yy = on_surface(measure, nearer)
                    spread = xx + yy
                    elongation = math.hypot(xx - yy, 2.0 * xy) / max(spread, 1e-30)
                    cost[p, k] = unlikeness(away, gate, area, spread, elongation, known.grain, traits, kind)
    assign(cost, seen.column_of)
    for p in range(parts):
        if seen.column_of[p] >= objects:
            seen.column_of[p] = -1


@jit
def _is_merged(known, p, shown, seen):
    """Return whether a part without an object and another one are inside the same unassigned object."""
    for k in range(seen.found.count[0]):
        taken = False
        for other in range(shown.shape[0]):
            taken = taken or seen.column_of[other] == k
        if taken:
            continue
        box = seen.found.box[k]
        measure = seen.measure[k]
        a, b, c, d = measure[JACOBIAN], measure[JACOBIAN + 1], measure[JACOBIAN + 2], measure[JACOBIAN + 3]
        tall, wide = box[1] - box[0], box[3] - box[2]
        half = 0.5 * max(math.hypot(a * wide + b * tall, c * wide + d * tall),
                         math.hypot(a * wide - b * tall, c * wide - d * tall))  # fmt: skip
        within, mine = 0, False
        for other in range(shown.shape[0]):
            if shown[other] and seen.column_of[other] < 0:
                x, y = _place(known, measure, known.traits.kind[other])
                if math.hypot(x - seen.expected[other, 0], y - seen.expected[other, 1]) < half:
                    within += 1
                    mine = mine or other == p
        if mine and within > 1:
            return True
    return False


@jit
def _swapped(pose, x, y, p, shown):
    """Return whether another part is nearer to the measured position of part ``p`` than part ``p``."""
    nearest, least = p, math.hypot(pose[p, 0] - x, pose[p, 1] - y)
    for other in range(pose.shape[0]):
        if shown[other]:
            away = math.hypot(pose[other, 0] - x, pose[other, 1] - y)
            if away < least:
                nearest, least = other, away
    return nearest != p


@jit(allocates=True)
def take_samples(
    worlds: np.ndarray, pose: np.ndarray, earlier: np.ndarray, shown: np.ndarray, rig: Rig, known: Knowledge,
    key: np.ndarray, samples: np.ndarray, seen: Seen, track: Track, read_pose: np.ndarray, read_velocity: np.ndarray,
    read_seen: np.ndarray,
) -> None:  # fmt: skip
    """Sample ``worlds`` (index array) in order.

    Args:
        pose: (worlds, parts, 3) true poses.  earlier: when the odd lines were taken, or (worlds, 0, 3).
        shown: (worlds, parts) bool, parts that are on the surface.
        key: (worlds, 2).  samples: (worlds,) number of this sample; at 0 the tracks are the true poses.
        seen: working arrays.  track: overwritten.
        read_pose, read_velocity, read_seen: of the reading, overwritten.
    """
    for w in worlds:
        parts = pose.shape[1]
        load_kinds(rig.kind, w, rig.shapes.kind)
        draw(
            rig.optics, rig.shapes, rig.exposure, pose[w], earlier[w], shown[w], key[w], samples[w], seen.canvas,
            seen.boxes,
        )  # fmt: skip
        find(seen.canvas.grey, known.interest, seen.found)
        for k in range(seen.found.count[0]):
            measure_object(seen.canvas.grey, known, seen.found, k, seen.measure[k])
        for p in range(parts):
            # A part that was missed for long has probably hit another one: its old velocity is no longer valid.
            since = known.step * min(1 + track.missed[w, p], COASTING) if samples[w] > 0 else 0.0
            for axis in range(3):
                seen.expected[p, axis] = track.pose[w, p, axis] + since * track.velocity[w, p, axis]
        _match(known, track.missed[w], shown[w], seen)
        track.count[w] = 0
        for p in range(parts):
            k, kind = seen.column_of[p], known.traits.kind[p]
            read_seen[w, p] = k >= 0
            if k < 0:
                track.missed[w, p] += 1
                if shown[w, p]:
                    merged = _is_merged(known, p, shown[w], seen)
                    track.count[w, MERGES if merged else LOSSES] += 1
                for axis in range(3):
                    read_pose[w, p, axis], read_velocity[w, p, axis] = track.pose[w, p, axis], 0.0
                continue
            x, y = _place(known, seen.measure[k], kind)
            heading = track.pose[w, p, 2]
            if known.traits.order[kind] > 0:
                apart = 2.0 * math.pi / known.traits.order[kind]
                heading = heading_of(seen.canvas.grey, known, seen.found, k, seen.measure[k], kind)
                heading = nearest_heading(heading, apart, seen.expected[p, 2])
            since = known.step * (1 + track.missed[w, p])
            read_pose[w, p, 0], read_pose[w, p, 1], read_pose[w, p, 2] = x, y, heading
            for axis in range(3):
                moved = read_pose[w, p, axis] - track.pose[w, p, axis]
                read_velocity[w, p, axis] = moved / since if samples[w] > 0 else 0.0
                track.pose[w, p, axis] = read_pose[w, p, axis]
                track.velocity[w, p, axis] = read_velocity[w, p, axis]
            track.missed[w, p] = 0
            if _swapped(pose[w], x, y, p, shown[w]):
                track.count[w, SWAPS] += 1
        wipe(seen.boxes, rig.background, seen.canvas)


@jit
def nearest_heading(angle, apart, near):
    """Return the one of the equivalent headings ``angle + k apart`` nearest to ``near``."""
    return angle + apart * math.floor((near - angle) / apart + 0.5)


@jit
def unlikeness(away, gate, area, spread, elongation, grain, traits, kind):
    """Return the cost of assigning an object to a part (thesis eqs. 5.32 and 5.33), by scaled differences.

    FAR beyond the gates. Kinds differ by area and elongation.

    Args:
        away: m, distance from the expected position of the part.
        gate: m, largest such distance.
        area, spread, elongation: of the object, m^2, m^2, 1, assuming this kind.
        grain: m, size of a pixel; the error of areas is a fraction of it times the outline's length.
    """
    if not (away < gate and area > 0.0 and spread > 0.0):
        return FAR
    finest = 0.02 + 0.1 * traits.edge[kind] * grain / traits.area[kind]
    place = 3.0 * away / gate
    size = math.log(area / traits.area[kind]) / finest
    width = math.log(spread / traits.spread[kind]) / finest
    form = (elongation - traits.elongation[kind]) / finest
    cost = place * place + size * size + 0.5 * width * width + 0.5 * form * form
    return cost if abs(size) < 8.0 and cost < NO_PAIR else FAR
