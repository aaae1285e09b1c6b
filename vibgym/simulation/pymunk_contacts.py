"""Contacts by pymunk (``contacts="pymunk"`` of the planar model): an example of contacts by another library.

Where parts of a world are near, all move by friction, one contact step at a time. From the first step of a period in which some
overlap, each is followed by ``space.step``:

1. A body gets the velocity ``u`` after friction and the position ``x - u h``. pymunk begins a step with a motion by
   velocity, so it finds contacts at ``x``, the pose after friction.
2. The change of ``u`` is that by contacts. The change of ``x`` corrects the overlaps that pymunk found in its last step.

The state of a world is poses and velocities. A space also keeps impulses, neighbours, and the next correction. Therefore each
period has its own space, and its last step computes no correction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pymunk
from pymunk.batch import BodyFields, Buffer, get_space_bodies, set_space_bodies

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Pinned, reference
from vibgym.kernels.vector import LANES
from vibgym.physics.contacts.broad_phase import FREE
from vibgym.physics.contacts.fast import (
    Rows,
    fast_scene_at,
    load_bodies,
    load_worlds,
    measure_overlap,
    rows_at,
    slide_slots,
    store_worlds,
    write_bodies,
)
from vibgym.physics.core.drive import Drive, pinned_drive
from vibgym.physics.core.records import State, state_at
from vibgym.physics.planar.workspace import Scene
from vibgym.simulation.fast import FastBuffers, FastMultibody
from vibgym.simulation.model import Setup
from vibgym.simulation.schemes import PlanarSchemes

ITERATIONS = 20
"""Fewest iterations of pymunk's solver; in a world with different masses their ratio is added."""

CORRECTED = 0.3
"""Share of an overlap that pymunk corrects in a contact step."""

MOTION = BodyFields.POSITION | BodyFields.ANGLE | BodyFields.VELOCITY | BodyFields.ANGULAR_VELOCITY
"""Columns of the arrays of motions: x, y (m), heading (rad), and their rates."""

KINDS = 31
"""Collision categories of parts, one for each pair of their coefficients in contacts; pymunk has 32, the last one of walls."""


@jit
def load_world(world, start, fixed, drive, state, rows):
    """Load the parts on the table of a world in a block that begins at ``start``; return their number."""
    fixed, state, rows = fast_scene_at(fixed), state_at(state), rows_at(rows)
    friction, drive = fixed.friction, reference(pinned_drive(drive))
    scene = reference(Scene(friction.table, friction.bodies, friction.scheme, drive, state, friction.workspace, 1))
    load_worlds(scene, fixed.contacts, rows.driven, world, world + 1, start)
    return fixed.contacts.first[1]


