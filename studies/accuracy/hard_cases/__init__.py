"""Hard cases of planar contact, each with a bound from a closed form, a symmetry, the reference or the order of the scheme."""

from __future__ import annotations

from studies.accuracy.hard_cases import bounds, crowds, drives, endurance, geometry, thresholds
from studies.accuracy.hard_cases.case import HardCase, Outcome, run_case

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
    """Run every case in order and return it with its outcome."""
    return [(case, run_case(case)) for case in CASES]
