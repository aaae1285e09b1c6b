"""Who rules an element under several parts: the elements' motion from what the parts want."""

import math

import numpy as np
import pytest

from agents.control.allocation import DAMPING, RULES, Allocator, area_samples, cover
from tests.agents.helpers import ALUMINIUM, DISC, STEEL, SURFACE
from vibgym import Part, allocation


def shares(parts, pose):
    allocator = Allocator(SURFACE, parts, "solve")
    share = np.empty((len(pose), len(parts), SURFACE.rows, SURFACE.columns))
    lever = np.empty((*share.shape, 2))
    cover(allocator.samples, allocator.first, pose, np.ones(pose.shape[:2], bool), SURFACE.element_size, share, lever)
    return share, lever


def test_samples_have_the_moments_of_the_part():
    for part in (STEEL, ALUMINIUM, DISC, Part.polygon([[0, 0], [0.06, 0], [0.06, 0.02], [0, 0.05]], friction=0.5)):
        points = area_samples(part)
        assert len(points) > 30
        assert points.mean(axis=0) == pytest.approx(0.0, abs=1e-3)
        assert (points**2).sum(axis=1).mean() == pytest.approx(part.gyration, rel=0.08)


def test_shares_are_those_of_the_area():
    """A block straight on the grid: shares are products of lengths."""
    share, lever = shares([STEEL], np.array([[[0.104, 0.104, 0.0]]]))  # centre on a corner of four elements
    assert share[0, 0].sum() == pytest.approx(1.0) and (share[0, 0] > 0).sum() == 4
    assert share[0, 0, 3:5, 3:5] == pytest.approx(0.25)
    assert lever[0, 0, 3, 3] == pytest.approx(0.25 * np.array([-0.0125, -0.010]))
    beside, _ = shares([STEEL], np.array([[[0.0, 0.1, 0.0]]]))
    assert beside.sum() == pytest.approx(0.5)  # half of it is beside the surface


def accelerations(parts, pose, push):
    """Of parts at rest under pushes, by the averaged model of the first order, over what full amplitude gives."""
    result = []
    for k, part in enumerate(parts):
        amplitude = SURFACE.max_amplitude * np.hypot(push[..., 0], push[..., 1])
        phase = np.arctan2(-push[..., 0], -push[..., 1])
        found = allocation.mean_acceleration(SURFACE, part, pose[:, k], np.zeros(3), amplitude, phase, order=1)
        scale = 0.5 * part.friction * SURFACE.full_scale
        result.append(found / scale * np.array([1, 1, math.sqrt(part.gyration)]))
    return np.stack(result, axis=1)


WANTED = np.array([[[0.3, 0.1, 0.1], [-0.2, 0.2, -0.1]]])


@pytest.mark.parametrize("rule", RULES)
def test_parts_apart_get_what_they_want(rule):
    pose = np.array([[[0.3, 0.11, 0.4], [0.5, 0.08, -0.3]]])
    there = np.ones((1, 2), dtype=bool)
    push = Allocator(SURFACE, [STEEL, ALUMINIUM], rule).pushes(pose, there, WANTED)
    assert accelerations([STEEL, ALUMINIUM], pose, push) == pytest.approx(WANTED, abs=0.03)


def test_only_fields_found_together_serve_parts_that_share_elements():
    """Side by side, 2 mm apart, wishes apart: the other rules give part of it to the neighbour."""
    parts, there = [STEEL, STEEL], np.ones((1, 2), dtype=bool)
    pose = np.array([[[0.3, 0.117, 0.0], [0.352, 0.117, 0.0]]])  # the border is in the middle of an element
    error = {}
    for rule in RULES:
        push = Allocator(SURFACE, parts, rule).pushes(pose, there, WANTED)
        assert np.hypot(push[..., 0], push[..., 1]).max() <= 1 + 1e-12
        error[rule] = np.abs(accelerations(parts, pose, push) - WANTED).max()
    assert error["solve"] < 0.05 < min(error["average"], error["nearest"]), error


def test_a_part_alone_gets_the_same_push_from_all_its_elements():
    pose, there = np.array([[[0.3, 0.11, 0.4]]]), np.ones((1, 1), dtype=bool)
    wanted = np.array([[[0.6, -0.3, 0.0]]])
    for rule in RULES:
        push = Allocator(SURFACE, [STEEL], rule).pushes(pose, there, wanted)[0]
        under = np.hypot(push[..., 0], push[..., 1]) > 0
        assert 4 <= under.sum() <= 12
        assert push[under] == pytest.approx(np.tile(wanted[0, 0, :2] / (1 + DAMPING), (under.sum(), 1)), abs=1e-9)


def test_nearest_and_average_rule_differ_only_where_parts_share():
    parts, there = [STEEL, STEEL], np.ones((1, 2), dtype=bool)
    pose = np.array([[[0.3, 0.117, 0.0], [0.355, 0.117, 0.0]]])
    share, _ = shares(parts, pose)
    shared = (share[0] > 0).all(axis=0)
    nearest, average = (Allocator(SURFACE, parts, rule).pushes(pose, there, WANTED)[0] for rule in RULES[:2])
    different = np.abs(nearest - average).max(axis=-1) > 1e-9
    assert shared.sum() >= 2 and (different == shared).all()


def test_absent_parts_claim_nothing():
    pose = np.array([[[0.3, 0.11, 0.4], [0.31, 0.11, 0.0]]])
    one = Allocator(SURFACE, [STEEL], "solve").actions(pose[:, :1], np.array([[True]]), WANTED[:, :1])
    two = Allocator(SURFACE, [STEEL, STEEL], "solve").actions(pose, np.array([[True, False]]), WANTED)
    assert two == pytest.approx(one, abs=1e-6)
    none = Allocator(SURFACE, [STEEL, STEEL], "solve").actions(pose, np.zeros((1, 2), dtype=bool), WANTED)
    assert (none == 0).all()
