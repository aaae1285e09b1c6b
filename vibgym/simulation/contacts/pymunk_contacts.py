"""Contacts by pymunk (``contacts="pymunk"`` of the planar model): an example of contacts by another library.

1. A body gets the velocity after friction and the position at the step's start. pymunk begins a step with a motion by
   velocity, so it finds contacts at the pose after friction.
2. The change of velocity is that by contacts. The change of position corrects the overlaps that pymunk found in its last step.

The state of a world is poses and velocities. A space also keeps impulses, neighbours, and the next correction. Therefore each
period has its own space, and its last step computes no correction.
"""

from __future__ import annotations

import math

import numpy as np
import pymunk
from pymunk.batch import BodyFields, Buffer, get_space_bodies, set_space_bodies

from vibgym import checks
from vibgym.simulation.contacts.stepped import SteppedContacts
from vibgym.simulation.model import Setup
from vibgym.simulation.schemes import PlanarSettings

ITERATIONS = 20
"""Fewest iterations of pymunk's solver; in a world with different masses their ratio is added."""

CORRECTED = 0.3
"""Share of an overlap that pymunk corrects in a contact step."""

MOTION = BodyFields.POSITION | BodyFields.ANGLE | BodyFields.VELOCITY | BodyFields.ANGULAR_VELOCITY
"""Columns of the arrays of motions: x, y (m), heading (rad), and their rates."""

KINDS = 31
"""Collision categories of parts, one for each pair of their coefficients in contacts; pymunk has 32, the last one of walls."""


class PymunkContacts(SteppedContacts):
    """Contacts by pymunk's solver. Bodies and shapes outlive the spaces."""

    most_overlap = math.inf

    def __init__(self, setup: Setup, settings: PlanarSettings) -> None:
        super().__init__(setup, settings)
        self._given, self._result = Buffer(), Buffer()
        self._given.set_float_buf(self._motion)
        self._laws = [(kind.restitution, kind.contact_friction) for kind in self.kinds]
        self._kinds = sorted(set(self._laws))
        if len(self._kinds) > KINDS:
            got = f"{len(self._kinds)} different pairs of restitution and contact_friction"
            raise checks.refuse("parts", got, f"parts with at most {KINDS} such pairs with contacts='pymunk'")
        self._walls = [wall for name in setup.walls for wall in self._wall(name)]
        self._made: dict[tuple[int, int], tuple[pymunk.Body, list[pymunk.Shape]]] = {}  # by part and kind

    def _body(self, part: int, kind: int) -> tuple[pymunk.Body, list[pymunk.Shape]]:
        """Return body and shapes of a part."""
        if (part, kind) not in self._made:
            body = pymunk.Body(self.kinds[kind].mass, self.kinds[kind].mass * self.kinds[kind].gyration)
            self._made[part, kind] = body, self._shapes_of(kind, body)
        return self._made[part, kind]

    def _shapes_of(self, kind: int, body: pymunk.Body) -> list[pymunk.Shape]:
        """Return the convex shapes of a kind of parts; those of a disc are a circle."""
        hulls, shapes = self.hulls.every, []
        law = pymunk.ShapeFilter(categories=1 << self._kinds.index(self._laws[kind]))
        for hull in range(hulls.owner[kind], hulls.owner[kind + 1]):
            corners, radius = hulls.corner[hulls.first[hull] : hulls.first[hull + 1], :2], float(hulls.rounding[hull])
            one = len(corners) == 1
            shape = pymunk.Circle(body, radius) if one else pymunk.Poly(body, corners.tolist(), radius=radius)
            shapes.append(with_law(shape, self._laws[kind], law))
        return shapes

    def _wall(self, name: str) -> list[pymunk.Shape]:
        """Return a wall as one box for each pair of coefficients, which are those of the part in contact."""
        width, depth = self.setup.surface.width, self.setup.surface.depth
        far = width + depth + 2.0 * max(kind.radius for kind in self.kinds)
        left, right = {"left": (-far, 0.0), "right": (width, far)}.get(name, (-far, far))
        bottom, top = {"bottom": (-far, 0.0), "top": (depth, far)}.get(name, (-far, far))
        box = [(left, bottom), (right, bottom), (right, top), (left, top)]
        kinds = (pymunk.ShapeFilter(categories=1 << KINDS, mask=1 << k) for k in range(len(self._kinds)))
        return [with_law(pymunk.Poly(None, box), law, kind) for law, kind in zip(self._kinds, kinds, strict=True)]

    def begin(self, parts: list[int], kinds: list[int], mass: np.ndarray) -> None:
        """Make a space with the bodies of ``parts``, which get their shapes at their positions, and walls."""
        space, self._present = pymunk.Space(), -1
        bodies, self._shapes = zip(*map(self._body, parts, kinds), strict=True)
        for body, kind, kg in zip(bodies, kinds, mass.tolist(), strict=True):
            body.mass, body.moment = kg, kg * self.kinds[kind].gyration
        space.iterations = ITERATIONS + int(mass.max() / mass.min())
        space.collision_slop = self.scene.record.slop
        space.collision_bias = (1.0 - CORRECTED) ** (1.0 / self.h)
        for wall in self._walls:
            wall.body = space.static_body
        space.add(*bodies, *self._walls)
        self._space = space

    def resolve_step(self, motion: np.ndarray, away: np.ndarray, last: bool) -> np.ndarray:
        space = self._space
        set_space_bodies(space, MOTION, self._given)
        if np.count_nonzero(away) != self._present:
            self._present = self._update_shapes(away)
        if last:
            space.collision_bias = 1.0  # keep all of each overlap
        space.step(self.h)
        self._result.clear()
        get_space_bodies(space, MOTION, self._result)
        return np.frombuffer(self._result.float_buf()).reshape(-1, 6)

    def _update_shapes(self, away: np.ndarray) -> int:
        """Add the shapes of the parts on the table and remove those of fallen ones; return how many have fallen."""
        for shapes, gone in zip(self._shapes, away.tolist(), strict=True):
            for shape in shapes:
                if (shape in self._space.shapes) == gone:
                    (self._space.remove if gone else self._space.add)(shape)
        return int(away.sum())

    def end(self, complete: bool) -> None:
        self._space.remove(*self._space.shapes, *self._space.bodies)
        if not complete:
            self._made.clear()  # some may have corrections that have not been applied


def with_law(shape: pymunk.Shape, law: tuple[float, float], kind: pymunk.ShapeFilter) -> pymunk.Shape:
    """Return the shape with restitution and friction ``law``; pymunk multiplies those of two shapes in contact."""
    shape.elasticity, shape.friction, shape.filter = math.sqrt(law[0]), math.sqrt(law[1]), kind
    return shape
