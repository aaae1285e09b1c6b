"""Pictures of several kinds of parts with their zones, trails and walls: sampled pixels, not whole images."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("pygame")

from tests.rendering.test_rendering_painter import BLOCK, COLUMNS, ELEMENT, EMPTY, ROWS, looks_like, pixel
from vibgym.rendering import SurfacePainter, Zone, colours

WIDTH, HEIGHT = COLUMNS * ELEMENT, ROWS * ELEMENT
LEFT, RIGHT = (0.0, 0.0), (27 * ELEMENT, 0.0)
ZONES = (Zone(LEFT, (5 * ELEMENT, HEIGHT), 0, "50 x 40"), Zone(RIGHT, (WIDTH, HEIGHT), 1))
POSES = np.array([[0.2, 0.05, 0.0], [0.3, 0.15, 0.0], [0.45, 0.05, 0.0], [0.6, 0.15, 0.0]])
LOST = np.full((4, 3), np.nan)


def paint(painter, **changes):
    return painter.paint(dataclasses.replace(EMPTY, **{"pose": LOST, **changes})).astype(int)


@pytest.fixture(scope="module")
def painter():
    return SurfacePainter(ROWS, COLUMNS, ELEMENT, [BLOCK] * 4, kinds=[1, 0, 3, 1])


def test_parts_have_the_colours_of_their_kinds(painter):
    picture = paint(painter, pose=POSES)
    for pose, kind in zip(POSES, (1, 0, 3, 1), strict=True):
        assert looks_like(picture, (pose[0] - 0.01, pose[1]), colours.PARTS[kind])
    lost = POSES.copy()
    lost[1, 2] = np.nan
    changed = (paint(painter, pose=POSES) != paint(painter, pose=lost)).any(axis=-1)
    assert changed[pixel(0.29, 0.15)]
    assert not any(changed[pixel(x, y)] for x, y in POSES[[0, 2, 3], :2])


def test_zone_tints_its_elements_and_no_others(painter):
    plain, zoned = paint(painter), paint(painter, zones=ZONES)
    for zone in ZONES:
        colour = np.array(colours.PARTS[zone.kind])
        for at in (0.3, 0.5, 0.7):
            inside = pixel(*(np.array(zone.low) + at * (np.array(zone.high) - zone.low) + 0.3 * ELEMENT))
            change = zoned[inside] - plain[inside]
            towards = colour - plain[inside]
            share = change @ towards / (towards @ towards)
            assert 0.15 < share < 0.6, "a tint that leaves the element's own colour visible"
            np.testing.assert_allclose(change, share * towards, atol=3.0)
    changed = np.flatnonzero((plain != zoned).any(axis=(0, 2)))
    left, right = pixel(5 * ELEMENT, 0.1)[1], pixel(27 * ELEMENT, 0.1)[1]
    assert ((changed <= left + 1) | (changed >= right - 1)).all()
    rows = np.flatnonzero((plain != zoned).any(axis=(1, 2)))
    assert rows.min() >= pixel(0.0, HEIGHT)[0] - 1 and rows.max() <= pixel(0.0, 0.0)[0] + 1


@pytest.mark.parametrize("walls", [("left",), ("right",), ("bottom",), ("top",), ("left", "top"), ("right", "bottom")])
def test_walls_are_dark_bars_outside_the_surface(walls):
    picture = paint(SurfacePainter(ROWS, COLUMNS, ELEMENT, [], walls=walls), pose=np.zeros((0, 3)))
    plain = paint(SurfacePainter(ROWS, COLUMNS, ELEMENT, []), pose=np.zeros((0, 3)))
    out = 0.006
    sides = {
        "left": [(-out, at * HEIGHT) for at in (0.01, 0.5, 0.99)],
        "right": [(WIDTH + out, at * HEIGHT) for at in (0.01, 0.5, 0.99)],
        "bottom": [(at * WIDTH, -out) for at in (0.01, 0.5, 0.99)],
        "top": [(at * WIDTH, HEIGHT + out) for at in (0.01, 0.5, 0.99)],
    }
    for side, points in sides.items():
        for point in points:
            assert looks_like(picture, point, colours.INK) == (side in walls)
            assert not looks_like(plain, point, colours.INK)
    (top, left), (bottom, right) = pixel(0.0, HEIGHT), pixel(WIDTH, 0.0)
    inside = np.s_[top + 1 : bottom - 1, left + 1 : right - 1]
    np.testing.assert_array_equal(picture[inside], plain[inside])
    corners: dict[tuple[str, ...], tuple[float, float]] = {
        ("left", "top"): (-out, HEIGHT + out),
        ("right", "bottom"): (WIDTH + out, -out),
    }
    corner = corners.get(walls)
    assert corner is None or looks_like(picture, corner, colours.INK), "walls that meet leave no gap"


def seen(colour, matrix):
    """Return CIELAB of sRGB ``colour`` (..., 3), 0 to 255, under the ``matrix`` of a colour deficiency."""
    share = np.asarray(colour) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    linear = (linear @ matrix.T).clip(0.0, 1.0)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    root = np.cbrt(linear @ to_xyz.T / to_xyz.sum(axis=1))
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116.0 * y, 500.0 * (x - y), 200.0 * (y - z)], axis=-1)


# Machado, Oliveira and Fernandes 2009, full severity.
SIGHT = {
    "normal": np.eye(3),
    "no red": np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]),
    "no green": np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]),
    "no blue": np.array([[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]]),
}  # fmt: skip


@pytest.mark.parametrize("matrix", SIGHT.values(), ids=SIGHT.keys())
def test_kinds_are_distinguishable_in_every_kind_of_colour_vision(matrix):
    kinds = seen(np.array(colours.PARTS), matrix)
    between = np.linalg.norm(kinds[:, None] - kinds, axis=-1)
    assert between[~np.eye(len(kinds), dtype=bool)].min() > 20.0
    phase = np.radians(np.arange(0.0, 360.0, 3.0))
    unit = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    tints = np.concatenate([colours.element_colours(amplitude * unit) for amplitude in (0.0, 0.3, 0.6, 1.0)])
    # The last kind is lighter than the field and has only its dark outline on resting elements.
    away = np.linalg.norm(kinds[:-1, None] - seen(tints, matrix), axis=-1)
    assert away.min() > 18.0


@pytest.mark.parametrize(("arguments", "named"), [
    ({"kinds": [0]}, "kinds"),
    ({"kinds": [0, -1]}, r"kinds\[1\]"),
    ({"kinds": [0, 1.5]}, r"kinds\[1\]"),
    ({"walls": ["left", "middle"]}, r"walls\[1\]"),
])  # fmt: skip
def test_bad_arguments_are_refused(arguments, named):
    with pytest.raises(ValueError, match=named):
        SurfacePainter(ROWS, COLUMNS, ELEMENT, [BLOCK, BLOCK], **arguments)


@pytest.mark.parametrize(("arguments", "named"), [
    (((0.0, 0.0), (0.1, 0.0), 0), "high"),
    (((0.0, np.nan), (0.1, 0.1), 0), "low"),
    (((0.0, 0.0), (0.1, 0.1, 0.1), 0), "high"),
    (((0.0, 0.0), (0.1, 0.1), -1), "kind"),
])  # fmt: skip
def test_bad_zones_are_refused(arguments, named):
    with pytest.raises(ValueError, match=named):
        Zone(*arguments)
