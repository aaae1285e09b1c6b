"""Figs. 3.15 to 3.20: the tilt of a cylinder on its rim, for candidates of its lost size, over tables at rest and in motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, POLICY_COLOURS, SUCCESS, new_figure, png, style
from studies.thesis.cylinder import (
    DIRECTIONS,
    DRIVE,
    FREQUENCY,
    FRICTION,
    KNOCKS,
    REVOLUTION,
    SHOWN,
    START_TILT,
    Candidate,
    Cylinder,
    all_directions,
    from_five_degrees,
    knocked,
    let_go,
    of_constant_tilt,
    phi_change,
    slippery,
    undriven_frequency,
)
from studies.thesis.figure import Comparison, Figure, Picture, Table
from studies.thesis.rim import Course, follow

CIRCLES = (1e-5, 1e-4)
"""Radii of the table's motion that are compared with the real one, m."""

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


SLIGHT = 1e-5
"""m, a table's motion that is just enough to keep a cylinder without rotation from coming down flat."""


def of_geometry(tall: Sequence[Candidate], flat: Sequence[Candidate]) -> tuple[Comparison, ...]:
    """What tells the size of the cylinder."""
    fall = {each: math.degrees(float(np.ptp(knocked(each.cylinder, KNOCKS[-1]).tilt))) for each in (*tall, *flat)}
    top = {each: max(math.degrees(run.tilt.max()) for run in knocks(each.cylinder)) for each in (*tall, *flat)}
    change = {each: phi_change(let_go(each.cylinder, each.tilt)) / 2.5 for each in (*tall, *flat)}
    nearest = min(flat, key=lambda each: abs(change[each] - 0.09))
    return (
        Comparison(
            "Fig. 3.15: frequency of the tilt",
            f"{FREQUENCY} Hz",
            "; ".join(f"({each.size}) from {math.degrees(each.tilt):.1f} deg" for each in (*tall, *flat)),
            "all of these have it (radius, centre height): it does not fix the cylinder",
        ),
        Comparison(
            "Fig. 3.19: how far the tilt goes from 5 deg after psi' = -270 deg/s",
            "the same tilt at all times",
            f"tall ones {span([fall[each] for each in tall])} deg; flat ones {max(fall[each] for each in flat):.5f} deg",
            "their heights are chosen for it: only flat ones keep it",
        ),
        Comparison(
            "Fig. 3.19: largest tilt of all eight starts",
            "its axes end at 10 deg",
            f"tall ones {span([top[each] for each in tall])} deg; flat ones {span([top[each] for each in flat])} deg",
            "only flat ones stay on the axes",
        ),
        Comparison(
            "Fig. 3.20: phi' of these starts",
            "-2.6 to -2.4 rev/s are the axis's labels",
            f"tall ones {phi_range([run for each in tall for run in knocks(each.cylinder)])}; flat ones "
            f"{phi_range([run for each in flat for run in knocks(each.cylinder)])}",
            "only flat ones stay near the labels",
        ),
        Comparison(
            "Fig. 3.16: change of phi' from -2.5 rev/s",
            "at most about 9 % of where it starts",
            f"tall ones {span([100.0 * change[each] for each in tall])} %; flat ones "
            + ", ".join(f"{100.0 * change[each]:.1f} % ({each.size})" for each in flat),
            f"{nearest.size} is nearest",
        ),
    )


