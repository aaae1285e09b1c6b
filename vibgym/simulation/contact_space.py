"""Interface to pymunk's contact solver for kernels.

A space serves one island of parts at a time. Bodies and shapes are made once, of all parts and walls; the kernel puts those of
an island in, steps the space by the addresses of the library's own functions, and takes them out again
(:mod:`vibgym.physics.contacts.coupling`), so that every island finds it empty. The order in which the library goes through
shapes is that of the numbers that they are given, from 0 on: it keeps them in hash tables with more places than shapes. Tables
grow and never shrink, and each step goes through all of them: so there are several spaces, for islands of different sizes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pymunk
from pymunk._chipmunk_cffi import ffi, lib

from vibgym import checks
from vibgym.kernels.jit import foreign
from vibgym.physics.contacts.impact import ImpactProperties
from vibgym.physics.contacts.solver import Solver
from vibgym.scene.hulls import WALLS, convex_pieces, rounding
from vibgym.scene.outlines import narrowest_width
from vibgym.scene.parts import Part, kinds_of
from vibgym.scene.surface import Surface

INSET = 1e-6
"""m; the solver's shapes are smaller all around, so that parts laid against one another by computed numbers do not overlap."""

SLOP = 3e-5
"""m of overlap that is left alone; contacts that come and go would lose what the solver has learnt."""

LEAST_WIDTH = 1e-4
"""m, of a part that may touch others: overlaps are to stay small against it."""

MOST_MASS_RATIO = 2000.0
"""Between parts that may touch: the solver's rounds bring a push through light parts between heavy ones up to here."""

KEPT_PER_SECOND = 1e-150
"""Share of the overlap beyond it that is left after a second. In 2 ms, half of it goes."""

ROOM = 12
"""Shapes that the smallest space is for; each other one is for four times as many as the one before. About so many fit into the
library's tables before they grow."""

MATERIALS = 31
"""Most different coefficients of friction with walls: bits of pymunk's shape filter."""


