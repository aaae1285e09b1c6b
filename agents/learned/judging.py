"""Learning curves: deterministic episodes on the same seeds, every so many steps, written down beside the run."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.rollout import outcomes
from agents.learned.coding import Coding
from agents.learned.parts_policy import PartsPolicy, trained_tensors
from agents.learned.pictures import PictureCoding
from agents.learned.settings import TrainSettings
from agents.learned.trained import TrainedPolicy
from vibgym import checks

FILE = "curve.csv"
COLUMNS = ("steps", "seconds", "phase", "success", "time_to_goal", "return_")


class Judge:
    """Plays the policy of a run and writes ``curve.csv``: a row each time, with share of successes and medians.

    Args:
        settings: of the run.
        coding: of its network.
        directory: of the run.

    Raises:
        ValueError: an environment that is not one of vibgym's.
    """

    def __init__(self, settings: TrainSettings, coding: Coding | PictureCoding, directory: Path) -> None:
        assert settings.judging is not None
        self.settings, self.judging, self.coding = settings, settings.judging, coding
        if not settings.environment_name.startswith("vibgym/"):
            raise checks.refuse("judging", settings.task, "nothing: only environments of vibgym are judged")
        self.task = settings.environment_name.removeprefix("vibgym/").removesuffix("-v0")
        self.path, self._last = directory / FILE, 0
        own = {name: value for name, value in settings.environment.items() if name not in ("action", "observation")}
        own.pop("autoreset_mode", None)
        self._scenes = [{**own, **scene} for scene in settings.scenes] or [own]

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

    def judge(self, policy: PartsPolicy, steps: int, seconds: float, phase: str) -> dict[str, Any]:
        """Play, write a row, and return it.

        Args:
            policy: of which the actor plays.
            steps, seconds: of the training so far.
            phase: ``"imitation"`` or ``"ppo"``.
        """
        self._last = steps
        network = policy.actor.kind
        acting = TrainedPolicy(trained_tensors(policy.actor), network, self.settings.ppo.activation, self.coding)
        success, time, returns = [], [], []
        first = self.judging.first_seed
        for scene, share in zip(
            self._scenes, np.array_split(np.arange(self.judging.episodes), len(self._scenes)), strict=True
        ):
            if len(share):
                found = outcomes(acting, self.task, [first + int(k) for k in share], scene, quiet=True)
                success.append(found.success)
                time.append(found.time_to_goal)
                returns.append(found.returns)
        times = np.concatenate(time)
        row = {
            "steps": steps,
            "seconds": round(seconds, 1),
            "phase": phase,
            "success": round(float(np.concatenate(success).mean()), 4),
            "time_to_goal": round(float(np.nanmedian(times)), 4) if np.isfinite(times).any() else "",
            "return_": round(float(np.median(np.concatenate(returns))), 4),
        }
        self._write([row], "a")
        return row

    def _write(self, rows: list[dict[str, Any]], mode: str) -> None:
        with self.path.open(mode, newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            if mode == "w":
                writer.writeheader()
            writer.writerows(rows)
