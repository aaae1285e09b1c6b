"""What one period costs: scenes, exponents, and that every case is timed."""

import json
import math

import numpy as np
import pytest

from agents.evaluation import cost
from agents.evaluation.report import cost_figure
from vibgym import Surface
from vibgym.config import part_from
from vibgym.scene.hulls import gaps_between

LARGE = Surface(rows=32, columns=64)


def blocks(surface, count):
    rows = cost.heap_rows(surface, count)
    return [part_from(cost.BLOCKS[kind]) for kind in cost.block_kinds(count, rows)], rows


@pytest.mark.parametrize(
    ("surface", "count"), [*((LARGE, n) for n in (2, 3, 8, 31, 64)), *((Surface(), n) for n in (2, 3, 8, 31))]
)
def test_a_heap_is_in_touch_all_round(surface, count):
    parts, rows = blocks(surface, count)
    pose = cost.heaped(surface, parts, rows)
    gaps = gaps_between(parts, pose[None])[0]
    assert gaps.min() == pytest.approx(cost.GAP, abs=1e-9)
    assert gaps.min(axis=1).max() < 0.2e-3
    assert (pose[:, :2] > 0.0).all() and (pose[:, :2] < [surface.width, surface.depth]).all()


@pytest.mark.parametrize("count", [1, 2, 16, 64])
def test_parts_apart_keep_the_rule_and_meet_nobody(count):
    parts, _ = blocks(LARGE, count)
    pose = cost.apart(LARGE, parts)
    assert pose is not None
    assert gaps_between(parts, pose[None])[0].min() >= math.sqrt(2.0) * LARGE.element_size
    bench = cost.Simulating(LARGE, parts, pose)
    assert 0.0 < bench.seconds() < 10.0
    statistics = bench.simulator.statistics
    assert statistics["contact"] == 0 and statistics["free"] + statistics["near"] == cost.WARM_UP + cost.PERIODS


def test_a_heap_is_timed_with_contacts():
    parts, rows = blocks(LARGE, 8)
    bench = cost.Simulating(LARGE, parts, cost.heaped(LARGE, parts, rows))
    bench.seconds()
    assert bench.simulator.statistics["contact"] == cost.WARM_UP + cost.PERIODS


def test_counts_without_room_are_left_out():
    parts, _ = blocks(Surface(), 17)
    assert cost.apart(Surface(), parts) is None
    found = cost.measure(quiet=True, counts=(2, 17), surfaces=[Surface()], policies=[], repetitions=1)
    assert [curve.parts for curve in found.curves] == [(2,), (2,)]


def test_exponent_is_that_of_the_power_law():
    counts = (1, 2, 4, 8, 16, 32, 64)
    for power in (0.0, 1.0, 1.7):
        seconds = tuple(3e-6 * n**power if n >= 8 else 1.0 for n in counts)  # fewer parts do not count
        assert cost.Curve("simulation", 8, 32, False, counts, seconds).exponent == pytest.approx(power, abs=1e-12)
    assert cost.Curve("simulation", 8, 32, False, counts[:5], (1.0,) * 5).exponent is None


def test_words_for_exponents():
    assert cost_figure.growth(1.0) == "in proportion to the parts, not to the pairs"
    assert "slowly than the number of parts" in cost_figure.growth(0.6)
    assert "faster than the parts" in cost_figure.growth(1.4)
    assert "pairs, or faster" in cost_figure.growth(2.1)


def test_values_and_section():
    curve = cost.Curve("planner", 8, 32, False, (8, 16, 32), (1e-3, 2e-3, 4e-3))
    found = cost.Cost(0.04, 3, (curve,))
    values = json.loads(json.dumps(found.as_values()))
    assert values["curves"][0]["parts"] == [8, 16, 32]
    assert values["curves"][0]["exponent"] == pytest.approx(1.0)
    section = cost_figure.section(found)
    assert section["rows"][0]["exponent"] == "1.00" and section["rows"][0]["most"] == "4 ms"
    assert section["plot"].startswith("data:image/png;base64,")


def test_measured_in_a_process_of_its_own():
    found = cost.measure_alone(quiet=True, counts=(1, 2), repetitions=1)
    kinds = {(curve.what, curve.rows, curve.touching): curve.parts for curve in found.curves}
    assert kinds == {
        (what, rows, touching): (2,) if touching else (1, 2)
        for rows in (8, 32)
        for what, touching in [("simulation", False), ("simulation", True), *((name, False) for name in cost.POLICIES)]
    }
    assert all(np.greater(curve.seconds, 0.0).all() for curve in found.curves)
