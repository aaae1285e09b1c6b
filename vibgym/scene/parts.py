"""Flat parts: outline, friction, mass."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.scene import outlines
from vibgym.scene.friction_laws import law_table
from vibgym.scene.surface import Surface

if TYPE_CHECKING:
    from vibgym.scene.drawings.records import Drawing, Solid

LEAST_MASS, MOST_MASS = 1e-9, 1e9
"""kg."""

STEEL_DENSITY = 7850.0  # kg/m^3, for parts given without a mass

LEAST_DENSITY, MOST_DENSITY = 5.0, 50e3
"""kg/m^3, range of plausible densities, from foam to twice osmium; others give a warning."""

PRISM = 0.05
"""Relative deviation from a prism above which a mesh gives a warning."""

PROTOTYPE = Surface()

DEFAULTS: dict[str, Any] = {
    "name": None,
    "static_friction": None,
    "height": 0.010,
    "centre_height": None,
    "mass": None,
    "restitution": 0.2,
    "contact_friction": 0.3,
    "coupling": 1.0,
    "friction_law": None,
}
"""Properties of a part besides outline and friction."""


class _Shape(NamedTuple):
    """An outline and its properties, see :class:`Part`."""

    outline: np.ndarray
    rim: np.ndarray
    area: float
    gyration: float
    symmetry: int
    holes: tuple[np.ndarray, ...] = ()


@dataclass(frozen=True, eq=False)
class Part:
    """A rigid part of uniform density that lies flat on the surface.

    Build one with :meth:`rectangle`, :meth:`disc`, :meth:`polygon` or :meth:`from_file`. Its pose is that of the centre of
    mass.

    Attributes:
        outline: (n, 2) m, contact area about the centre of mass, counter-clockwise; with holes, each is joined by a cut
            that is passed twice (:func:`vibgym.scene.outlines.bridged`).
        rim: (n, 2) m, outer outline, which other parts and walls touch; parts cannot enter holes.
        holes: (n, 2) m each, clockwise.
        friction: coefficient of sliding friction between part and surface.
        static_friction: coefficient of static friction, at least ``friction``.
        area: m^2.  gyration: planar inertia over mass, m^2.  radius: of the smallest circle about the centre of mass, m.
        symmetry: turns by ``2 pi / symmetry`` map the part onto itself; 0 for a disc, whose heading is not observable.
        height: m.  mass: kg (default: of steel; sliding does not depend on it).
        restitution, contact_friction: of contacts with other parts and walls; the energetic coefficient of restitution
            (:mod:`vibgym.physics.contacts.impact`).
        centre_height: of the centre of mass above the bottom, m (default: half the height).
        coupling: share of the elements' vertical motion that reaches the part, 0 to 1; a soft foot absorbs the rest. With 0 the
            part presses evenly: friction brakes it, and only other parts can move it.
        friction_law: mapping of ``kind`` and settings, by which sliding friction is ``friction`` times a factor that depends on
            the slip speed (:mod:`vibgym.scene.friction_laws`); None: it is constant.
        skipped: what the part's drawing contains and the part does not, such as text or hidden lines -> number.
    """

    outline: np.ndarray
    rim: np.ndarray
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
    coupling: float = 1.0
    centre_height: float = 0.0
    friction_law: Mapping[str, Any] | None = None
    holes: tuple[np.ndarray, ...] = ()
    skipped: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def rectangle(cls, length: float, width: float, *, friction: float, **properties: Any) -> Part:
        """Return a block ``length`` (along its own x) by ``width``, m. Keyword arguments as for :meth:`polygon`."""
        a = checks.number("length", length, least=outlines.LEAST_SIZE, most=outlines.MOST_PLACE) / 2
        b = checks.number("width", width, least=outlines.LEAST_SIZE, most=outlines.MOST_PLACE) / 2
        properties.setdefault("name", "rectangle")
        return cls.polygon([[-a, -b], [a, -b], [a, b], [-a, b]], friction=friction, **properties)

    @classmethod
    def disc(cls, radius: float, *, friction: float, **properties: Any) -> Part:
        """Return a disc of ``radius`` m. Keyword arguments as for :meth:`polygon`."""
        radius = checks.number("radius", radius, least=outlines.LEAST_SIZE, most=outlines.MOST_PLACE)
        properties.setdefault("name", "disc")
        outline = outlines.disc_outline(radius)
        shape = _Shape(outline, outline, math.pi * radius**2, 0.5 * radius**2, 0)
        return cls._build(shape, friction, properties)

    @classmethod
    def polygon(cls, vertices: Any, *, friction: float, holes: Sequence[Any] = (), **properties: Any) -> Part:
        """Return a part with a simple polygonal outline, convex or not, about any origin and in either sense.

        Args:
            vertices: (n, 2), m.
            friction: coefficient of sliding friction, >= 0.
            holes: (n, 2) m each, simple polygons inside the outline, apart from each other. They carry no load and have no
                mass; their corners and those of ``vertices`` have the same origin.
            **properties: ``static_friction`` (default: that at rest), ``friction_law``, ``height`` (m, default 10 mm),
                ``centre_height`` (m, 0 to ``height``, default half of it), ``mass`` (kg, default: of steel), ``name``,
                ``restitution`` (0 to 1, default 0.2), ``contact_friction`` (default 0.3), ``coupling`` (0 to 1, default 1).

        Raises:
            ValueError: an outline that crosses itself or a hole, or a value out of its range.
        """
        properties.setdefault("name", "polygon")
        rim, inner = (
            outlines.outline_with_holes(vertices, holes) if len(holes) else (outlines.simple_outline(vertices), [])
        )
        of = outlines.bridged(rim, inner)
        for each in (rim, *inner):
            each.setflags(write=False)
        order = outlines.symmetry_order(rim, inner)
        shape = _Shape(of, rim, outlines.signed_area(of), outlines.gyration(of), order, tuple(inner))
        return cls._build(shape, friction, properties)

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        *,
        friction: float,
        thickness_mm: float | None = None,
        density: float | None = None,
        tolerance_mm: float = 0.05,
        units: str | None = None,
        scale: float | None = None,
        layer: str | Sequence[str] | None = None,
        without_layers: str | Sequence[str] = (),
        part: int | None = None,
        gap_mm: float | None = None,
        stable_pose: int | None = None,
        surface: Surface | None = PROTOTYPE,
        **properties: Any,
    ) -> Part:
        """Return the part in a DXF, SVG or STL file (extra ``cad``).

        A drawing has one closed outline, with holes inside it. A mesh has the outline of its projection onto the table. A
        circle without holes is a disc.

        Args:
            path: ``.dxf``, ``.svg`` or ``.stl``.
            friction: coefficient of sliding friction, >= 0.
            thickness_mm: of a drawing (default 10 mm); a mesh has its own.
            density: kg/m^3 (default: steel).
            tolerance_mm: largest distance of flattened curves from the drawn ones; flattening preserves area.
            units: of the drawing, ``"mm"``, ``"in"``, ... (:data:`vibgym.scene.drawings.records.UNITS`), if the file does not
                name them, or wrong ones; STL files are in mm by default.
            scale: of a drawing, factor of all lengths.
            layer: one or several, whose content alone is read; in SVG files ids, group labels or stroke colours.
            without_layers: those whose content is not read.
            part: number among several in a drawing, 0 for the largest; without it, several are an error that lists them.
            gap_mm: largest gap between ends of lines that is closed, with a warning; by default a tenth of the tolerance.
            stable_pose: of a mesh, 0 for the most probable one; None: as modelled.
            surface: that the part must fit on; None: not checked.
            **properties: as for :meth:`polygon`; ``name`` is that of the file by default.

        Raises:
            ValueError: a file that does not describe exactly one part, or a value out of its range; the message names the file
                and the entity by its handle (DXF), line (SVG, STL in text) or facet (STL). ``error.faults`` lists all faults.
            MissingExtra: the extra is not installed.

        Warns:
            UserWarning: a mesh that is no prism, with its deviations; ``units`` that are not those of the file; a drawing that
                contains more than the part (:attr:`skipped`).
        """
        from vibgym.scene.drawings.drawing import read

        drawing = read(
            path, tolerance_mm, units, scale=scale, layer=layer, without_layers=without_layers, part=part, gap=gap_mm,
            stable_pose=stable_pose, surface=surface,
        )  # fmt: skip
        return cls.from_drawing(
            drawing, path, friction=friction, thickness_mm=thickness_mm, density=density, **properties
        )

    @classmethod
    def from_drawing(
        cls,
        drawing: Drawing,
        path: str | Path,
        *,
        friction: float,
        thickness_mm: float | None = None,
        density: float | None = None,
        **properties: Any,
    ) -> Part:
        """Return the part in a drawing that :func:`vibgym.scene.drawings.drawing.read` has read from ``path``.

        Arguments, errors and warnings are those of :meth:`from_file`.
        """
        from vibgym.scene.drawings.records import summary

        properties = {"name": Path(path).stem, **properties}
        if density is not None:
            if properties.get("mass") is not None:
                raise checks.conflict("density and mass exclude one another")
            density = checks.number("density", density, least=LEAST_DENSITY, most=MOST_DENSITY)
        solid = drawing.solid
        if solid is None:
            if thickness_mm is not None:
                if properties.get("height") is not None:
                    raise checks.conflict("thickness_mm and height exclude one another")
                properties["height"] = 1e-3 * checks.number("thickness_mm", thickness_mm, above=0.0)
        else:
            given = [name for name in ("height", "centre_height") if properties.get(name) is not None]
            if thickness_mm is not None or given:
                raise checks.conflict(
                    f"{given[0] if given else 'thickness_mm'} is that of the mesh, in {Path(path).name}"
                )
            properties |= {"height": 1e-3 * solid.height, "centre_height": 1e-3 * solid.centre_height}
            if properties.get("mass") is None:
                properties["mass"] = (density or STEEL_DENSITY) * 1e-9 * solid.volume
        if drawing.radius is not None:
            part = cls.disc(1e-3 * drawing.radius, friction=friction, **properties)
        else:
            holes = [1e-3 * hole for hole in drawing.holes]
            part = cls.polygon(1e-3 * drawing.rim, friction=friction, holes=holes, **properties)
        if solid is not None:
            _warn_of_shape(part, solid)
        elif density is not None:
            part = replace(part, mass=density * part.area * part.height)
        if drawing.skipped:
            warnings.warn(f"part {part.name!r}: skipped {summary(drawing.skipped)}", stacklevel=3)
        return replace(part, skipped=drawing.skipped)

    @classmethod
    def _build(cls, shape: _Shape, friction: float, properties: dict[str, Any]) -> Part:
        unknown = [name for name in properties if name not in DEFAULTS]
        if unknown:
            raise checks.refuse("part", sorted(unknown), f"properties among {', '.join(DEFAULTS)}")
        given = {**DEFAULTS, **properties}
        friction = checks.number("friction", friction, least=0.0)
        law = given["friction_law"]
        at_rest = friction * float(law_table(law)[0])
        static = at_rest if given["static_friction"] is None else given["static_friction"]
        static = checks.number("static_friction", static, least=at_rest)
        height = checks.number("height", given["height"], above=0.0, most=outlines.MOST_PLACE)
        centre = 0.5 * height if given["centre_height"] is None else given["centre_height"]
        mass = STEEL_DENSITY * shape.area * height if given["mass"] is None else given["mass"]
        mass = checks.number("mass", mass, least=LEAST_MASS, most=MOST_MASS)
        density = mass / (shape.area * height)
        if given["mass"] is not None and not LEAST_DENSITY <= density <= MOST_DENSITY:
            warnings.warn(
                f"part {given['name']!r}: mass {mass:g} kg implies a density of {density:.3g} kg/m^3; "
                "masses are in kg, lengths in m",
                stacklevel=4,
            )
        checks.label("name", given["name"])
        shape.outline.setflags(write=False)
        return cls(
            **shape._asdict(),
            friction=friction,
            static_friction=static,
            radius=float(np.hypot(*shape.outline.T).max()),
            height=height,
            mass=mass,
            name=given["name"],
            restitution=checks.number("restitution", given["restitution"], least=0.0, most=1.0),
            contact_friction=checks.number("contact_friction", given["contact_friction"], least=0.0),
            coupling=checks.number("coupling", given["coupling"], least=0.0, most=1.0),
            centre_height=checks.number("centre_height", centre, least=0.0, most=height),
            friction_law=None if law is None else dict(law),
        )

    @property
    def inner_radius(self) -> float:
        """Radius of the largest circle about the centre of mass that no edge of the rim crosses, m."""
        edge = np.roll(self.rim, -1, axis=0) - self.rim
        along = np.clip(-(self.rim * edge).sum(axis=1) / (edge**2).sum(axis=1), 0.0, 1.0)
        return float(np.hypot(*(self.rim + along[:, None] * edge).T).min())

    @property
    def tipping_ratio(self) -> float:
        """``mu h_C`` over the distance from the centre of mass to the nearest edge that the part can tip over.

        Under a sliding part the centre of pressure is displaced by ``mu h_C``: from 1 on, friction alone tips the part.
        """
        return self.most_friction * self.centre_height / self._tipping_distance

    @property
    def height_is_known(self) -> bool:
        """Whether height or centre height differ from the default; slenderness is not checked for parts of default height."""
        return self.height != DEFAULTS["height"] or self.centre_height != 0.5 * self.height

    @property
    def slenderness(self) -> float:
        """Height of the centre of mass over the distance to the nearest edge that the part can tip over."""
        return self.centre_height / self._tipping_distance

    @property
    def _tipping_distance(self) -> float:
        """Distance from the centre of mass to the nearest edge of the convex hull, m."""
        return outlines.inner_distance(outlines.convex_hull(self.outline))

    @property
    def inertia(self) -> np.ndarray:
        """(3,) m^2, xx, yy and xy of a prism's inertia over mass about horizontal axes through the centre of mass."""
        upright = np.array([self.height**2 / 12.0, self.height**2 / 12.0, 0.0])
        return outlines.inertia(self.outline) * (self.gyration / outlines.gyration(self.outline)) + upright

    @property
    def most_friction(self) -> float:
        """Largest coefficient of sliding friction, which differs from ``friction`` with a friction law."""
        return self.friction * float(law_table(self.friction_law).max())

    def to_dict(self) -> dict[str, Any]:
        """Return the part as a mapping for JSON, from which :func:`vibgym.config.part_from` restores an equal one."""
        shape: dict[str, Any] = {"shape": "polygon", "vertices": self.rim.tolist()}
        if self.holes:
            shape["holes"] = [hole.tolist() for hole in self.holes]
        if self.symmetry == 0:
            shape = {"shape": "disc", "radius": self._disc_radius()}
        names = ("friction", "static_friction", "height", "mass", "name", "restitution", "contact_friction")
        more: dict[str, Any] = {}  # so that files of other parts stay the same
        if self.coupling != 1.0:
            more["coupling"] = self.coupling
        if self.friction_law is not None:
            more["friction_law"] = dict(self.friction_law)
        if self.centre_height != 0.5 * self.height:
            more["centre_height"] = self.centre_height
        return {**shape, **{name: getattr(self, name) for name in names}, **more}

    def _disc_radius(self) -> float:
        """Return the radius from which the disc was constructed, to the last bit."""
        near = math.sqrt(self.area / math.pi)
        around = [near + k * math.ulp(near) for k in (0, -1, 1, -2, 2, -3, 3, -4, 4)]
        same = (radius for radius in around if math.pi * radius**2 == self.area)
        return next((radius for radius in same if np.array_equal(outlines.disc_outline(radius), self.outline)), near)

    def slides_as(self, other: Part) -> bool:
        """Return whether both parts have the same motion in the plane, which does not depend on height."""
        names = (
            "friction", "static_friction", "mass", "restitution", "contact_friction", "symmetry", "coupling", "friction_law",
        )  # fmt: skip
        return all(getattr(self, name) == getattr(other, name) for name in names) and np.array_equal(
            self.outline, other.outline
        )

    def same_as(self, other: Part) -> bool:
        """Return whether both parts are equal except for their names."""
        return self.height == other.height and self.centre_height == other.centre_height and self.slides_as(other)


