"""Distances between outlines, against shapely and against brute force; convex pieces that make up an outline exactly."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import MultiPoint, Point, Polygon
from shapely.ops import unary_union

from vibgym import Part
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import reference
from vibgym.physics.contacts.hulls import (
    BOTTOM,
    KEPT_OVERLAP,
    LEFT,
    RIGHT,
    TOP,
    hull_contact,
    kept_contact,
    place_hulls,
    wall_gap,
)
from vibgym.scene.hulls import convex_pieces, gaps_between, hulls_of

ROUNDING = 1e-12
"""m; a few roundings of numbers of about a metre."""

seeds = st.integers(0, 2**32 - 1)


def convex_part(rng):
    """Convex outlines with corners on an ellipse, sometimes long and thin or with very short edges."""
    angle = np.sort(rng.uniform(0, 2 * math.pi, rng.integers(3, 9)))
    size = 10.0 ** rng.uniform(-2.5, -0.8, 2)
    try:
        return Part.polygon(np.column_stack([size[0] * np.cos(angle), size[1] * np.sin(angle)]), friction=0.5)
    except ValueError:  # two corners, or all of them, too close to one another
        return convex_part(rng)


def star_part(rng):
    """A simple outline with dents."""
    corners = int(rng.integers(4, 14))
    gaps = rng.uniform(0.3, 1.0, corners)
    angle, far = 2 * math.pi * np.cumsum(gaps) / gaps.sum(), rng.uniform(0.01, 0.06, corners)
    return Part.polygon(np.column_stack([far * np.cos(angle), far * np.sin(angle)]), friction=0.5)


def comb_part(rng):
    """Combs: teeth of different lengths on a bar, not star-shaped."""
    teeth = int(rng.integers(2, 6))
    corners = [(0.0, -0.01)]
    for k in range(teeth):
        length = rng.uniform(0.01, 0.05)
        corners += [(0.02 * k, length), (0.02 * k + rng.uniform(0.004, 0.01), length)]
        if k < teeth - 1:
            corners += [(0.02 * k + 0.011, 0.0), (0.02 * k + 0.019, 0.0)]
    corners.append((corners[-1][0], -0.01))
    return Part.polygon(corners, friction=0.5)


def some_part(rng):
    make = (convex_part, star_part, comb_part, lambda rng: Part.disc(rng.uniform(0.003, 0.05), friction=0.5))
    return make[rng.integers(4)](rng)


def outline(part, pose):
    """The outline at a pose; of a disc its centre."""
    shape = Point(0, 0) if part.symmetry == 0 else Polygon(part.outline)
    return affinity.translate(affinity.rotate(shape, pose[2], origin=(0, 0), use_radians=True), *pose[:2])


def disc_radius(part):
    return math.sqrt(part.area / math.pi) if part.symmetry == 0 else 0.0


def some_pose(rng, reach=0.15):
    return rng.uniform([-reach, -reach, -4], [reach, reach, 4])


def gap_of(parts, poses):
    gaps = gaps_between(parts, np.array([poses]))[0]
    assert gaps[0, 0] == gaps[1, 1] == math.inf and gaps[0, 1] == gaps[1, 0]
    return gaps[0, 1]


# -- distances ---------------------------------------------------------------------------------------------------------


@given(seeds)
def test_distance_of_separate_parts(seed):
    """Compare with shapely's distance; gaps of overlapping outlines are not positive."""
    rng = np.random.default_rng(seed)
    parts, poses = [some_part(rng), some_part(rng)], [some_pose(rng), some_pose(rng)]
    shapes = [outline(part, pose) for part, pose in zip(parts, poses)]
    expected = shapes[0].distance(shapes[1]) - disc_radius(parts[0]) - disc_radius(parts[1])
    gap = gap_of(parts, poses)
    if expected > ROUNDING:
        assert gap == pytest.approx(expected, abs=ROUNDING)
    else:
        assert gap < ROUNDING


