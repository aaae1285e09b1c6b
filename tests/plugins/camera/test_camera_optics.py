"""Optics: closed forms of the pinhole."""

import math

import numpy as np
import pytest

from vibgym.plugins.camera.optics import optics_of, projected

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
