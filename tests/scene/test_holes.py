"""Parts with holes: mass properties, friction, symmetry, contacts, storage."""

import json
import math

import numpy as np
import pytest

from vibgym import Part, Simulator, Surface
from vibgym.scene.hulls import gaps_between
from vibgym.scene.outlines import contains
from vibgym.scene.parts import part_from

OUTER = np.array([[0, 0], [80, 0], [80, 50], [0, 50]]) * 1e-3
INNER = np.array([[10, 10], [40, 10], [40, 45], [10, 45]]) * 1e-3


def ring(radius, corners, x=0.0, y=0.0):
    angle = 2.0 * math.pi * np.arange(corners) / corners
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def test_mass_properties():
    """A rectangle less a rectangle, by the parallel-axis theorem."""
    part = Part.polygon(OUTER + 3.0, holes=[INNER + 3.0], friction=0.5, height=0.01)
    whole, gone = 0.08 * 0.05, 0.03 * 0.035
    area = whole - gone
    middle, hole = np.array([0.04, 0.025]), np.array([0.025, 0.0275])
    centre = (whole * middle - gone * hole) / area
    turn = whole * ((0.08**2 + 0.05**2) / 12 + ((middle - centre) ** 2).sum())
    turn -= gone * ((0.03**2 + 0.035**2) / 12 + ((hole - centre) ** 2).sum())
    assert part.area == pytest.approx(area, rel=1e-12)
    assert part.mass == pytest.approx(7850.0 * area * 0.01, rel=1e-12)
    assert part.gyration == pytest.approx(turn / area, rel=1e-9)
    assert part.rim == pytest.approx(OUTER - centre, abs=1e-12)
    assert part.holes[0][::-1] == pytest.approx(INNER - centre, abs=1e-12)
    assert part.inertia[:2].sum() - 2 * 0.01**2 / 12 == pytest.approx(part.gyration)


def test_friction_acts_between_the_holes_only():
    """A part that spins on a still table slows down by ``mu g <r> / <r^2>``, the means over its area."""
    part = Part.polygon(OUTER, holes=[INNER, ring(0.008, 24, 0.06, 0.02)], friction=0.1)
    surface = Surface(horizontal_amplitude=0.0)
    simulator = Simulator(surface, part)
    simulator.reset([[[0.4, 0.1, 0.3]]], [[[0.0, 0.0, 6.0]]])
    simulator.advance(0.0, 0.0, 1)
    grid = np.stack(np.meshgrid(*(np.arange(-0.06, 0.06, 1e-4) + 5e-5,) * 2), axis=-1).reshape(-1, 2)
    inside = contains(part.rim, grid) & ~np.any([contains(hole, grid) for hole in part.holes], axis=0)
    radius = np.hypot(*grid[inside].T)
    slower = 0.1 * 9.81 * radius.mean() / (radius**2).mean() * surface.period
    assert simulator.velocity[0, 0, 2] == pytest.approx(6.0 - slower, rel=1e-3)


@pytest.mark.parametrize(("bolts", "order"), [(2, 2), (3, 3), (5, 1), (6, 6)])
def test_symmetry_of_a_flange(bolts, order):
    """The outer outline of 48 corners has order 48; five bolts do not divide it. Corners of the holes do not match."""
    holes = [ring(0.003, 17, *point) for point in ring(0.02, bolts)]
    assert Part.polygon(ring(0.03, 48), holes=[ring(0.01, 31), *holes], friction=0.5).symmetry == order


def test_a_turned_hole_breaks_the_symmetry():
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.03
    triangle = ring(0.01, 3)
    assert Part.polygon(square, holes=[ring(0.01, 4)], friction=0.5).symmetry == 4
    assert Part.polygon(square, holes=[triangle], friction=0.5).symmetry == 1
    assert Part.polygon(ring(0.03, 6), holes=[triangle], friction=0.5).symmetry == 3


def test_parts_touch_the_rim():
    part = Part.polygon(OUTER, holes=[INNER], friction=0.5)
    centre = OUTER[0] - part.rim[0]
    solid = Part.polygon(OUTER, friction=0.5)
    disc = Part.disc(0.01, friction=0.5)
    for x in (0.0, 0.02, 0.06):  # beside, and in the hole
        pose = np.array([[[0.1, 0.1, 0.0], [0.1 + x, 0.1, 0.0]]])
        moved = pose - [[[*(np.array([0.04, 0.025]) - centre), 0.0], [0.0, 0.0, 0.0]]]
        assert gaps_between([part, disc], moved) == pytest.approx(gaps_between([solid, disc], pose), abs=1e-12)


def test_storage_keeps_every_bit():
    part = Part.polygon(OUTER, holes=[INNER, ring(0.004, 16, 0.06, 0.02)], friction=0.5, name="frame")
    again = part_from(json.loads(json.dumps(part.to_dict())))
    assert again.same_as(part) and again.symmetry == part.symmetry
    assert all(np.array_equal(a, b) for a, b in zip(again.holes, part.holes, strict=True))
    given = {"vertices_mm": (1e3 * OUTER).tolist(), "holes_mm": [(1e3 * INNER).tolist()]}
    millimetres = part_from({"shape": "polygon", "friction": 0.5, **given})
    assert millimetres.area == pytest.approx(0.08 * 0.05 - 0.03 * 0.035)


@pytest.mark.parametrize("holes", [
    [INNER + 0.02], [INNER + 0.5], [INNER, INNER + 0.001], [INNER, ring(0.002, 9, 0.02, 0.02)], [OUTER],
    [ring(0.02, 1001, 0.03, 0.025)], [[[0.01, 0.01], [0.02, 0.02], [0.02, 0.01], [0.01, 0.02]]],
])  # fmt: skip
def test_bad_holes_are_refused(holes):
    with pytest.raises(ValueError, match="holes|vertices"):
        Part.polygon(OUTER, holes=holes, friction=0.5)
    with pytest.raises(ValueError, match="holes"):
        part_from({"shape": "disc", "radius": 0.02, "friction": 0.5, "holes": [ring(0.002, 9).tolist()]})


def test_a_missing_extra_is_named(monkeypatch, tmp_path):
    (tmp_path / "part.dxf").write_text("0\nEOF\n")
    monkeypatch.setattr("vibgym.extras._found", lambda package: False)
    with pytest.raises(ModuleNotFoundError, match=r"ezdxf is not installed: pip install 'vibgym\[cad\]'"):
        Part.from_file(tmp_path / "part.dxf", friction=0.5)
