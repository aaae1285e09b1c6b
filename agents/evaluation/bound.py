"""The least time to goal of the episodes that are about to be run."""

from __future__ import annotations

import numpy as np

from vibgym.bounds import TimeBound
from vibgym.envs.shared import SharedInterface
from vibgym.tasks import PoseTask
from vibgym.tasks.base import HOLD_PERIODS


def least_times(env: SharedInterface) -> np.ndarray:
    """Least time to goal (worlds,) of the episodes that have just begun, s; see :class:`vibgym.bounds.TimeBound`.

    Args:
        env: with all worlds at the start of an episode.

    Returns:
        nan where no bound is known: for several parts and tasks without a goal pose, models other than the planar one, parts
        that may stick, and where friction or the table's incline are not what part and table say.
    """
    core, truth = env.core, env.truth
    state = core.simulator.state
    known = isinstance(env.task, PoseTask) and len(env.parts) == 1 and core.simulator.model == "planar"
    if not known or not env.surface.slides_permanently(env.parts[0].static_friction) or env.parts[0].friction == 0.0:
        return np.full(len(truth.pose), np.nan)
    bound = TimeBound(
        env.surface,
        env.parts[0],
        position_tolerance=env.task.position_tolerance,
        heading_tolerance=env.task.heading_tolerance,
        heading_period=env.task.heading_period(env.parts[0]),
        hold=HOLD_PERIODS,
        periods_per_step=env.periods_per_step,
        amplitude=core.actuators.most_amplitude,
        latency=core.actuators.least_latency,
    )
    usual = (state.friction[:, 0] == 1.0) & (state.incline == 0.0).all(axis=1)
    return np.where(usual, bound.seconds(truth.pose[:, 0], truth.goal[:, 0]), np.nan)
