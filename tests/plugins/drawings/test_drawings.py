"""Parts from DXF, SVG and STL files: properties of known geometry, joining, units, and errors that name the entity."""

import io
import math

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.plugins.drawings.contours import Stroke, flattened, loops
from vibgym.scene.parts import part_from

ezdxf = pytest.importorskip("ezdxf")
pytest.importorskip("svgpathtools")
trimesh = pytest.importorskip("trimesh")

from studies.benchmarks.drawing_cases import KINDS, case, write  # noqa: E402
from studies.benchmarks.drawing_faults import FAULTS, spoiled  # noqa: E402
from studies.benchmarks.drawings import deviations, refusal  # noqa: E402
from tests.plugins.drawings.helpers import read, saved  # noqa: E402


def page(path, inner, size='width="100mm" height="50mm" viewBox="0 0 100 50"'):
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n{inner}\n</svg>')
    return path


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
    assert any(each in error for each in made.expected), error
    assert "\n" not in error


def arcs(radius, *bounds):
    """Strokes of the arcs of a circle between angles."""
    found = []
    for a, b in zip(bounds, bounds[1:], strict=False):
        angle = np.linspace(a, b, 1025)
        found.append(Stroke(radius * np.column_stack([np.cos(angle), np.sin(angle)]), f"arc {a:g}"))
    return found


@pytest.mark.parametrize("tolerance", [0.01, 0.05, 0.3])
@pytest.mark.parametrize("bounds", [(0, 2 * math.pi), (0, math.pi, 2 * math.pi), (0, 1, 1.5, 4, 2 * math.pi)])
def test_flattening_keeps_area_and_tolerance(bounds, tolerance):
    """Of a circle, whole or of arcs: every edge is within the tolerance, and the area is right to higher order."""
    points = flattened(arcs(20.0, *bounds), tolerance)
    along = np.linspace(0.0, 1.0, 9)[:, None, None]
    edges = points + along * (np.roll(points, -1, axis=0) - points)
    assert np.abs(np.hypot(edges[..., 0], edges[..., 1]) - 20.0).max() <= tolerance
    x, y = points.T
    area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
    inscribed = (2 * math.pi / len(points)) ** 2 / 6
    assert abs(area / (math.pi * 400.0) - 1.0) < 0.1 * inscribed


def test_corners_between_curves_stay():
    """A lens of two arcs: the ends where they meet at an angle are not moved."""
    one = arcs(20.0, math.pi / 4, 3 * math.pi / 4)[0]
    other = Stroke(one.points[::-1] * [1, -1] + [0, 2 * one.points[0, 1]], "other")
    points = flattened(loops([one, other], 0.005)[0][0], 0.05)
    for tip in (one.points[0], one.points[-1]):
        assert np.hypot(*(points - tip).T).min() < 1e-12


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
    for bad in ({"density": 1000, "mass": 0.1}, {"thickness_mm": 1, "height": 0.001}, {"tolerance_mm": 0}, {"tolerance_mm": 5},
                {"units": "miles"}, {"layer": "0815"}, {"stable_pose": 0}):  # fmt: skip
        with pytest.raises(ValueError, match="|".join(bad)):
            Part.from_file(path, friction=0.5, **bad)


@pytest.mark.parametrize("name", ["part.step", "missing.dxf", "garbage.dxf", "garbage.svg", "garbage.stl"])
def test_other_files_are_refused(tmp_path, name):
    if name.startswith("garbage"):
        (tmp_path / name).write_bytes(b"\x00\xffnothing\n" * 100)
    with pytest.raises(ValueError, match=name):
        Part.from_file(tmp_path / name, friction=0.5)


def test_layers(tmp_path):
    """Frozen layers and annotations are skipped and counted; a selected layer is read alone."""
    document = ezdxf.new(units=4)
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (50, 0), (50, 30), (0, 30)], close=True, dxfattribs={"layer": "cut"})
    space.add_line((-10, 15), (60, 15), dxfattribs={"layer": "axes"})
    space.add_text("bracket")
    path = saved(document, tmp_path / "layers.dxf")
    document.layers.add("axes")
    document.layers.add("cut")
    path = saved(document, path)
    with pytest.raises(ValueError, match="LINE"):
        read(path)
    drawing = read(path, layer="cut")
    left = {f"{kind} on layer '{layer}', which is not selected": 1 for kind, layer in (("LINE", "axes"), ("TEXT", "0"))}
    assert drawing.skipped == left
    document.layers.get("axes").freeze()
    assert read(saved(document, path)).skipped == {"LINE on hidden layer 'axes'": 1, "TEXT": 1}


