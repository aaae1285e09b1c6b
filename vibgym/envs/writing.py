"""Kernels that write observations: quantities of a part in SI units, encoded according to a layout.

Kernels compute a list of quantities per part; a :class:`Program`, made from a layout, encodes them value by value. A new
feature of a known quantity is a line of the table in :mod:`vibgym.envs.features`; a new quantity also needs a kernel here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym.envs.features import CODINGS, NEIGHBOUR, NEIGHBOURS, TABLE, Feature, Layout
from vibgym.kernels.jit import borrowing
from vibgym.kernels.reference import Layout as Memory
from vibgym.kernels.reference import Pinned
from vibgym.physics.contacts.hulls import Hulls, part_contact, part_gap, place_hulls
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks import Task
from vibgym.tasks.episode import PREVIEW, Episode, Relations


def places_of(features: Sequence[Feature]) -> dict[str, int]:
    """Return the offset of each quantity in the list of all, and under ``""`` the length of the list."""
    widths = {each.quantity: each.width for each in features}
    return dict(zip((*widths, ""), np.cumsum([0, *widths.values()]).tolist(), strict=True))


OF_PART, OF_NEIGHBOUR = places_of(TABLE), places_of(NEIGHBOUR)

# Offsets of quantities that change, as constants of the kernels.
POSITION, HEADING, WAY, TURN = (OF_PART[name] for name in ("position", "heading", "way", "turn"))
VELOCITY, SPIN, BORDERS, ZONE = (OF_PART[name] for name in ("velocity", "spin", "borders", "zone"))
GAP, TOWARDS, AGE, SIGMA = (OF_PART[name] for name in ("gap", "neighbour", "age", "sigma"))
NORMAL, PUSHED = OF_PART["normal"], OF_PART["pushed"]
GOAL_VELOCITY, GOAL_SPIN = OF_PART["goal_velocity"], OF_PART["goal_spin"]
WAY_AHEAD, TURN_AHEAD, ARRIVED = OF_PART["way_ahead"], OF_PART["turn_ahead"], OF_PART["arrived"]

APART, BETWEEN, FASTER = OF_NEIGHBOUR["apart"], OF_NEIGHBOUR["gap"], OF_NEIGHBOUR["velocity"]
THEIR_HEADING, SAME_KIND, THEIR_WAY = (OF_NEIGHBOUR[name] for name in ("heading", "same_kind", "way"))
THEIR_FAR, THEIR_TURN = OF_NEIGHBOUR["way_far"], OF_NEIGHBOUR["turn"]

LINEAR, TANH, PLACE, CELL = (CODINGS.index(name) for name in ("linear", "tanh", "place", "cell"))


class Program(NamedTuple):
    """Encoding of the values of a block, a row or a neighbour, arrays (values,)."""

    source: np.ndarray  # int64, index in the list of quantities
    coding: np.ndarray  # int64, of CODINGS
    scale: np.ndarray  # SI units at a value of 1


class Scene(NamedTuple):
    """Data of the kernels except the measurement, pinned in memory."""

    relations: Relations  # of the measured poses
    present: np.ndarray  # (worlds, parts) bool
    arrived: np.ndarray  # (worlds, parts) bool
    motion: np.ndarray  # (worlds, parts, ...) of the goals, see vibgym.tasks.episode.Episode
    kind: np.ndarray  # (parts, 2) int64, kind and symmetry
    zone: np.ndarray  # (parts, 4) m, x_low, y_low, x_high, y_high
    size: np.ndarray  # (2,) m, of the surface
    hulls: Hulls
    program: Program  # of the part itself
    others: Program  # of a neighbour; empty if a row has none
    touch: int  # 1: with features of contacts
    coarse: int  # offset of "way_coarse" in a row, copied as "way" of a neighbour
    known: np.ndarray  # scratch: (parts, values) quantities of each part, constant ones filled in; ...
    seen: np.ndarray  # ... (numbers,) of a neighbour; ...
    placed: np.ndarray  # ... as hulls.corner; ...
    nearest: np.ndarray  # ... (parts, NEIGHBOURS) int64, nearest first, -1: none; ...
    gap: np.ndarray  # ... (parts, NEIGHBOURS) m, to these


SCENE: Memory[Scene] = Memory("SCENE", __name__)
scene_at = SCENE.at


@borrowing
def _unit(value):
    return min(max(value, -1.0), 1.0)


@borrowing
def write_numbers(program, quantities, row):
    """Write encoded quantities to a row (n,)."""
    source, codings, scales = program.source, program.coding, program.scale
    for k in range(source.shape[0]):
        value, coding = quantities[source[k]], codings[k]
        if coding == TANH:
            value = math.tanh(value / scales[k])
        elif coding == LINEAR:
            value = _unit(value / scales[k])
        elif coding == PLACE:
            value = _unit(value / scales[k] - 1.0)
        elif coding == CELL:
            cells = value / (2.0 * scales[k])
            value = 2.0 * (cells - math.floor(cells)) - 1.0
        row[k] = value


@borrowing
def look_at_part(scene, pose, velocity, age, sigma, w, p, known):
    """Compute the quantities of a part.

    Args:
        pose, velocity: (parts, 3) of the world.  age: (parts,).  sigma: (parts, 3).
        known: (numbers,) of the part.
    """
    relations, size, zones = scene.relations, scene.size, scene.zone[p]
    error, motion, turned = relations.error[w, p], scene.motion[w, p], scene.kind[p, 1] * pose[p, 2]
    known[HEADING], known[HEADING + 1] = math.cos(turned), math.sin(turned)
    for axis in range(2):
        at, border, zone = pose[p, axis], BORDERS + 2 * axis, ZONE + 2 * axis
        known[POSITION + axis], known[VELOCITY + axis], known[WAY + axis] = at, velocity[p, axis], error[axis]
        known[border], known[border + 1] = at, size[axis] - at
        known[zone], known[zone + 1] = at - zones[axis], zones[2 + axis] - at
    known[SPIN], known[TURN], known[GAP], known[AGE] = velocity[p, 2], error[2], relations.gap[w, p], age[p]
    known[SIGMA] = math.sqrt(sigma[p, 0] * sigma[p, 0] + sigma[p, 1] * sigma[p, 1])
    known[SIGMA + 1] = sigma[p, 2]
    known[ARRIVED] = 1.0 if scene.arrived[w, p] else 0.0
    if motion.shape[0] > 0:
        known[GOAL_VELOCITY], known[GOAL_VELOCITY + 1], known[GOAL_SPIN] = motion[0], motion[1], motion[2]
        for ahead in range(PREVIEW):
            for axis in range(2):
                known[WAY_AHEAD + 2 * ahead + axis] = error[axis] + motion[3 + 3 * ahead + axis]
            known[TURN_AHEAD + ahead] = error[2] + motion[5 + 3 * ahead]
    known[TOWARDS] = known[TOWARDS + 1] = 0.0
    other = relations.neighbour[w, p]
    if other >= 0:
        dx, dy = pose[other, 0] - pose[p, 0], pose[other, 1] - pose[p, 1]
        apart = math.sqrt(dx * dx + dy * dy)
        if apart > 0.0:
            known[TOWARDS], known[TOWARDS + 1] = dx / apart, dy / apart


@borrowing
def touch_part(scene, pose, pushed, w, p, known):
    """Compute the quantities of a part's contacts.

    Args:
        pose: (parts, 3) of the world.  pushed: (parts, 2) likewise.
        known: (numbers,) of the part.
    """
    known[PUSHED], known[PUSHED + 1] = pushed[p, 0], pushed[p, 1]
    known[NORMAL] = known[NORMAL + 1] = 0.0
    other = scene.relations.neighbour[w, p]
    if other >= 0:
        for part in (p, other):
            place_hulls(scene.hulls, part, pose[part, 0], pose[part, 1], pose[part, 2], scene.placed)
        _, known[NORMAL], known[NORMAL + 1] = part_contact(scene.hulls, scene.placed, p, other)


@borrowing
def note_neighbour(gaps, nearest, gap, other):
    """Insert a part at a distance ``gap`` (m) into the sorted lists (NEIGHBOURS,) of the nearest, after equal ones."""
    place = NEIGHBOURS
    while place > 0 and gap < gaps[place - 1]:
        place -= 1
    for k in range(NEIGHBOURS - 1, place, -1):
        gaps[k], nearest[k] = gaps[k - 1], nearest[k - 1]
    if place < NEIGHBOURS:
        gaps[place], nearest[place] = gap, other


@borrowing
def rank_neighbours(scene, pose, gone, world):
    """List every part's nearest others by the distance between outlines; absent parts have none.

    Pairs whose bounding circles are farther apart than the last entries of both lists are skipped.
    """
    hulls, placed, here = scene.hulls, scene.placed, scene.present[world]
    for i in range(pose.shape[1]):
        for k in range(NEIGHBOURS):
            scene.gap[i, k], scene.nearest[i, k] = math.inf, -1
        if not here[i] or gone[world, i]:
            continue
        place_hulls(hulls, i, pose[world, i, 0], pose[world, i, 1], pose[world, i, 2], placed)
        for j in range(i):
            if not here[j] or gone[world, j]:
                continue
            dx, dy = pose[world, i, 0] - pose[world, j, 0], pose[world, i, 1] - pose[world, j, 1]
            least = math.sqrt(dx * dx + dy * dy) - hulls.radius[i] - hulls.radius[j]
            if least >= scene.gap[i, NEIGHBOURS - 1] and least >= scene.gap[j, NEIGHBOURS - 1]:
                continue
            between = part_gap(hulls, placed, i, j)
            note_neighbour(scene.gap[i], scene.nearest[i], between, j)
            note_neighbour(scene.gap[j], scene.nearest[j], between, i)


@borrowing
def write_neighbours(scene, pose, velocity, p, rows):
    """Write the neighbours of row ``p``, after the rows of the neighbours themselves.

    Args:
        pose, velocity: (parts, 3) of the world.  rows: (slots, size) of the world.
    """
    seen, known, kind, nearest, gap = scene.seen, scene.known, scene.kind, scene.nearest[p], scene.gap[p]
    start, width = scene.program.source.shape[0], scene.others.source.shape[0]
    for k in range(NEIGHBOURS):
        other = nearest[k]
        if other < 0:
            break
        seen[BETWEEN] = gap[k]
        seen[THEIR_TURN] = known[other, TURN]
        seen[SAME_KIND] = 1.0 if kind[p, 0] == kind[other, 0] else 0.0
        for axis in range(2):
            seen[APART + axis] = pose[other, axis] - pose[p, axis]
            seen[FASTER + axis] = velocity[other, axis] - velocity[p, axis]
            seen[THEIR_HEADING + axis] = known[other, HEADING + axis]
            seen[THEIR_FAR + axis] = known[other, WAY + axis]
            seen[THEIR_WAY + axis] = rows[other, scene.coarse + axis]
        write_numbers(scene.others, seen, rows[p, start + k * width : start + (k + 1) * width])


@borrowing
def write_rows(pinned, pose, mean_velocity, gone, age, sigma, pushed, worlds, out):
    """Write the blocks or rows of some worlds.

    Args:
        pinned: address of a pinned :class:`Scene`.
        pose, mean_velocity, gone, age, sigma, pushed: measured, see :class:`vibgym.sensing.Measurement`.
        worlds: (n,) index.
        out: (worlds, slots, size) float32, overwritten; zeros for absent parts.
    """
    scene = scene_at(pinned)
    present = scene.present
    for k in range(worlds.shape[0]):
        w = worlds[k]
        for slot in range(out.shape[1]):
            there = slot < pose.shape[1] and present[w, slot]
            for number in range(scene.program.source.shape[0] if there else 0, out.shape[2]):
                out[w, slot, number] = 0.0
        for p in range(pose.shape[1]):
            if present[w, p]:
                look_at_part(scene, pose[w], mean_velocity[w], age[w], sigma[w], w, p, scene.known[p])
                if scene.touch == 1:
                    touch_part(scene, pose[w], pushed[w], w, p, scene.known[p])
                write_numbers(scene.program, scene.known[p], out[w, p])
        if scene.others.source.shape[0] > 0:
            rank_neighbours(scene, pose, gone, w)
            for p in range(pose.shape[1]):
                write_neighbours(scene, pose[w], mean_velocity[w], p, out[w])


@borrowing
def write_mask(present, worlds, mask):
    """Write the mask (worlds, slots) of present parts (worlds, parts) of some worlds."""
    for k in range(worlds.shape[0]):
        w = worlds[k]
        for slot in range(mask.shape[1]):
            mask[w, slot] = 1 if slot < present.shape[1] and present[w, slot] else 0


@borrowing
def write_goals(low, high, pose, worlds, goals):
    """Write poses (worlds, parts, 3) of the first parts of some worlds, clipped, as goals (worlds, values)."""
    for k in range(worlds.shape[0]):
        w = worlds[k]
        for number in range(goals.shape[1]):
            goals[w, number] = min(max(np.float32(pose[w, 0, number]), low[number]), high[number])


def pinned_scene(task: Task, layout: Layout, relations: Relations, episode: Episode) -> Pinned[Scene]:
    """Return the data that kernels need to write a layout; the arrays of ``relations`` and ``episode`` are live."""
    surface, parts = task.surface, task.parts
    own = tuple(each for each in layout.table if each in TABLE)
    others = _program(tuple(each for each in NEIGHBOUR if f"neighbour_1_{each.name}" in layout), OF_NEIGHBOUR, surface)
    # A neighbour's way is copied from its own row, encoded.
    others.coding[others.source >= THEIR_WAY] = CODINGS.index("flag")
    coarse = next((row.start for row in layout.rows if row.name == "way_coarse"), -1)
    zones = np.zeros((len(parts), 4)) if task.zones is None else task.zones[task.kind]
    scene = Scene(
        relations=relations,
        present=episode.present,
        arrived=episode.arrived,
        motion=episode.motion,
        kind=np.ascontiguousarray(np.column_stack([task.kind, [part.symmetry for part in parts]])),
        zone=np.ascontiguousarray(zones),
        size=np.array([surface.width, surface.depth]),
        hulls=task.hulls,
        program=_program(own, OF_PART, surface),
        others=others,
        touch=int("contact_normal" in layout),
        coarse=coarse,
        known=_unchanging(parts, task.kind),
        seen=np.ones(OF_NEIGHBOUR[""]),
        placed=np.zeros(task.hulls.corner.shape),
        nearest=np.full((len(parts), NEIGHBOURS), -1, dtype=np.int64),
        gap=np.zeros((len(parts), NEIGHBOURS)),
    )
    return Pinned(SCENE, scene)


def _program(features: Sequence[Feature], places: dict[str, int], surface: Surface) -> Program:
    """Return the encoding of features from quantities at these offsets."""
    numbers = [
        (places[each.quantity] + k, CODINGS.index(each.coding), scale)
        for each in features
        for k, scale in enumerate(each.scales(surface))
    ]
    source, coding, scale = zip(*numbers, strict=True) if numbers else ((), (), ())
    return Program(
        np.array(source, dtype=np.int64), np.array(coding, dtype=np.int64), np.array(scale, dtype=np.float64)
    )


def _unchanging(parts: Sequence[Part], kind: np.ndarray) -> np.ndarray:
    """Return quantities (parts, values) with constant ones filled in."""
    known = np.zeros((len(parts), OF_PART[""]))
    for row, part, number in zip(known, parts, kind, strict=True):
        row[OF_PART["present"]] = row[OF_PART["kind"] + number] = 1.0
        row[OF_PART["friction"]], row[OF_PART["radius"]] = part.friction, part.radius
        row[OF_PART["gyration"]], row[OF_PART["extent"]] = math.sqrt(part.gyration), math.sqrt(part.area)
    return known