def of_trends(tall: Candidate, flat: Candidate) -> tuple[Comparison, ...]:
    """What the thesis says of any of them, for one of either kind."""
    still = [phi_change(run) for run in all_directions(flat.cylinder, flat.tilt, SLIGHT, spin=0.0)]
    by_tilt = [undriven_frequency(flat.cylinder, math.radians(each)) for each in (2.0, 5.0, 10.0)]
    by_spin = [undriven_frequency(flat.cylinder, flat.tilt, each * REVOLUTION) for each in (1.0, 2.5, 5.0)]
    poses = [
        let_go(each.cylinder, math.radians(tilt), azimuth=0.25 * REVOLUTION * turn)
        for each in (tall, flat) for tilt in (2.0, 5.0) for turn in range(4)
    ]  # fmt: skip
    apart = max(float(np.abs(run.tilt - poses[k - k % 4].tilt).max()) for k, run in enumerate(poses))
    least = [math.degrees(knocked(flat.cylinder, each).tilt.min()) for each in KNOCKS[:2]]
    tall_least = [math.degrees(knocked(tall.cylinder, each).tilt.min()) for each in KNOCKS[:2]]
    fading = max(let_go(each.cylinder, each.tilt, duration=1.0).energy_error for each in (tall, flat))
    return (
        Comparison(
            "Fig. 3.15: frequency by the largest tilt (2, 5, 10 deg, the flat one)",
            "falls with it",
            ", ".join(f"{each:.1f}" for each in by_tilt) + " Hz",
            "agrees",
        ),
        Comparison(
            "Fig. 3.16: frequency by |phi'| (1, 2.5, 5 rev/s, the flat one)",
            "rises with it",
            ", ".join(f"{each:.2f}" for each in by_spin) + " Hz",
            "agrees from 2.5 rev/s; slower ones are a little faster than that again",
        ),
        Comparison(
            "Fig. 3.16: change of phi' from 0",
            "at most 0.09 rev/s",
            f"{span(still, 2)} rev/s (the flat one, table by {1e3 * SLIGHT:.2f} mm)",
            "of the same size; over a table at rest it comes down flat, so the thesis's moved",
        ),
        Comparison(
            "Figs. 3.17 and 3.18: four directions of the first lean, 2 and 5 deg",
            "hardly differ; labels of phi' from -2.5 to -2.35 rev/s",
            f"tilts {math.degrees(apart):.2g} deg apart; phi' {phi_range(poses)}",
            "agrees, over a table at rest",
        ),
        Comparison(
            "Fig. 3.19: which comes closest to standing, theta' or psi' = 100 deg/s (first and second panel)",
            "theta', very close",
            f"{least[0]:.2f} and {least[1]:.2f} deg (flat); {tall_least[0]:.2f} and {tall_least[1]:.2f} deg (tall)",
            f"not reproduced by the flat one, from {math.degrees(START_TILT):.0f} deg on a table at rest",
        ),
        Comparison(
            "Does the tilting fade? Error of the energy after 1 s, over the tilt's own",
            "it does not fade by itself",
            f"{fading:.0e}",
            "agrees: nothing takes energy from a rim that rolls",
        ),
    )


SPINS = (-5.0, -2.5, 0.0, 2.5, 5.0)
"""rev/s, of fig. 3.16."""

RATIOS = np.linspace(0.0, 4.0, 161)
"""|F_R|/F_N, along the axis."""


def thesis_plot(tall: Candidate, flat: Candidate) -> bytes:
    """The thesis's courses, of a tall cylinder and a flat one."""
    figure = new_figure(7.6, 5.4)
    grid = figure.subplots(2, 2)
    start, rotation, slow, fast = grid.ravel()
    for each, colour, name in ((tall, FAILURE, "tall"), (flat, SUCCESS, "flat")):
        run = let_go(each.cylinder, each.tilt)
        start.plot(run.times, np.degrees(run.tilt), color=colour, linewidth=1.4, label=name)
    style(start, title=f"3.15: both at {FREQUENCY} Hz, from rest but for -2.5 rev/s", xlabel="t, s", ylabel="tilt, deg")
    for spin, colour in zip(SPINS, POLICY_COLOURS[1:]):
        run = let_go(flat.cylinder, flat.tilt, spin * REVOLUTION, radius=SLIGHT)
        rotation.plot(run.times, run.phi_rate / REVOLUTION, color=colour, linewidth=1.4)
    style(rotation, title="3.16: phi' by what it starts with (flat)", xlabel="t, s", ylabel="phi', rev/s")
    for axes, rate, pairs in ((slow, 100, KNOCKS[:4]), (fast, 270, KNOCKS[4:])):
        for pair, colour in zip(pairs, (FAILURE, INK, MUTED, SUCCESS)):
            name = f"theta' = {_degrees(pair[0])}" if pair[0] else f"psi' = {_degrees(pair[1])}"
            run, other = knocked(flat.cylinder, pair), knocked(tall.cylinder, pair)
            axes.plot(run.times, np.degrees(run.tilt), color=colour, linewidth=1.4, label=f"{name} deg/s")
            axes.plot(other.times, np.degrees(other.tilt), color=colour, linewidth=0.7, linestyle=":")
        style(axes, title=f"3.19: from 5 deg with {rate} deg/s (dotted: tall)", xlabel="t, s", ylabel="tilt, deg")
        axes.set_ylim(0.0, 17.0)
    for axes in (start, slow, fast):
        axes.legend(frameon=False, fontsize=7, labelcolor=MUTED, ncols=2, loc="upper right")
    start.set_ylim(0.0, 22.0)
    for axes in grid.ravel():
        axes.set_xlim(0.0, SHOWN)
    return png(figure)


