"""Schedules from fresh starts: how many parts end at the goal, how far off they are, and what Align says of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.sensorless.errors import COARSE, FINE, errors_of
from studies.sensorless.play import draw_trials, play
from studies.sensorless.settings import SensorlessSettings
from vibgym import Part, Surface
from vibgym.policies.rollout import run, worlds_of
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.schedule import Schedule, SchedulePolicy

FRESH = 7_100_000  # seeds of the judgement's episodes, which nothing else uses


@dataclass(frozen=True, eq=False)
class Judgement:
    """Of one schedule on one hardware. Arrays are (periods + 1,), over time.

    Attributes:
        fine, coarse: share of parts within Align's 2 mm and 3 deg, and within 5 mm and 5 deg.
        distance, turn: (2,) median and 95th percentile at the end, m and rad.
    """

    fine: np.ndarray
    coarse: np.ndarray
    distance: np.ndarray
    turn: np.ndarray


def judge(
    schedules: list[Schedule],
    part: Part,
    surface: Surface,
    settings: SensorlessSettings,
    hardware: str,
    friction: tuple[float, float],
    seconds: float,
) -> list[Judgement]:
    """All schedules from the same fresh starts, on the planar model, period by period, for ``seconds``."""
    trials = draw_trials(part, surface, hardware, friction, settings.judged, (1, 0))
    found = []
    for schedule in schedules:
        poses = play([schedule], trials, part, surface, hardware, seconds, threads=settings.threads)[:, 0]
        errors = errors_of(poses, schedule.goal, part.symmetry)
        ends = (errors.distance[-1], errors.turn[-1])
        distance, turn = (np.quantile(each, [0.5, 0.95]) for each in ends)
        found.append(Judgement(errors.within(FINE).mean(1), errors.within(COARSE).mean(1), distance, turn))
    return found


def episodes(
    schedule: Schedule, part: str, hardware: str, friction: tuple[float, float], worlds: int, first: int = FRESH
) -> tuple[np.ndarray, float]:
    """Episodes of Align, as any policy is judged: success (worlds,) bool, and the successes' median time, s (nan: none).

    Starts are the environment's, from seeds ``first`` on; the goal is the schedule's.
    """
    arguments: dict[str, Any] = {"parts": [part], "actuators": hardware, "randomize": {"friction": list(friction)}}
    env = worlds_of("Align", worlds, action=SchedulePolicy.action, observation=SchedulePolicy.observation, **arguments)
    policy = SchedulePolicy(TaskInfo.of(env), schedule)
    found = run(policy, env, range(first, first + worlds), "Align", options={"goal": schedule.goal})
    env.close()
    return found.success, float(np.median(found.time_to_goal[found.success])) if found.success.any() else float("nan")
