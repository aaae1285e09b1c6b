"""Parts from DXF, SVG and STL files: properties of known geometry, joining, units, and errors that name the entity."""

import math

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.scene import outlines
from vibgym.scene.parts import part_from

ezdxf = pytest.importorskip("ezdxf")
pytest.importorskip("svgpathtools")
trimesh = pytest.importorskip("trimesh")

from studies.benchmarks.drawing_cases import KINDS, case, write  # noqa: E402
from studies.benchmarks.drawing_faults import FAULTS, spoiled  # noqa: E402
from studies.benchmarks.drawings import deviations, refusal  # noqa: E402
from tests.plugins.drawings.helpers import read, saved  # noqa: E402


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(1000, 1008))
def test_known_geometry(tmp_path, kind, seed):
    """Lines, arcs, bulges, ellipses, splines and holes in nested, turned, scaled and reflected blocks, in several units."""
    of, path = case(seed, kind), tmp_path / f"part.{kind}"
    true = write(of, path, seed)
    assert max(deviations(of, path, true).values()) < 1e-3


@pytest.mark.parametrize(("kind", "fault"), [(kind, fault) for kind in KINDS for fault in FAULTS[kind]])
def test_faults_are_refused_with_the_entity(tmp_path, kind, fault):
    made = spoiled(case(0, kind), fault, 7)
    error = refusal(made.content, kind, tmp_path)
    assert error is not None and error.startswith(str(tmp_path / f"spoiled.{kind}"))
    assert any(text in error for text in made.expected), error
    assert "\n" not in error


def arcs(path, *curves, **options):
    """Return the drawing of arcs: centre, radius, and angles between which they are."""
    document = ezdxf.new(units=4)
    for centre, radius, *angles in curves:
        for a, b in zip(angles, angles[1:], strict=False):
            document.modelspace().add_arc(centre, radius, a, b)
    return read(saved(document, path / "arcs.dxf"), **options)


@pytest.mark.parametrize("tolerance", [0.01, 0.05, 0.3])
@pytest.mark.parametrize("angles", [(0, 360), (0, 180, 360), (0, 57, 86, 229, 360)])
def test_flattening_keeps_area_and_tolerance(tmp_path, angles, tolerance):
    """Of a circle, whole or of arcs: every edge is within the tolerance, and the area is right to higher order."""
    points = arcs(tmp_path, ((0, 0), 20.0, *angles), tolerance_mm=tolerance).rim
    along = np.linspace(0.0, 1.0, 9)[:, None, None]
    edges = points + along * (np.roll(points, -1, axis=0) - points)
    assert np.abs(np.hypot(edges[..., 0], edges[..., 1]) - 20.0).max() <= tolerance
    inscribed = (2 * math.pi / len(points)) ** 2 / 6
    assert abs(outlines.signed_area(points) / (math.pi * 400.0) - 1.0) < 0.1 * inscribed


def test_corners_between_curves_stay(tmp_path):
    """A lens of two arcs: the ends where they meet at an angle are not moved."""
    rim = arcs(tmp_path, ((0, 0), 20.0, 45, 135), ((0, 20 * math.sqrt(2)), 20.0, 225, 315)).rim
    for x in (-1, 1):
        assert np.hypot(*(rim - 20 * math.sqrt(0.5) * np.array([x, 1])).T).min() < 1e-12


def test_a_circle_is_a_disc(tmp_path):
    document = ezdxf.new(units=4)
    document.modelspace().add_lwpolyline([(0, 0, 1), (40, 0, 1)], format="xyb", close=True)
    part = Part.from_file(saved(document, tmp_path / "coin.dxf"), friction=0.4, thickness_mm=2, density=2700)
    assert (part.symmetry, part.name, part.height) == (0, "coin", 0.002)
    assert part.area == pytest.approx(math.pi * 0.02**2, rel=1e-4)
    assert part.mass == pytest.approx(2700 * math.pi * 0.02**2 * 0.002, rel=1e-4)


def test_properties_and_mappings(tmp_path):
    document = ezdxf.new(units=1)
    document.modelspace().add_lwpolyline([(0, 0), (2, 0), (2, 1), (0, 1)], close=True)
    path = saved(document, tmp_path / "block.dxf")
    part = part_from(
        {"file": str(path), "friction": 0.5, "thickness_mm": 4, "density": 1000, "restitution": 0.1, "units": "in"}
    )
    assert sorted(np.ptp(part.outline, axis=0)) == pytest.approx([0.0254, 0.0508])
    assert (part.height, part.restitution, part.symmetry) == (0.004, 0.1, 2)
    assert part.mass == pytest.approx(1000 * 0.0254 * 0.0508 * 0.004)
    assert part.same_as(part_from(part.to_dict()))
    with pytest.warns(UserWarning, match="units='mm' replaces 'in'"):
        assert part_from({"file": str(path), "units": "mm", "scale": 10.0}).area == pytest.approx(2e-4)
    with pytest.raises(ValueError, match="did you mean 'thickness'"):
        part_from({"file": str(path), "friction": 0.5, "thicknes_mm": 4})
    for bad in (
        {"density": 1000, "mass": 0.1},
        {"thickness_mm": 1, "height": 0.001},
        {"layer": "0815"},
        {"stable_pose": 0},
    ):
        with pytest.raises(ValueError, match="|".join(bad)):
            Part.from_file(path, friction=0.5, **bad)