class ContactSpace:
    """pymunk spaces for the parts of a world and the walls.

    Contacts in them do not rebound: :mod:`vibgym.physics.contacts.impact` does that. Friction of a contact between
    two parts is the geometric mean of theirs; a wall takes on that of the part that touches it.

    Args:
        surface: the table.
        parts: of a world.
        walls: names among :data:`vibgym.scene.hulls.WALLS`.

    Attributes:
        solver: what the kernels take. It holds addresses into this object: keep both together.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], walls: Sequence[str]) -> None:
        self._made_of = (surface, tuple(parts), tuple(walls))
        materials = sorted({part.contact_friction for part in parts})
        if walls and len(materials) > MATERIALS:
            raise checks.conflict(
                f"parts on a surface with walls have at most {MATERIALS} different values of contact_friction, got "
                f"{len(materials)}"
            )
        check_parts(parts)
        self._bodies, self._shapes, owner = [], [], [0]
        for part in parts:
            body = pymunk.Body(part.mass, part.mass * part.gyration)
            bit = 1 << materials.index(part.contact_friction) % 32 if walls else 1
            for shape in _part_shapes(body, part):
                shape.friction = math.sqrt(part.contact_friction)  # the solver takes the product over two shapes
                shape.filter = pymunk.ShapeFilter(categories=bit | 1 << 31)
                self._shapes.append(shape)
            owner.append(len(self._shapes))
            self._bodies.append(body)
        rooms = [ROOM]
        while rooms[-1] < len(self._shapes):
            rooms.append(4 * rooms[-1])
        self._spaces = [pymunk.Space() for _ in rooms]
        for space in self._spaces:
            space.collision_bias = KEPT_PER_SECOND
        bars = [_wall_shapes(space, surface, walls, materials) for space in self._spaces]
        self._keep: list[Any] = [bars]
        self.solver = self._solver(
            spaces=np.array([_address(space._space) for space in self._spaces]),
            capacity=np.array(rooms),
            owner=np.array(owner),
            material=np.array([materials.index(part.contact_friction) for part in parts]),
            wall_shapes=np.array(
                [[[_address(bar._shape) if bar else 0 for bar in each] for each in some] for some in bars]
            ),
            added_walls=np.zeros((len(WALLS), len(materials)), np.bool_),
        )

    def _solver(self, **more: np.ndarray) -> Solver:
        """Return addresses of all that kernels call and hand over."""
        data = np.zeros(
            6 * len(self._bodies) + 8
        )  # the library grows its arrays when they are nearly full: never let it
        floats = ffi.new("pmFloatArray *")
        floats.arr, floats.max, floats.num = ffi.from_buffer("cpFloat[]", data), 1 << 30, 0
        integers = ffi.new("pmIntArray *")
        self._keep += [data, floats, integers]

        def batch(fields: int) -> int:
            made = ffi.new("pmBatchedData *")
            made.fields, made.floatArray, made.intArray = fields, floats, integers
            self._keep.append(made)
            return _address(made)

        place, speed = lib.POSITION | lib.ANGLE, lib.VELOCITY | lib.ANGULAR_VELOCITY
        return Solver(
            step=_function("cpSpaceStep", "int64", "float64"),
            each=_function("cpSpaceEachBody", "int64", "int64", "int64"),
            put=_place("pmSpaceBodySetIteratorFuncBatched"),
            take=_place("pmSpaceBodyGetIteratorFuncBatched"),
            update=_function("cpBodyUpdatePosition", "int64", "float64"),
            add_body=_function("cpSpaceAddBody", "int64", "int64"),
            remove_body=_function("cpSpaceRemoveBody", "int64", "int64"),
            add=_function("cpSpaceAddShape", "int64", "int64"),
            remove=_function("cpSpaceRemoveShape", "int64", "int64"),
            number_from=_function("cpSpaceSetShapeIDCounter", "int64", "int64"),
            set_mass=_function("cpBodySetMass", "int64", "float64"),
            set_moment=_function("cpBodySetMoment", "int64", "float64"),
            set_rounds=_function("cpSpaceSetIterations", "int64", "int64"),
            set_slop=_function("cpSpaceSetCollisionSlop", "int64", "float64"),
            last_step=_function("cpSpaceSetCurrentTimeStep", "int64", "float64"),
            put_all=batch(place | speed),
            put_velocity=batch(speed),
            take_all=batch(place | speed),
            take_pose=batch(place),
            data=data,
            cursor=np.frombuffer(ffi.buffer(floats, 4), dtype=np.int32),
            bodies=np.array([_address(body._body) for body in self._bodies]),
            shapes=np.array([_address(shape._shape) for shape in self._shapes]),
            **more,
        )

    def __reduce__(self) -> Any:
        """Return copies and pickles are built anew: the solver's addresses are this object's own."""
        return ContactSpace, self._made_of


def check_parts(parts: Sequence[Part]) -> None:
    """Refuse parts that contacts cannot be relied on for.

    Raises:
        ValueError: one is too thin, or much heavier than another.
    """
    kinds, _ = kinds_of(parts)
    width, thinnest = min(((narrowest_width(kind.outline), kind) for kind in kinds), key=lambda each: each[0])
    if width < LEAST_WIDTH:
        allowed = f"at least {1e3 * LEAST_WIDTH:g} mm wide where parts may touch one another or walls"
        raise checks.refuse(
            "parts", f"part {parts.index(thinnest)} ({thinnest.name!r}), {1e3 * width:.3g} mm wide", allowed
        )
    check_masses("parts", parts, np.array([part.mass for part in parts]))


def slop_of(part: Part) -> float:
    """Return overlap of a part that the solver leaves alone, m."""
    return min(SLOP, 0.05 * narrowest_width(part.outline))


def check_masses(argument: str, parts: Sequence[Part], masses: np.ndarray) -> None:
    """Refuse ``masses`` (parts,), kg, that are too different for the solver."""
    heavy, light = int(np.argmax(masses)), int(np.argmin(masses))
    ratio = masses[heavy] / masses[light]
    if ratio > MOST_MASS_RATIO:
        names = parts[heavy].name, parts[light].name
        got = f"part {heavy} ({names[0]!r}), {ratio:.3g} times as heavy as part {light} ({names[1]!r})"
        allowed = f"masses with a ratio of at most {MOST_MASS_RATIO:g} where parts may touch one another"
        raise checks.refuse(argument, got, allowed)


def impact_properties_of(parts: Sequence[Part]) -> ImpactProperties:
    """Return the properties of the parts of a world that determine impacts."""
    n = len(parts)
    return ImpactProperties(
        mass=np.array([part.mass for part in parts]),
        gyration=np.array([part.gyration for part in parts]),
        inverse_mass=np.zeros(n),  # written for each world
        inverse_inertia=np.zeros(n),
        restitution=np.array([part.restitution for part in parts]),
        friction=np.array([part.contact_friction for part in parts]),
    )


def _address(pointer: Any) -> int:
    return int(ffi.cast("intptr_t", pointer))


def _place(function: str) -> int:
    return _address(ffi.addressof(lib, function))


def _function(name: str, *arguments: str) -> Any:
    return foreign(_place(name), *arguments)


def _part_shapes(body: pymunk.Body, part: Part) -> list[pymunk.Shape]:
    if part.symmetry == 0:
        return [pymunk.Circle(body, rounding(part) - INSET)]
    return [pymunk.Poly(body, _inset(piece).tolist()) for piece in convex_pieces(part)]


def _inset(piece: np.ndarray) -> np.ndarray:
    """Return a convex polygon with every edge moved inwards by :data:`INSET`."""
    edges = np.roll(piece, -1, axis=0) - piece
    edges = edges / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    before = np.roll(edges, 1, axis=0)
    turn = before[:, 0] * edges[:, 1] - before[:, 1] * edges[:, 0]
    # Where edges are parallel the corner moves straight in.
    way = np.where(
        turn[:, None] > 1e-9, (edges - before) / np.maximum(turn, 1e-9)[:, None], edges[:, ::-1] * [-1.0, 1.0]
    )
    # A sharp corner moves far; not so far that a sliver turns inside out.
    return piece + INSET * way / np.maximum(np.hypot(way[:, 0], way[:, 1]) / 100.0, 1.0)[:, None]


def _wall_shapes(
    space: pymunk.Space, surface: Surface, walls: Sequence[str], materials: Sequence[float]
) -> list[list[pymunk.Shape | None]]:
    """Return the walls of a space, in the order of all of them, once for each material, as thick bars outside the surface."""
    width, height = surface.width, surface.depth
    thick = max(width, height)
    bars = {
        "left": (-thick, -thick, 0.0, height + thick),
        "right": (width, -thick, width + thick, height + thick),
        "bottom": (-thick, -thick, width + thick, 0.0),
        "top": (-thick, height, width + thick, height + thick),
    }
    shapes: list[list[pymunk.Shape | None]] = [[None] * len(materials) for _ in WALLS]
    for wall, name in enumerate(WALLS):
        for index, friction in enumerate(materials if name in walls else ()):
            low_x, low_y, high_x, high_y = bars[name]
            corners = [(low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y)]
            bar = pymunk.Poly(space.static_body, corners)
            bar.friction = math.sqrt(friction)
            bar.filter = pymunk.ShapeFilter(mask=1 << index)
            shapes[wall][index] = bar
    return shapes
