"""Broad phase: pairs of parts that may touch within a period, and a test of the paths after it.

Before a period, friction bounds the distance that a part can travel: its acceleration is at most ``2 mu g``, plus that of the
incline. Pairs are near if the circumscribed circles, enlarged by these distances, overlap. They are found with a hashed uniform
grid in time proportional to the number of parts (C. Ericson, Real-Time Collision Detection, 2005, sec. 7.1). After the period
the paths of near pairs are compared.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout
from vibgym.physics.contacts.hulls import load_hulls, part_gap, place_hulls, wall_direction, wall_gap
from vibgym.physics.contacts.impulses import load_properties
from vibgym.physics.core.records import friction_in, incline_size, kind_in

IN_TOUCH = 2e-4
"""Gap (m) at the start of a period below which parts are assumed to touch; they are not advanced without contacts first."""

FREE, NEAR, CONTACT = 0, 1, 2
"""Kinds of periods of a world: no near pairs; near pairs that stay apart; with contacts."""

CALLS, COUNTS = 3, 4
"""Column with the number of contact steps, after those of periods ``FREE``, ``NEAR`` and ``CONTACT``; number of columns."""


class Rows(NamedTuple):
    """Parts of a block of worlds: those that touch nothing in a period, and which may touch others."""

    rows: np.ndarray  # (kinds, worlds * parts) parts that touch nothing, as world * parts + part
    count: np.ndarray  # (kinds,) number of rows
    driven: np.ndarray  # (worlds, parts) bool: advances with contacts


ROWS: Layout[Rows] = Layout("ROWS", __name__)
rows_at = ROWS.at


def new_rows(worlds: int, parts: int, kinds: int) -> Rows:
    """Allocate arrays for a block of ``worlds``."""
    return Rows(
        rows=np.empty((kinds, worlds * parts), np.int64),
        count=np.zeros(kinds, np.int64),
        driven=np.zeros((worlds, parts), np.bool_),
    )


class Circles(NamedTuple):
    """One circle for each part on the table, and the grid cells of their centres."""

    part: np.ndarray  # (parts,) index of the part
    x: np.ndarray  # (parts,) m
    y: np.ndarray
    reach: np.ndarray  # (parts,) m, radius
    column: np.ndarray  # (parts,) of the cell
    row: np.ndarray
    following: np.ndarray  # (parts,) the next circle in the same bucket, -1: none
    first: np.ndarray  # (buckets,) the first circle of each; their number is a power of two


def new_circles(parts: int) -> Circles:
    """Allocate working arrays for up to ``parts`` parts."""

    def numbers() -> np.ndarray:
        return np.zeros(parts, np.int64)

    buckets = 1 << max(2 * parts - 1, 1).bit_length()
    return Circles(
        part=numbers(),
        x=np.zeros(parts),
        y=np.zeros(parts),
        reach=np.zeros(parts),
        column=numbers(),
        row=numbers(),
        following=numbers(),
        first=np.zeros(buckets, np.int64),
    )


@jit
def travel_bound(table, friction, incline, vx, vy):
    """Return the largest distance (m) that a part can travel in a period without contacts; incline in m/s^2."""
    # Not less for parts at the table's speed: spin under an uneven pressure may accelerate a part beyond it.
    pull = friction * table.gravity + 0.5 * incline
    return (math.sqrt(vx * vx + vy * vy) + pull * table.period) * table.period


@jit
def wall_distance(table, wall, x, y):
    """Return the distance of a point from the wall along a border, m."""
    nx, ny, border = wall_direction(table, wall)
    return border - (nx * x + ny * y)


@jit
def bucket_of(circles, column, row):
    """Return the bucket (hash) of a cell; other cells may share it."""
    return (column * 73856093 ^ row * 19349663) & (circles.first.shape[0] - 1)


@jit
def enter_cells(circles, count, size):
    """Assign the first ``count`` circles to cells of ``size`` m."""
    for bucket in range(circles.first.shape[0]):
        circles.first[bucket] = -1
    for k in range(count):
        circles.column[k] = int(math.floor(circles.x[k] / size))
        circles.row[k] = int(math.floor(circles.y[k] / size))
        bucket = bucket_of(circles, circles.column[k], circles.row[k])
        circles.following[k] = circles.first[bucket]
        circles.first[bucket] = k


@jit
def is_near(circles, k, other):
    """Return whether two circles overlap and the second is not the larger one, so that each pair is found once."""
    mine, theirs = circles.reach[k], circles.reach[other]
    if not (theirs < mine or (theirs == mine and other > k)):
        return False
    dx, dy = circles.x[other] - circles.x[k], circles.y[other] - circles.y[k]
    return dx * dx + dy * dy <= (mine + theirs) * (mine + theirs)


@jit
def near_pairs(table, walls, circles, count, pairs):
    """Find the pairs of circles that overlap, and the circles that reach over a border with a wall.

    Each circle searches for circles that are not larger, within twice its radius. The cell size is the mean diameter, so a
    small circle searches a few cells, independently of the largest circle.

    Args:
        walls: set of walls, a bit each.
        circles: of which the first ``count`` are in use.
        pairs: (:func:`pair_capacity`, 2) overwritten, in no particular order: both parts, or part and ``-1 - wall``.

    Returns:
        Number of pairs.
    """
    n, total = 0, 0.0
    for k in range(count):
        total += circles.reach[k]
    size = 2.0 * total / max(float(count), 1.0)
    celled = count > 9 and 0.0 < size < math.inf  # a circle's cells are nine or more
    if celled:
        enter_cells(circles, count, size)
    for k in range(count):
        part, x, y, reach = circles.part[k], circles.x[k], circles.y[k], circles.reach[k]
        across = 4.0 * reach / size + 2.0 if celled else math.inf
        if across * across < 2.0 * count + 9.0:
            for row in range(int(math.floor((y - 2.0 * reach) / size)), int(math.floor((y + 2.0 * reach) / size)) + 1):
                for column in range(
                    int(math.floor((x - 2.0 * reach) / size)), int(math.floor((x + 2.0 * reach) / size)) + 1
                ):
                    other = circles.first[bucket_of(circles, column, row)]
                    while other >= 0:
                        if circles.column[other] == column and circles.row[other] == row and is_near(circles, k, other):
                            pairs[n, 0], pairs[n, 1] = part, circles.part[other]
                            n += 1
                        other = circles.following[other]
        else:
            for other in range(count):
                if is_near(circles, k, other):
                    pairs[n, 0], pairs[n, 1] = part, circles.part[other]
                    n += 1
        if walls != 0:
            for wall in range(4):
                if (walls >> wall) & 1 and wall_distance(table, wall, x, y) <= reach:
                    pairs[n, 0], pairs[n, 1] = part, -1 - wall
                    n += 1
    return n


@jit
def find_pairs(fixed, state, world, pairs):
    """Write the near pairs of a world and return their number."""
    table, bodies, circles, count = fixed.friction.table, fixed.friction.bodies, fixed.contacts.circles, 0
    incline = incline_size(state, world)
    for part in range(state.pose.shape[1]):
        if not state.fallen[world, part]:
            mu = friction_in(bodies, state, world, part)
            way = travel_bound(table, mu, incline, state.velocity[world, part, 0], state.velocity[world, part, 1])
            circles.part[count], circles.reach[count] = part, fixed.hulls.radius[part] + way
            circles.x[count], circles.y[count] = state.pose[world, part, 0], state.pose[world, part, 1]
            count += 1
    return near_pairs(table, fixed.walls, circles, count, pairs)


@jit
def load_world(fixed, world):
    """Load hulls and properties for impacts of a world's parts."""
    if load_hulls(fixed.hulls, world):
        load_properties(fixed.properties, fixed.hulls.loaded)


