"""What a hard case is, and how a suite of them is run without losing one."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass

LONGEST = 180.0
"""Seconds after which a case counts as hung, by default; compilation of the kernels included."""


@dataclass(frozen=True)
class Outcome:
    """What a case measured.

    Attributes:
        measured, bound: in ``unit``; which way the bound holds is said in ``note`` where it is not "at most".
        passed: whether the case holds.
        note: what else a reader should know.
    """

    measured: float
    bound: float
    unit: str
    passed: bool
    note: str = ""


@dataclass(frozen=True)
class HardCase:
    """A named check: ``question`` says in one sentence what could go wrong, ``run`` finds out."""

    name: str
    question: str
    run: Callable[[], Outcome]


def at_most(measured: float, bound: float, unit: str, note: str = "") -> Outcome:
    """Passed if ``measured <= bound``; NaN never passes."""
    measured = float(measured)
    return Outcome(measured, bound, unit, bool(measured <= bound), note)


def run_case(case: HardCase, longest: float = LONGEST) -> Outcome:
    """Run one case; an exception or a hang is a failed outcome that names it.

    A case that hangs goes on in a thread that does not keep the process alive.
    """
    found: list[Outcome] = []

    def work() -> None:
        try:
            found.append(case.run())
        except Exception as error:
            found.append(Outcome(float("nan"), float("nan"), "", False, f"{type(error).__name__}: {error}"))

    thread = threading.Thread(target=work, name=case.name, daemon=True)
    thread.start()
    thread.join(longest)
    if not found:
        return Outcome(float("inf"), longest, "s", False, f"did not end within {longest:g} s")
    return found[0]


def run_suite(cases: Iterable[HardCase], longest: float = LONGEST) -> list[tuple[HardCase, Outcome]]:
    """Run all ``cases`` in order; every one has its line in the result."""
    return [(case, run_case(case, longest)) for case in cases]
