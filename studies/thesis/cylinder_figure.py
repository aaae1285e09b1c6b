"""Figs. 3.15 to 3.20: the tilt of a cylinder on its rim, by which cylinder and over which table."""

from __future__ import annotations

import math

from studies.thesis.cylinder import REVOLUTION
from studies.thesis.cylinder_comparisons import of_geometry, of_trends
from studies.thesis.cylinder_geometry import (
    DIRECTIONS,
    DRIVE,
    FREQUENCY,
    FRICTION,
    SHOWN,
    all_directions,
    from_five_degrees,
    let_go,
    of_constant_tilt,
    slippery,
)
from studies.thesis.cylinder_plots import real_drive_plot, thesis_plot
from studies.thesis.cylinder_tables import (
    held,
    lifted,
    median_asked,
    of_candidates,
    of_circles,
    of_sliding,
    of_steps,
    span,
)
from studies.thesis.figure import Comparison, Figure, Picture

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
            "of fig. 3.19 gives. Where nothing else is said, the table rests.",
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
