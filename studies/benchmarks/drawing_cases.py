"""Drawings with known geometry, generated from a seed, for :mod:`studies.benchmarks.drawings`.

Outlines of lines, arcs, bulges, ellipses and splines with round and long holes, in nested blocks (DXF) or groups (SVG) with
rotation, scale and reflection, in several units, and prisms (STL). Area, centre and inertia are those of the exact curves,
sampled densely and cut into triangles by shapely; of prisms those of trimesh.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vibgym.plugins.drawings.records import UNITS

DENSE = 1500
"""Samples of a curve of the reference."""

KINDS = ("dxf", "svg", "stl")


class Line(NamedTuple):
    """A straight edge."""

    a: tuple[float, float]
    b: tuple[float, float]

    def points(self) -> np.ndarray:
        """Return its ends."""
        return np.array([self.a, self.b])


class Arc(NamedTuple):
    """An arc about a centre, from an angle (rad) on, counter-clockwise if the sweep is positive."""

    centre: tuple[float, float]
    radius: float
    begin: float
    sweep: float

    def points(self) -> np.ndarray:
        """Return samples."""
        angle = self.begin + self.sweep * np.linspace(0.0, 1.0, DENSE)
        return np.array(self.centre) + self.radius * np.column_stack([np.cos(angle), np.sin(angle)])


class Spline(NamedTuple):
    """A closed uniform cubic B-spline."""

    control: tuple[tuple[float, float], ...]

    def beziers(self) -> np.ndarray:
        """Return the control points (n, 4, 2) of its Bezier curves."""
        a, b, c, d = (np.roll(self.control, -k, axis=0) for k in range(4))
        return np.stack([a + 4 * b + c, 4 * b + 2 * c, 2 * b + 4 * c, b + 4 * c + d], axis=1) / 6.0

    def points(self) -> np.ndarray:
        """Return samples."""
        t = np.linspace(0.0, 1.0, DENSE // len(self.control), endpoint=False)[:, None]
        weights = [(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3]
        curves = [sum(w * p for w, p in zip(weights, bezier, strict=True)) for bezier in self.beziers()]
        return np.concatenate([*curves, curves[0][:1]])


class Ellipse(NamedTuple):
    """A whole ellipse about the origin."""

    major: float
    minor: float
    turn: float

    def points(self) -> np.ndarray:
        """Return samples."""
        angle = np.linspace(0.0, 2.0 * math.pi, DENSE)
        x, y = self.major * np.cos(angle), self.minor * np.sin(angle)
        c, s = math.cos(self.turn), math.sin(self.turn)
        return np.column_stack([c * x - s * y, s * x + c * y])


Ring = list[Line | Arc | Spline | Ellipse]


def circle(x: float, y: float, radius: float) -> Ring:
    """Return a circle."""
    return [Arc((x, y), radius, 0.0, 2.0 * math.pi)]


def slot(x: float, y: float, length: float, radius: float, angle: float) -> Ring:
    """Return a slot: two half circles and two lines, counter-clockwise."""
    c, s = math.cos(angle), math.sin(angle)
    ends = [(x + k * length * c, y + k * length * s) for k in (0.5, -0.5)]
    corner = {(e, k): (ends[e][0] - k * radius * s, ends[e][1] + k * radius * c) for e in (0, 1) for k in (1, -1)}
    half = 0.5 * math.pi
    return [
        Arc(ends[0], radius, angle - half, math.pi), Line(corner[0, 1], corner[1, 1]),
        Arc(ends[1], radius, angle + half, math.pi), Line(corner[1, -1], corner[0, -1]),
    ]  # fmt: skip


def rounded(width: float, depth: float, radius: float) -> Ring:
    """Return a rectangle with round corners."""
    a, b, half = 0.5 * width - radius, 0.5 * depth - radius, 0.5 * math.pi
    arcs = [Arc((x, y), radius, k * half, half) for k, (x, y) in enumerate([(a, b), (-a, b), (-a, -b), (a, -b)])]
    ring: Ring = []
    for arc, after in zip(arcs, arcs[1:] + arcs[:1], strict=True):
        ring += [arc, Line(tuple(arc.points()[-1]), tuple(after.points()[0]))]
    return ring


def bulged(draw: random.Random, size: float) -> Ring:
    """Return a polygon about the origin whose edges are lines or arcs, to either side."""
    n = draw.randint(4, 8)
    corners = [
        size * draw.uniform(0.8, 1.0) * np.array([math.cos(a), math.sin(a)])
        for a in (2.0 * math.pi * (k + draw.uniform(-0.15, 0.15)) / n for k in range(n))
    ]
    ring: Ring = []
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        ring.append(Line(tuple(a), tuple(b)) if draw.random() < 0.5 else arc_of(a, b, draw.uniform(-0.12, 0.35)))
    return ring


def arc_of(a: np.ndarray, b: np.ndarray, bulge: float) -> Arc:
    """Return the arc from ``a`` to ``b`` with a bulge, the tangent of a quarter of its sweep; positive: to the right."""
    chord, sweep = b - a, 4.0 * math.atan(bulge)
    length = float(np.hypot(*chord))
    centre = 0.5 * (a + b) + np.array([-chord[1], chord[0]]) / length * (0.5 * length / math.tan(0.5 * sweep))
    start = a - centre
    return Arc(tuple(centre), float(np.hypot(*start)), math.atan2(start[1], start[0]), sweep)


class Frame(NamedTuple):
    """Scale (negative: reflection), rotation (deg) and translation of a block or group, in this order."""

    scale: tuple[float, float]
    turn: float
    move: tuple[float, float]

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3)."""
        c, s = math.cos(math.radians(self.turn)), math.sin(math.radians(self.turn))
        linear = np.array([[c, -s], [s, c]]) @ np.diag(self.scale)
        return np.vstack([np.column_stack([linear, self.move]), [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Case:
    """A drawing with known geometry.

    Attributes:
        rings: outline and holes, inside the frames.
        frames: of nested blocks or groups, the innermost one first.
        unit: a key of :data:`vibgym.plugins.drawings.records.UNITS`; lengths of the rings are in it.
        kind: among :data:`KINDS`.
        thickness: of a prism.
        shape: name of the outline.
    """

    rings: list[Ring]
    frames: list[Frame]
    unit: str
    kind: str
    thickness: float
    shape: str


def case(seed: int, kind: str) -> Case:
    """Return a case."""
    draw = random.Random(f"{kind} {seed}")
    unit = "mm" if kind == "stl" else draw.choice(["mm", "mm", "cm", "in", *(["m"] if kind == "dxf" else [])])
    size = draw.uniform(15.0, 60.0) / UNITS[unit]  # half of the largest dimension
    shape = draw.choice(["rounded", "slot", "bulged", "ellipse", "spline", "circle"])
    if shape == "rounded":
        depth = draw.uniform(0.5, 1.0)
        rim, room = rounded(2 * size, 2 * size * depth, size * depth * draw.uniform(0.1, 0.9)), 0.6 * depth * size
    elif shape == "slot":
        radius = draw.uniform(0.3, 0.6) * size
        rim, room = slot(0.0, 0.0, 2 * (size - radius), radius, draw.uniform(0.0, 3.0)), 0.8 * radius
    elif shape == "bulged":
        rim, room = bulged(draw, size), 0.35 * size
    elif shape == "ellipse":
        minor = draw.uniform(0.4, 0.9) * size
        rim, room = [Ellipse(size, minor, draw.uniform(0.0, 3.0))], 0.8 * minor
    elif shape == "spline":
        n = draw.randint(6, 12)
        polar = [(size * draw.uniform(0.75, 1.0), 2.0 * math.pi * k / n) for k in range(n)]
        rim, room = [Spline(tuple((r * math.cos(a), r * math.sin(a)) for r, a in polar))], 0.5 * size
    else:
        rim, room = circle(0.0, 0.0, size), 0.8 * size
    holes, first = [], draw.uniform(0.0, 6.0)
    for k in range(draw.choice([0, 0, 1, 2, 3, 4])):
        angle = first + 0.5 * math.pi * k
        x, y = 0.55 * room * math.cos(angle), 0.55 * room * math.sin(angle)
        radius = draw.uniform(0.05, 0.16) * room
        holes.append(circle(x, y, radius) if draw.random() < 0.5 else slot(x, y, radius, radius, draw.uniform(0, 3)))
    frames = []
    for level in range(draw.randint(0, 3) if kind != "stl" else 0):
        x, y = math.exp(draw.uniform(-0.3, 0.3)) * np.ones(2)
        if level == 0 and draw.random() < 0.5:
            y *= draw.uniform(0.7, 1.3)
        if draw.random() < 0.3:
            y *= -1.0
        moved = draw.uniform(-2.0, 2.0) * size, draw.uniform(-2.0, 2.0) * size
        frames.append(Frame((float(x), float(y)), draw.uniform(0.0, 360.0), moved))
    return Case([rim, *holes], frames, unit, kind, draw.uniform(2.0, 12.0), shape)


class Truth(NamedTuple):
    """Properties of the exact geometry: mm^2, mm, mm^2 (inertia over mass), mm (size)."""

    area: float
    centre: np.ndarray
    gyration: float
    size: float


def truth(of: Case) -> Truth:
    """Return the properties of a case by triangles of shapely, from dense samples."""
    import shapely

    matrix = np.eye(3)
    for frame in of.frames:
        matrix = frame.matrix @ matrix
    rings = []
    for ring in of.rings:
        points = np.concatenate([edge.points()[:-1] for edge in ring])
        rings.append(UNITS[of.unit] * (points @ matrix[:2, :2].T + matrix[:2, 2]))
    polygon = shapely.Polygon(rings[0], rings[1:])
    assert polygon.is_valid, shapely.is_valid_reason(polygon)
    triangles = shapely.constrained_delaunay_triangles(polygon)
    corners = np.array([np.array(triangle.exterior.coords)[:3] for triangle in triangles.geoms])
    a, b, c = (corners[:, k] - np.array(polygon.centroid.coords)[0] for k in range(3))
    areas = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2.0
    squares = sum((corner**2).sum(axis=1) for corner in (a, b, c, a + b + c)) / 12.0
    size = float(np.ptp(rings[0], axis=0).max())
    return Truth(polygon.area, np.array(polygon.centroid.coords)[0], float((areas * squares).sum() / areas.sum()), size)


def as_dxf(of: Case, draw: random.Random, polylines: float = 0.4) -> Any:
    """Return a case as an ezdxf document, with entities in any order, and a share of polylines with bulges."""
    import ezdxf

    document = ezdxf.new()
    document.header["$INSUNITS"] = {"mm": 4, "cm": 5, "in": 1, "m": 6}[of.unit]
    where: Any = document.modelspace()
    for k, frame in enumerate(reversed(of.frames)):
        block = document.blocks.new(f"BLOCK{k}")
        scale = {"xscale": frame.scale[0], "yscale": frame.scale[1], "rotation": frame.turn}
        where.add_blockref(f"BLOCK{k}", frame.move, dxfattribs=scale)
        where = block
    for ring in of.rings:
        _add_ring(where, ring, draw, polylines)
    document.modelspace().add_text("bracket", height=5.0)
    return document


def _add_ring(where: Any, ring: Ring, draw: random.Random, polylines: float) -> None:
    if all(isinstance(edge, Line | Arc) for edge in ring) and draw.random() < polylines:
        pieces: list[Any] = list(ring)
        if len(ring) == 1:  # a circle is two arcs
            centre, radius = ring[0].centre, ring[0].radius  # type: ignore[union-attr]
            pieces = [Arc(centre, radius, k * math.pi, math.pi) for k in range(2)]
        corners = [(*edge.points()[0], math.tan(edge.sweep / 4.0) if isinstance(edge, Arc) else 0.0) for edge in pieces]
        add = draw.choice([where.add_lwpolyline, where.add_polyline2d])
        add(corners, format="xyb", close=True)
        return
    for edge in draw.sample(ring, len(ring)):
        if isinstance(edge, Line):
            where.add_line(*draw.sample([edge.a, edge.b], 2))
        elif isinstance(edge, Arc) and abs(edge.sweep) > 6.28:
            where.add_circle(edge.centre, edge.radius)
        elif isinstance(edge, Arc):
            begin, end = sorted([edge.begin, edge.begin + edge.sweep])
            where.add_arc(edge.centre, edge.radius, math.degrees(begin), math.degrees(end))
        elif isinstance(edge, Ellipse):
            axis = (edge.major * math.cos(edge.turn), edge.major * math.sin(edge.turn))
            where.add_ellipse((0.0, 0.0), axis, edge.minor / edge.major)
        else:
            control = [*edge.control, *edge.control[:3]]
            where.add_open_spline(control, degree=3, knots=list(range(len(control) + 4)))


def as_svg(of: Case, draw: random.Random) -> list[str]:
    """Return the lines of a case as SVG: an element each."""
    scale = draw.choice([1.0, 2.5])  # user units per unit
    size = f'width="2000{of.unit}" viewBox="{-1000 * scale} {-1000 * scale} {2000 * scale} {2000 * scale}"'
    lines = [
        '<?xml version="1.0"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>',
        f'<g transform="scale({scale})">',
    ]
    for frame in reversed(of.frames):
        (a, b), (x, y) = frame.scale, frame.move
        lines.append(f'<g transform="translate({x!r},{y!r}) rotate({frame.turn!r}) scale({a!r},{b!r})">')
    lines += [_svg_ring(ring, draw) for ring in of.rings]
    return [*lines, *["</g>"] * (len(of.frames) + 1), "<text>bracket</text>", "</svg>"]


def _svg_ring(ring: Ring, draw: random.Random) -> str:
    first = ring[0]
    if isinstance(first, Ellipse):
        return f'<ellipse rx="{first.major!r}" ry="{first.minor!r}" transform="rotate({math.degrees(first.turn)!r})"/>'
    if isinstance(first, Spline):
        curves = [" ".join(f"{float(v)!r}" for v in bezier[1:].ravel()) for bezier in first.beziers()]
        begin = first.beziers()[0, 0]
        return f'<path d="M {float(begin[0])!r} {float(begin[1])!r} C {" ".join(curves)}"/>'
    if isinstance(first, Arc) and len(ring) == 1:
        return f'<circle cx="{first.centre[0]!r}" cy="{first.centre[1]!r}" r="{first.radius!r}"/>'
    data = "M {!r} {!r}".format(*map(float, first.points()[0]))
    for edge in ring:
        x, y = map(float, edge.points()[-1])
        if isinstance(edge, Arc):
            large, sweep = int(abs(edge.sweep) > math.pi), int(edge.sweep > 0.0)
            data += f" A {edge.radius!r} {edge.radius!r} 0 {large} {sweep} {x!r} {y!r}"
        else:
            data += f" L {x!r} {y!r}"
    return f'<path d="{data}{draw.choice([" Z", ""])}"/>'


def as_mesh(of: Case) -> Any:
    """Return a case as a prism of trimesh."""
    import shapely
    import trimesh

    rings = [np.concatenate([edge.points()[:-1:60] for edge in ring]) for ring in of.rings]
    return trimesh.creation.extrude_polygon(shapely.Polygon(rings[0], rings[1:]), of.thickness)


def write(of: Case, path: Path, seed: int) -> Truth:
    """Write a case to a file, and return its true properties."""
    draw = random.Random(f"write {seed}")
    if of.kind == "dxf":
        as_dxf(of, draw).saveas(path)
        return truth(of)
    if of.kind == "svg":
        path.write_text("\n".join(as_svg(of, draw)), encoding="utf-8")
        properties = truth(of)
        return properties._replace(centre=properties.centre * [1.0, -1.0])
    mesh = as_mesh(of)
    content = mesh.export(file_type=draw.choice(["stl", "stl_ascii"]))
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    volume = float(mesh.volume)
    size = float(mesh.extents[:2].max())
    return Truth(volume / of.thickness, mesh.center_mass[:2], float(mesh.moment_inertia[2, 2]) / volume, size)
