"""Every hard case, and the machinery that runs them: a check that is wrong must fail, and none may get lost."""

import math
import threading

import numpy as np
import pytest

from studies.accuracy import hard_cases
from studies.accuracy.hard_cases import CASES, HardCase, run_case
from studies.accuracy.hard_cases import case as motion
from studies.accuracy.hard_cases.case import Scene, against_reference, at_most, follow, gap, one_element
from studies.accuracy.hard_cases.friction import through_zero
from vibgym import Part, Surface


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(case):
    outcome = run_case(case)
    assert outcome.passed, outcome
    assert math.isfinite(outcome.measured)


def test_faults_are_failed_outcomes(monkeypatch):
    """An exception, a wrong value, NaN and a hang each have their line, in order, beside a case that passes."""
    release = threading.Event()

    def breaks():
        raise ZeroDivisionError("zero mass")

    def hangs():  # until the check is over: no clock decides the result
        release.wait()
        return at_most(0.0, 1.0, "m")

    runs = {"fine": lambda: at_most(1.0, 1.0, "m"), "breaks": breaks, "wrong": lambda: at_most(1.0000001, 1.0, "m"),
            "nan": lambda: at_most(math.nan, 1.0, "m")}  # fmt: skip
    monkeypatch.setattr(hard_cases, "CASES", tuple(HardCase(name, "?", run) for name, run in runs.items()))
    outcomes = {case.name: outcome for case, outcome in hard_cases.run_all()}
    assert {name: outcome.passed for name, outcome in outcomes.items()} == dict.fromkeys(runs, False) | {"fine": True}
    assert "ZeroDivisionError" in outcomes["breaks"].note
    outcome = run_case(HardCase("hangs", "?", hangs), longest=0.05)
    release.set()
    assert not outcome.passed and "within 0.05 s" in outcome.note
    assert len({case.name for case in CASES}) == len(CASES)


RIGHT = Scene(Surface(), motion.block(), [0.4, 0.1, 0.3], [0, 0, 0], 1e-4, 0.3, 2)


@pytest.mark.parametrize(
    "wrong",
    [{"part": motion.block(0.63)}, {"phase": -0.3}, {"amplitude": 1.2e-4}, {"pose": [0.4, 0.1003, 0.3]}],
    ids=lambda wrong: next(iter(wrong)),
)
def test_a_wrong_motion_fails(monkeypatch, wrong):
    """Another scene is followed than the reference's: what a wrong kernel would do."""
    default, fine = against_reference("x", "?", lambda: RIGHT)
    assert run_case(default).passed and run_case(fine).passed
    monkeypatch.setattr(motion, "follow", lambda scene, **knobs: follow(RIGHT._replace(**wrong), **knobs))
    # The rough bound detects wrong positions and directions, the fine one everything.
    assert not run_case(fine).passed


def test_a_part_that_falls_at_the_wrong_time_fails(monkeypatch):
    path = follow(RIGHT)
    monkeypatch.setattr(motion, "follow", lambda scene, **knobs: path._replace(fallen=path.fallen | True))
    outcome = run_case(against_reference("x", "?", lambda: RIGHT)[0])
    assert not outcome.passed and "fallen False, True; reference False, False" in outcome.note


def test_gap_counts_turn_at_the_farthest_point():
    part = Part.rectangle(0.06, 0.08, friction=0.5)  # radius 50 mm
    assert gap(part, np.array([[3.0, 4.0, 0.0], [0, 0, 0]]), np.zeros((2, 3))) == 5.0
    assert gap(part, np.array([0.0, 0.0, -0.2]), np.zeros(3)) == pytest.approx(0.01)


@pytest.mark.parametrize("instant", [0.2, 0.7])
def test_the_path_through_zero_slip_goes_through_zero(instant):
    """Its start and end belong together: a plain Euler integration from the start passes by the end, slip by zero."""
    surface, friction = one_element(), 0.6
    start, moved, end = through_zero(surface, friction, instant)
    w, held, n = surface.angular_frequency, 0.6 * surface.gravity, 400_000
    dt = surface.period / n
    velocity, way, least = start, 0j, math.inf
    for k in range(n):
        slip = 1j * surface.table_speed * complex(math.cos(w * k * dt), math.sin(w * k * dt)) - velocity
        least = min(least, abs(slip))
        way += velocity * dt
        velocity += held * slip / max(abs(slip), 1e-15) * dt
    assert least < 1e-4 * surface.table_speed
    assert abs(way - moved) < 1e-5 * abs(moved) + 1e-7 and abs(velocity - end) < 1e-3 * surface.table_speed
