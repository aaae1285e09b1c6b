"""The observation by parts: a row of numbers for each part, seen from that part, and a mask that says which are there."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from vibgym._numba.jit import borrowing
from vibgym._numba.reference import Layout, Pinned
from vibgym.envs import row_layout as table
from vibgym.envs.base import Observation
from vibgym.envs.row_layout import RowLayout
from vibgym.physics.collision.hulls import Hulls, part_gap, place_hulls
from vibgym.sensing import Measurement
from vibgym.tasks import Task
from vibgym.tasks.episode import PREVIEW, Episode, Relations

# The rows of the table as the kernel's constants.
KIND, TRAITS, POSITION, ELEMENT, HEADING = table.KIND, table.FRICTION, table.POSITION, table.ELEMENT, table.HEADING
WAY_FAR, WAY_COARSE, WAY_FINE, WAY_FINEST = table.WAY_FAR, table.WAY_COARSE, table.WAY_FINE, table.WAY_FINEST
TURN, TURN_COARSE, TURN_FINE, TURN_FINEST = table.TURN, table.TURN_COARSE, table.TURN_FINE, table.TURN_FINEST
VELOCITY, SPIN, BORDERS, ZONE = table.VELOCITY, table.SPIN_RATE, table.BORDERS, table.ZONE
GOAL_VELOCITY, GOAL_SPIN, WAY_AHEAD, TURN_AHEAD = (
    table.GOAL_VELOCITY, table.GOAL_SPIN, table.WAY_AHEAD, table.TURN_AHEAD,
)  # fmt: skip
AGE, SIGMA, NEIGHBOUR = table.AGE, table.SIGMA, table.FIRST_NEIGHBOUR
NEIGHBOURS, WIDTH = table.NEIGHBOURS, table.NEIGHBOUR_WIDTH
THERE, APART, APART_FAR, GAP, THEIR_VELOCITY, THEIR_HEADING, SAME_KIND, THEIR_WAY = 0, 1, 3, 5, 6, 8, 10, 11
"""Of a neighbour's numbers; the scales of the first one's are in the rows of the table from ``NEIGHBOUR`` on."""

APART_SCALE, FAR_SCALE, GAP_SCALE, VELOCITY_SCALE = NEIGHBOUR + 1, NEIGHBOUR + 2, NEIGHBOUR + 3, NEIGHBOUR + 4


class Rows(NamedTuple):
    """What the kernel needs besides the measurement, pinned in memory."""

    relations: Relations  # of the measured poses
    present: np.ndarray  # (worlds, parts) bool
    motion: np.ndarray  # (worlds, parts, ...) of the goals, see vibgym.tasks.episode.Episode
    kind: np.ndarray  # (parts, 2) int64, kind and symmetry
    traits: np.ndarray  # (parts, 4) numbers as they stand in a row
    zone: np.ndarray  # (parts, 4) m, x_low, y_low, x_high, y_high
    size: np.ndarray  # (2,) m, of the surface
    hulls: Hulls
    column: np.ndarray  # of the layout: where each feature stands, -1: nowhere, ...
    scale: np.ndarray  # ... and in what unit
    placed: np.ndarray  # scratch: as hulls.corner; ...
    nearest: np.ndarray  # ... (parts, NEIGHBOURS) int64, nearest first, -1: none; ...
    gap: np.ndarray  # ... (parts, NEIGHBOURS) m, to these


ROWS: Layout[Rows] = Layout("ROWS", __name__)
rows_at = ROWS.at


@borrowing
def _unit(value):
    return min(max(value, -1.0), 1.0)


@borrowing
def note_neighbour(gaps, nearest, gap, other):
    """Note a part at a distance ``gap`` (m) in the lists (NEIGHBOURS,) of the nearest; equally near ones go after."""
    place = NEIGHBOURS
    while place > 0 and gap < gaps[place - 1]:
        place -= 1
    for k in range(NEIGHBOURS - 1, place, -1):
        gaps[k], nearest[k] = gaps[k - 1], nearest[k - 1]
    if place < NEIGHBOURS:
        gaps[place], nearest[place] = gap, other


@borrowing
def rank_neighbours(seen, pose, gone, world):
    """List every part's nearest others by the distance between outlines; parts that are not there or gone have none.

    A pair whose circles are farther apart than the last in both lists is not looked at.
    """
    hulls, placed, here = seen.hulls, seen.placed, seen.present[world]
    for i in range(pose.shape[1]):
        for k in range(NEIGHBOURS):
            seen.gap[i, k], seen.nearest[i, k] = math.inf, -1
        if not here[i] or gone[world, i]:
            continue
        place_hulls(hulls, i, pose[world, i, 0], pose[world, i, 1], pose[world, i, 2], placed)
        for j in range(i):
            if not here[j] or gone[world, j]:
                continue
            dx, dy = pose[world, i, 0] - pose[world, j, 0], pose[world, i, 1] - pose[world, j, 1]
            least = math.sqrt(dx * dx + dy * dy) - hulls.radius[i] - hulls.radius[j]
            if least >= seen.gap[i, NEIGHBOURS - 1] and least >= seen.gap[j, NEIGHBOURS - 1]:
                continue
            between = part_gap(hulls, placed, i, j)
            note_neighbour(seen.gap[i], seen.nearest[i], between, j)
            note_neighbour(seen.gap[j], seen.nearest[j], between, i)


@borrowing
def write_place(seen, pose, p, row):
    """What a row says of the part itself and of where it is, ``pose`` (3,)."""
    column, scale = seen.column, seen.scale
    if column[KIND] >= 0:
        row[column[KIND] + seen.kind[p, 0]] = 1.0
    for k in range(seen.traits.shape[1]):
        row[column[TRAITS] + k] = seen.traits[p, k]
    row[column[HEADING]] = math.cos(seen.kind[p, 1] * pose[2])
    row[column[HEADING] + 1] = math.sin(seen.kind[p, 1] * pose[2])
    for axis in range(2):
        at, borders, zone = pose[axis], column[BORDERS] + 2 * axis, column[ZONE] + 2 * axis
        row[column[POSITION] + axis] = _unit(at / scale[POSITION, axis] - 1.0)
        place = at / (2.0 * scale[ELEMENT, axis])
        row[column[ELEMENT] + axis] = 2.0 * (place - math.floor(place)) - 1.0
        row[borders] = math.tanh(at / scale[BORDERS, 0])
        row[borders + 1] = math.tanh((seen.size[axis] - at) / scale[BORDERS, 0])
        if column[ZONE] >= 0:
            row[zone] = math.tanh((at - seen.zone[p, axis]) / scale[ZONE, 0])
            row[zone + 1] = math.tanh((seen.zone[p, 2 + axis] - at) / scale[ZONE, 0])


@borrowing
def write_goal(seen, error, motion, row):
    """What a row says of the way to the goal, ``error`` (3,), and of the goal's ``motion``."""
    column, scale = seen.column, seen.scale
    for axis in range(2):
        for feature in range(WAY_FAR, WAY_FINEST + 1):
            row[column[feature] + axis] = math.tanh(error[axis] / scale[feature, axis])
    if column[TURN] >= 0:
        row[column[TURN]] = _unit(error[2] / scale[TURN, 0])
        for feature in range(TURN_COARSE, TURN_FINEST + 1):
            row[column[feature]] = math.tanh(error[2] / scale[feature, 0])
    if column[GOAL_VELOCITY] >= 0:
        for axis in range(2):
            row[column[GOAL_VELOCITY] + axis] = _unit(motion[axis] / scale[GOAL_VELOCITY, axis])
            for ahead in range(PREVIEW):
                way = error[axis] + motion[3 + 3 * ahead + axis]
                row[column[WAY_AHEAD] + 2 * ahead + axis] = _unit(way / scale[WAY_AHEAD, axis])
    if column[GOAL_SPIN] >= 0:
        row[column[GOAL_SPIN]] = _unit(motion[2] / scale[GOAL_SPIN, 0])
        for ahead in range(PREVIEW):
            row[column[TURN_AHEAD] + ahead] = _unit((error[2] + motion[5 + 3 * ahead]) / scale[TURN_AHEAD, 0])


