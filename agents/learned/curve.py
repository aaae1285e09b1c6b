"""Learning curves: deterministic episodes on the same seeds every so many steps, written down beside the run."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.rollout import outcomes
from agents.learned.settings import TrainSettings
from agents.policy import Policy
from vibgym import checks

FILE = "curve.csv"
COLUMNS = ("steps", "seconds", "phase", "success", "time_to_goal", "return_")


class Curve:
    """Plays a policy and writes ``curve.csv``: share of successes, median time to the goal (s) and median return.

    Args:
        settings: of the run; its ``judging`` says when and how long.
        directory: of the run.

    Raises:
        ValueError: an environment that is not one of vibgym's.
    """

    def __init__(self, settings: TrainSettings, directory: Path) -> None:
        assert settings.judging is not None
        self.judging, self.path, self._last = settings.judging, directory / FILE, 0
        if not settings.environment_name.startswith("vibgym/"):
            raise checks.refuse("judging", settings.task, "nothing: only environments of vibgym are judged")
        self.task = settings.environment_name.removeprefix("vibgym/").removesuffix("-v0")
        spoken = ("action", "observation", "autoreset_mode")
        self.environment = {name: value for name, value in settings.environment.items() if name not in spoken}
        self.seeds = [self.judging.first_seed + k for k in range(self.judging.episodes)]

    def begin(self, steps: int) -> None:
        """A run begins, or goes on from so many steps: rows of steps that were lost go."""
        rows = []
        if steps and self.path.exists():
            with self.path.open(newline="") as file:
                rows = [row for row in csv.DictReader(file) if int(row["steps"]) <= steps]
        self._write(rows, "w")
        self._last = steps

    def due(self, steps: int) -> bool:
        """Whether it is time again."""
        return steps - self._last >= self.judging.every

    def judge(self, policy: Policy, steps: int, seconds: float, phase: str) -> dict[str, Any]:
        """Play, write a row, and return it.

        Args:
            policy: as it acts.
            steps, seconds: of the training so far.
            phase: of the training, such as ``"sac"``.
        """
        self._last = steps
        found = outcomes(policy, self.task, self.seeds, self.environment, quiet=True)
        reached = found.time_to_goal[found.success]
        row = {
            "steps": steps,
            "seconds": round(seconds, 1),
            "phase": phase,
            "success": round(float(found.success.mean()), 4),
            "time_to_goal": round(float(np.median(reached)), 4) if len(reached) else "",
            "return_": round(float(np.median(found.returns)), 4),
        }
        self._write([row], "a")
        return row

    def _write(self, rows: list[dict[str, Any]], mode: str) -> None:
        with self.path.open(mode, newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            if mode == "w":
                writer.writeheader()
            writer.writerows(rows)
