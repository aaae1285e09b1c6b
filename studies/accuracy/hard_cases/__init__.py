"""Hard cases of planar contact, each with a bound from a closed form, a symmetry, the reference or the order of the scheme."""

from __future__ import annotations

from studies.accuracy.hard_cases import crowds, friction, geometry, invariants  # noqa: F401
from studies.accuracy.hard_cases.case import CASES, HardCase, Outcome, run_case

__all__ = ["CASES", "HardCase", "Outcome", "run_all", "run_case"]


def run_all() -> list[tuple[HardCase, Outcome]]:
    """Run every case in order and return it with its outcome."""
    return [(case, run_case(case)) for case in CASES]
