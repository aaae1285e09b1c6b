"""The thesis's squeeze fields (fig. 4.4) in hand-made schedules: the baseline of a search.

Each family is tried with lines turned, centred and ramped in a few ways, since on this table no squeeze field aligns a part
with its own line: friction makes pushes run ahead of the table's motion, which turns parts by up to 40 degrees.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from studies.sensorless.play import Trials, cost, errors_of, play
from studies.sensorless.settings import SensorlessSettings
from vibgym import Part, Surface
from vibgym.policies.trained.schedule import Schedule

Rows = list[tuple[float, float, float]]

FAMILIES: dict[str, Callable[[float], Rows]] = {
    "one squeeze": lambda along: [(1.0, 1.0, 0.0)],
    "squeeze x, then y": lambda along: [(0.5, 0.0, 1.0), (0.5, 1.0, 0.0)],
    "squeeze x, then both": lambda along: [(0.5, 0.0, 1.0), (0.5, 1.0, along)],
    "both squeezes at once": lambda along: [(1.0, 1.0, along)],
}
"""Share of the time, push towards the line, and push along it, of every segment; ``along`` is the weaker squeeze's strength."""

PLACING = tuple(FAMILIES)[1:]
"""Families that leave no direction free: the others cannot position a part."""

ANGLES = np.radians(np.arange(-48.0, 49.0, 6.0))
REACHES = (0.013, 0.026, 0.052)
ALONG = (0.25, 0.5, 0.8)


def made(
    family: str, goal: np.ndarray, seconds: float, friction: float, turned: float, reach: float, along: float
) -> Schedule:
    """Return a schedule of a family; ``turned``: of the lines from the goal's heading, rad, in the last segment."""
    rows = FAMILIES[family](along)
    fields = np.array([[goal[0], goal[1], goal[2] + turned, push, other, 0.0, reach] for _, push, other in rows])
    fields[:-1, 2] = goal[2]
    return Schedule(fields, np.array([share * seconds for share, _, _ in rows]), goal, friction)


def shifted(schedule: Schedule, by: np.ndarray) -> Schedule:
    """Return the schedule with all centres shifted by (2,) m."""
    fields = schedule.fields.copy()
    fields[:, :2] += by
    return Schedule(fields, schedule.seconds, schedule.goal, schedule.friction)


def plain(family: str, part: Part, settings: SensorlessSettings) -> Schedule:
    """Return the family as the thesis draws it: lines through the goal, along its heading."""
    return made(family, np.array(settings.goal), settings.seconds, part.friction, 0.0, 0.026, 0.5)


def tuned(
    family: str, part: Part, surface: Surface, settings: SensorlessSettings, hardware: str, trials: Trials
) -> Schedule:
    """Return the family's best by cost: over :data:`ANGLES`, :data:`REACHES` and :data:`ALONG`, then with its centre moved by
    as much as parts end off the goal in the median, where that is better."""
    goal = np.array(settings.goal)

    def judged(schedules: list[Schedule]) -> tuple[np.ndarray, np.ndarray]:
        poses = play(
            schedules, trials, part, surface, hardware, settings.seconds, settings.model, settings.periods,
            settings.threads,
        )  # fmt: skip
        return cost(errors_of(poses, goal, part.symmetry)), poses[-1]

    several = ALONG if any(along not in (0.0, 1.0) for _, _, along in FAMILIES[family](0.5)) else ALONG[:1]
    choices = [(angle, reach, along) for angle in ANGLES.tolist() for reach in REACHES for along in several]
    schedules = [made(family, goal, settings.seconds, part.friction, *choice) for choice in choices]
    values, ends = judged(schedules)
    best = int(values.argmin())
    off = np.median(ends[best, :, :2], axis=0) - goal[:2]
    moved = [shifted(schedules[best], -share * off) for share in (0.0, 0.5, 1.0, 1.5)]
    return moved[int(judged(moved)[0].argmin())]