def real_drive_plot(
    candidates: Sequence[Candidate],
    rolling: Mapping[Candidate, Sequence[Course]],
    sliding: Mapping[Candidate, Sequence[Course]],
) -> bytes:
    """Which friction holds a rim for how much of the time, and the tilt of one that slides."""
    figure = new_figure(7.6, 5.0)
    grid = figure.subplots(2, len(candidates), squeeze=False)
    for (above, below), each in zip(grid.T, candidates):
        tables = {
            "at rest": [let_go(each.cylinder, each.tilt)],
            "0.1 mm": all_directions(each.cylinder, each.tilt, CIRCLES[-1]),
            "2.7 mm": rolling[each],
        }
        for (name, runs), colour in zip(tables.items(), (MUTED, INK, FAILURE)):
            shares = [[held(run, ratio) for run in runs] for ratio in RATIOS]
            above.plot(RATIOS, np.mean(shares, axis=1), color=colour, linewidth=1.4, label=f"table {name}")
        above.axvline(FRICTION, color=MUTED, linewidth=0.8, linestyle=":")
        for run in sliding[each]:
            below.plot(run.times, np.degrees(run.tilt), color=SUCCESS, linewidth=0.8)
        kind = "tall" if each is candidates[0] else "flat"
        style(above, title=f"{kind}: where a rim holds", ylabel="share of time, %", xlabel="friction")
        style(below, title=f"{kind}: sliding over 2.7 mm", ylabel="tilt, deg", xlabel="t, s")
        above.set(xlim=(0.0, RATIOS[-1]), ylim=(0.0, 104.0))
        below.set_xlim(0.0, SHOWN)
        below.set_ylim(0.0)
    grid[0, 0].legend(frameon=False, fontsize=7, labelcolor=MUTED, loc="lower right")
    return png(figure)


def _degrees(rate: float) -> str:
    return f"{math.degrees(rate):.0f}"


TALL, FLAT = (0.015, 0.020, 0.030), (0.015, 0.020, 0.025, 0.030)
"""Radii that are tried, m: with the height that gives the frequency from 5 deg, and the one that keeps fig. 3.19's tilt."""

DRAWN_TALL, DRAWN_FLAT = 0.020, 0.025
"""Those that are drawn."""


