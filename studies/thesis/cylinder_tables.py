"""What candidates for the thesis's cylinder do, in numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from studies.thesis.cylinder import REVOLUTION, Cylinder
from studies.thesis.cylinder_geometry import (
    DRIVE,
    FRICTION,
    KNOCKS,
    Candidate,
    all_directions,
    knocked,
    let_go,
    phi_change,
)
from studies.thesis.figure import Table
from studies.thesis.rim_course import Course, follow

CIRCLES = (1e-5, 1e-4)
"""Radii of the table's motion besides the real one, m."""

STEPS, ARCS = (2e-4, 1e-4, 5e-5), (math.inf, 0.3, 0.03)
"""s and rad, of RK4."""


def span(values: Sequence[float], digits: int = 1) -> str:
    """From the smallest to the largest."""
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}"


def phi_range(runs: Sequence[Course]) -> str:
    """All values of phi' in some courses."""
    rates = np.concatenate([run.phi_rate for run in runs]) / REVOLUTION
    return f"{rates.min():.2f} to {rates.max():.2f} rev/s"


def lifted(run: Course) -> float:
    """Share of the time in which the table would have to pull, %."""
    return 100.0 * float((run.normal < 0.0).mean())


def median_asked(run: Course) -> float:
    """Median of |F_R|/F_N while the table pushes."""
    return float(np.median(run.needed_friction[run.normal > 0.0]))


def held(run: Course, friction: float = FRICTION) -> float:
    """Share of the time in which the table pushes and this friction is enough, %."""
    return 100.0 * float(((run.needed_friction <= friction) & (run.normal > 0.0)).mean())


def knocks(cylinder: Cylinder) -> list[Course]:
    """The eight courses of fig. 3.19."""
    return [knocked(cylinder, each) for each in KNOCKS]


def of_candidates(candidates: Sequence[Candidate]) -> Table:
    """Each over a table at rest."""
    rows = []
    for each in candidates:
        run, eight = let_go(each.cylinder, each.tilt), knocks(each.cylinder)
        rows.append((
            each.size, f"{math.degrees(each.tilt):.2f} deg", f"{math.degrees(run.tilt.min()):.2f} deg",
            f"{100.0 * phi_change(run) / 2.5:.1f} %",
            f"{median_asked(run):.2f}, {run.needed_friction.max():.2f}",
            f"{max(math.degrees(one.tilt.max()) for one in eight):.1f} deg",
            f"{span([math.degrees(one) for one in (eight[-1].tilt.min(), eight[-1].tilt.max())])} deg",
            phi_range(eight),
        ))  # fmt: skip
    return Table(
        "Cylinders that tilt at 10.64 Hz, over a table at rest, let go with phi' = -2.5 rev/s. The last three columns are fig. "
        "3.19's eight starts, their last one, and fig. 3.20.",
        ("Radius, centre height", "From", "Least tilt", "Change of phi'", "|F_R|/F_N, median, largest", "Largest tilt of eight",
         "Tilt, last start", "phi' of eight"),
        tuple(rows),
    )  # fmt: skip


def of_circles(candidates: Sequence[Candidate], real: Mapping[Candidate, Sequence[Course]]) -> Table:
    """Each over tables that move, without slip; ``real`` has those over the real drive."""
    rows = []
    for each in candidates:
        for radius in (*CIRCLES, DRIVE.horizontal_amplitude):
            small = radius in CIRCLES
            runs = all_directions(each.cylinder, each.tilt, radius) if small else real[each]
            rows.append((
                each.size, f"{1e3 * radius:.2f} mm",
                f"{span([100.0 * phi_change(run) / 2.5 for run in runs])} %",
                span([median_asked(run) for run in runs], 2),
                f"{span([lifted(run) for run in runs])} %",
                f"{span([held(run) for run in runs])} %",
            ))  # fmt: skip
    return Table(
        "The same without slip over a table that moves in a circle at 25 Hz, by eight directions of the first lean: largest "
        "change of phi', median of what friction is asked for while the table pushes, time in which it would have to pull, and "
        "in which a friction of 0.6 holds the rim.",
        ("Radius, centre height", "Table's radius", "Change of phi'", "|F_R|/F_N, median", "F_N < 0", "0.6 holds"),
        tuple(rows),
    )


def of_sliding(courses: Mapping[Candidate, Sequence[Course]]) -> Table:
    """Each over the real drive, sliding."""
    rows = tuple(
        (
            each.size, f"{math.degrees(each.tilt):.2f} deg",
            f"{span([math.degrees(run.tilt.min()) for run in runs])} deg",
            f"{span([math.degrees(run.tilt.max()) for run in runs])} deg",
            f"{span([float(run.phi_rate[-1]) / REVOLUTION for run in runs])} rev/s",
            f"{span([1e3 * float(run.slip.min()) for run in runs], 0)} mm/s",
            f"{max(run.energy_error for run in runs):.0e}",
        )
        for each, runs in courses.items()
    )  # fmt: skip
    return Table(
        "The same over the real drive (2.7 mm, 25 Hz; no vertical motion) with a rim that slides, friction 0.6, for 0.2 s from "
        "phi' = -2.5 rev/s. Where the least slip is near 0 a real rim may stick; there RK4 loses order as well.",
        (
            "Radius, centre height",
            "From",
            "Least tilt",
            "Largest tilt",
            "phi' at the end",
            "Least slip",
            "Energy, error",
        ),
        rows,
    )


def of_steps(candidate: Candidate) -> Table:
    """What RK4's step and the limit on the arc do to the energy."""
    rows = []
    for step in STEPS:
        runs = [
            follow(candidate.cylinder.rim(), candidate.cylinder.released(candidate.tilt, spin=-2.5 * REVOLUTION), 1.0,
                   sampled=max(STEPS), step=step, arc=arc)
            for arc in ARCS
        ]  # fmt: skip
        rows.append((f"{1e6 * step:.0f} us", *(f"{run.energy_error:.0e}" for run in runs)))
    return Table(
        f"Error of the energy after 1 s over the tilt's own, {candidate.size} from 5 deg over a table at rest, by RK4's step "
        "and by how far the point of contact may run along the rim in one.",
        ("Step", "no limit", *(f"{each:g} rad" for each in ARCS[1:])),
        tuple(rows),
    )
