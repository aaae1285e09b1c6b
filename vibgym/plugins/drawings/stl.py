"""Meshes in STL, read by trimesh: stable poses, and the outline of the part as it lies."""

from __future__ import annotations

import io
import re
from functools import lru_cache
from typing import Any

import numpy as np
import shapely
import trimesh
from trimesh.convex import convex_hull
from trimesh.poses import compute_stable_poses

from vibgym import checks
from vibgym.plugins.drawings.records import GAP, UNITS, Solid
from vibgym.scene import outlines
from vibgym.scene.parts import StablePose

SIMPLIFIED = 0.05
"""Corners nearer to the line between their neighbours than this share of the tolerance are removed."""

UPWARDS = 1e-6
"""Upward components of normals up to this are of vertical facets."""

MERGED = 1e-6
"""Over the size of the part: deviation of facets from a plane that are merged."""


def read(
    content: bytes, tolerance: float, units: str | None, stable_pose: int | None
) -> tuple[list[np.ndarray], Solid]:
    """Return the outline, counter-clockwise, and holes, clockwise, of the mesh in an STL file, whose z axis points up.

    As modelled it keeps its x axis; in a stable pose the long side of the smallest rectangle around the outline is along x.
    """
    mesh, poses, transforms = _mesh_and_poses(content, UNITS[units or "mm"], GAP * tolerance)
    mesh = mesh.copy()
    if stable_pose is not None:
        mesh.apply_transform(transforms[checks.count("stable_pose", stable_pose, least=0, most=len(poses) - 1)])
    mesh.apply_translation([0.0, 0.0, -mesh.bounds[0, 2]])
    if stable_pose is None:
        _check_standing(mesh, GAP * tolerance, len(poses))
    rings = _projection(mesh, tolerance)
    area, centre = outlines.area_and_centre(rings)
    solid = Solid(
        height=float(mesh.extents[2]),
        centre_height=float(mesh.center_mass[2]),
        volume=float(mesh.volume),
        resting=_resting_area(mesh, np.array([0.0, 0.0, 1.0]), GAP * tolerance) / area,
        offset=float(np.hypot(*(mesh.center_mass[:2] - centre))),
        gyration=float(mesh.moment_inertia[2, 2] / mesh.volume),
        poses=tuple(poses),
    )
    return rings if stable_pose is None else [ring @ _lengthwise(rings[0]) for ring in rings], solid