@jit
def slide(step, stop, fixed, drive, state, motion):
    """Move the loaded parts by friction in contact step ``step``, and on until parts overlap or step ``stop``.

    Args:
        motion: (parts + 1, 6) overwritten for pymunk.

    Returns:
        The last step, or ``stop`` if no parts overlap; how many have fallen, or -1 if a value is not finite.
    """
    fixed, state = fast_scene_at(fixed), state_at(state)
    friction, slots, fallen = fixed.friction, fixed.contacts.first[1], 0
    drive, groups, workspace = reference(pinned_drive(drive)), (slots + LANES - 1) // LANES, friction.workspace
    scene = reference(Scene(friction.table, friction.bodies, friction.scheme, drive, state, workspace, groups))
    while step < stop:
        h, total, fallen = slide_slots(scene, fixed, slots, step), 0.0, 0
        for slot in range(slots):
            fallen += workspace.away[slot]
            for axis in range(3):
                at = axis * LANES + slot % LANES
                x, u = workspace.pose[slot // LANES, at], workspace.velocity[slot // LANES, at]
                motion[slot, axis], motion[slot, 3 + axis] = x - u * h, u
                total += abs(x) + abs(u)
        motion[slots, :] = 0.0  # pymunk's static body, which has the walls, comes last
        if not total < math.inf:
            return stop, -1
        if measure_overlap(scene, fixed) > 0.0:
            fixed.contacts.touched[0] += 1
            break
        step += 1
    return step, fallen


@jit
def take_contacts(fixed, drive, state, motion):
    """Take over the motions (parts or more, 6) of the loaded parts after a step of pymunk."""
    fixed, state = fast_scene_at(fixed), state_at(state)
    friction, contacts, slots = fixed.friction, fixed.contacts, fixed.contacts.first[1]
    drive, groups, workspace = reference(pinned_drive(drive)), (slots + LANES - 1) // LANES, friction.workspace
    scene = reference(Scene(friction.table, friction.bodies, friction.scheme, drive, state, workspace, groups))
    load_bodies(scene, fixed, 0, slots)
    for slot in range(slots):
        if not workspace.away[slot]:
            for axis in range(3):
                x = workspace.pose[slot // LANES, axis * LANES + slot % LANES]
                contacts.points.move[slot, axis] = motion[slot, axis] - x
                contacts.points.velocity[slot, axis] = motion[slot, 3 + axis]
    write_bodies(scene, fixed, 0, slots)


@jit
def end_world(fixed, drive, state, counts):
    """Store the loaded parts after a period; ``counts``: (worlds, COUNTS) int64, added to."""
    fixed, state = fast_scene_at(fixed), state_at(state)
    friction, drive = fixed.friction, reference(pinned_drive(drive))
    scene = reference(Scene(friction.table, friction.bodies, friction.scheme, drive, state, friction.workspace, 1))
    measure_overlap(scene, fixed)
    store_worlds(scene, fixed.contacts, 1, counts)


class PymunkMultibody(FastMultibody):
    """Advances worlds with several parts or walls, with contacts by pymunk."""

    WHOLE = True
    most_overlap = math.inf

    def __init__(self, setup: Setup, schemes: PlanarSchemes) -> None:
        super().__init__(setup, schemes, PymunkBuffers)

    def drive(
        self, start: int, stop: int, buffers: Any, drive: Pinned[Drive], state: Pinned[State], rows: Pinned[Rows]
    ) -> None:
        self.counts[start:stop, FREE] += 1
        inputs = buffers.together.address, drive.address, state.address
        for row in np.flatnonzero(rows.record.driven.any(axis=1)).tolist():
            count = load_world(start + row, start, *inputs, rows.address)
            step, _ = slide(0, buffers.steps, *inputs, buffers.motion)
            if step < buffers.steps:
                buffers.resolve(step, count, state.record.mass[start + row], inputs)
            end_world(*inputs, self.counts)


class PymunkBuffers(FastBuffers):
    """Constants and working arrays of one thread, and the bodies and shapes, which outlive pymunk's spaces."""

    def __init__(self, setup: Setup, schemes: PlanarSchemes) -> None:
        super().__init__(setup, schemes)
        self.steps = self.together.record.friction.scheme.steps * self.together.record.couplings
        self.motion = np.zeros((len(setup.parts) + 1, 6))
        self._setup, self._workspace = setup, self.together.record.friction.workspace
        self._hulls = self.together.record.hulls.every
        self._given, self._result = Buffer(), Buffer()
        self._given.set_float_buf(self.motion)
        self._laws = [(kind.restitution, kind.contact_friction) for kind in setup.parts.every]
        self._kinds = sorted(set(self._laws))
        if len(self._kinds) > KINDS:
            got = f"{len(self._kinds)} different pairs of restitution and contact_friction"
            raise checks.refuse("parts", got, f"parts with at most {KINDS} such pairs with contacts='pymunk'")
        self._walls = [wall for name in setup.walls for wall in self._wall(name)]
        self._made: dict[tuple[int, int], tuple[pymunk.Body, list[pymunk.Shape]]] = {}  # by part and kind

    def _body(self, part: int, kind: int) -> tuple[pymunk.Body, list[pymunk.Shape]]:
        """Return body and shapes of a part."""
        if (part, kind) not in self._made:
            own = self._setup.parts.every[kind]
            body = pymunk.Body(own.mass, own.mass * own.gyration)
            self._made[part, kind] = body, self._shapes_of(kind, body)
        return self._made[part, kind]

    def _shapes_of(self, kind: int, body: pymunk.Body) -> list[pymunk.Shape]:
        """Return the convex shapes of a kind of parts; those of a disc are a circle."""
        hulls, shapes = self._hulls, []
        law = pymunk.ShapeFilter(categories=1 << self._kinds.index(self._laws[kind]))
        for hull in range(hulls.owner[kind], hulls.owner[kind + 1]):
            corners, radius = hulls.corner[hulls.first[hull] : hulls.first[hull + 1], :2], float(hulls.rounding[hull])
            one = len(corners) == 1
            shape = pymunk.Circle(body, radius) if one else pymunk.Poly(body, corners.tolist(), radius=radius)
            shapes.append(with_law(shape, self._laws[kind], law))
        return shapes

    def _wall(self, name: str) -> list[pymunk.Shape]:
        """Return a wall as one box for each pair of coefficients, which are those of the part in contact."""
        width, depth = self._setup.surface.width, self._setup.surface.depth
        far = width + depth + 2.0 * max(kind.radius for kind in self._setup.parts.every)
        left, right = {"left": (-far, 0.0), "right": (width, far)}.get(name, (-far, far))
        bottom, top = {"bottom": (-far, 0.0), "top": (depth, far)}.get(name, (-far, far))
        box = [(left, bottom), (right, bottom), (right, top), (left, top)]
        kinds = (pymunk.ShapeFilter(categories=1 << KINDS, mask=1 << k) for k in range(len(self._kinds)))
        return [with_law(pymunk.Poly(None, box), law, kind) for law, kind in zip(self._kinds, kinds, strict=True)]

    def _space(self, bodies: list[pymunk.Body], kinds: list[int], factors: list[float], h: float) -> pymunk.Space:
        """Return a space with bodies of these kinds, which get their shapes at their positions, and walls.

        ``factors``: on their masses.
        """
        space = pymunk.Space()
        for body, kind, factor in zip(bodies, kinds, factors, strict=True):
            body.mass = factor * self._setup.parts.every[kind].mass
            body.moment = body.mass * self._setup.parts.every[kind].gyration
        masses = [body.mass for body in bodies]
        space.iterations = ITERATIONS + int(max(masses) / min(masses))
        space.collision_slop, space.collision_bias = self.together.record.slop, (1.0 - CORRECTED) ** (1.0 / h)
        for wall in self._walls:
            wall.body = space.static_body
        space.add(*bodies, *self._walls)
        return space

    def resolve(self, step: int, count: int, mass: np.ndarray, inputs: tuple[Any, ...]) -> None:
        """Finish a period in which contact step ``step`` has moved ``count`` loaded parts by friction, so that some overlap.

        ``mass``: (all parts,) factors on masses.  ``inputs``: addresses for kernels.
        """
        h, parts = self._setup.surface.period / self.steps, self._workspace.part[:count]
        kinds = self._workspace.kind[:count].tolist()
        bodies, shapes = zip(*map(self._body, parts.tolist(), kinds), strict=True)
        space, fallen, present = self._space(list(bodies), kinds, mass[parts].tolist(), h), 0, -1
        try:
            while step < self.steps and fallen >= 0:
                set_space_bodies(space, MOTION, self._given)
                if fallen != present:
                    present = self._update_shapes(space, shapes)
                if step + 1 == self.steps:
                    space.collision_bias = 1.0  # keep all of each overlap
                space.step(h)
                self._result.clear()
                get_space_bodies(space, MOTION, self._result)
                take_contacts(*inputs, np.frombuffer(self._result.float_buf()).reshape(-1, 6))
                step += 1
                _, fallen = slide(step, min(step + 1, self.steps), *inputs, self.motion)
        finally:
            space.remove(*space.shapes, *space.bodies)
            if step < self.steps:
                self._made.clear()  # some may have corrections that have not been applied

    def _update_shapes(self, space: pymunk.Space, shapes: Sequence[list[pymunk.Shape]]) -> int:
        """Add the shapes of the parts on the table and remove those of fallen ones; return how many have fallen."""
        away = self._workspace.away[: len(shapes)].tolist()
        for own, gone in zip(shapes, away, strict=True):
            for shape in own:
                if (shape in space.shapes) == gone:
                    (space.remove if gone else space.add)(shape)
        return sum(away)


def with_law(shape: pymunk.Shape, law: tuple[float, float], kind: pymunk.ShapeFilter) -> pymunk.Shape:
    """Return the shape with restitution and friction ``law``; pymunk multiplies those of two shapes in contact."""
    shape.elasticity, shape.friction, shape.filter = math.sqrt(law[0]), math.sqrt(law[1]), kind
    return shape
