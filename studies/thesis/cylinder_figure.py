"""Figs. 3.15 to 3.20: tilt of a cylinder on its rim, for candidates of its lost size, on tables at rest and in motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, POLICY_COLOURS, SUCCESS, new_figure, png, style
from studies.thesis.cylinder import (
    DIRECTIONS,
    DISTURBANCES,
    DRIVE,
    FREQUENCY,
    FRICTION,
    REVOLUTION,
    SHOWN,
    START_TILT,
    Candidate,
    Cylinder,
    all_directions,
    disturbed,
    from_five_degrees,
    of_constant_tilt,
    phi_change,
    release,
    slippery,
    undriven_frequency,
)
from studies.thesis.figure import Comparison, Figure, Picture, Table
from studies.thesis.rim import Motion, follow

CIRCLES = (1e-5, 1e-4)
"""m, small radii of the table's motion, compared with the real one."""

STEPS, ARCS = (2e-4, 1e-4, 5e-5), (math.inf, 0.3, 0.03)
"""s and rad, step limits of the table of energy errors."""


def span(values: Sequence[float], digits: int = 1) -> str:
    """Format the range of values."""
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}"


def phi_range(runs: Sequence[Motion]) -> str:
    """Format the range of phi' in some motions."""
    rates = np.concatenate([run.phi_rate for run in runs]) / REVOLUTION
    return f"{rates.min():.2f} to {rates.max():.2f} rev/s"


def lifted(run: Motion) -> float:
    """Return the share of the time in which the table would have to pull, %."""
    return 100.0 * float((run.normal < 0.0).mean())


def median_friction(run: Motion) -> float:
    """Return the median of |F_R|/F_N while the table pushes."""
    return float(np.median(run.needed_friction[run.normal > 0.0]))


def held(run: Motion, friction: float = FRICTION) -> float:
    """Return the share of the time in which the table pushes and this friction suffices, %."""
    return 100.0 * float(((run.needed_friction <= friction) & (run.normal > 0.0)).mean())


def all_disturbed(cylinder: Cylinder) -> list[Motion]:
    """Compute the eight motions of fig. 3.19."""
    return [disturbed(cylinder, each) for each in DISTURBANCES]


def of_candidates(candidates: Sequence[Candidate]) -> Table:
    """Return the table of candidates on a table at rest."""
    rows = []
    for each in candidates:
        run, eight = release(each.cylinder, each.tilt), all_disturbed(each.cylinder)
        rows.append((
            each.size, f"{math.degrees(each.tilt):.2f} deg", f"{math.degrees(run.tilt.min()):.2f} deg",
            f"{100.0 * phi_change(run) / 2.5:.1f} %",
            f"{median_friction(run):.2f}, {run.needed_friction.max():.2f}",
            f"{max(math.degrees(one.tilt.max()) for one in eight):.1f} deg",
            f"{span([math.degrees(one) for one in (eight[-1].tilt.min(), eight[-1].tilt.max())])} deg",
            phi_range(eight),
        ))  # fmt: skip
    return Table(
        "Cylinders with a tilt of 10.64 Hz on a table at rest, released with phi' = -2.5 rev/s. The last three columns are for "
        "the eight starts of fig. 3.19, for the last of them, and for fig. 3.20.",
        ("Radius, centre height", "Start", "Smallest tilt", "Change of phi'", "|F_R|/F_N, median, largest", "Largest tilt of 8",
         "Tilt, last start", "phi' of 8"),
        tuple(rows),
    )  # fmt: skip


