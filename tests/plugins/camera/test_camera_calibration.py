"""Optics in closed form, and calibration: the map from the image to the surface, and invalid templates."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.plugins.camera.helpers import SURFACE, setup
from vibgym.kernels.jit import jit
from vibgym.plugins.camera.calibration import Grid, Template, assign_marks, at_height, grid_of, locate
from vibgym.plugins.camera.optics import optics_of, projected
from vibgym.scene.parts import shipped_part

BLOCK = [shipped_part("steel_block")]


@jit
def located(grid: Grid, u: float, v: float, jacobian: np.ndarray):
    return locate(grid, u, v, jacobian)


@pytest.mark.parametrize("settings, most", [
    *(({"distortion": 0.01, "lines": lines, "edge": edge}, 0.1) for lines in ("all", "half") for edge in ("grey", "threshold")),
    ({"tilt": (0.03, -0.02), "position": (0.41, 0.09), "height": 0.9, "distortion": -0.02, "lines": "all"}, 0.15),
])  # fmt: skip
def test_the_residual_is_below_a_tenth_of_a_pixel(settings, most):
    points = np.random.default_rng(3).uniform([0, 0], [SURFACE.width, SURFACE.depth], (3000, 2))
    assert setup(BLOCK, **settings).residual(points).max() < most


corner = st.floats(-8.0, 8.0)


@given(st.lists(corner, min_size=8, max_size=8), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_bilinear_interpolation_is_inverted_within_its_tetragon(shifts, xi, eta):
    """Check convex tetragons near a square of 40 px, of either orientation."""
    square = np.array([[[0.0, 40.0], [40.0, 40.0]], [[0.0, 0.0], [40.0, 0.0]]])
    places = square + np.array(shifts).reshape(2, 2, 2)
    grid = grid_of(Template(0.1, 0.2, 2, 2, 0.01), places)
    weights = np.array([[(1 - eta) * (1 - xi), (1 - eta) * xi], [eta * (1 - xi), eta * xi]])
    u, v = (weights[..., None] * places).sum(axis=(0, 1))
    x, y = located(grid, u, v, np.empty(4))
    assert (x, y) == pytest.approx((0.1 * xi, 0.2 * eta), abs=1e-9)


def test_the_jacobian_is_the_derivative_of_the_inverse_map():
    """Compare with the derivative of the smooth map, which the bilinear pieces approximate."""
    known = setup(BLOCK, distortion=0.01, noise=0.0, lines="half")
    jacobian = np.empty(4)
    for x, y in ((0.1, 0.05), (0.75, 0.17), (0.4, 0.11)):
        h = 1e-3
        u, v = projected(known.optics, np.array([[x, y, 0.0]]))[0]
        steps = projected(known.optics, np.array([[x + h, y, 0], [x - h, y, 0], [x, y + h, 0], [x, y - h, 0]]))
        forward = np.column_stack([steps[0] - steps[1], steps[2] - steps[3]]) / (2 * h)
        located(known.known.grid, u, v, jacobian)
        assert jacobian.reshape(2, 2) @ forward == pytest.approx(np.eye(2), abs=2e-3)


def test_missing_and_further_marks_are_named():
    known = setup(BLOCK, lines="all")
    image = known.template_image()
    image[270:276, 300:306] = 40
    for bad in (image, image[:-1], image.astype(float) + 0.5, "picture", None, known.template_image(missing=[(2, 7)])):
        with pytest.raises(ValueError, match="template"):
            known.calibrate(bad)
    with pytest.raises(ValueError, match="row 0 column 0, row 4 column 16"):
        known.calibrate(known.template_image(missing=[(0, 0), (4, 16)]))


def test_marks_are_identified_under_large_distortion():
    expected = np.stack(np.meshgrid(np.arange(17) * 40.0, np.arange(5) * -40.0), axis=-1)
    middle = expected.mean(axis=(0, 1))
    seen = middle + (expected - middle) * (1.0 + 0.1 * (((expected - middle) / 330.0) ** 2).sum(axis=-1, keepdims=True))
    assert np.abs(seen - expected).max() > 30.0
    mixed = np.random.default_rng(1).permutation(seen.reshape(-1, 2))
    assert (assign_marks(mixed, expected) == seen).all()


@jit
def lifted(x: float, y: float, z: float):
    return at_height(x, y, 0.4, 0.1, 0.8, z)


def test_the_position_of_a_top_is_on_the_ray_to_the_lens():
    lens, z = np.array([0.4, 0.1, 0.8]), 0.05
    top = np.array([0.7, 0.2, z])
    seen = lens + (top - lens) * lens[2] / (lens[2] - z)
    assert lifted(seen[0], seen[1], z) == pytest.approx((0.7, 0.2))


# -- optics --------------------------------------------------------------------------------------------------------------

MIDDLE = (0.416, 0.104)


def test_the_prototype_covers_what_the_thesis_says():
    optics = optics_of(MIDDLE)
    corners = np.array([[0.434, 0.329, 0.0], [-0.434, -0.329, 0.0]]) + [*MIDDLE, 0.0]
    # From edge to edge, half a pixel beyond the centres of the outermost ones; x goes right, y up.
    assert projected(optics, corners) == pytest.approx(np.array([[751.5, -0.5], [-0.5, 569.5]]), abs=0.05)


def test_distortion_is_the_displacement_of_the_corner():
    for share in (0.01, -0.05):
        straight, bent = optics_of(MIDDLE), optics_of(MIDDLE, distortion=share)
        half = 0.5 * 0.868 / 752
        corner = np.array([[MIDDLE[0] + 752 * half, MIDDLE[1] - 570 * half, 0.0]])
        centre = np.array([375.5, 284.5])
        there = projected(straight, corner)[0] - centre
        assert projected(bent, corner)[0] - centre == pytest.approx(there * (1.0 + share), rel=1e-9)


def test_a_tilted_camera_looks_along_its_axis():
    """The principal point shows where the axis meets the surface."""
    for tilt, towards in (((0.1, 0.0), (0.0, 1.0)), ((0.0, 0.1), (-1.0, 0.0))):
        optics = optics_of(MIDDLE, tilt=tilt)
        far = 0.772 * math.tan(0.1)
        point = np.array([[MIDDLE[0] + far * towards[0], MIDDLE[1] + far * towards[1], 0.0]])
        assert projected(optics, point)[0] == pytest.approx([375.5, 284.5], abs=1e-9)


def test_nothing_is_seen_behind_the_lens():
    assert np.isnan(projected(optics_of(MIDDLE), np.array([[0.4, 0.1, 0.772], [0.4, 0.1, 2.0]]))).all()