@pytest.mark.parametrize("name", ["part.step", "missing.dxf", "garbage.dxf", "garbage.svg", "garbage.stl"])
def test_other_files_are_refused(tmp_path, name):
    if name.startswith("garbage"):
        (tmp_path / name).write_bytes(b"\x00\xffnothing\n" * 100)
    with pytest.raises(ValueError, match=name):
        Part.from_file(tmp_path / name, friction=0.5)


def test_faults_in_blocks_name_entity_and_insertion(tmp_path):
    document = ezdxf.new(units=4)
    block = document.blocks.new("B")
    line = block.add_line((0, 0), (10, 0))
    insert = document.modelspace().add_blockref("B", (5, 5), dxfattribs={"rotation": 30})
    with pytest.raises(ValueError, match=f"LINE {line.dxf.handle} in INSERT {insert.dxf.handle}"):
        read(saved(document, tmp_path / "block.dxf"))


def box_shares(a, b, c):
    """Solid angles of the faces of a box from its centre, over 4 pi, the largest first."""

    def share(a, b, h):
        return 4.0 * math.asin(a * b / math.sqrt((a**2 + h**2) * (b**2 + h**2))) / (4.0 * math.pi)

    return sorted([share(a, b, c), share(a, c, b), share(b, c, a)] * 2, reverse=True)


def test_stable_poses_of_a_box(tmp_path):
    """The probability of a face is its solid angle from the centre, since every face of a box is stable."""
    a, b, c = 40.0, 30.0, 10.0
    path = tmp_path / "box.stl"
    path.write_bytes(trimesh.creation.box([a, b, c]).export(file_type="stl"))
    poses = read(path).solid.poses
    assert [pose.probability for pose in poses] == pytest.approx(box_shares(a, b, c), abs=1e-6)
    assert [pose.height for pose in poses] == pytest.approx([10, 10, 30, 30, 40, 40])
    assert [pose.area for pose in poses] == pytest.approx([1200, 1200, 400, 400, 300, 300])
    for pose, sides in ((None, (40, 30, 10)), (0, (40, 30, 10)), (2, (40, 10, 30)), (5, (30, 10, 40))):
        part = Part.from_file(path, friction=0.5, density=1000, stable_pose=pose)
        assert sorted(1e3 * np.ptp(part.rim @ turned(part.rim), axis=0)) == pytest.approx(sorted(sides[:2]))
        assert (part.height, part.centre_height) == pytest.approx((1e-3 * sides[2], 5e-4 * sides[2]))
        assert part.mass == pytest.approx(0.012)
        assert part.symmetry == 2
    with pytest.raises(ValueError, match="stable_pose"):
        read(path, stable_pose=6)


def turned(outline):
    """Return the rotation that brings the first edge along x."""
    x, y = outline[1] - outline[0]
    return np.array([[x, -y], [y, x]]) / math.hypot(x, y)


def test_stable_poses_of_a_leaning_prism(tmp_path):
    """An oblique prism does not stand on its small ends: they add to the faces onto which it rolls."""
    corners = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]], dtype=float)
    mesh = trimesh.Trimesh(np.vstack([corners, corners + [40, 0, 20]])).convex_hull
    path = tmp_path / "leaning.stl"
    path.write_bytes(mesh.export(file_type="stl_ascii").encode())
    with pytest.raises(ValueError, match="does not stand as modelled"):
        read(path)
    poses = read(path, stable_pose=0).solid.poses
    assert sum(pose.probability for pose in poses) == pytest.approx(1.0)
    assert len(poses) == 4


def test_meshes_that_are_no_prisms_give_a_warning(tmp_path):
    path = tmp_path / "cone.stl"
    path.write_bytes(trimesh.creation.cone(20.0, 20.0, sections=64).export(file_type="stl"))
    with pytest.warns(UserWarning, match="no prism.*inertia 0.60"):
        part = Part.from_file(path, friction=0.5)
    assert part.symmetry == 0 and part.centre_height == pytest.approx(0.005, rel=1e-3)
    with pytest.raises(ValueError, match="that of the mesh"):
        Part.from_file(path, friction=0.5, thickness_mm=3)


def test_size_against_the_table(tmp_path):
    """A part fits at any heading; another table, or none, can be given."""
    document = ezdxf.new(units=4)
    document.modelspace().add_lwpolyline([(0, 0), (50, 0), (50, 800), (0, 800)], close=True)
    path = saved(document, tmp_path / "long.dxf")
    assert Part.from_file(path, friction=0.5).area == pytest.approx(0.04)
    with pytest.raises(ValueError, match="smaller than the table of 104 x 208 mm"):
        Part.from_file(path, friction=0.5, surface=Surface(columns=4))
    document.modelspace().query("LWPOLYLINE")[0].append((-300, 400))
    with pytest.raises(ValueError, match="table"):
        Part.from_file(saved(document, path), friction=0.5)
    assert Part.from_file(path, friction=0.5, surface=None).area > 0.04


def test_units_are_an_argument_where_the_file_has_none(tmp_path):
    document = ezdxf.new(units=0)
    document.modelspace().add_circle((0, 0), 2)
    path = saved(document, tmp_path / "disc.dxf")
    with pytest.raises(ValueError, match="INSUNITS"):
        read(path)
    assert read(path, units="cm").radius == pytest.approx(20.0, rel=1e-4)
    path.write_text(path.read_text().replace("$INSUNITS\n 70\n0\n", "$INSUNITS\n 70\n3\n"))  # miles
    with pytest.raises(ValueError, match="INSUNITS must be .*, got 3"):
        read(path)