def of_circles(candidates: Sequence[Candidate], real: Mapping[Candidate, Sequence[Motion]]) -> Table:
    """Return the table of candidates on moving tables, without slip; ``real`` has the motions for the real drive."""
    rows = []
    for each in candidates:
        for radius in (*CIRCLES, DRIVE.horizontal_amplitude):
            small = radius in CIRCLES
            runs = all_directions(each.cylinder, each.tilt, radius) if small else real[each]
            rows.append((
                each.size, f"{1e3 * radius:.2f} mm",
                f"{span([100.0 * phi_change(run) / 2.5 for run in runs])} %",
                span([median_friction(run) for run in runs], 2),
                f"{span([lifted(run) for run in runs])} %",
                f"{span([held(run) for run in runs])} %",
            ))  # fmt: skip
    return Table(
        "The same without slip on a table that moves in a circle at 25 Hz, for eight initial directions of the lean: largest "
        "change of phi', median of the required friction while the table pushes, share of the time in which the table would "
        "have to pull, and share in which a friction of 0.6 holds the rim.",
        ("Radius, centre height", "Table's radius", "Change of phi'", "|F_R|/F_N, median", "F_N < 0", "0.6 holds"),
        tuple(rows),
    )


def of_sliding(courses: Mapping[Candidate, Sequence[Motion]]) -> Table:
    """Return the table of candidates on the real drive, sliding."""
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
        "The same on the real drive (2.7 mm, 25 Hz; no vertical motion) with a sliding rim, friction 0.6, for 0.2 s from "
        "phi' = -2.5 rev/s. Where the smallest slip is near 0 a real rim may stick, and RK4 loses order.",
        (
            "Radius, centre height",
            "Start",
            "Smallest tilt",
            "Largest tilt",
            "phi' at the end",
            "Smallest slip",
            "Energy error",
        ),
        rows,
    )


def of_steps(candidate: Candidate) -> Table:
    """Return the table of energy errors over RK4's step and the limit on the arc."""
    rows = []
    for step in STEPS:
        runs = [
            follow(candidate.cylinder.rim(), candidate.cylinder.released(candidate.tilt, spin=-2.5 * REVOLUTION), 1.0,
                   sampled=max(STEPS), step=step, arc=arc)
            for arc in ARCS
        ]  # fmt: skip
        rows.append((f"{1e6 * step:.0f} us", *(f"{run.energy_error:.0e}" for run in runs)))
    return Table(
        f"Energy error after 1 s relative to the energy of the tilt, {candidate.size} from 5 deg on a table at rest, over the "
        "step of RK4 and the largest motion of the contact along the rim in a step.",
        ("Step", "no limit", *(f"{each:g} rad" for each in ARCS[1:])),
        tuple(rows),
    )


SLIGHT = 1e-5
"""m, motion of the table that just keeps a cylinder without rotation from falling flat."""


def of_geometry(tall: Sequence[Candidate], flat: Sequence[Candidate]) -> tuple[Comparison, ...]:
    """Compare quantities that depend on the size of the cylinder."""
    fall = {
        each: math.degrees(float(np.ptp(disturbed(each.cylinder, DISTURBANCES[-1]).tilt))) for each in (*tall, *flat)
    }
    top = {each: max(math.degrees(run.tilt.max()) for run in all_disturbed(each.cylinder)) for each in (*tall, *flat)}
    change = {each: phi_change(release(each.cylinder, each.tilt)) / 2.5 for each in (*tall, *flat)}
    nearest = min(flat, key=lambda each: abs(change[each] - 0.09))
    return (
        Comparison(
            "Fig. 3.15: frequency of the tilt",
            f"{FREQUENCY} Hz",
            "; ".join(f"({each.size}) from {math.degrees(each.tilt):.1f} deg" for each in (*tall, *flat)),
            "all of these have it (radius, centre height): it does not determine the cylinder",
        ),
        Comparison(
            "Fig. 3.19: change of the tilt from 5 deg after psi' = -270 deg/s",
            "none",
            f"tall ones {span([fall[each] for each in tall])} deg; flat ones {max(fall[each] for each in flat):.5f} deg",
            "only flat ones: their heights are chosen for it",
        ),
        Comparison(
            "Fig. 3.19: largest tilt of all eight starts",
            "axes end at 10 deg",
            f"tall ones {span([top[each] for each in tall])} deg; flat ones {span([top[each] for each in flat])} deg",
            "only flat ones are within the axes",
        ),
        Comparison(
            "Fig. 3.20: phi' of these starts",
            "labels of the axis from -2.6 to -2.4 rev/s",
            f"tall ones {phi_range([run for each in tall for run in all_disturbed(each.cylinder)])}; flat ones "
            f"{phi_range([run for each in flat for run in all_disturbed(each.cylinder)])}",
            "only flat ones are near the labels",
        ),
        Comparison(
            "Fig. 3.16: change of phi' from -2.5 rev/s",
            "at most about 9 %",
            f"tall ones {span([100.0 * change[each] for each in tall])} %; flat ones "
            + ", ".join(f"{100.0 * change[each]:.1f} % ({each.size})" for each in flat),
            f"{nearest.size} is nearest",
        ),
    )