@borrowing
def write_neighbours(seen, pose, velocity, p, rows):
    """What row ``p`` says of its neighbours, whose own rows have been written.

    Args:
        pose, velocity: (parts, 3) of the world.  rows: (slots, size) of the world.
    """
    column, scale, row = seen.column, seen.scale, rows[p]
    for k in range(NEIGHBOURS):
        other = seen.nearest[p, k]
        if other < 0:
            break
        start = column[NEIGHBOUR] + k * WIDTH
        row[start + THERE] = 1.0
        row[start + GAP] = math.tanh(seen.gap[p, k] / scale[GAP_SCALE, 0])
        if seen.kind[p, 0] == seen.kind[other, 0]:
            row[start + SAME_KIND] = 1.0
        for axis in range(2):
            apart = pose[other, axis] - pose[p, axis]
            row[start + APART + axis] = math.tanh(apart / scale[APART_SCALE, axis])
            row[start + APART_FAR + axis] = math.tanh(apart / scale[FAR_SCALE, axis])
            faster = velocity[other, axis] - velocity[p, axis]
            row[start + THEIR_VELOCITY + axis] = _unit(faster / scale[VELOCITY_SCALE, axis])
            row[start + THEIR_HEADING + axis] = rows[other, column[HEADING] + axis]
            row[start + THEIR_WAY + axis] = rows[other, column[WAY_COARSE] + axis]


