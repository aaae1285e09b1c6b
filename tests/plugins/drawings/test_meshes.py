"""Meshes: stable poses against random directions, and closed surfaces that are written in unusual ways."""

import re

import numpy as np
import pytest

from tests.plugins.drawings.helpers import read

trimesh = pytest.importorskip("trimesh")
shapely = pytest.importorskip("shapely")


def plate(seed):
    """Return a convex plate with further vertices on its edges, in a random pose, and that without them."""
    draw = np.random.default_rng(seed)
    count = int(draw.integers(3, 8))
    angle = (np.arange(count) + draw.uniform(-0.3, 0.3, count)) * 2.0 * np.pi / count
    corners = np.column_stack([20.0 * np.cos(angle), draw.uniform(10, 20) * np.sin(angle)])
    rim = np.concatenate(
        [
            a + np.sort(np.r_[0.0, draw.uniform(0.05, 0.95, draw.integers(1, 5))])[:, None] * (b - a)
            for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
        ]
    )
    height, turn = draw.uniform(1.0, 12.0), trimesh.transformations.random_rotation_matrix(draw.random(3))
    meshes = []
    for points in (rim, corners):
        n = len(points)
        inner = [
            (n if up else 0) + np.array([0, k, k + 1])[:: 1 if up else -1] for k in range(1, n - 1) for up in (0, 1)
        ]
        outer = [t for k in range(n) for j in [(k + 1) % n] for t in ([k, j, n + j], [k, n + j, n + k])]
        corners3 = np.vstack([np.column_stack([points, np.full(n, z)]) for z in (0.0, height)])
        meshes.append(trimesh.Trimesh(corners3, np.vstack([inner, outer]), process=False).apply_transform(turn))
    return meshes


@pytest.mark.parametrize("seed", range(8))
def test_stable_poses_of_plates_with_vertices_on_edges(tmp_path, seed):
    """Those without these vertices; and from no side do fewer random directions hit than the pose on it is probable."""
    poses = []
    for k, mesh in enumerate(plate(seed)):
        (tmp_path / f"{k}.stl").write_bytes(mesh.export(file_type="stl"))
        poses.append(read(tmp_path / f"{k}.stl", stable_pose=0).solid.poses)
        assert sum(pose.probability for pose in poses[-1]) == pytest.approx(1.0, abs=1e-9)
    for one, other in zip(*poses, strict=True):
        assert one.probability == pytest.approx(other.probability, abs=1e-5)
    clean = plate(seed)[1]
    away = np.random.default_rng(seed).normal(size=(100_000, 3))
    normals = np.unique(clean.face_normals.round(6), axis=0)
    depth = ((clean.vertices - clean.center_mass) @ normals.T).max(axis=0)
    hits = np.bincount((away @ normals.T / depth).argmax(axis=1), minlength=len(normals)) / len(away)
    for height, share in zip(depth, hits, strict=True):
        here = [pose.probability for pose in poses[0] if pose.centre_height == pytest.approx(height, abs=1e-3)]
        assert not here or sum(here) >= share - 0.01


FACETS = re.findall("facet.*?endfacet", trimesh.creation.box([40, 30, 10]).export(file_type="stl_ascii"), flags=re.S)


def stl(*sections, name="part"):
    return "".join("\n".join([f"solid {name}", *section, f"endsolid {name}\n"]) for section in sections)


def facet(*corners):
    return "\n".join(
        ["facet normal 0 0 0", "outer loop", *(f"vertex {rows}" for rows in corners), "endloop", "endfacet"]
    )


def bodies(move, inwards):
    inner = trimesh.creation.box([10, 10, 4]).apply_translation([move, 0, 1])
    if inwards:
        inner.invert()
    return trimesh.util.concatenate([trimesh.creation.box([40, 30, 10]), inner]).export(file_type="stl_ascii")


def stepped(lean):
    """A step whose riser leans, by mm."""
    profile = shapely.Polygon([(0, 0), (40, 0), (40, 5), (20 + lean, 5), (20, 10), (0, 10)])
    mesh = trimesh.creation.extrude_polygon(profile, 30.0)
    return mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])).export(
        file_type="stl_ascii"
    )


@pytest.mark.parametrize(("content", "volume", "centre_height"), [
    (stl(FACETS[:5], FACETS[5:]), 12000, 5),
    (stl(FACETS, name="Träger"), 12000, 5),
    (stl(FACETS).upper(), 12000, 5),
    (stl([*FACETS, facet("20 15 5", "20 15 5", "-20 15 5")]), 12000, 5),
    (trimesh.creation.box([40, 30, 10]).subdivide().export(file_type="stl_ascii"), 12000, 5),
    (bodies(5, True), 11600, (12000 * 5 - 400 * 6) / 11600),
    *[(stepped(lean), 9000 + 75 * lean, 25 / 6) for lean in (2e-6, -2e-6, 2e-4, 2e-3)],
])  # fmt: skip
def test_closed_surfaces_are_read(tmp_path, content, volume, centre_height):
    (tmp_path / "part.stl").write_bytes(content.encode("latin-1"))
    drawing = read(tmp_path / "part.stl")
    assert drawing.solid.volume == pytest.approx(volume, rel=1e-6)
    assert drawing.solid.centre_height == pytest.approx(centre_height, rel=1e-4)
    assert np.ptp(drawing.rim, axis=0) == pytest.approx([40, 30])


def test_facets_without_area_may_close_a_surface(tmp_path):
    """A side of three facets, one of them on a vertex that two others have on their common edge."""
    rest = [triangle for triangle in FACETS if [float(value) for value in triangle.split()[2:5]] != [0, 0, 1]]
    a, b, c, d, m = "-20 -15 5", "20 -15 5", "20 15 5", "-20 15 5", "0 -15 5"
    content = stl([*rest, facet(a, m, d), facet(m, b, c), facet(m, c, d), facet(a, b, m)])
    (tmp_path / "part.stl").write_text(content)
    assert read(tmp_path / "part.stl").solid.volume == pytest.approx(12000)


@pytest.mark.parametrize(("move", "inwards"), [(5, False), (100, True), (18, True)])
def test_other_bodies_are_refused(tmp_path, move, inwards):
    (tmp_path / "part.stl").write_text(bodies(move, inwards))
    with pytest.raises(ValueError, match="2 bodies in one file, one with facet 12 in line"):
        read(tmp_path / "part.stl")
