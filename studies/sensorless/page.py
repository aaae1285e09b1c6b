"""Page with the results, in Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.evaluation.table import markdown
from studies.sensorless.schedule import Schedule
from studies.sensorless.settings import SensorlessSettings
from vibgym import Surface

AFTER = 1.25
"""Duration of the evaluation over the longest duration of a learned schedule."""


class Evaluation(NamedTuple):
    """Evaluation of one schedule on one hardware model.

    Attributes:
        fine, coarse: (periods + 1,) share of parts within 2 mm and 3 deg (Align), and within 5 mm and 5 deg.
        distance, heading: (2,) median and 95th percentile of the errors at the end, m and rad.
    """

    fine: np.ndarray
    coarse: np.ndarray
    distance: np.ndarray
    heading: np.ndarray


class Entry(NamedTuple):
    """A line of the tables."""

    name: str
    schedule: Schedule
    nominal: Evaluation | None  # nominal friction; None: not evaluated
    varied: Evaluation  # varied friction
    success: float | None = None  # share of episodes of Align, varied friction; None: not evaluated
    time: float = math.nan  # s, median time to success


class Case(NamedTuple):
    """Results of one part on one hardware model."""

    part: str
    hardware: str
    entries: Sequence[Entry]
    stored: str  # name of the stored entry
    searches: str  # sentence about the searches


INTRODUCTION = """# Sensorless schedules

A *schedule* moves a part of unknown pose to a known pose without a sensor. It is a sequence of fields of the whole surface,
independent of the part's motion. Each field reduces the set of possible poses, until one is left, up to the part's symmetry
(Böhringer, Donald and MacDonald, *Programmable force fields for distributed manipulation*, 1999; Kavraki, 1997, for a single
elliptic field). The thesis used one squeeze field (section 7.2.2).

The part starts at rest, anywhere on the table, at any heading. The goal is the pose {goal}.

**Learned** schedules have {segments} fields. Each field has two squeezes at right angles and a swirl about one centre: eight
parameters with its duration. CMA-ES optimizes them, with {starts} random starts per schedule and new ones in every generation,
on the {model} model with friction {friction}. The initial point is the best tuned schedule. After at most {seconds:g} s all
elements rest.

**Hand-made** schedules are squeeze fields of the thesis: one; along x, then along y; along x, then both; both at once. The
last field acts until the end. *As drawn*: lines through the goal along its heading. *Tuned*: the best of 17 angles, three
ramps, three strengths of the weaker squeeze and four centres. Tuning compensates the effect of friction on the direction of
pushes, which turns parts away from the line.

All results are of {evaluated} new starts on the planar model, {after:g} s after the start. *Nominal*: share of parts
within these tolerances with the part's friction. *Varied*: the same with friction {friction}. Distance,
heading error and episodes of Align have varied friction. The episodes have the starts of the environment.
Command: `python -m studies.sensorless {config}`
"""


def text(cases: Sequence[Case], settings: SensorlessSettings, surface: Surface, config: str, host: str) -> str:
    """Return the page."""
    x, y, heading = settings.goal
    lines = [
        INTRODUCTION.format(
            goal=f"x = {1e3 * x:g} mm, y = {1e3 * y:g} mm, heading {math.degrees(heading):g} deg",
            segments=settings.segments, starts=settings.starts, model=settings.model, seconds=settings.seconds,
            friction=f"multiplied by {settings.friction[0]:g} to {settings.friction[1]:g}", evaluated=settings.evaluated,
            config=config, after=AFTER * settings.seconds,
        ),
        host + "\n",
    ]  # fmt: skip
    return "\n".join([*lines, *(section(case, surface) for case in cases)])


def section(case: Case, surface: Surface) -> str:
    """Return the section about one part and hardware model."""
    pieces = [
        f"## {case.part.replace('_', ' ').capitalize()}, {case.hardware} hardware",
        _ends(case),
        "Share of parts within 2 mm and 3 deg over time, with varied friction:",
        _curves(case, surface),
        case.searches,
    ]
    return "\n\n".join(pieces) + "\n"


def _ends(case: Case) -> str:
    tolerances = ("5 mm, 5 deg", "2 mm, 3 deg")
    shares = [f"{friction}: {each}" for friction in ("nominal", "varied") for each in tolerances]
    errors = ("distance: median, 95 %", "heading error: median, 95 %")
    lines = []
    for entry in case.entries:
        (near, far), (little, much) = entry.varied.distance, np.degrees(entry.varied.heading)
        lines.append([
            f"**{entry.name}** (stored)" if entry.name == case.stored else entry.name,
            *_shares(entry.nominal),
            *_shares(entry.varied),
            f"{1e3 * near:.2f} mm, {1e3 * far:.2f} mm",
            f"{little:.2f} deg, {much:.2f} deg",
            "" if entry.success is None else percent(entry.success),
            "" if math.isnan(entry.time) else f"{entry.time:.2f} s",
        ])  # fmt: skip
    return markdown(("schedule", *shares, *errors, "Align: success", "median time"), lines)


def _shares(evaluation: Evaluation | None) -> list[str]:
    return ["", ""] if evaluation is None else [percent(evaluation.coarse[-1]), percent(evaluation.fine[-1])]


def _curves(case: Case, surface: Surface) -> str:
    times = np.arange(1.5, 10.0, 0.5)
    periods = [round(each / surface.period) for each in times]
    shown = [(t, k) for t, k in zip(times.tolist(), periods) if k < len(case.entries[0].varied.fine)]
    lines = [[entry.name, *(percent(entry.varied.fine[k]) for _, k in shown)] for entry in case.entries]
    return markdown(("schedule", *(f"{t:g} s" for t, _ in shown)), lines)


def percent(share: float) -> str:
    """Return a share in percent."""
    return f"{100.0 * share:.1f} %"