def draw() -> Figure:
    """Both kinds of cylinder in the thesis's figures, and over the real drive."""
    tall = {each: from_five_degrees(each) for each in TALL}
    flat = {each: of_constant_tilt(each) for each in FLAT}
    both = (*tall.values(), *flat.values())
    one, other = tall[DRAWN_TALL], flat[DRAWN_FLAT]
    rolling = {each: all_directions(each.cylinder, each.tilt, DRIVE.horizontal_amplitude) for each in both}
    sliding = {each: all_directions(slippery(each.cylinder), each.tilt, DRIVE.horizontal_amplitude) for each in both}
    runs = [run for each in rolling.values() for run in each]
    asked = span([median_asked(run) for run in runs])
    holds = span([held(run) for run in runs], digits=0)
    pulled = span([lifted(run) for run in runs], digits=0)
    left = span([abs(float(run.phi_rate[-1])) / REVOLUTION for each in sliding.values() for run in each])
    lowest, highest = (math.degrees(pick(each.tilt for each in flat.values())) for pick in (min, max))
    return Figure(
        title="Figs. 3.15 to 3.20: a tilted cylinder that rolls on its rim",
        shows="A cylinder is let go from a tilt on a table that moves in a circle; its rim holds by static friction. The "
        "tilt falls and rises 10.64 times a second, the rotation about the cylinder's axis hardly changes, and neither "
        "fades. The text has lost the cylinder's size, the start of fig. 3.15 and what its table did.",
        comparisons=(
            *of_geometry(tuple(tall.values()), tuple(flat.values())),
            *of_trends(one, other),
            Comparison(
                "Static friction over the real drive (2.7 mm, 25 Hz): median of |F_R|/F_N while the table pushes",
                "static friction applies",
                f"{asked}; for {pulled} % of the time the table would have to pull, and a friction of {FRICTION} holds the rim "
                f"for {holds} %",
                "no rim holds like that: these figures are not of the real drive",
            ),
            Comparison(
                f"The same over a table at rest, largest ({other.size})",
                "static friction applies",
                f"{let_go(other.cylinder, other.tilt).needed_friction.max():.1f}",
                "not with usual materials either: a flat cylinder would slide",
            ),
            Comparison(
                f"phi' over the real drive, {SHOWN} s after -2.5 rev/s, of a rim that slides with friction {FRICTION}",
                "is preserved (without slip)",
                f"{left} rev/s, in either sense",
                "a real rim does not keep its rotation",
            ),
        ),
        differs=f"The frequency of {FREQUENCY} Hz does not fix the cylinder: tall ones have it from 5 deg, flat ones from "
        f"{lowest:.0f} to {highest:.0f} deg. Figs. 3.19 and 3.20 are those of a flat one, over a table that moves by far less "
        f"than 2.7 mm; {other.size} of radius and centre height come nearest of those tried. Over the real drive nothing "
        f"rolls: a friction of {FRICTION} would hold the rim for {holds} % of the time, and for {pulled} % the table would "
        "have to pull. One remark on fig. 3.19 is not reproduced: ours comes nearest to standing in its second panel, not in "
        "the first.",
        assumed=(
            "The cylinder is solid and of even density; what the thesis took for its moments of inertia is lost.",
            "The start of fig. 3.15 is lost. Here it is at rest over the table but for phi' = -2.5 rev/s, which the caption "
            "of fig. 3.19 gives. Unless stated otherwise, the table rests.",
            "The curves of figs. 3.18 and 3.20 are lost; the labels of their axes stand in for them.",
            f"Where the table moves, ranges are over {DIRECTIONS} directions of the first lean, {SHOWN} s each or until the "
            "cylinder lies on its side. A sliding rim starts with its centre of mass at rest in the room; that it may stick "
            "for a moment is not simulated.",
        ),
        pictures=(
            Picture(
                thesis_plot(one, other),
                f"Figs. 3.15, 3.16 and 3.19 without slip. Radius and centre height: {one.size} from 5 deg (tall), and "
                f"{other.size} from {math.degrees(other.tilt):.1f} deg (flat). In fig. 3.16 the table moves by 0.01 mm, so "
                "that the one without rotation does not come down flat; else it rests.",
            ),
            Picture(
                real_drive_plot((one, other), rolling, sliding),
                "The same two cylinders. Above: for how much of the time which friction would hold a rim without slip, over "
                f"tables that move in circles at 25 Hz (eight directions of the first lean; {FRICTION} is marked). Below: the "
                f"tilt of a rim that slides over the real drive with friction {FRICTION}, from each of these directions.",
            ),
        ),
        tables=(of_candidates(both), of_circles(both, rolling), of_sliding(sliding), of_steps(tall[min(TALL)])),
    )
