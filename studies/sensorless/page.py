"""The results as a page of Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from studies.sensorless.settings import SensorlessSettings
from vibgym import Surface
from vibgym.policies.trained.schedule import Schedule

AFTER = 1.25
"""Time of the evaluation over the longest duration of a learned schedule."""


class Judgement(NamedTuple):
    """Evaluation of one schedule on one hardware. Arrays are (periods + 1,), over time.

    Attributes:
        fine, coarse: share of parts within Align's 2 mm and 3 deg, and within 5 mm and 5 deg.
        distance, turn: (2,) median and 95th percentile at the end, m and rad.
    """

    fine: np.ndarray
    coarse: np.ndarray
    distance: np.ndarray
    turn: np.ndarray


class Entry(NamedTuple):
    """A line of the tables."""

    name: str
    schedule: Schedule
    nominal: Judgement | None  # the part's own friction; None: not tried
    varied: Judgement  # factors of the settings' range
    success: float | None = None  # share of Align's episodes, friction varied; None: not tried
    time: float = math.nan  # s, median of the successes


class Case(NamedTuple):
    """A part on a hardware."""

    part: str
    hardware: str
    entries: Sequence[Entry]
    shipped: str  # name of the entry that is shipped
    searches: str  # duration and cost of the searches


INTRODUCTION = """# Sensorless schedules

Can a part of unknown pose be brought to a known one without any sensor? A *schedule* is a sequence of fields of the whole
surface, independent of the part's motion. Each field leaves fewer poses possible, until there is one left, up to the part's
symmetry (Böhringer, Donald and MacDonald, *Programmable force fields for distributed manipulation*, 1999; Kavraki, 1997,
for a single elliptic field). The thesis tried one squeeze field (section 7.2.2).

The part starts at rest, anywhere on the table, at any heading. The goal is the pose {goal}.

**Learned** schedules have {segments} fields, each two squeezes at right angles and a swirl about one centre: eight numbers
with its duration. CMA-ES finds them, over {starts} random starts a schedule, fresh in every generation, on the {model}
model with friction {friction}. Its search begins at the best of the tuned schedules. After {seconds:g} s at most all
elements rest.

**Hand-made** ones are the thesis's squeeze fields: one; along x, then along y; along x, then both; both at once. Their last
field goes on. *As drawn* has lines through the goal along its heading. *Tuned* is the best of 17 angles, three ramps, three
strengths of the weaker squeeze and four centres: friction makes pushes run ahead of the table's motion, which turns parts away
from the line that should align them.

All figures are of {judged} fresh starts on the planar model, {after:g} s after the start. "Varied" is friction {friction}, and
distance and heading are of these. Align's episodes have varied friction, too, and the environment's own starts.
Command: `python -m studies.sensorless {config}`
"""


def text(cases: Sequence[Case], settings: SensorlessSettings, surface: Surface, config: str, machine: str) -> str:
    """Return the page."""
    x, y, heading = settings.goal
    lines = [
        INTRODUCTION.format(
            goal=f"x = {1e3 * x:g} mm, y = {1e3 * y:g} mm, heading {math.degrees(heading):g} deg",
            segments=settings.segments, starts=settings.starts, model=settings.model, seconds=settings.seconds,
            friction=f"times {settings.friction[0]:g} to {settings.friction[1]:g}", judged=settings.judged, config=config,
            after=AFTER * settings.seconds,
        ),
        machine + "\n",
    ]  # fmt: skip
    return "\n".join([*lines, *(section(case, surface) for case in cases)])


def section(case: Case, surface: Surface) -> str:
    """Return the section on one part and hardware."""
    lines = [f"## {case.part.replace('_', ' ').capitalize()}, {case.hardware} hardware\n", *_ends(case), ""]
    lines += [*_curves(case, surface), "", case.searches, ""]
    return "\n".join(lines)


def _ends(case: Case) -> list[str]:
    heads = (
        "schedule", "5 mm, 5 deg", "2 mm, 3 deg", "varied: 5 mm, 5 deg", "2 mm, 3 deg", "distance: median, 95 %",
        "heading: median, 95 %", "Align: success", "median time",
    )  # fmt: skip
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for entry in case.entries:
        varied, (near, far), (little, much) = entry.varied, entry.varied.distance, np.degrees(entry.varied.turn)
        name = f"**{entry.name}** (shipped)" if entry.name == case.shipped else entry.name
        plain = (
            ["", ""] if entry.nominal is None else [percent(entry.nominal.coarse[-1]), percent(entry.nominal.fine[-1])]
        )
        tried = ["", ""] if entry.success is None else [percent(entry.success), _seconds(entry.time)]
        cells = [
            name, *plain, percent(varied.coarse[-1]),
            percent(varied.fine[-1]), f"{1e3 * near:.2f} mm, {1e3 * far:.2f} mm", f"{little:.2f} deg, {much:.2f} deg", *tried,
        ]  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _curves(case: Case, surface: Surface) -> list[str]:
    times = np.arange(1.5, 10.0, 0.5)
    periods = [round(each / surface.period) for each in times]
    shown = [(t, k) for t, k in zip(times.tolist(), periods) if k < len(case.entries[0].varied.fine)]
    lines = ["Share within 2 mm and 3 deg after so many seconds, friction varied:\n"]
    lines += ["| schedule | " + " | ".join(f"{t:g} s" for t, _ in shown) + " |", "|---" * (len(shown) + 1) + "|"]
    for entry in case.entries:
        lines.append(f"| {entry.name} | " + " | ".join(percent(entry.varied.fine[k]) for _, k in shown) + " |")
    return lines


def percent(share: float) -> str:
    """Return a share as text."""
    return f"{100.0 * share:.1f} %"


def _seconds(time: float) -> str:
    return "" if math.isnan(time) else f"{time:.2f} s"