@jit
def begin_world(fixed, state, world, driven, pairs):
    """Begin a world's period: clear ``driven`` (parts,) and impulses of contacts, write the near pairs; return their number."""
    load_world(fixed, world)
    for part in range(driven.shape[0]):
        driven[part] = False
        state.pushed[world, part, 0] = state.pushed[world, part, 1] = 0.0
    return 0 if state.diverged[world] else find_pairs(fixed, state, world, pairs)


@jit
def list_others(bodies, rows, world, w):
    """Add the parts of a world, number ``w`` of the block, that are not driven to the rows."""
    parts = rows.driven.shape[1]
    for part in range(parts):
        if not rows.driven[w, part]:
            kind = kind_in(bodies, world, part)
            rows.rows[kind, rows.count[kind]] = world * parts + part
            rows.count[kind] += 1


@jit
def pair_gap(table, hulls, placed, i, j):
    """Return the gap between two placed parts, or a part and a wall (``j = -1 - wall``), m."""
    if j >= 0:
        return part_gap(hulls, placed, i, j)
    return wall_gap(hulls, placed, i, -1 - j, table.columns * table.element_size, table.rows * table.element_size)


@jit
def circle_gap(table, hulls, i, at, j, there):
    """Return the gap between the circumscribed circles of two parts, or of a part and a wall, at poses ``at`` and ``there``, m.

    It is a lower bound of the gap between the parts. For a wall ``there`` is not used.
    """
    if j < 0:
        return wall_distance(table, -1 - j, at[0], at[1]) - hulls.radius[i]
    dx, dy = there[0] - at[0], there[1] - at[1]
    return math.sqrt(dx * dx + dy * dy) - hulls.radius[i] - hulls.radius[j]