@given(seeds)
def test_convex_outlines_through_the_difference_of_all_corners(seed):
    """Signed distance of the origin from the hull of all differences: how far apart, or how deep inside one another."""
    rng = np.random.default_rng(seed)
    parts, poses = [convex_part(rng), convex_part(rng)], [some_pose(rng, 0.04), some_pose(rng, 0.04)]
    corners = [np.array(outline(part, pose).exterior.coords) for part, pose in zip(parts, poses)]
    difference = MultiPoint((corners[1][None] - corners[0][:, None]).reshape(-1, 2)).convex_hull
    origin = Point(0, 0)
    inside = difference.contains(origin)
    expected = -difference.exterior.distance(origin) if inside else difference.distance(origin)
    # shapely drops corners within rounding of an edge
    assert gap_of(parts, poses) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("depth", [1e-6, 1e-3, 0.01, 0.025])
def test_depth_of_discs_and_blocks(depth):
    disc, block = Part.disc(0.02, friction=0.5), Part.rectangle(0.06, 0.04, friction=0.5)
    assert gap_of([disc, disc], [(0, 0, 0), (0.04 - depth, 0, 2)]) == pytest.approx(-depth, abs=ROUNDING)
    # Through a face, even with the centre inside the block.
    assert gap_of([disc, block], [(0, 0, 0), (0, 0.04 - depth, 0)]) == pytest.approx(-depth, abs=ROUNDING)
    assert gap_of([block, disc], [(0, 0, 0), (0.05 - depth, 0, 0)]) == pytest.approx(-depth, abs=ROUNDING)
    # Against a corner, along the diagonal.
    away = np.array([0.03, 0.02]) + (0.02 - min(depth, 0.01)) * math.sqrt(0.5)
    assert gap_of([block, disc], [(0, 0, 0), (*away, 0)]) == pytest.approx(-min(depth, 0.01), abs=ROUNDING)


def test_discs_in_one_place():
    disc = Part.disc(0.02, friction=0.5)
    assert gap_of([disc, disc], [(0.1, 0.2, 0), (0.1, 0.2, 1)]) == pytest.approx(-0.04, abs=ROUNDING)
    block = Part.rectangle(0.06, 0.04, friction=0.5)
    assert gap_of([block, disc], [(0.1, 0.2, 0), (0.1, 0.2, 1)]) == pytest.approx(-0.04, abs=ROUNDING)
    assert gap_of([block, block], [(0.1, 0.2, 0), (0.1, 0.2, 0)]) == pytest.approx(-0.04, abs=ROUNDING)


def test_many_worlds_at_once():
    rng = np.random.default_rng(3)
    parts = [some_part(rng) for _ in range(5)]
    pose = np.array([[some_pose(rng) for _ in parts] for _ in range(7)])
    together = gaps_between(parts, pose)
    assert together.shape == (7, 5, 5)
    for world in range(7):
        assert (together[world] == gaps_between(parts, pose[world : world + 1])[0]).all()
        for i, j in zip(*np.triu_indices(5, 1)):
            assert together[world, i, j] == gap_of([parts[i], parts[j]], pose[world, [i, j]])
    with pytest.raises(ValueError, match="pose"):
        gaps_between(parts, pose[:, :4])


# -- walls -------------------------------------------------------------------------------------------------------------


@jit(allocates=True)
def kept_along(hulls, path, contact):
    """Write gap and normal of two convex parts along a path (n, 2, 3), with the face kept and without, into ``contact``."""
    hulls, feature, placed = reference(hulls), np.full(2, -1), np.empty_like(hulls.corner)
    for k in range(path.shape[0]):
        for part in range(2):
            place_hulls(hulls, part, path[k, part, 0], path[k, part, 1], path[k, part, 2], placed)
        contact[k, 0, 0], contact[k, 0, 1], contact[k, 0, 2], _ = kept_contact(hulls, placed, 0, 1, feature)
        contact[k, 1, 0], contact[k, 1, 1], contact[k, 1, 2], _ = hull_contact(hulls, placed, 0, 1)