def _warn_of_shape(part: Part, solid: Solid) -> None:
    """Warn of a mesh that differs from a plate with its outline, as which it moves."""
    inertia = 1e-6 * solid.gyration / part.gyration
    offset = 1e-3 * solid.offset / part.radius
    if solid.resting < 1.0 - PRISM or abs(inertia - 1.0) > PRISM or offset > PRISM:
        warnings.warn(
            f"part {part.name!r} is no prism: it rests on {100 * solid.resting:.0f} % of its outline, its centre of mass is "
            f"{solid.offset:.3g} mm from the outline's, its inertia {inertia:.2f} of a plate's; it moves as a plate",
            stacklevel=4,
        )


def kinds_of(
    parts: Sequence[Part], same: Callable[[Part, Part], bool] = Part.slides_as
) -> tuple[list[Part], np.ndarray]:
    """Return the different parts among ``parts``, in order of appearance, and the kind of each, (parts,).

    Args:
        same: whether two parts are of one kind: :meth:`Part.slides_as`, or :meth:`Part.same_as` where heights matter.
    """
    kinds: list[Part] = []
    numbers = []
    for part in parts:
        number = next((k for k, kind in enumerate(kinds) if same(kind, part)), len(kinds))
        if number == len(kinds):
            kinds.append(part)
        numbers.append(number)
    return kinds, np.array(numbers)


SHIPPED: dict[str, dict[str, Any]] = {
    "steel_block": {"length": 0.050, "width": 0.040, "height": 0.004, "friction": 0.64},
    "aluminium_block": {"length": 0.050, "width": 0.035, "height": 0.020, "friction": 0.58, "mass": 0.0945},
}
"""The two parts of the thesis's experiments (section 7.1), both on a fluoropolymer foil."""


def shipped_part(name: str) -> Part:
    """Return one of the shipped parts by name."""
    checks.choice("part", name, tuple(SHIPPED))
    return Part.rectangle(**SHIPPED[name], name=name)
