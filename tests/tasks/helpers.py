"""Helpers of the task tests."""

from typing import Any

import numpy as np

from vibgym.physics.core.records import new_state
from vibgym.settings import read
from vibgym.tasks.base import Start, Task


def made(cls: Any, surface: Any, parts: Any, **settings: Any) -> Any:
    """Return a task, or a pattern, with settings as an environment takes them."""
    return cls(surface, parts, settings=read(cls.Settings, settings, "task_settings"))


class Scorer:
    """A task's scoring on given states."""

    def __init__(self, task: Any, worlds: int, periods: int = 1) -> None:
        self.state = new_state(worlds, len(task.parts))
        self.state.velocity[...] = np.nan  # scores use the mean only
        self.scoring = Task.scoring(task, self.state, periods)
        self.episode, self.relations = self.scoring.episode, self.scoring.relations

    def begin(self, start: Start, worlds: Any = None) -> None:
        """Place the parts of some worlds at a start, one row per world, and begin their episodes."""
        worlds = np.arange(len(self.state.pose)) if worlds is None else np.asarray(worlds)
        self.state.pose[worlds], self.state.fallen[worlds] = start.pose, ~start.present
        self.scoring.begin(worlds, start)

    def score(self, pose: Any, mean_velocity: Any = 0.0, fallen: Any = False, diverged: Any = False) -> None:
        """Score a step that ends in this state."""
        self.state.pose[...], self.state.mean_velocity[...] = pose, mean_velocity
        self.state.fallen[...], self.state.diverged[...] = fallen, diverged
        for stage in self.scoring.stages():
            stage(np.arange(len(self.state.pose)))