def of_trends(tall: Candidate, flat: Candidate) -> tuple[Comparison, ...]:
    """Compare statements of the thesis about any cylinder, for a tall and a flat one."""
    still = [phi_change(run) for run in all_directions(flat.cylinder, flat.tilt, SLIGHT, spin=0.0)]
    by_tilt = [undriven_frequency(flat.cylinder, math.radians(each)) for each in (2.0, 5.0, 10.0)]
    by_spin = [undriven_frequency(flat.cylinder, flat.tilt, each * REVOLUTION) for each in (1.0, 2.5, 5.0)]
    poses = [
        release(each.cylinder, math.radians(tilt), azimuth=0.25 * REVOLUTION * turn)
        for each in (tall, flat) for tilt in (2.0, 5.0) for turn in range(4)
    ]  # fmt: skip
    apart = max(float(np.abs(run.tilt - poses[k - k % 4].tilt).max()) for k, run in enumerate(poses))
    least = [math.degrees(disturbed(flat.cylinder, each).tilt.min()) for each in DISTURBANCES[:2]]
    tall_least = [math.degrees(disturbed(tall.cylinder, each).tilt.min()) for each in DISTURBANCES[:2]]
    fading = max(release(each.cylinder, each.tilt, duration=1.0).energy_error for each in (tall, flat))
    return (
        Comparison(
            "Fig. 3.15: frequency over the largest tilt (2, 5, 10 deg, flat)",
            "falls",
            ", ".join(f"{each:.1f}" for each in by_tilt) + " Hz",
            "agrees",
        ),
        Comparison(
            "Fig. 3.16: frequency over |phi'| (1, 2.5, 5 rev/s, flat)",
            "rises",
            ", ".join(f"{each:.2f}" for each in by_spin) + " Hz",
            "agrees from 2.5 rev/s; the frequency is slightly higher again at lower |phi'|",
        ),
        Comparison(
            "Fig. 3.16: change of phi' from 0",
            "at most 0.09 rev/s",
            f"{span(still, 2)} rev/s (flat, table motion {1e3 * SLIGHT:.2f} mm)",
            "same order; on a table at rest it falls flat, so the thesis's table moved",
        ),
        Comparison(
            "Figs. 3.17 and 3.18: four initial directions of the lean, 2 and 5 deg",
            "hardly any difference; labels of phi' from -2.5 to -2.35 rev/s",
            f"tilts differ by {math.degrees(apart):.2g} deg; phi' {phi_range(poses)}",
            "agrees, on a table at rest",
        ),
        Comparison(
            "Fig. 3.19: smallest tilt for theta' and psi' = 100 deg/s (first and second panel)",
            "theta', nearly upright",
            f"{least[0]:.2f} and {least[1]:.2f} deg (flat); {tall_least[0]:.2f} and {tall_least[1]:.2f} deg (tall)",
            f"not reproduced by the flat cylinder, from {math.degrees(START_TILT):.0f} deg on a table at rest",
        ),
        Comparison(
            "Damping: energy error after 1 s, relative to the energy of the tilt",
            "none",
            f"{fading:.0e}",
            "agrees: rolling without slip does not dissipate",
        ),
    )


