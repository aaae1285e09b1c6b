"""Pictures of figs. 3.15 to 3.20."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, POLICY_COLOURS, SUCCESS, new_figure, png, style
from studies.thesis.cylinder import REVOLUTION
from studies.thesis.cylinder_comparisons import SLIGHT
from studies.thesis.cylinder_geometry import (
    FREQUENCY,
    FRICTION,
    KNOCKS,
    SHOWN,
    Candidate,
    all_directions,
    knocked,
    let_go,
)
from studies.thesis.cylinder_tables import CIRCLES, held
from studies.thesis.rim_course import Course

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
