"""Curricula: a run trains in easier environments first, each until its condition holds, then in its own environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.training_envs import make_worlds
from agents.training_settings import TrainSettings
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv

Episode = tuple[float, int, bool, float]
"""Return, length, success and cost of a finished episode."""


class Curriculum:
    """Position of a run in its curriculum.

    Args:
        settings: of the run.
        observation: the environments' ``observation=``.
        window: finished episodes over which success is averaged.

    Attributes:
        stage: index of the current stage; the number of stages once the run trains in its own environment.
        began: steps of the run at which the stage began.
    """

    def __init__(self, settings: TrainSettings, observation: str, window: int) -> None:
        self._run, self._observation, self._window = settings, observation, window
        self.stage, self.began = 0, 0

    def worlds(self) -> VecEnv:
        """Return all worlds of the current stage.

        Raises:
            ValueError: its environment is invalid.
        """
        last = self.stage == len(self._run.curriculum)
        with checks.within("environment" if last else f"curriculum[{self.stage}].environment"):
            return make_worlds(self.settings, self._observation)

    def first_worlds(self) -> VecEnv:
        """Return the worlds of the first stage, once those of every stage have been made.

        Raises:
            ValueError: an environment is invalid, or a stage has other spaces than the run's own environment.
        """
        spaces = None
        for stage in reversed(range(len(self._run.curriculum) + 1)):
            self.stage = stage
            env = self.worlds()
            found = env.observation_space, env.action_space
            spaces = found if spaces is None else spaces
            if found != spaces:
                env.close()
                where = f"curriculum[{stage}].environment"
                raise checks.conflict(f"{where} has other observations or actions than the run's environment")
            if stage:
                env.close()
        return env

    @property
    def settings(self) -> TrainSettings:
        """Settings of the run with the environment of the current stage. Mappings in both environments are merged."""
        if self.stage == len(self._run.curriculum):
            return self._run
        merged = dict(self._run.environment)
        for name, value in self._run.curriculum[self.stage].environment.items():
            both = isinstance(value, dict) and isinstance(merged.get(name), dict)
            merged[name] = {**merged[name], **value} if both else value
        return self._run.model_copy(update={"environment": merged})

    def advance(self, steps: int, episodes: Sequence[Episode], least: int) -> bool:
        """Go to the next stage if the condition of this one holds; return whether it does.

        Args:
            steps: of the run.
            episodes: the last ones that finished in this stage.
            least: steps of a stage before its success counts: successful episodes finish before the others.
        """
        if self.stage == len(self._run.curriculum):
            return False
        until, done = self._run.curriculum[self.stage].until, steps - self.began
        success = float(np.mean([each[2] for each in episodes])) if len(episodes) == self._window else 0.0
        mastered = until.success is not None and done >= least and success >= until.success
        if not mastered and (until.steps is None or done < until.steps):
            return False
        self.stage, self.began = self.stage + 1, steps
        return True

    def get_state(self) -> dict[str, Any]:
        """Return what :meth:`set_state` restores."""
        return {"stage": self.stage, "began": self.began}

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue from what :meth:`get_state` returned."""
        self.stage, self.began = state["stage"], state["began"]
