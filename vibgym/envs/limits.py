"""How long an episode may last, in steps and in oscillation periods."""

from __future__ import annotations

import math
from typing import Any

from vibgym import checks
from vibgym.actuators.stage import ActuatorStage
from vibgym.sensing import Sensor
from vibgym.tasks import Task

MOST_EPISODE = 10**12
"""Steps or periods of an episode."""


def step_limit(periods_per_step: int, max_episode_periods: Any) -> int | None:
    """Steps after which an episode is truncated by the environment itself.

    With one period a step that is left to Gymnasium's limit in steps, which users may change. With longer steps that limit, the
    same number, would be one on another time.
    """
    if max_episode_periods is None:
        return None
    limit = checks.count("max_episode_periods", max_episode_periods, most=MOST_EPISODE)
    return None if periods_per_step == 1 else math.ceil(limit / periods_per_step)


def longest_paths(task: Task, actuators: ActuatorStage, sensor: Sensor, max_episode_periods: int | None) -> float:
    """s that the paths of an episode may last.

    Raises:
        ValueError: a machine of which an episode shows nothing, or that does nothing in it (a delay or a latency that lasts as
            long), a hold that lasts longer, or paths that do with it.
    """
    if max_episode_periods is None:
        return math.inf
    latency = "randomize['latency']" if "latency" in actuators.drawn() else "actuators.latency"
    for name, periods in (("sensor.delay", sensor.delay), (latency, actuators.most_latency)):
        if periods >= max_episode_periods:
            raise checks.refuse(name, f"{periods} periods", f"less than an episode, {max_episode_periods} periods")
    if task.hold > max_episode_periods:
        raise checks.refuse("task_settings['hold']", task.hold, f"at most an episode, {max_episode_periods} periods")
    longest = (max_episode_periods - task.hold) * task.surface.period
    if task.lasts > longest:
        allowed = f"at most {longest:.4g} s: an episode without the hold"
        raise checks.refuse("paths", f"{task.lasts:.4g} s", allowed)
    return longest
