"""What a network sees of a goal observation: nothing of a goal but how the part stands to it."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym import checks
from vibgym.policies.classical.measured import check_state
from vibgym.policies.task_info import TaskInfo

WAYS = (0.25, 0.05, 0.005)  # m
TURNS = (6.0, 0.5, 0.05)  # rad
OF_THE_GOAL = ("way", "way_coarse", "way_fine", "turn", "turn_coarse", "turn_fine")


class GoalFeatures:
    """Goal observations as rows of numbers in [-1, 1], by ``achieved_goal`` and ``desired_goal``.

    The state in a goal observation tells way and turn to the goal. Where experience is replayed with another goal, they would
    still be those to the first, so these columns are left out and made anew from the two goals: hyperbolic tangents of
    the way in 250, 50 and 5 mm (x and y of each) and of the turn, wrapped as the task has it, in 6, 0.5 and 0.05 rad.

    Args:
        info: of a task with one part that has a goal pose.

    Attributes:
        kept: (n,) int64 columns of the state that stay; they come first.
        goal: (m,) int64 of which component of the goal every further number is made, and its scale ``(m,)``, m or rad.
        period: rad, turn that makes no difference; 0 where headings are not wrapped, or do not count.
        size: of a row, n + m.
        described: what makes a row, for files: columns of the state that stay, scales and period.
    """

    def __init__(self, info: TaskInfo) -> None:
        if not info.has_goal or len(info.parts) != 1 or info.goal_moves:
            raise checks.refuse(
                "network", "goal", f"tasks with one part and a goal pose that stays; {info.name} has not"
            )
        self.layout = info.layout
        rows = [row for row in self.layout.rows if row.name not in OF_THE_GOAL]
        self.kept = np.concatenate([np.arange(row.start, row.start + row.width) for row in rows])
        symmetry = info.parts[0].symmetry
        self.period = (2.0 * np.pi / symmetry if symmetry else 1e-9) if info.has_heading and info.wraps else 0.0
        axes = [(0, scale) for scale in WAYS] + [(1, scale) for scale in WAYS]
        axes += [(2, scale) for scale in TURNS] if info.has_heading else []
        self.goals = 3 if info.has_heading else 2
        self.goal = np.array([axis for axis, _ in axes])
        self.scale = np.array([scale for _, scale in axes], dtype=np.float32)
        self.size = len(self.kept) + len(axes)
        self.described = {
            "state": [[row.name, row.width] for row in rows],
            "goal": [[axis, scale] for axis, scale in axes],
            "period": self.period,
        }

    def of(self, observation: Any) -> np.ndarray:
        """(..., size) float32 of one goal observation or a batch of them.

        Raises:
            ValueError: it is no such dictionary, or its arrays have other shapes.
        """
        names = ("observation", "achieved_goal", "desired_goal")
        if not isinstance(observation, dict) or not set(names) <= set(observation):
            raise checks.refuse("observation", type(observation).__name__, f"a dictionary with {', '.join(names)}")
        state = check_state(observation["observation"], self.layout).astype(np.float32)
        shape = (*state.shape[:-1], self.goals)
        achieved, desired = (np.asarray(observation[name], dtype=np.float32) for name in names[1:])
        for name, value in (("achieved_goal", achieved), ("desired_goal", desired)):
            if value.shape != shape:
                raise checks.refuse(f"observation[{name!r}]", f"array of shape {value.shape}", f"shape {shape}")
        difference = desired - achieved
        if self.period:
            turn = difference[..., 2]
            difference[..., 2] = turn - np.float32(self.period) * np.round(turn / np.float32(self.period))
        return np.concatenate([state[..., self.kept], np.tanh(difference[..., self.goal] / self.scale)], axis=-1)