def _mesh(content: bytes, factor: float) -> Any:
    """Return the mesh in mm: one closed body.

    Raises:
        ValueError: another content; names a facet and, of a file in text, its line.
    """
    plain = content
    if _is_text(content):  # one body may have several sections, with names in any encoding
        plain = b"solid\n" + re.sub(rb"(?m)^\s*(end)?solid\b.*$", b"", content.lower()) + b"\nendsolid\n"
    try:
        mesh: Any = trimesh.load_mesh(io.BytesIO(plain), file_type="stl")
    except Exception as error:  # of a parser that expects valid data
        raise checks.refuse("file", str(error) or type(error).__name__, "an STL file") from None
    if not len(mesh.faces):
        raise checks.conflict("the file has no facets")
    bad = ~np.isfinite(mesh.triangles).all(axis=(1, 2))
    if bad.any():
        raise checks.conflict(f"{_facet(content, int(bad.argmax()))} has coordinates that are not finite")
    number = np.arange(len(mesh.faces))
    # Facets without area may close the surface; those with a corner twice cannot.
    for keep in (lambda: np.diff(np.sort(mesh.faces)).all(axis=1), mesh.nondegenerate_faces):
        if not mesh.is_watertight:
            kept = keep()
            number = number[kept]
            mesh.update_faces(kept)
    if not mesh.is_watertight:
        broken = trimesh.repair.broken_faces(mesh)
        where = _facet(content, int(number[broken[0]])) if len(broken) else "a facet"
        raise checks.conflict(
            f"the surface is not closed: {where} has an edge that it does not share with exactly one other"
        )
    if not mesh.is_winding_consistent or mesh.volume <= 0.0:
        raise checks.conflict("facets point inwards: their corners must be counter-clockwise, seen from outside")
    first, *others = sorted(mesh.split(only_watertight=False), key=lambda body: -body.volume)
    for body in others:  # a cavity is inside, and its facets point into it
        corners = body.vertices[:: 1 + len(body.vertices) // 100]
        inside = (_shares(first.triangles - corner).sum() > 0.5 for corner in corners)
        if body.volume > 0.0 or not all(inside):
            facet = mesh.faces[:, 0] == int(np.flatnonzero((mesh.vertices == body.vertices[0]).all(axis=1))[0])
            where = _facet(content, int(number[facet.argmax()]))
            raise checks.conflict(f"{1 + len(others)} bodies in one file, one with {where}: one part a file")
    mesh.apply_scale(factor)
    return mesh


def _is_text(content: bytes) -> bool:
    """Return whether a file has not the length of a binary one."""
    return len(content) != 84 + 50 * int.from_bytes(content[80:84], "little")


def _facet(content: bytes, number: int) -> str:
    """Return the number of a facet, and its line in a file in text."""
    lines = content.splitlines() if _is_text(content) else []
    at = [k for k, line in enumerate(lines, 1) if line.lower().split()[:1] == [b"facet"]]
    return f"facet {number}" + (f" in line {at[number]}" if number < len(at) else "")


@lru_cache(maxsize=1)  # of all poses of one file in turn
def _mesh_and_poses(content: bytes, factor: float, flat: float) -> tuple[Any, list[StablePose], np.ndarray]:
    """Return the mesh in mm, its stable poses, most probable first, and their transforms (n, 4, 4).

    The probability of a pose is the share of all directions from the centre of mass that hit its face, or faces of the convex
    hull from which the part rolls onto it (K. Goldberg et al., "Part pose statistics", 1999).
    """
    mesh = _mesh(content, factor)
    transforms, shares = _stable(mesh)
    poses = []
    for turn, share in zip(transforms, shares, strict=True):
        up = turn[2, :3]
        level = mesh.vertices @ up
        low = float(level.min())
        area = _resting_area(mesh, up, low + flat)
        poses.append(StablePose(float(share), float(level.max()) - low, float(mesh.center_mass @ up) - low, area))
    return mesh, poses, transforms


def _shares(triangles: np.ndarray) -> np.ndarray:
    """Return the solid angles of triangles (n, 3, 3) from the origin over 4 pi, positive from behind.

    A. Van Oosterom, J. Strackee, "The solid angle of a plane triangle", 1983: also of needles, with an error of rounding.
    """
    a, b, c = triangles.transpose(1, 0, 2)
    x, y, z = np.linalg.norm(triangles, axis=2).T
    volume = (a * np.cross(b, c)).sum(axis=1)
    return np.arctan2(volume, x * y * z + (a * b).sum(1) * z + (b * c).sum(1) * x + (c * a).sum(1) * y) / (2.0 * np.pi)


def _stable(mesh: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the transforms (n, 4, 4) to the stable poses, and their probabilities (n,), the largest first."""
    merged = f"Qt C-{MERGED * mesh.extents.max():g}"  # vertices on edges would make needles
    transforms, shares = compute_stable_poses(convex_hull(mesh.vertices, qhull_options=merged), mesh.center_mass)
    if not abs(shares.sum() - 1.0) < MERGED:
        raise checks.conflict(f"the probabilities of the stable poses add up to {shares.sum():.6g}, not 1")
    order = np.lexsort([*-transforms[:, 2, 2::-1].round(6).T, -shares.round(9)])
    transforms[:, :3, 3] = 0.0
    return transforms[order], shares[order]


def _resting_area(mesh: Any, up: np.ndarray, level: float) -> float:
    """Return the area of the facets below a level along the direction ``up``, whose normals point down, mm^2."""
    down = ((mesh.triangles @ up).max(axis=1) <= level) & (mesh.face_normals @ up < 0.0)
    return float(mesh.area_faces[down].sum())


def _check_standing(mesh: Any, flat: float, poses: int) -> None:
    low = mesh.vertices[mesh.vertices[:, 2] <= flat][:, :2]
    if not shapely.MultiPoint(low).convex_hull.contains(shapely.Point(mesh.center_mass[:2])):
        raise checks.conflict(f"the part does not stand as modelled, with z up: give stable_pose=, 0 to {poses - 1}")


def _projection(mesh: Any, tolerance: float) -> list[np.ndarray]:
    """Return the outline of the part from above, counter-clockwise, and its through holes, clockwise."""
    triangles = mesh.triangles[mesh.face_normals[:, 2] > UPWARDS][:, :, :2]
    gap = UPWARDS * mesh.extents[2]  # between facets above and below one that is left out
    area = (
        shapely.union_all(shapely.polygons(triangles)).buffer(gap, join_style="mitre").buffer(-gap, join_style="mitre")
    )
    area = area.simplify(SIMPLIFIED * tolerance)
    pieces = sorted(getattr(area, "geoms", [area]), key=lambda piece: -piece.area)
    if sum(piece.area for piece in pieces[1:]) > tolerance**2:  # rounding may cut off specks
        raise checks.conflict("the part touches itself at a corner or edge only, seen from above")
    area = shapely.geometry.polygon.orient(pieces[0])
    rings = [np.array(ring.coords)[:-1] for ring in (area.exterior, *area.interiors)]
    return [rings[0], *(ring for ring in rings[1:] if abs(outlines.signed_area(ring)) > tolerance**2)]


def _lengthwise(outline: np.ndarray) -> np.ndarray:
    """Return the matrix (2, 2) by which rows are multiplied: it turns the long side of the smallest rectangle to x."""
    around: Any = shapely.oriented_envelope(shapely.Polygon(outline))
    corners = np.array(around.exterior.coords)
    x, y = max(np.diff(corners, axis=0), key=lambda side: float(np.hypot(*side)))
    return np.array([[x, -y], [y, x]]) / np.hypot(x, y)
