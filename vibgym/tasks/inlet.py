"""The inlet of :class:`vibgym.tasks.Feed`: which parts arrive, and where.

All draws follow from the key of the episode and counters: the poses from the number of attempts, and with given probabilities
the part that is next from the number of arrivals, so that it stays next until it has a slot and room.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.physics.contacts.hulls import place_hulls
from vibgym.physics.core.noise import uniforms
from vibgym.scene.parts import Part, kinds_of
from vibgym.scene.surface import Surface
from vibgym.tasks.starts import CLEAR, TRIES, Room, heap, is_clear, lattice

INLET = (0.020, 0.055)
"""m, least and largest x of the centres of parts that arrive one at a time."""

HEAP_LENGTH = 0.200
"""m along x in which heaps arrive."""

ROUNDED = 1e-3
"""Largest deviation of the sum of probabilities from 1, of numbers that have been rounded."""

WHICH, WHERE, HEAPED, DRAWN = 17, 18, 19, 20
"""Third word of a counter, by the purpose of a random number."""


class Inlet(NamedTuple):
    """Region in which parts arrive, and scratch memory."""

    low: float  # m, least and largest x of the centres of parts that arrive one at a time
    high: float
    heap: int  # parts that arrive at once, in touch; 1: they arrive one at a time
    most: int  # parts on the table at once
    group: np.ndarray  # (parts,) int64, which different part a slot is for
    cumulative: np.ndarray  # (groups,) probabilities of arrivals, summed up; empty: any slot that is empty may be next
    room: Room  # of a heap, from the left border on
    numbers: np.ndarray  # scratch: (parts, TRIES, 2)
    order: np.ndarray  # scratch: (parts,) int64
    chance: np.ndarray  # scratch: (parts,)
    pose: np.ndarray  # scratch: (parts, 3)


@jit
def shuffle_waiting(inlet, key, tried, waiting):
    """Write the waiting parts into ``order``, shuffled; returns their number."""
    order, chance, count = inlet.order, inlet.chance, 0
    for part in range(waiting.shape[0]):
        if waiting[part]:
            value, _, _, _ = uniforms(key, tried, part, WHICH, 0)
            at = count
            while at > 0 and chance[at - 1] > value:
                order[at], chance[at] = order[at - 1], chance[at - 1]
                at -= 1
            order[at], chance[at] = part, value
            count += 1
    return count


@jit
def choose_drawn(inlet, key, arrivals, count):
    """Draw the parts that arrive next by their probabilities, and move an empty slot for each to the front of ``order``.

    The draw depends on the number of arrivals alone: a part without a slot or room is next until it arrives.

    Args:
        arrivals: number of parts that have arrived in this episode.  count: of empty slots, in ``order``.

    Returns:
        Whether each of the next ``heap`` parts has an empty slot.
    """
    order, cumulative = inlet.order, inlet.cumulative
    for k in range(inlet.heap):
        value, _, _, _ = uniforms(key, arrivals + k, 0, DRAWN, 0)
        group, at = 0, k
        while group + 1 < cumulative.shape[0] and value >= cumulative[group]:
            group += 1
        while at < count and inlet.group[order[at]] != group:
            at += 1
        if at == count:
            return False
        order[k], order[at] = order[at], order[k]
    return True


@jit
def find_free_pose(inlet, hulls, placed, key, tried, present, pose):
    """Draw a free pose for the part ``order[0]``, into ``inlet.pose``; returns whether one has been found.

    Args:
        hulls, placed: of all parts; those that are present have been placed.
        present: (parts,) bool.  pose: (parts, 3).
    """
    order, own, part, room = inlet.order, inlet.pose, inlet.order[0], inlet.room
    count = 0
    for other in range(present.shape[0]):
        for axis in range(3):
            own[other, axis] = pose[other, axis]
    for t in range(TRIES):
        u, v, turn, _ = uniforms(key, tried, t, WHERE, 0)
        own[part, 0] = inlet.low + (inlet.high - inlet.low) * u
        own[part, 1] = hulls.radius[part] + (room.depth - 2.0 * hulls.radius[part]) * v
        own[part, 2] = math.pi * (2.0 * turn - 1.0)
        place_hulls(hulls, part, own[part, 0], own[part, 1], own[part, 2], placed)
        count = 0
        for other in range(present.shape[0]):
            if present[other]:
                order[count] = other
                count += 1
        order[count] = part
        if is_clear(hulls, placed, own, order, count, room.clear):
            order[0] = part
            return True
    return False


@jit
def draw_heap(inlet, hulls, placed, key, tried, present, pose):
    """Draw the poses of a heap of the parts ``order[:inlet.heap]``, into ``inlet.pose``; returns False if its room is occupied.

    Args: as for :func:`find_free_pose`.
    """
    room, numbers = inlet.room, inlet.numbers
    for other in range(present.shape[0]):
        if present[other] and pose[other, 0] - hulls.radius[other] < room.width:
            return False
    for k in range(inlet.heap):
        for t in range(TRIES):
            part = inlet.order[k]
            numbers[part, t, 0], numbers[part, t, 1], _, _ = uniforms(key, tried, part * TRIES + t, HEAPED, 0)
    heap(hulls, room, inlet.order, inlet.heap, numbers, placed, inlet.pose)
    return True


@jit
def draw_arrivals(inlet, hulls, placed, key, tried, arrivals, waiting, present, pose):
    """Draw which waiting parts arrive, and their poses; returns their number.

    They are the first ones of ``inlet.order``, at ``inlet.pose``.

    Args:
        key: (2,) of the episode.  tried: number of previous draws.  arrivals: number of parts that have arrived.
        waiting, present: (parts,) bool.  pose: (parts, 3) of present parts.
    """
    count = shuffle_waiting(inlet, key, tried, waiting)
    if count < inlet.heap or present.sum() + inlet.heap > inlet.most:
        return 0
    if inlet.cumulative.shape[0] > 0 and not choose_drawn(inlet, key, arrivals, count):
        return 0
    if inlet.heap > 1:
        return inlet.heap if draw_heap(inlet, hulls, placed, key, tried, present, pose) else 0
    return 1 if find_free_pose(inlet, hulls, placed, key, tried, present, pose) else 0


def new_inlet(
    surface: Surface, parts: Sequence[Part], together: int, probabilities: Sequence[float] | None, most: int | None
) -> Inlet:
    """Return an inlet at the left border for heaps of so many parts; other arguments are settings of Feed.

    Raises:
        ValueError: a heap of more parts than there are, than there is certainly room for, or than a part has slots if it is
            drawn; no probabilities of the different parts.
    """
    count, radius, length = len(parts), max(part.radius for part in parts), HEAP_LENGTH
    if together > count:
        raise checks.refuse("task_settings.heap", together, f"a whole number <= {count}, the number of parts")
    most = count if most is None else most
    if not together <= most <= count:
        allowed = f"a whole number >= {together} and <= {count}, the number of parts"
        raise checks.refuse("task_settings.most", most, allowed)
    cells = lattice(np.zeros(2), np.array([length, surface.depth]), radius, 0.0)
    if together > 1 and len(cells) < together:
        allowed = f"at most {len(cells)} parts of radius {radius:.4g} m on {length:g} x {surface.depth:g} m at the left border"
        raise checks.refuse("task_settings.heap", together, allowed)
    if 2.0 * radius > surface.depth:
        got = f"a part of radius {radius:.4g} m"
        raise checks.refuse("parts", got, f"at most {surface.depth / 2:g} m on this surface")
    kinds, group = kinds_of(parts, lambda one, other: one.name == other.name and one.same_as(other))
    inlet = Inlet(
        *INLET, together, most, group, _cumulative(probabilities, kinds), Room(length, surface.depth, cells, CLEAR),
        np.zeros((count, TRIES, 2)), np.zeros(count, dtype=np.int64), np.zeros(count), np.zeros((count, 3)),
    )  # fmt: skip
    check_slots("parts", inlet, np.ones((1, count), dtype=bool))
    return inlet


def _cumulative(probabilities: Sequence[float] | None, kinds: Sequence[Part]) -> np.ndarray:
    """Return the sums of the probabilities of different parts, (kinds,); empty for None."""
    if probabilities is None:
        return np.zeros(0)
    name, names = "task_settings.probabilities", ", ".join(part.name for part in kinds)
    if len(probabilities) != len(kinds):
        raise checks.refuse(name, probabilities, f"{len(kinds)} numbers, one for each different part: {names}")
    total = sum(probabilities)
    if abs(total - 1.0) > ROUNDED:
        raise checks.refuse(name, f"a sum of {total:.6g}", f"a sum of 1, within {ROUNDED:g}")
    return np.cumsum(probabilities) / total


def check_slots(name: str, inlet: Inlet, there: np.ndarray) -> None:
    """Check that every part that may be drawn has slots for a heap of it alone, without which it would never arrive.

    Args:
        name: of the argument, for errors.
        there: (n, parts) bool, slots that are in use.

    Raises:
        ValueError: too few slots.
    """
    for group in range(len(inlet.cumulative)):
        fewest = int(there[:, inlet.group == group].sum(axis=1).min(initial=inlet.heap))
        if fewest < inlet.heap:
            first = int((inlet.group == group).argmax())
            allowed = f"at least {inlet.heap}, which may be drawn for one heap" if inlet.heap > 1 else "at least 1"
            raise checks.refuse(name, f"{fewest} slots for parts equal to parts[{first}]", allowed)
