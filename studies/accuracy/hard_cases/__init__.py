"""Hard cases: what is likely to go wrong in planar contact, each with a check that can fail.

Bounds come from closed forms, from symmetry, from the independent reference (:mod:`studies.accuracy.reference`) and from the
order of the scheme, not from what the model happens to do.
"""

from __future__ import annotations

from studies.accuracy.hard_cases import bounds, crowds, drives, endurance, geometry, thresholds
from studies.accuracy.hard_cases.case import HardCase, Outcome, run_case, run_suite

__all__ = ["CASES", "HardCase", "Outcome", "run_all", "run_case"]

CASES: tuple[HardCase, ...] = (
    *thresholds.CASES,
    *geometry.CASES,
    *drives.CASES,
    *endurance.CASES,
    *bounds.CASES,
    *crowds.CASES,
)


def run_all() -> list[tuple[HardCase, Outcome]]:
    """Every case with its outcome, in order. An exception or a hang is a failed outcome whose note names it."""
    return run_suite(CASES)
