"""Contact models in Python that correct the motion of a world's parts after each of several equal steps of friction."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.broad_phase import FREE, rows_at
from vibgym.physics.contacts.fast import (
    fast_scene_at,
    load_bodies,
    load_worlds,
    measure_overlap,
    slide_slots,
    store_worlds,
    write_bodies,
)
from vibgym.physics.core.drive import pinned_drive
from vibgym.physics.core.records import state_at
from vibgym.physics.planar.workspace import scene_of
from vibgym.simulation.contacts.fast import FastContacts
from vibgym.simulation.model import Setup
from vibgym.simulation.schemes import CONTACT_STEPS, PlanarSettings


class SteppedContacts(FastContacts):
    """Contact models of which :meth:`resolve_step` is required.

    Where parts of a world are near, all of its parts move by friction, one contact step at a time. From the first step of a
    period in which some overlap, each is followed by :meth:`resolve_step`.
    """

    FEWEST, WHOLE = CONTACT_STEPS, True

    def __init__(self, setup: Setup, settings: PlanarSettings) -> None:
        super().__init__(setup, settings)
        self.h = setup.surface.period / self.steps
        self._motion = np.zeros((len(setup.parts) + 1, 6))

    def begin(self, parts: list[int], kinds: list[int], mass: np.ndarray) -> None:
        """Begin the contacts of a period.

        Args:
            parts: the n parts of the world that had not fallen before the period.
            kinds: (n,) of them, indices of :attr:`kinds`.
            mass: (n,) kg.
        """

    @abstractmethod
    def resolve_step(self, motion: np.ndarray, away: np.ndarray, last: bool) -> np.ndarray:
        """Return the motion after the contacts of a step of :attr:`h` s.

        Args:
            motion: (n + 1, 6) of the parts of :meth:`begin` after friction: x, y (m) and heading (rad) at the step's start, so
                that a motion by velocity ends where friction has moved the part, and their rates (m/s, rad/s). The last row,
                of walls, is zero.
            away: (n,) bool, parts that have fallen.
            last: whether this is the period's last step.

        Returns:
            (n or more, 6) at the step's end.
        """

    def end(self, complete: bool) -> None:
        """End the contacts of a period; ``complete``: it was not interrupted by an exception."""

    def resolve(self, start: int, stop: int, drive: Any, state: Any, counts: np.ndarray, deepest: np.ndarray) -> None:
        counts[start:stop, FREE] += 1
        inputs = self.scene.address, drive.address, state.address
        for row in np.flatnonzero(self.block.record.driven.any(axis=1)).tolist():
            count = load_world(start + row, start, *inputs, self.block.address)
            step, _ = slide(0, self.steps, *inputs, self._motion)
            if step < self.steps:
                self._resolve_world(step, count, state.record.mass[start + row], inputs)
            end_world(*inputs, counts, deepest)

    def _resolve_world(self, step: int, count: int, mass: np.ndarray, inputs: tuple[Any, ...]) -> None:
        """Finish a period in which contact step ``step`` has moved ``count`` loaded parts by friction, so that some overlap.

        Args:
            mass: (all parts,) factors on masses.
            inputs: addresses for kernels.
        """
        workspace, fallen = self.scene.record.friction.workspace, 0
        parts, away = workspace.part[:count].tolist(), workspace.away[:count]
        kinds = workspace.kind[:count].tolist()
        own = np.array([self.kinds[kind].mass for kind in kinds])
        self.begin(parts, kinds, mass[parts] * own)
        try:
            while step < self.steps and fallen >= 0:
                last = step + 1 == self.steps
                write(*inputs, self.resolve_step(self._motion, away, last))
                step += 1
                _, fallen = slide(step, min(step + 1, self.steps), *inputs, self._motion)
        finally:
            self.end(step >= self.steps)


@jit
def load_world(world, start, fixed, drive, state, rows):
    """Load the parts on the table of a world in a block that begins at ``start``; return their number."""
    fixed, drive = fast_scene_at(fixed), reference(pinned_drive(drive))
    scene = reference(scene_of(fixed.friction, drive, state_at(state), 1))
    load_worlds(scene, fixed.contacts, rows_at(rows).driven, world, world + 1, start)
    return fixed.contacts.first[1]


@jit
def slide(step, stop, fixed, drive, state, motion):
    """Move the loaded parts by friction in contact step ``step``, and on until parts overlap or step ``stop``.

    Args:
        motion: (parts + 1, 6) overwritten, see :meth:`SteppedContacts.resolve_step`.

    Returns:
        The last step, or ``stop`` if no parts overlap; how many have fallen, or -1 if a value is not finite.
    """
    fixed, drive = fast_scene_at(fixed), reference(pinned_drive(drive))
    workspace, slots, fallen = fixed.friction.workspace, fixed.contacts.first[1], 0
    scene = reference(scene_of(fixed.friction, drive, state_at(state), (slots + LANES - 1) // LANES))
    while step < stop:
        h, total, fallen = slide_slots(scene, fixed, slots, step), 0.0, 0
        for slot in range(slots):
            fallen += workspace.away[slot]
            for axis in range(3):
                at = axis * LANES + slot % LANES
                x, u = workspace.pose[slot // LANES, at], workspace.velocity[slot // LANES, at]
                motion[slot, axis], motion[slot, 3 + axis] = x - u * h, u
                total += abs(x) + abs(u)
        motion[slots, :] = 0.0
        if not total < math.inf:
            return stop, -1
        if measure_overlap(scene, fixed) > 0.0:
            fixed.contacts.touched[0] += 1
            break
        step += 1
    return step, fallen


@jit
def write(fixed, drive, state, motion):
    """Write the motion (parts or more, 6) of the loaded parts after contacts."""
    fixed, drive = fast_scene_at(fixed), reference(pinned_drive(drive))
    workspace, contacts, slots = fixed.friction.workspace, fixed.contacts, fixed.contacts.first[1]
    scene = reference(scene_of(fixed.friction, drive, state_at(state), (slots + LANES - 1) // LANES))
    load_bodies(scene, fixed, 0, slots)
    for slot in range(slots):
        if not workspace.away[slot]:
            for axis in range(3):
                x = workspace.pose[slot // LANES, axis * LANES + slot % LANES]
                contacts.points.move[slot, axis] = motion[slot, axis] - x
                contacts.points.velocity[slot, axis] = motion[slot, 3 + axis]
    write_bodies(scene, fixed, 0, slots)


@jit
def end_world(fixed, drive, state, counts, deepest):
    """Store the loaded parts after a period; ``counts``, ``deepest``: added to."""
    fixed, drive = fast_scene_at(fixed), reference(pinned_drive(drive))
    scene = reference(scene_of(fixed.friction, drive, state_at(state), 1))
    measure_overlap(scene, fixed)
    store_worlds(scene, fixed.contacts, 1, counts, deepest)
