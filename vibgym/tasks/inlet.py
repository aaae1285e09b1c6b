"""Where parts arrive in the middle of an episode: one at a time wherever there is room, or in heaps of some that touch.

All is drawn by counter from a key of the episode's own (:mod:`vibgym.physics.core.noise`), which the world's generator has
given, so an arrival depends on nothing but the key and how often it has been tried.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym import checks
from vibgym.kernels.jit import borrowing
from vibgym.physics.contacts.hulls import place_hulls
from vibgym.physics.core.noise import uniforms
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.lattice import lattice
from vibgym.tasks.starts import CLEAR, TRIES, Room, heap, is_clear

WHICH, WHERE, HEAPED = 17, 18, 19
"""Third word of a counter: what a random number is drawn for."""


class Inlet(NamedTuple):
    """Where parts come in, and in what company; with what it works on."""

    low: float  # m, least and largest x of the centres of parts that come one at a time
    high: float
    heap: int  # parts that come at once, in touch; 1: they come one at a time
    room: Room  # that a heap lies in, from the left border on
    numbers: np.ndarray  # scratch: (parts, TRIES, 2)
    order: np.ndarray  # scratch: (parts,) int64
    chance: np.ndarray  # scratch: (parts,)
    pose: np.ndarray  # scratch: (parts, 3)


def new_inlet(surface: Surface, parts: Sequence[Part], low: float, high: float, together: int, length: float) -> Inlet:
    """An inlet at the left border.

    Args:
        low, high: m, least and largest x of the centres of parts that come one at a time.
        together: parts of a heap; 1: they come one at a time.
        length: m, along the table, that a heap may take.

    Raises:
        ValueError: a heap of more parts than there are, or than lie there for sure.
    """
    together = checks.count("task_settings['heap']", together, most=len(parts))
    radius = max(part.radius for part in parts)
    cells = lattice(np.zeros(2), np.array([length, surface.depth]), radius, 0.0)
    if together > 1 and len(cells) < together:
        allowed = f"at most {len(cells)} parts of radius {radius:.4g} m on {length:g} x {surface.depth:g} m at the left border"
        raise checks.refuse("task_settings['heap']", together, allowed)
    if 2.0 * radius > surface.depth:
        raise checks.refuse(
            "parts", f"a part of radius {radius:.4g} m", f"at most {surface.depth / 2:g} m on this surface"
        )
    count = len(parts)
    return Inlet(
        low, high, together, Room(length, surface.depth, cells, CLEAR), np.zeros((count, TRIES, 2)),
        np.zeros(count, dtype=np.int64), np.zeros(count), np.zeros((count, 3)),
    )  # fmt: skip


@borrowing
def shuffle_waiting(inlet, key, tried, waiting):
    """Let ``order`` begin with the parts that wait, at random; returns their number."""
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


@borrowing
def find_place(inlet, hulls, placed, key, tried, present, pose):
    """Look for room for the part ``order[0]``; its pose is left in ``inlet.pose``.

    Args:
        hulls, placed: of all parts; those that are present have been placed.
        present: (parts,) bool.  pose: (parts, 3), theirs.

    Returns:
        Whether there is any.
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


@borrowing
def pile_up(inlet, hulls, placed, key, tried, present, pose):
    """Pile the parts ``order[:inlet.heap]`` up, if their room is free; their poses are left in ``inlet.pose``.

    Args: as for :func:`find_place`.

    Returns:
        Whether it is.
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


@borrowing
def deliver(inlet, hulls, placed, key, tried, waiting, present, pose):
    """Let parts arrive that wait for it.

    Args:
        key: (2,) of the episode.  tried: how often it has been tried.
        waiting, present: (parts,) bool.  pose: (parts, 3) of those that are present.

    Returns:
        How many arrive: the first ones of ``inlet.order``, at ``inlet.pose``.
    """
    if shuffle_waiting(inlet, key, tried, waiting) < inlet.heap:
        return 0
    if inlet.heap > 1:
        return inlet.heap if pile_up(inlet, hulls, placed, key, tried, present, pose) else 0
    return 1 if find_place(inlet, hulls, placed, key, tried, present, pose) else 0
