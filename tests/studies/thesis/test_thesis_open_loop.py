"""Figures without a sensor: squeeze experiment, alignment on a grid, friction experiment."""

import math

import numpy as np
import pytest

from studies.accuracy.friction_experiment import experiment, fit_friction
from studies.thesis import friction_radius
from studies.thesis.element_size import ALIGNED, PITCH, aligned
from studies.thesis.squeeze import Squeezed, largest_deviations, objects, squeezed
from vibgym.scene.parts import SHIPPED, shipped_part


def courses(headings, symmetry=2, seconds=10.0):
    """Return parts on the squeeze line, by pairs of initial heading (deg) and rate (deg/s)."""
    time = np.linspace(0.0, seconds, 251)
    pose = np.zeros((251, len(headings), 3))
    pose[..., 1] = 0.078
    for k, (start, rate) in enumerate(headings):
        pose[:, k, 2] = np.radians(start + rate * time)
    return Squeezed(time, pose, symmetry)


def test_headings_are_modulo_the_symmetry():
    run = courses([(10.0, 0.0), (190.0, 0.0), (-170.0, 0.0), (14.0, 0.0)])
    assert np.degrees(run.heading[-1]) == pytest.approx([-1.0, -1.0, -1.0, 3.0], abs=0.01)
    assert run.resting == run.stable == 1.0
    assert largest_deviations(run) == pytest.approx((0.0, math.sqrt(3.0)), abs=0.01)


def test_what_counts_as_stable():
    run = courses([(0.0, 0.0)] * 6 + [(0.0, 8.0), (60.0, 0.0)])
    assert run.resting == 7 / 8  # 8 deg/s are 12 deg in 1.5 s
    assert run.stable == 6 / 8
    assert courses([(0.0, 6.0)]).resting == 1.0


@pytest.fixture(scope="module")
def squeezed_blocks():
    return {
        hardware: squeezed(shipped_part("aluminium_block"), hardware, worlds=60) for hardware in ("ideal", "prototype")
    }


def test_a_squeeze_field_aligns_a_block(squeezed_blocks):
    """Figs. 7.4 and 7.5: the thesis's bounds, and ideal elements leave no scatter at all."""
    for run in squeezed_blocks.values():
        offset, turn = largest_deviations(run)
        assert offset < 5.0 and turn < 22.5
        assert 20.0 < 1e3 * run.offset[0].std() < 35.0  # 96 mm, evenly: 27.7 mm
        assert math.degrees(run.heading[0].std()) == pytest.approx(180.0 / math.sqrt(12.0), abs=8.0)
    ideal, real = squeezed_blocks["ideal"], squeezed_blocks["prototype"]
    assert 1e3 * ideal.offset[-1].std() < 1e-2 and math.degrees(ideal.heading[-1].std()) < 0.01 and ideal.stable == 1.0
    assert largest_deviations(real)[1] > 2.0 and real.stable > 0.9  # its elements differ


def test_other_shapes_have_no_stable_heading():
    run = squeezed(objects()["triangle, 50 mm"], "ideal", worlds=20)
    assert run.symmetry == 3 and run.resting == 0.0
    assert 1e3 * run.offset[run.late].std(axis=1).max() < 5.0


@pytest.mark.parametrize("name", list(SHIPPED))
def test_four_elements_attract_a_block_and_fewer_do_not(name):
    """Fig. 6.2: elements of half the pitch align all blocks, larger ones none to speak of."""
    part = shipped_part(name)
    for elements, least, most in ((4, 1.0, 1.0), (2, 1.0, 1.0), (1.5, 0.0, 0.1), (1, 0.0, 0.1)):
        distance, pose = aligned(part, PITCH / elements, starts=20)
        assert least <= (distance < ALIGNED).mean() <= most
    assert np.isfinite(pose).all()


def test_the_friction_experiment():
    """Figs. 7.1 and 7.2: closed forms, the coefficients that went in, and a window that the steps do not resolve."""
    frequencies = np.linspace(5.0, 10.0, 26)
    found = experiment(frequencies=frequencies, static_ratio=friction_radius.STATIC_RATIO)
    for block in found.blocks:
        assert friction_radius.largest_misfit(block, frequencies) < 3e-6
        assert fit_friction(frequencies, block.down)[0] == pytest.approx(block.friction, abs=2e-4)
        assert abs(block.fitted - block.friction) < 4.0 * block.standard_error < 0.03
        width = block.window[1] - block.window[0]
        assert 0.0 < width < 0.5 * np.diff(friction_radius.FREQUENCIES).min()