SPINS = (-5.0, -2.5, 0.0, 2.5, 5.0)
"""rev/s, of fig. 3.16."""

RATIOS = np.linspace(0.0, 4.0, 161)
"""|F_R|/F_N, along the axis."""


def thesis_plot(tall: Candidate, flat: Candidate) -> bytes:
    """Plot the motions of the thesis for a tall and a flat cylinder."""
    figure = new_figure(7.6, 5.4)
    grid = figure.subplots(2, 2)
    start, rotation, slow, fast = grid.ravel()
    for each, colour, name in ((tall, FAILURE, "tall"), (flat, SUCCESS, "flat")):
        run = release(each.cylinder, each.tilt)
        start.plot(run.times, np.degrees(run.tilt), color=colour, linewidth=1.4, label=name)
    style(start, title=f"3.15: both at {FREQUENCY} Hz, released with -2.5 rev/s", xlabel="t, s", ylabel="tilt, deg")
    for spin, colour in zip(SPINS, POLICY_COLOURS[1:]):
        run = release(flat.cylinder, flat.tilt, spin * REVOLUTION, radius=SLIGHT)
        rotation.plot(run.times, run.phi_rate / REVOLUTION, color=colour, linewidth=1.4)
    style(rotation, title="3.16: phi' for five initial values (flat)", xlabel="t, s", ylabel="phi', rev/s")
    for axes, rate, pairs in ((slow, 100, DISTURBANCES[:4]), (fast, 270, DISTURBANCES[4:])):
        for pair, colour in zip(pairs, (FAILURE, INK, MUTED, SUCCESS)):
            name = f"theta' = {_degrees(pair[0])}" if pair[0] else f"psi' = {_degrees(pair[1])}"
            run, other = disturbed(flat.cylinder, pair), disturbed(tall.cylinder, pair)
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
    rolling: Mapping[Candidate, Sequence[Motion]],
    sliding: Mapping[Candidate, Sequence[Motion]],
) -> bytes:
    """Plot the share of the time in which a friction holds the rim, and the tilt of a sliding rim."""
    figure = new_figure(7.6, 5.0)
    grid = figure.subplots(2, len(candidates), squeeze=False)
    for (above, below), each in zip(grid.T, candidates):
        tables = {
            "at rest": [release(each.cylinder, each.tilt)],
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
        style(above, title=f"{kind}: sufficient friction", ylabel="share of time, %", xlabel="friction")
        style(below, title=f"{kind}: sliding, 2.7 mm", ylabel="tilt, deg", xlabel="t, s")
        above.set(xlim=(0.0, RATIOS[-1]), ylim=(0.0, 104.0))
        below.set_xlim(0.0, SHOWN)
        below.set_ylim(0.0)
    grid[0, 0].legend(frameon=False, fontsize=7, labelcolor=MUTED, loc="lower right")
    return png(figure)


def _degrees(rate: float) -> str:
    return f"{math.degrees(rate):.0f}"


TALL, FLAT = (0.015, 0.020, 0.030), (0.015, 0.020, 0.025, 0.030)
"""m, radii of candidates: with the frequency from 5 deg, and with constant tilt in fig. 3.19."""

DRAWN_TALL, DRAWN_FLAT = 0.020, 0.025
"""m, radii of the candidates in the plots."""


def draw() -> Figure:
    """Compute and plot the figures of the thesis for both kinds of cylinder, and the motion on the real drive."""
    tall = {each: from_five_degrees(each) for each in TALL}
    flat = {each: of_constant_tilt(each) for each in FLAT}
    both = (*tall.values(), *flat.values())
    one, other = tall[DRAWN_TALL], flat[DRAWN_FLAT]
    rolling = {each: all_directions(each.cylinder, each.tilt, DRIVE.horizontal_amplitude) for each in both}
    sliding = {each: all_directions(slippery(each.cylinder), each.tilt, DRIVE.horizontal_amplitude) for each in both}
    runs = [run for each in rolling.values() for run in each]
    required = span([median_friction(run) for run in runs])
    holds = span([held(run) for run in runs], digits=0)
    pulled = span([lifted(run) for run in runs], digits=0)
    left = span([abs(float(run.phi_rate[-1])) / REVOLUTION for each in sliding.values() for run in each])
    lowest, highest = (math.degrees(pick(each.tilt for each in flat.values())) for pick in (min, max))
    return Figure(
        title="Figs. 3.15 to 3.20: a tilted cylinder that rolls on its rim",
        shows="A cylinder is released from a tilt on a table that moves in a circle; static friction holds its rim. The "
        "tilt oscillates at 10.64 Hz, the rotation about the cylinder's axis hardly changes, and neither decays. Lost: the "
        "cylinder's size, the start of fig. 3.15 and the motion of its table.",
        comparisons=(
            *of_geometry(tuple(tall.values()), tuple(flat.values())),
            *of_trends(one, other),
            Comparison(
                "Static friction on the real drive (2.7 mm, 25 Hz): median of |F_R|/F_N while the table pushes",
                "static friction applies",
                f"{required}; the table would have to pull for {pulled} % of the time, and a friction of {FRICTION} holds the "
                f"rim for {holds} %",
                "the rim cannot hold: these figures are not of the real drive",
            ),
            Comparison(
                f"The same on a table at rest, largest ({other.size})",
                "static friction applies",
                f"{release(other.cylinder, other.tilt).needed_friction.max():.1f}",
                "not with usual materials: a flat cylinder would slide",
            ),
            Comparison(
                f"phi' on the real drive, {SHOWN} s after -2.5 rev/s, rim sliding with friction {FRICTION}",
                "constant (without slip)",
                f"{left} rev/s, in either direction",
                "the rotation of a real rim changes",
            ),
        ),
        differs=f"The frequency of {FREQUENCY} Hz does not determine the cylinder: tall ones have it from 5 deg, flat ones "
        f"from {lowest:.0f} to {highest:.0f} deg. Figs. 3.19 and 3.20 are those of a flat one, on a table that moves by far "
        f"less than 2.7 mm. Of the candidates, radius and centre height of {other.size} agree best. On the real drive no "
        f"cylinder rolls: a friction of {FRICTION} would hold the rim for {holds} % of the time, and the table would have to "
        f"pull for {pulled} %. One remark on fig. 3.19 is not reproduced: the tilt is smallest in its second "
        "panel, not in the first.",
        assumed=(
            "The cylinder is solid and homogeneous; the thesis's moments of inertia are lost.",
            "The start of fig. 3.15 is lost: here at rest relative to the table except for phi' = -2.5 rev/s, from the caption "
            "of fig. 3.19. Unless stated otherwise, the table rests.",
            "The curves of figs. 3.18 and 3.20 are lost; the labels of their axes replace them.",
            f"On a moving table, ranges are over {DIRECTIONS} initial directions of the lean, {SHOWN} s each or until the "
            "cylinder lies on its side. A sliding cylinder starts with its centre of mass at rest in the room; sticking is "
            "not simulated.",
        ),
        pictures=(
            Picture(
                thesis_plot(one, other),
                f"Figs. 3.15, 3.16 and 3.19 without slip. Radius and centre height: {one.size} from 5 deg (tall), and "
                f"{other.size} from {math.degrees(other.tilt):.1f} deg (flat). The table rests, except in fig. 3.16: there it "
                "moves by 0.01 mm, so that the cylinder without rotation does not fall flat.",
            ),
            Picture(
                real_drive_plot((one, other), rolling, sliding),
                "The same two cylinders. Top: share of the time in which a friction would hold the rim without slip, on "
                f"tables that move in circles at 25 Hz (eight initial directions of the lean; {FRICTION} is marked). Bottom: "
                f"tilt with a rim that slides on the real drive with friction {FRICTION}, for each of these directions.",
            ),
        ),
        tables=(of_candidates(both), of_circles(both, rolling), of_sliding(sliding), of_steps(tall[min(TALL)])),
    )