def test_faults_in_blocks_name_entity_and_insertion(tmp_path):
    document = ezdxf.new(units=4)
    block = document.blocks.new("B")
    line = block.add_line((0, 0), (10, 0))
    insert = document.modelspace().add_blockref("B", (5, 5), dxfattribs={"rotation": 30})
    with pytest.raises(ValueError, match=f"LINE {line.dxf.handle} in INSERT {insert.dxf.handle}"):
        read(saved(document, tmp_path / "block.dxf"))


@pytest.mark.parametrize(("inner", "size", "area"), [
    ('<rect width="40" height="20"/>', 'width="200mm" viewBox="0 0 100 50"', 3200),
    ('<rect width="40mm" height="20mm"/>', 'width="200mm" height="100mm"', 800),
    ('<rect width="40" height="20"/>', 'width="2in" height="2in" viewBox="0 0 50.8 100"', 800 * 0.508**2),
    ('<rect width="40" height="20"/>', 'width="10cm" height="10cm" viewBox="0 0 100 50" preserveAspectRatio="none"', 1600),
    ('<rect width="40" height="20" rx="5"/>', 'width="100mm" viewBox="0 0 100 50"', 800 - 25 * (4 - math.pi)),
    ('<defs><g id="a"><circle r="5"/></g></defs><use href="#a" transform="scale(2)"/>',
     'width="100mm" viewBox="-50 -25 100 50"', 100 * math.pi),
    ('<g transform="rotate(30)"><g transform="skewX(20) scale(2 -1)"><path d="M0 0h10v10H0z"/></g></g>',
     'width="100mm" viewBox="-50 -25 100 50"', 200),
    ('<path d="M0 0 Q 15 20 30 0 Z"/><text>30</text>', 'width="100mm" viewBox="0 0 100 50"', 200),
    ('<path style="display:none" d="M0 0h9v9z"/><polygon points="0,0 30,0 30,10"/>', 'width="100mm" viewBox="0 0 100 50"', 150),
])  # fmt: skip
def test_svg(tmp_path, inner, size, area):
    drawing = read(page(tmp_path / "part.svg", inner, size))
    part = Part.from_file(tmp_path / "part.svg", friction=0.5)
    assert 1e6 * part.area == pytest.approx(area, rel=1e-4)
    assert not drawing.holes


def test_svg_is_not_mirrored(tmp_path):
    """The y axis of the file points down, that of a part up."""
    drawing = read(page(tmp_path / "ell.svg", '<polygon points="0,0 10,0 10,30 30,30 30,40 0,40"/>'))
    assert [10.0, -30.0] in drawing.rim.tolist() and (drawing.rim[:, 1] <= 0.0).all()


@pytest.mark.parametrize("inner", [
    '<use href="#b"/>', '<rect width="4" height="3" transform="rotate(a)"/>',
    '<rect width="4" height="3" transform="scale(0)"/>',
    '<circle r="-1"/>',
    '<polygon points="1 2 3"/>',
])  # fmt: skip
def test_invalid_svg_is_refused_with_its_line(tmp_path, inner):
    with pytest.raises(ValueError, match="in line 2"):
        read(page(tmp_path / "bad.svg", inner))


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
    assert [each.probability for each in poses] == pytest.approx(box_shares(a, b, c), abs=1e-6)
    assert [each.height for each in poses] == pytest.approx([10, 10, 30, 30, 40, 40])
    assert [each.area for each in poses] == pytest.approx([1200, 1200, 400, 400, 300, 300])
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
    assert sum(each.probability for each in poses) == pytest.approx(1.0)
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
    stream = io.StringIO()
    document.header["$INSUNITS"] = 3  # miles
    document.write(stream)
    path.write_text(stream.getvalue())
    with pytest.raises(ValueError, match="INSUNITS"):
        read(path)
