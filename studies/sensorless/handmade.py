"""Hand-made schedules of the thesis's squeeze fields (fig. 4.4), the baseline of a search.

On this table no squeeze field aligns a part with its line: friction rotates the direction of pushes, which turns parts by up to
40 degrees. Angle, centre and ramp of the lines are therefore tuned for each family.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from studies.sensorless.play import Trials, cost, errors_of, play
from studies.sensorless.schedule import Schedule
from studies.sensorless.settings import SensorlessSettings
from vibgym import Part, Surface

Rows = list[tuple[float, float, float]]

FAMILIES: dict[str, Callable[[float], Rows]] = {
    "one squeeze": lambda along: [(1.0, 1.0, 0.0)],
    "squeeze x, then y": lambda along: [(0.5, 0.0, 1.0), (0.5, 1.0, 0.0)],
    "squeeze x, then both": lambda along: [(0.5, 0.0, 1.0), (0.5, 1.0, along)],
    "both squeezes at once": lambda along: [(1.0, 1.0, along)],
}
"""Family -> rows of segments: share of the time, push towards the line, push along it.

``along`` is the strength of the weaker squeeze."""

PLACING = tuple(FAMILIES)[1:]
"""Families that position a part in both directions."""

ANGLES = np.radians(np.arange(-48.0, 49.0, 6.0))  # rad
REACHES = (0.013, 0.026, 0.052)  # m
ALONG = (0.25, 0.5, 0.8)


def schedule_of(
    family: str, goal: np.ndarray, seconds: float, friction: float, angle: float, reach: float, along: float
) -> Schedule:
    """Return a schedule of a family; ``angle``: of the lines relative to the goal's heading in the last segment, rad."""
    rows = FAMILIES[family](along)
    fields = np.array([[goal[0], goal[1], goal[2] + angle, towards, other, 0.0, reach] for _, towards, other in rows])
    fields[:-1, 2] = goal[2]
    return Schedule(fields, np.array([share * seconds for share, _, _ in rows]), goal, friction)


def shifted(schedule: Schedule, by: np.ndarray) -> Schedule:
    """Return the schedule with all centres shifted by ``by`` (2,) m."""
    fields = schedule.fields.copy()
    fields[:, :2] += by
    return replace(schedule, fields=fields)


def as_drawn(family: str, part: Part, settings: SensorlessSettings) -> Schedule:
    """Return the family's schedule as in the thesis: lines through the goal along its heading."""
    return schedule_of(family, np.array(settings.goal), settings.seconds, part.friction, 0.0, 0.026, 0.5)


def tuned(
    family: str, part: Part, surface: Surface, settings: SensorlessSettings, hardware: str, trials: Trials
) -> Schedule:
    """Return the family's schedule with the lowest cost.

    The first search is over :data:`ANGLES`, :data:`REACHES` and :data:`ALONG`. The second shifts the centre against the median
    deviation of the final positions.
    """
    goal = np.array(settings.goal)

    def costs_and_ends(schedules: list[Schedule]) -> tuple[np.ndarray, np.ndarray]:
        poses = play(
            schedules, trials, part, surface, hardware, settings.seconds, settings.model, settings.periods,
            settings.threads,
        )  # fmt: skip
        return cost(errors_of(poses, goal, part.symmetry)), poses[-1]

    strengths = ALONG if any(along not in (0.0, 1.0) for _, _, along in FAMILIES[family](0.5)) else ALONG[:1]
    choices = [(angle, reach, along) for angle in ANGLES.tolist() for reach in REACHES for along in strengths]
    schedules = [schedule_of(family, goal, settings.seconds, part.friction, *choice) for choice in choices]
    values, ends = costs_and_ends(schedules)
    best = int(values.argmin())
    deviation = np.median(ends[best, :, :2], axis=0) - goal[:2]
    candidates = [shifted(schedules[best], -share * deviation) for share in (0.0, 0.5, 1.0, 1.5)]
    return candidates[int(costs_and_ends(candidates)[0].argmin())]