@borrowing
def write_rows(pose, mean_velocity, gone, age, sigma, pinned, out, mask):
    """Write every world's observation by parts.

    Args:
        pose, mean_velocity, gone, age, sigma: measured, see :class:`vibgym.sensing.Measurement`.
        pinned: address of pinned :class:`Rows`.
        out: (worlds, slots, size) float32, zeros.  mask: (worlds, slots) int8, zeros.
    """
    seen = rows_at(pinned)
    present, column, scale, error = seen.present, seen.column, seen.scale, seen.relations.error
    for w in range(pose.shape[0]):
        for p in range(pose.shape[1]):
            if not present[w, p]:
                continue
            row = out[w, p]
            mask[w, p] = 1
            write_place(seen, pose[w, p], p, row)
            write_goal(seen, error[w, p], seen.motion[w, p], row)
            for axis in range(2):
                row[column[VELOCITY] + axis] = _unit(mean_velocity[w, p, axis] / scale[VELOCITY, axis])
            row[column[SPIN]] = _unit(mean_velocity[w, p, 2] / scale[SPIN, 0])
            if column[AGE] >= 0:
                row[column[AGE]] = math.tanh(age[w, p] / scale[AGE, 0])
            if column[SIGMA] >= 0:
                unsure = math.sqrt(sigma[w, p, 0] * sigma[w, p, 0] + sigma[w, p, 1] * sigma[w, p, 1])
                row[column[SIGMA]] = math.tanh(unsure / scale[SIGMA, 0])
                row[column[SIGMA] + 1] = math.tanh(sigma[w, p, 2] / scale[SIGMA, 1])
        if column[NEIGHBOUR] >= 0:
            rank_neighbours(seen, pose, gone, w)
            for p in range(pose.shape[1]):
                write_neighbours(seen, pose[w], mean_velocity[w], p, out[w])


class PartsObservation(Observation):
    """Dictionary of ``parts``, a row of numbers in [-1, 1] for each slot, and ``mask``, 1 where there is a part.

    Rows of parts that are not there, and of slots without a part, are all 0. Part p has row p, whose numbers the table in
    :mod:`vibgym.envs.row_layout` explains.

    Attributes:
        row_layout: what the numbers of a row mean.
    """

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.row_layout = RowLayout.of(task)
        symmetry = [part.symmetry for part in task.parts]
        self._kind = np.ascontiguousarray(np.column_stack([task.kind, symmetry]))
        zones = np.zeros((len(task.parts), 4)) if task.zones is None else task.zones[task.kind]
        self._zone = np.ascontiguousarray(zones)
        self._relations: Relations | None = None
        self._rows: Any = None

    @property
    def space(self) -> spaces.Space:
        slots, size = self.task.slots, self.row_layout.block
        return spaces.Dict(
            {"parts": spaces.Box(-1.0, 1.0, (slots, size), np.float32), "mask": spaces.MultiBinary(slots)}
        )

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        if relations is not self._relations:  # the same ones ever after
            self._relations, self._rows = relations, self._pinned(relations, episode)
        pose, mean_velocity, gone, age, sigma = measurement
        out = np.zeros((len(pose), self.task.slots, self.row_layout.block), dtype=np.float32)
        mask = np.zeros(out.shape[:2], dtype=np.int8)
        write_rows(pose, mean_velocity, gone, age, sigma, self._rows.address, out, mask)
        return {"parts": out, "mask": mask}

    def _pinned(self, relations: Relations, episode: Episode) -> Pinned[Rows]:
        task, layout, hulls = self.task, self.row_layout, self.task.hulls
        rows = Rows(
            relations=relations,
            present=episode.present,
            motion=episode.motion,
            kind=self._kind,
            traits=table.traits_of(task.parts),
            zone=self._zone,
            size=np.array([task.surface.width, task.surface.depth]),
            hulls=hulls,
            column=layout.column,
            scale=layout.scale,
            placed=np.zeros(hulls.corner.shape),
            nearest=np.full((len(task.parts), table.NEIGHBOURS), -1, dtype=np.int64),
            gap=np.zeros((len(task.parts), table.NEIGHBOURS)),
        )
        return Pinned(ROWS, rows)
