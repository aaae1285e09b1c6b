"""Drawings with one fault each, for :mod:`studies.benchmarks.drawings`: the error must name the entity at fault."""

from __future__ import annotations

import io
import random
from typing import Any, NamedTuple

import numpy as np

from studies.benchmarks.drawing_cases import Case, as_dxf, circle, slot


class Fault(NamedTuple):
    """A spoiled drawing: its content, and texts of which the error must hold one."""

    content: bytes
    expected: tuple[str, ...]


def spoiled(of: Case, fault: str, seed: int) -> Fault:
    """Return a case with a fault among :data:`FAULTS`; without blocks or groups, in mm."""
    draw = random.Random(f"{fault} {seed}")
    return (_spoiled_dxf if of.kind == "dxf" else _spoiled_svg if of.kind == "svg" else _spoiled_stl)(of, fault, draw)


FAULTS = {
    "dxf": (
        "open", "gap", "two parts", "crossing", "in a hole", "self-intersecting", "unknown units", "too large",
        "not an outline", "no length", "out of plane", "no outline",
    ),
    "svg": (
        "open", "two parts", "crossing", "in a hole", "self-intersecting", "unknown units", "too large",
        "not an outline", "invalid path", "no outline",
    ),
    "stl": ("open", "inside out", "two parts", "too large", "does not stand"),
}  # fmt: skip
"""Faults by kind of file."""


def _spoiled_dxf(of: Case, fault: str, draw: random.Random) -> Fault:
    plain = Case(
        [slot(0.0, 0.0, 40.0, 12.0, draw.uniform(0.0, 3.0)), circle(0.0, 0.0, 4.0)], [], "mm", "dxf", 5.0, "slot"
    )
    document = as_dxf(plain, draw, polylines=0.0)
    space = document.modelspace()
    lines, arcs, circles = (list(space.query(kind)) for kind in ("LINE", "ARC", "CIRCLE"))
    one: Any = draw.choice(lines + arcs)
    expected: list[Any] = [one]
    if fault == "open":
        expected = lines if one in arcs else arcs  # its neighbours
        space.delete_entity(one)
    elif fault == "gap":
        one = draw.choice(arcs)
        expected = [one, *lines]
        one.dxf.end_angle -= draw.uniform(0.5, 5.0)
    elif fault == "two parts":
        expected = [space.add_circle((200.0, draw.uniform(0.0, 9.0)), 5.0)]
    elif fault == "crossing":
        expected = [space.add_circle(draw.choice(lines).dxf.start, 3.0)]
    elif fault == "in a hole":
        expected = [space.add_circle((0.0, 0.0), draw.uniform(1.0, 3.0))]
    elif fault == "self-intersecting":
        for entity in [*lines, *arcs, *circles]:
            space.delete_entity(entity)
        expected = [space.add_lwpolyline([(0, 0), (50, 40), (50, 0), (0, draw.uniform(20.0, 40.0))], close=True)]
    elif fault == "unknown units":
        document.header["$INSUNITS"] = 0
    elif fault == "too large":
        document.header["$INSUNITS"] = 6
    elif fault == "not an outline":
        expected = [space.add_3dface([(0, 0), (1, 0), (1, 1), (0, 1)])]
    elif fault == "no length":
        expected = [space.add_line((3.0, 3.0), (3.0, 3.0))]
    elif fault == "out of plane":
        expected = [space.add_circle((0.0, 0.0, draw.uniform(0.1, 9.0)), 2.0)]
    else:
        expected = []
        for entity in [*lines, *arcs, *circles]:
            space.delete_entity(entity)
    stream = io.StringIO()
    document.write(stream)
    words = {"unknown units": ("units=",), "too large": ("smaller than the table",), "no outline": ("no outline",)}
    handles = tuple(f"{entity.dxftype()} {entity.dxf.handle}" for entity in expected)
    return Fault(stream.getvalue().encode(), words.get(fault, handles))


def _spoiled_svg(of: Case, fault: str, draw: random.Random) -> Fault:
    at = 5 + draw.randint(0, 3)
    size = 'width="100mm" height="100mm" viewBox="0 0 100 100"'
    outline, hole, more = '<path d="M 0 0 H 50 V 40 C 40 60 20 60 0 40 Z"/>', '<circle cx="20" cy="20" r="5"/>', ""
    if fault == "open":
        outline = outline.replace("Z", "L 0 10")
    elif fault == "two parts":
        more = '<rect x="80" y="0" width="5" height="5"/>'
    elif fault == "crossing":
        more = '<ellipse cx="50" cy="20" rx="5" ry="3"/>'
    elif fault == "in a hole":
        more = '<circle cx="20" cy="20" r="2"/>'
    elif fault == "self-intersecting":
        outline = '<polygon points="0,0 50,40 50,0 0,40"/>'
        hole = ""
    elif fault == "unknown units":
        size = 'viewBox="0 0 100 100"'
    elif fault == "too large":
        size = size.replace("mm", "in")
    elif fault == "not an outline":
        more = "<circel/>"
    elif fault == "invalid path":
        more = '<path d="M 0 0 L 1"/>'
    else:
        outline = hole = ""
    blank = [""] * (at - 4)
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" {size}>', hole, *blank, "<g>", outline, more, "</g>", "</svg>"]
    words = {"unknown units": ("units=",), "too large": ("smaller than the table",), "no outline": ("no outline",)}
    line = 1 + (lines.index(more) if more else lines.index(outline))
    return Fault("\n".join(lines).encode(), words.get(fault, (f"in line {line}",)))


def _spoiled_stl(of: Case, fault: str, draw: random.Random) -> Fault:
    import trimesh

    mesh = trimesh.creation.box([40.0, 30.0, 10.0])
    expected = ("in line ",)
    if fault == "open":
        mesh.update_faces(np.arange(12) != draw.randrange(12))
    elif fault == "inside out":
        mesh.invert()
        expected = ("inwards",)
    elif fault == "two parts":
        mesh = trimesh.util.concatenate(
            [mesh, trimesh.creation.box([5.0, 5.0, 5.0]).apply_translation([60.0, 0.0, 0.0])]
        )
    elif fault == "too large":
        mesh.apply_scale(25.4)
        expected = ("smaller than the table",)
    else:
        mesh.apply_transform(trimesh.transformations.rotation_matrix(draw.uniform(0.2, 0.6), [1.0, 0.0, 0.0]))
        expected = ("stable_pose=",)
    return Fault(mesh.export(file_type="stl_ascii").encode(), expected)