@jit
def curvature_bound(table, bodies, hulls, state, world, part, step):
    """Return a bound on the distance of a point of a part from the straight line between two poses ``step`` s apart, m."""
    friction, radius = friction_in(bodies, state, world, part), hulls.radius[part]
    gyration, bend = bodies.gyration[kind_in(bodies, world, part)], incline_size(state, world) * step * step / 8.0
    return 2.0 * friction * table.gravity * (1.0 + radius * radius / gyration) * step * step / 8.0 + bend


class Paths(NamedTuple):
    """Paths of the parts of a world in a period."""

    pose: np.ndarray  # (parts, most steps + 1, 3) at the ends of a part's steps
    steps: np.ndarray  # (parts,) of the part's path
    driven: np.ndarray  # (parts,) bool: path with contacts
    travel: np.ndarray  # (parts, most steps) m, bound on the displacement of any point of a driven part in a step


@jit
def path_segment(hulls, paths, part, first, last):
    """Return a part's displacement x, y (m) from step ``first`` to ``last``, and a bound on its points' deviation (m)."""
    if paths.driven[part]:
        off = 0.0
        for step in range(first, last):
            off += paths.travel[part, step]
        return 0.0, 0.0, off
    at, then = paths.pose[part, first], paths.pose[part, last]
    return then[0] - at[0], then[1] - at[1], hulls.radius[part] * abs(then[2] - at[2])


@jit
def paths_cross(table, bodies, hulls, state, world, paths, i, j, placed):
    """Return whether two parts, or a part and a wall (``j = -1 - wall``), may have touched on their paths.

    Of a path with contacts only the distance travelled in each step is known.
    """
    mine = paths.steps[i]
    common = mine if j < 0 else math.gcd(mine, paths.steps[j])
    step = table.period / common
    slack = 0.0 if paths.driven[i] else curvature_bound(table, bodies, hulls, state, world, i, step)
    if j >= 0 and not paths.driven[j]:
        slack += curvature_bound(table, bodies, hulls, state, world, j, step)
    stride = mine // common
    other, theirs = (i, stride) if j < 0 else (j, paths.steps[j] // common)
    for k in range(common):
        dx, dy, off = path_segment(hulls, paths, i, k * stride, (k + 1) * stride)
        if j >= 0:
            ox, oy, more = path_segment(hulls, paths, j, k * theirs, (k + 1) * theirs)
            dx, dy, off = dx - ox, dy - oy, off + more
        apart = math.sqrt(dx * dx + dy * dy) + off + slack
        at, there = paths.pose[i, k * stride], paths.pose[other, k * theirs]
        if circle_gap(table, hulls, i, at, j, there) > apart:
            continue
        place_hulls(hulls, i, at[0], at[1], at[2], placed)
        if j >= 0:
            place_hulls(hulls, j, there[0], there[1], there[2], placed)
        if not pair_gap(table, hulls, placed, i, j) > apart:
            return True
    return False


def pair_capacity(parts: int) -> int:
    """Return the largest number of pairs in a world: each part with each other part and each wall."""
    return parts * (parts - 1) // 2 + 4 * parts