@given(seeds)
def test_kept_face_of_hulls_that_approach(seed):
    """The contact of all faces and corners where the parts are separate or overlap by much, and no other one separates more."""
    rng = np.random.default_rng(seed)
    parts = [convex_part(rng) if rng.random() < 0.7 else Part.disc(0.02, friction=0.5) for _ in range(2)]
    start, away = rng.uniform(-3.0, 3.0, (2, 3)), sum(part.radius for part in parts)
    angle, step = rng.uniform(-3.0, 3.0), np.linspace(0.0, 1.0, 60)
    start[:, :2] = [[0.0, 0.0], [1.2 * away * math.cos(angle), 1.2 * away * math.sin(angle)]]
    path = start + step[:, None, None] * rng.uniform(-1.0, 1.0, (2, 3)) * [0.3 * away, 0.3 * away, 0.5]
    path[:, 1, :2] -= 0.5 * step[:, None] * start[1, :2]
    contact = np.zeros((len(path), 2, 3))
    kept_along(hulls_of(parts), path, contact)
    kept, full = contact[:, 0], contact[:, 1]
    apart = full[:, 0] > ROUNDING
    np.testing.assert_allclose(kept[apart, 0], full[apart, 0], atol=ROUNDING)
    assert (kept[:, 0] <= full[:, 0] + ROUNDING).all()  # no direction separates more
    deep = full[:, 0] < -KEPT_OVERLAP
    np.testing.assert_array_equal(kept[deep], full[deep])
    np.testing.assert_allclose(np.hypot(kept[:, 1], kept[:, 2]), 1.0, atol=1e-12)


@given(seeds)
def test_distance_from_walls(seed):
    """Compare with the bounding box of the outline."""
    rng = np.random.default_rng(seed)
    part, pose = some_part(rng), some_pose(rng)
    hulls, width, height = hulls_of([part]), 0.2, 0.1
    placed = np.empty_like(hulls.corner)
    place_hulls(hulls, 0, *pose, placed)
    low_x, low_y, high_x, high_y = outline(part, pose).bounds
    r = disc_radius(part)
    expected = {LEFT: low_x - r, RIGHT: width - high_x - r, BOTTOM: low_y - r, TOP: height - high_y - r}
    for wall, gap in expected.items():
        assert wall_gap(hulls, placed, 0, wall, width, height) == pytest.approx(gap, abs=ROUNDING)


# -- convex pieces -----------------------------------------------------------------------------------------------------


def check_pieces(part):
    pieces = [Polygon(piece) for piece in convex_pieces(part)]
    whole = Polygon(part.outline)
    for piece in pieces:
        assert piece.exterior.is_ccw and piece.is_valid
        assert piece.convex_hull.area - piece.area <= 1e-9 * whole.area
    union = unary_union(pieces)
    assert union.symmetric_difference(whole).area <= 1e-9 * whole.area
    assert sum(piece.area for piece in pieces) == pytest.approx(whole.area, rel=1e-9)  # no overlaps


@given(seeds)
def test_pieces_of_stars_and_combs(seed):
    check_pieces(star_part(np.random.default_rng(seed)))
    comb = comb_part(np.random.default_rng(seed))
    assert len(convex_pieces(comb)) > 1
    check_pieces(comb)


@given(seeds)
def test_edges_of_pieces_are_whole(seed):
    """Corners on an edge, also many, are in no piece, so that contact points of an edge are those of its whole length."""
    random = np.random.default_rng(seed)
    angles = np.sort(random.uniform(0.0, 2.0 * math.pi, 6))[:, None] + random.uniform(0.0, 1.0)
    corners = 0.03 * np.hstack([np.cos(angles), np.sin(angles)])
    extra = [
        corner + share * (after - corner)
        for corner, after in zip(corners, np.roll(corners, -1, axis=0), strict=True)
        for share in [0.0, *np.sort(random.uniform(0.1, 0.9, random.integers(0, 4)))]
    ]
    part = Part.polygon(np.array(extra), friction=0.5)
    (piece,) = convex_pieces(part)
    assert len(piece) == len(corners)
    check_pieces(part)


def test_pieces_of_convex_parts():
    block, disc = Part.rectangle(0.06, 0.04, friction=0.5), Part.disc(0.02, friction=0.5)
    (piece,) = convex_pieces(block)
    assert (piece == block.outline).all()
    (centre,) = convex_pieces(disc)
    assert (centre == [[0.0, 0.0]]).all()
    hulls = hulls_of([block, disc])
    assert hulls.rounding[0] == 0.0 and hulls.rounding[1] == pytest.approx(0.02, rel=1e-14)
    assert hulls.radius[0] == pytest.approx(math.hypot(0.03, 0.02)) and hulls.radius[1] == pytest.approx(0.02)
    lengths = np.hypot(*hulls.corner[:4, 2:].T)
    assert lengths == pytest.approx(np.ones(4))
