"""Interface to pymunk's contact solver for kernels.

A space serves one island of parts at a time. Bodies and shapes of all parts and walls are constructed once. The kernel adds
those of an island, steps the space by the addresses of the library's functions, and removes them
(:mod:`vibgym.physics.contacts.coupling`), so that the space is empty for the next island. The library iterates over shapes in
the order of their ids: its hash tables have more slots than shapes. Tables never shrink, and each step scans them: so there
are several spaces, for islands of different sizes.
"""

from __future__ import annotations

import ctypes
import functools
import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import pymunk

from vibgym import checks
from vibgym.kernels.jit import foreign
from vibgym.physics.contacts.impact import ImpactProperties
from vibgym.physics.contacts.solver import Solver
from vibgym.scene.hulls import WALLS, convex_pieces, rounding
from vibgym.scene.outlines import narrowest_width
from vibgym.scene.parts import Part, kinds_of
from vibgym.scene.surface import Surface

ffi: Any
lib: Any
try:
    from pymunk._chipmunk_cffi import ffi, lib
except ImportError:  # see solver_problem
    ffi = lib = None

INSET = 1e-6
"""m, by which the solver's shapes are smaller all around, so that touching parts do not overlap by rounding."""

SLOP = 3e-5
"""m, overlap that the solver does not correct, so that contacts persist and it can warm-start."""

LEAST_WIDTH = 1e-4
"""m, least width of a part that may touch others: overlaps must be small against it."""

MOST_MASS_RATIO = 2000.0
"""Largest ratio of masses of parts that may touch, up to which the solver's iterations converge."""

KEPT_PER_SECOND = 1e-150
"""Share of the overlap beyond ``SLOP`` that is left after a second; half of it is corrected in 2 ms."""

ROOM = 12
"""Shapes of the smallest space, about as many as the library's tables hold before they grow; each further one has four times
as many."""

FUNCTIONS = (
    "cpSpaceStep", "cpSpaceEachBody", "pmSpaceBodySetIteratorFuncBatched", "pmSpaceBodyGetIteratorFuncBatched",
    "cpBodyUpdatePosition", "cpSpaceAddBody", "cpSpaceRemoveBody", "cpSpaceAddShape", "cpSpaceRemoveShape",
    "cpSpaceSetShapeIDCounter", "cpBodySetMass", "cpBodySetMoment", "cpSpaceSetIterations", "cpSpaceSetCollisionSlop",
    "cpSpaceSetCurrentTimeStep",
)  # fmt: skip
CONSTANTS = "POSITION", "ANGLE", "VELOCITY", "ANGULAR_VELOCITY"
"""Names of pymunk's library that kernels use."""

MATERIALS = 31
"""Most different coefficients of friction with walls: bits of pymunk's shape filter."""


class ContactSpace:
    """Spaces of pymunk for the parts of a world and the walls.

    Contacts in them do not rebound: :mod:`vibgym.physics.contacts.impact` computes rebounds. Friction of a contact between two
    parts is the geometric mean of theirs; a wall has the friction of the part that touches it.

    Args:
        surface: the table.
        parts: of a world.
        walls: names among :data:`vibgym.scene.hulls.WALLS`.

    Attributes:
        solver: record for kernels, with addresses into this object: keep both together.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], walls: Sequence[str]) -> None:
        problem = solver_problem()
        if problem:
            raise checks.conflict(
                f"several parts or walls, with certified contacts, require pymunk's solver: {problem}"
            )
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
        """Return the addresses of functions and arguments of the library."""
        data = np.zeros(
            6 * len(self._bodies) + 8
        )  # with room, since the library reallocates arrays that are nearly full
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
        """Construct copies anew: the solver's addresses point into this object."""
        return ContactSpace, self._made_of


@functools.cache
def solver_problem() -> str:
    """Return why kernels cannot call pymunk's solver; "" if they can. ``VIBGYM_SOLVER=0`` switches it off.

    pymunk's public interface has no substitute: without the ids of shapes and the length of the last step, results would depend
    on the islands before.
    """
    if os.environ.get("VIBGYM_SOLVER", "1") == "0":
        return "VIBGYM_SOLVER is 0"
    lacking = [name for name in (*FUNCTIONS, *CONSTANTS) if not hasattr(lib, name)]
    if lacking:
        return f"pymunk {pymunk.version} lacks {', '.join(lacking)}"
    body = pymunk.Body(1.0, 1.0)
    set_mass = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_double)(_place("cpBodySetMass"))
    set_mass(_address(body._body), 2.0)
    return "" if body.mass == 2.0 else f"functions of pymunk {pymunk.version} cannot be called by their addresses"


def check_parts(parts: Sequence[Part]) -> None:
    """Raise ValueError for parts that are too thin, or much heavier than another, for reliable contacts."""
    kinds, _ = kinds_of(parts)
    width, thinnest = min(((narrowest_width(kind.outline), kind) for kind in kinds), key=lambda each: each[0])
    if width < LEAST_WIDTH:
        allowed = f"at least {1e3 * LEAST_WIDTH:g} mm wide where parts may touch one another or walls"
        raise checks.refuse(
            "parts", f"part {parts.index(thinnest)} ({thinnest.name!r}), {1e3 * width:.3g} mm wide", allowed
        )
    check_masses("parts", parts, np.array([part.mass for part in parts]))


def slop_of(part: Part) -> float:
    """Return the overlap of a part that the solver does not correct, m."""
    return min(SLOP, 0.05 * narrowest_width(part.outline))


def check_masses(argument: str, parts: Sequence[Part], masses: np.ndarray) -> None:
    """Check that the ratio of ``masses`` (parts,), kg, is within the range of the solver."""
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
    # Between parallel edges the corner moves along the normal.
    way = np.where(
        turn[:, None] > 1e-9, (edges - before) / np.maximum(turn, 1e-9)[:, None], edges[:, ::-1] * [-1.0, 1.0]
    )
    # The displacement of a sharp corner is limited, so that a sliver keeps its orientation.
    return piece + INSET * way / np.maximum(np.hypot(way[:, 0], way[:, 1]) / 100.0, 1.0)[:, None]


def _wall_shapes(
    space: pymunk.Space, surface: Surface, walls: Sequence[str], materials: Sequence[float]
) -> list[list[pymunk.Shape | None]]:
    """Return the walls of a space as thick bars outside the surface, by wall and material; None without a wall."""
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
        low_x, low_y, high_x, high_y = bars[name]
        corners = [(low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y)]
        for index, friction in enumerate(materials if name in walls else ()):
            bar = pymunk.Poly(space.static_body, corners)
            bar.friction = math.sqrt(friction)
            bar.filter = pymunk.ShapeFilter(mask=1 << index)
            shapes[wall][index] = bar
    return shapes
