"""Flat parts: outline, friction, mass."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.physics.core.records import Bodies, Body
from vibgym.scene import outlines

LEAST_MASS, MOST_MASS = 1e-9, 1e9
"""kg."""

STEEL_DENSITY = 7850.0  # kg/m^3, for parts given without a mass


@dataclass(frozen=True, eq=False)
class Part:
    """A rigid part of uniform density that lies flat on the surface.

    Build one with :meth:`rectangle`, :meth:`disc` or :meth:`polygon`. Its pose is that of the centre of mass.

    Attributes:
        outline: (n, 2) m, contact area about the centre of mass, counter-clockwise.
        friction: coefficient of sliding friction between part and surface.
        static_friction: coefficient of static friction, at least ``friction``.
        area: m^2.  gyration: planar inertia over mass, m^2.  radius: of the smallest circle about the centre of mass, m.
        symmetry: turns by ``2 pi / symmetry`` map the part onto itself; 0 for a disc, whose heading shows nowhere.
        height: m.  mass: kg (of steel, if not given; sliding does not depend on it).
        restitution, contact_friction: of contacts with other parts and walls; the energetic coefficient of restitution
            (:mod:`vibgym.physics.collision.impact`).
    """

    outline: np.ndarray
    friction: float
    static_friction: float
    area: float
    gyration: float
    radius: float
    symmetry: int
    height: float
    mass: float
    name: str
    restitution: float
    contact_friction: float

    @classmethod
    def rectangle(cls, length: float, width: float, *, friction: float, **properties: Any) -> Part:
        """A block ``length`` (along its own x) by ``width``, m. Keyword arguments as for :meth:`polygon`."""
        a = checks.number("length", length, least=outlines.LEAST_SIZE, most=outlines.MOST_PLACE) / 2
        b = checks.number("width", width, least=outlines.LEAST_SIZE, most=outlines.MOST_PLACE) / 2
        properties.setdefault("name", "rectangle")
        return cls.polygon([[-a, -b], [a, -b], [a, b], [-a, b]], friction=friction, **properties)

    @classmethod
    def disc(cls, radius: float, *, friction: float, **properties: Any) -> Part:
        """A disc of ``radius`` m. Keyword arguments as for :meth:`polygon`."""
        radius = checks.number("radius", radius, least=outlines.LEAST_SIZE, most=outlines.MOST_PLACE)
        properties.setdefault("name", "disc")
        return cls._build(
            outlines.disc_outline(radius), math.pi * radius**2, 0.5 * radius**2, 0, friction, **properties
        )

    @classmethod
    def polygon(cls, vertices: Any, *, friction: float, **properties: Any) -> Part:
        """A part with a simple polygonal outline, convex or not, given about any origin and in either sense.

        Args:
            vertices: (n, 2), m.
            friction: coefficient of sliding friction, >= 0.
            **properties: ``static_friction`` (default: equal to ``friction``), ``height`` (m, default 10 mm), ``mass``
                (kg, default: of steel), ``name``, ``restitution`` (0 to 1, default 0.2), ``contact_friction``
                (default 0.3).

        Raises:
            ValueError: an outline that crosses itself, or a value out of its range.
        """
        outline = outlines.simple_outline(vertices)
        properties.setdefault("name", "polygon")
        return cls._build(
            outline,
            outlines.signed_area(outline),
            outlines.gyration(outline),
            outlines.symmetry_order(outline),
            friction,
            **properties,
        )

    @classmethod
    def _build(
        cls,
        outline: np.ndarray,
        area: float,
        gyration: float,
        symmetry: int,
        friction: float,
        *,
        name: str,
        static_friction: float | None = None,
        height: float = 0.010,
        mass: float | None = None,
        restitution: float = 0.2,
        contact_friction: float = 0.3,
        **unknown: Any,
    ) -> Part:
        if unknown:
            allowed = "static_friction, height, mass, name, restitution, contact_friction"
            raise checks.refuse("part", sorted(unknown), f"properties among {allowed}")
        friction = checks.number("friction", friction, least=0.0)
        if static_friction is None:
            static_friction = friction
        static_friction = checks.number("static_friction", static_friction, least=friction)
        height = checks.number("height", height, above=0.0, most=outlines.MOST_PLACE)
        given = STEEL_DENSITY * area * height if mass is None else mass
        mass = checks.number("mass", given, least=LEAST_MASS, most=MOST_MASS)
        checks.label("name", name)
        outline.setflags(write=False)
        return cls(
            outline=outline,
            friction=friction,
            static_friction=static_friction,
            area=area,
            gyration=gyration,
            radius=float(np.hypot(*outline.T).max()),
            symmetry=symmetry,
            height=height,
            mass=mass,
            name=name,
            restitution=checks.number("restitution", restitution, least=0.0, most=1.0),
            contact_friction=checks.number("contact_friction", contact_friction, least=0.0),
        )

    def body(self) -> Body:
        """The part as the kernels take it."""
        return Body(
            np.array(self.outline),
            self.area,
            self.radius,
            self.gyration,
            self.friction,
            self.static_friction,
            outlines.is_convex(self.outline),
            self.symmetry != 0,
        )

    def to_dict(self) -> dict[str, Any]:
        """The part as a mapping for JSON, from which :func:`vibgym.config.part_from` makes an equal one."""
        shape: dict[str, Any] = {"shape": "polygon", "vertices": self.outline.tolist()}
        if self.symmetry == 0:
            shape = {"shape": "disc", "radius": self._disc_radius()}
        names = ("friction", "static_friction", "height", "mass", "name", "restitution", "contact_friction")
        return {**shape, **{name: getattr(self, name) for name in names}}

    def _disc_radius(self) -> float:
        """The number that the disc was made from, to the last bit."""
        near = math.sqrt(self.area / math.pi)
        around = [near + k * math.ulp(near) for k in (0, -1, 1, -2, 2, -3, 3, -4, 4)]
        same = (radius for radius in around if math.pi * radius**2 == self.area)
        return next((radius for radius in same if np.array_equal(outlines.disc_outline(radius), self.outline)), near)

    def same_as(self, other: Part) -> bool:
        """Whether the other part is one of the same kind: equal in all that physics knows of it."""
        return (
            (self.friction, self.static_friction, self.mass, self.restitution, self.contact_friction, self.symmetry)
            == (
                other.friction,
                other.static_friction,
                other.mass,
                other.restitution,
                other.contact_friction,
                other.symmetry,
            )
            and self.outline.shape == other.outline.shape
            and bool((self.outline == other.outline).all())
        )


def kinds_of(parts: Sequence[Part]) -> tuple[list[Part], np.ndarray]:
    """The different parts among ``parts``, in order of appearance, and the kind of each, (parts,)."""
    kinds: list[Part] = []
    numbers = []
    for part in parts:
        number = next((k for k, kind in enumerate(kinds) if kind.same_as(part)), len(kinds))
        if number == len(kinds):
            kinds.append(part)
        numbers.append(number)
    return kinds, np.array(numbers)


def bodies_of(parts: Sequence[Part]) -> Bodies:
    """The parts of a world as the kernels take them."""
    kinds, numbers = kinds_of(parts)
    bodies = [kind.body() for kind in kinds]
    return Bodies(
        kind=numbers,
        outline=np.concatenate([body.outline for body in bodies]),
        first=np.cumsum([0, *(len(body.outline) for body in bodies)]),
        area=np.array([body.area for body in bodies]),
        radius=np.array([body.radius for body in bodies]),
        gyration=np.array([body.gyration for body in bodies]),
        friction=np.array([body.friction for body in bodies]),
        static_friction=np.array([body.static_friction for body in bodies]),
        convex=np.array([body.convex for body in bodies]),
        turns=np.array([body.turns for body in bodies]),
    )


SHIPPED: dict[str, dict[str, Any]] = {
    "steel_block": {"length": 0.050, "width": 0.040, "height": 0.004, "friction": 0.64},
    "aluminium_block": {"length": 0.050, "width": 0.035, "height": 0.020, "friction": 0.58, "mass": 0.0945},
}
"""The two parts of the thesis's experiments (section 7.1), both on a fluoropolymer foil."""


def shipped_part(name: str) -> Part:
    """One of the shipped parts by name."""
    checks.choice("part", name, tuple(SHIPPED))
    return Part.rectangle(**SHIPPED[name], name=name)
