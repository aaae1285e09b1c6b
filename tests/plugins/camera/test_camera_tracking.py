"""Assignment, shapes, and parts that keep their names."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from studies.benchmarks.camera import wandering
from tests.plugins.camera.helpers import QUIET, camera, state_of
from vibgym import Part
from vibgym.physics.core.assignment import assign
from vibgym.plugins.camera.shapes import outline_moment, size_moment, traits_of
from vibgym.scene.parts import shipped_part

ALUMINIUM, STEEL = shipped_part("aluminium_block"), shipped_part("steel_block")
ANGLE = Part.polygon([[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.06], [0, 0.06]], friction=0.5)
SQUARE, DISC = Part.rectangle(0.04, 0.04, friction=0.5), Part.disc(0.02, friction=0.5)
TRIANGLE = Part.polygon([[0.0, 0.0], [0.05, 0.0], [0.025, 0.05 * math.sqrt(0.75)]], friction=0.5)


@given(st.integers(1, 7), st.integers(0, 5), st.integers(0, 10**6))
def test_assignments_cost_as_little_as_those_of_scipy(rows, more, seed):
    random = np.random.default_rng(seed)
    cost = random.random((rows, rows + more))
    cost[random.random(cost.shape) < 0.3] = 1e9  # impossible pairs
    cost[:, :rows] = np.where(np.eye(rows) > 0, 60.0, cost[:, :rows])
    result = np.full(rows, -1)
    assign(cost, result)
    assert len(set(result.tolist())) == rows and (result >= 0).all()
    best = cost[linear_sum_assignment(cost)].sum()
    assert cost[np.arange(rows), result].sum() == pytest.approx(best, rel=1e-9)


def test_moments_of_outlines_are_sums_over_their_area():
    n = 1200
    x, y = np.meshgrid((np.arange(n) + 0.5) / n * 0.1 - 0.05, (np.arange(n) + 0.5) / n * 0.1 - 0.05)
    inside = shapely.contains_xy(shapely.Polygon(TRIANGLE.outline), x, y)
    z = (x + 1j * y)[inside]
    for order in (2, 3, 6):
        expected = (z**order).sum() * (0.1 / n) ** 2
        assert outline_moment(TRIANGLE.outline, order) == pytest.approx(
            expected, abs=3e-3 * 0.03**order * TRIANGLE.area
        )
        assert size_moment(TRIANGLE.outline, order) == pytest.approx(
            (np.abs(z) ** order).sum() * (0.1 / n) ** 2, rel=5e-3
        )


@pytest.mark.parametrize("part", [ALUMINIUM, STEEL, ANGLE, SQUARE, TRIANGLE], ids=lambda part: part.name)
@pytest.mark.parametrize("lines", ["all", "half"])
def test_headings_of_all_shapes_through_two_turns(part, lines):
    """At any position; headings continue beyond a full turn, as in the simulator."""
    sensor = camera([part], [[[0.1, 0.06, 0.0]]], **QUIET | {"distortion": 0.01}, lines=lines)
    worst = 0.0
    for k in range(1, 130):
        pose = [0.1 + 0.004 * k, 0.06 + 0.0007 * k, 0.1 * k]
        sensor.sample(state_of([[pose]]))
        assert sensor.due.seen.all()
        error = sensor.due.pose[0, 0] - pose
        worst = max(worst, abs(error[2]))
        assert np.abs(error[:2]).max() < 1e-4
    assert worst < math.radians(0.3)


@pytest.mark.parametrize("lines, edge", [("half", "grey"), ("all", "threshold")])
def test_no_identity_is_lost_among_parts_that_keep_the_spacing_rule(lines, edge):
    """Six blocks, three of a kind, cross paths for 1000 frames, with sudden stops and reversals."""
    parts = [ALUMINIUM] * 3 + [STEEL] * 3
    poses = wandering(1000, parts, 11)
    order = np.sign(poses[:, :, None, 0] - poses[:, None, :, 0])
    assert (np.diff(order, axis=0) != 0).sum() // 2 > 20  # they do pass each other
    sensor = camera(parts, poses[:1], lines=lines, edge=edge)
    for before, now in zip(poses[:-1], poses[1:]):
        sensor.sample(state_of([now], (now - before) / 0.04))
        assert sensor.due.seen.all() and not sensor.track.count.any()
        assert np.abs(sensor.due.pose[0] - now)[:, :2].max() < 1e-3


def test_kinds_are_distinguished_by_shape():
    """Parts of different kinds are distinguished by their shapes between samples, and those of a kind by their places."""
    left, right = [0.3, 0.1, 0.0], [0.312, 0.16, 0.0]
    for kinds in ([ALUMINIUM, STEEL], [STEEL, DISC], [ALUMINIUM, SQUARE]):
        sensor = camera(kinds, [[left, right]])
        sensor.sample(state_of([[[0.306, 0.1, 0.0], [0.306, 0.16, 0.0]]]))
        assert sensor.due.seen.all() and not sensor.track.count.any()
    sensor = camera([ALUMINIUM, ALUMINIUM], [[left, [0.4, 0.1, 0.0]]])
    sensor.sample(state_of([[[0.4, 0.1, 0.0], left]]))  # exchanged
    assert sensor.due.seen.all() and sensor.info()["swaps"].tolist() == [2]
    traits = traits_of([ALUMINIUM, STEEL], np.arange(2))
    assert traits.area[1] / traits.area[0] == pytest.approx(8 / 7)
