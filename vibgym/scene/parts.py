"""Flat parts: outline, friction, mass."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.registry import Registry
from vibgym.scene import outlines
from vibgym.scene.friction_laws import law_table
from vibgym.scene.part_settings import (
    HEIGHT,
    MAX_DENSITY,
    MAX_MASS,
    MIN_DENSITY,
    MIN_MASS,
    SHAPES,
    DiscSettings,
    DrawingSettings,
    PartSettings,
    RectangleSettings,
)
from vibgym.scene.surface import Surface
from vibgym.settings import read

STEEL_DENSITY = 7850.0  # kg/m^3, for parts given without a mass

PROTOTYPE = Surface()


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
            (:mod:`vibgym.physics.contacts.certified.impact`).
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
        settings = read(RectangleSettings, {"length": length, "width": width, "friction": friction, **properties}, "")
        a, b = settings.length / 2, settings.width / 2
        return cls._polygon([[-a, -b], [a, -b], [a, b], [-a, b]], (), settings, "rectangle")

    @classmethod
    def disc(cls, radius: float, *, friction: float, **properties: Any) -> Part:
        """Return a disc of ``radius`` m. Keyword arguments as for :meth:`polygon`."""
        settings = read(DiscSettings, {"radius": radius, "friction": friction, **properties}, "")
        radius = settings.radius
        outline = outlines.disc_outline(radius)
        shape = _Shape(outline, outline, math.pi * radius**2, 0.5 * radius**2, 0)
        return cls._build(shape, settings, "disc")

    @classmethod
    def polygon(cls, vertices: Any, *, friction: float, holes: Sequence[Any] = (), **properties: Any) -> Part:
        """Return a part with a simple polygonal outline, convex or not, about any origin and in either sense.

        Args:
            vertices: (n, 2), m.
            friction: coefficient of sliding friction, >= 0.
            holes: (n, 2) m each, simple polygons inside the outline, apart from each other. They carry no load and have no
                mass; their corners and those of ``vertices`` have the same origin.
            **properties: ``static_friction``, ``friction_law``, ``height``, ``mass``, ``name``, ...: the fields of
                :class:`vibgym.scene.part_settings.PartSettings`.

        Raises:
            ValueError: an outline that crosses itself or a hole, or a value out of its range.
        """
        settings = read(PartSettings, {"friction": friction, **properties}, "")
        return cls._polygon(vertices, holes, settings, "polygon")

    @classmethod
    def from_file(
        cls, path: str | Path, *, friction: float, surface: Surface | None = PROTOTYPE, **settings: Any
    ) -> Part:
        """Return the part in a DXF, SVG or STL file (extra ``cad``).

        A drawing has one closed outline, with holes inside it. A mesh has the outline of its projection onto the table. A
        circle without holes is a disc.

        Args:
            path: ``.dxf``, ``.svg`` or ``.stl``.
            friction: coefficient of sliding friction, >= 0.
            surface: that the part must fit on; None: not checked.
            **settings: ``thickness_mm``, ``density``, ``tolerance_mm``, ``units``, ``layer``, ...: the fields of
                :class:`vibgym.scene.part_settings.DrawingSettings`, in m or with ``_mm``.

        Raises:
            ValueError: a file that does not describe exactly one part, or a value out of its range; the message names the file
                and the entity by its handle (DXF), line (SVG, STL in text) or facet (STL). ``error.faults`` lists all faults.
            MissingExtra: the extra is not installed.

        Warns:
            UserWarning: a mesh that is no prism, with its deviations; ``units`` that are not those of the file; a drawing that
                contains more than the part (:attr:`skipped`).
        """
        if not isinstance(path, str | Path):
            raise checks.refuse("file", path, "a path")
        arguments = {"file": str(path), "friction": friction, **settings}
        return drawn_part(read(DrawingSettings, arguments, ""), surface)[0]

    @classmethod
    def _polygon(cls, vertices: Any, holes: Sequence[Any], settings: PartSettings, name: str) -> Part:
        rim, inner = (
            outlines.outline_with_holes(vertices, holes) if len(holes) else (outlines.simple_outline(vertices), [])
        )
        of = outlines.bridged(rim, inner)
        for ring in (rim, *inner):
            ring.setflags(write=False)
        order = outlines.symmetry_order(rim, inner)
        shape = _Shape(of, rim, outlines.signed_area(of), outlines.gyration(of), order, tuple(inner))
        return cls._build(shape, settings, name)

    @classmethod
    def _build(cls, shape: _Shape, settings: PartSettings, name: str) -> Part:
        """Return a part; ``name``: where the settings have none."""
        name = checks.label("name", name if settings.name is None else settings.name)
        law, height, mass = settings.friction_law, settings.height, settings.mass
        at_rest = settings.friction * float(law_table(law)[0])
        static = at_rest if settings.static_friction is None else settings.static_friction
        centre = 0.5 * height if settings.centre_height is None else settings.centre_height
        if mass is None:
            mass = STEEL_DENSITY * shape.area * height
        density = mass / (shape.area * height)
        if settings.mass is not None and not MIN_DENSITY <= density <= MAX_DENSITY:
            warnings.warn(
                f"part {name!r}: mass {mass:g} kg implies a density of {density:.3g} kg/m^3; "
                "masses are in kg, lengths in m",
                stacklevel=4,
            )
        shape.outline.setflags(write=False)
        return cls(
            **shape._asdict(),
            friction=settings.friction,
            static_friction=checks.number("static_friction", static, least=at_rest),
            radius=float(np.hypot(*shape.outline.T).max()),
            height=height,
            mass=checks.number("mass", mass, least=MIN_MASS, most=MAX_MASS),
            name=name,
            restitution=settings.restitution,
            contact_friction=settings.contact_friction,
            coupling=settings.coupling,
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
        return self.height != HEIGHT or self.centre_height != 0.5 * self.height

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
        """Return the part as a mapping for JSON, from which :func:`part_from` restores an equal one."""
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


def part_from(value: Any, where: str = "parts", surface: Surface | None = None) -> Part:
    """Return a part from the name of a shipped one, the path of a drawing, a mapping of settings, or a Part.

    Args:
        value: a mapping has ``shape`` and the fields of its settings (:data:`vibgym.scene.part_settings.SHAPES`), or ``file``
            and those of :class:`vibgym.scene.part_settings.DrawingSettings`; None: the default.
        where: name of the argument, for errors.
        surface: that a part from a file must fit on; None: not checked.
    """
    if isinstance(value, Part):
        return value
    if isinstance(value, str | Path) and Path(value).suffix:
        value = {"file": str(value)}
    if isinstance(value, str):
        return shipped_part(value, where)
    if not isinstance(value, Mapping):
        raise checks.refuse(where, value, "a shipped part's name, the path of a drawing, or a mapping with 'shape'")
    if "file" in value:
        return part_and_poses(value, where, surface)[0]
    if "shape" not in value:
        raise checks.missing(f"{where}.shape", f"one of {', '.join(SHAPES)}")
    shape = checks.choice(f"{where}.shape", value["shape"], SHAPES)
    properties = {name: property_ for name, property_ in value.items() if property_ is not None}
    settings = vars(read(SHAPES[shape], properties, where))
    return getattr(Part, shape)(**{name: setting for name, setting in settings.items() if name != "shape"})


def part_and_poses(
    value: Mapping[str, Any], where: str = "parts", surface: Surface | None = None
) -> tuple[Part, tuple[StablePose, ...]]:
    """Return the part of a mapping of drawing settings as :func:`part_from`, and the stable poses of a mesh."""
    settings = read(DrawingSettings, {name: setting for name, setting in value.items() if setting is not None}, where)
    with checks.within(where):
        return drawn_part(settings, surface)


class StablePose(NamedTuple):
    """A pose in which a part from a mesh rests on the table.

    Attributes:
        probability: that a part dropped at a random orientation without bouncing comes to rest in it.
        height, centre_height: of the part and its centre of mass above the table, mm.
        area: of the faces on the table, mm^2.
    """

    probability: float
    height: float
    centre_height: float
    area: float


DRAWINGS: Registry[Callable[[DrawingSettings, Surface | None], tuple[Part, tuple[StablePose, ...]]]] = Registry(
    "kind of drawing", {}, "vibgym.drawings"
)
"""Readers of drawings by the suffix of the file without its dot: return what :func:`drawn_part` returns."""


def drawn_part(settings: DrawingSettings, surface: Surface | None = None) -> tuple[Part, tuple[StablePose, ...]]:
    """Return the part of a drawing, and the stable poses of a mesh, most probable first.

    Errors and warnings are those of :meth:`Part.from_file`.
    """
    kind = Path(settings.file).suffix.lower().removeprefix(".")
    if kind not in DRAWINGS:
        raise checks.refuse("file", settings.file, "a drawing: " + ", ".join(f".{suffix}" for suffix in DRAWINGS))
    return DRAWINGS[kind](settings, surface)


def skipped_text(skipped: Mapping[str, int]) -> str:
    """Return what a drawing contains and its part does not, :attr:`Part.skipped`, as a list."""
    return ", ".join(f"{count} {kind}" for kind, count in sorted(skipped.items()))


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


def shipped_part(name: str, where: str = "part") -> Part:
    """Return one of the shipped parts by name."""
    checks.choice(where, name, tuple(SHIPPED))
    return Part.rectangle(**SHIPPED[name], name=name)
