"""What happens between two rollouts of a training: progress bar, learning curve, the best actor, checkpoints."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from agents.training import checkpoint
from agents.training.algorithm import Algorithm
from agents.training.judging import Judge
from agents.training.train_settings import TrainSettings
from vibgym.policies.trained.storage import load_set, save_set

BEST = "best.json"

Listener = Callable[[dict[str, Any]], None]
"""Told of a row of the learning curve."""


class Progress(BaseCallback):
    """Progress bar, learning curve and checkpoints, each between two updates.

    Args:
        algorithm: of the run.
        settings, directory: of the run.
        seconds_before: trained before this sitting.
        quiet: no bar.
        judge: of the learning curve; None: there is none.
        listener: told of its rows.
    """

    def __init__(
        self,
        algorithm: Algorithm,
        settings: TrainSettings,
        directory: Path,
        seconds_before: float = 0.0,
        quiet: bool = True,
        judge: Judge | None = None,
        listener: Listener | None = None,
    ) -> None:
        super().__init__()
        self.algorithm, self.settings, self.directory, self.judge = algorithm, settings, directory, judge
        self.listener = listener
        self.seconds_before, self.began = seconds_before, time.perf_counter()
        self.bar: Any = tqdm(total=settings.steps, unit="step", unit_scale=True, disable=quiet)
        self.saved_at = 0  # steps of the checkpoint on disk

    @property
    def seconds(self) -> float:
        """Training time so far, over all sittings, learning curve included."""
        return self.seconds_before + time.perf_counter() - self.began

    def _on_training_start(self) -> None:
        self.bar.initial = self.bar.n = self.num_timesteps  # steps of earlier sittings do not count in the rate

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        # Here the last update is complete, so that weights, optimizers and worlds belong together.
        self.bar.update(self.num_timesteps - self.bar.n)
        episodes = self.model.ep_info_buffer or []
        if episodes:
            success = float(np.mean(self.model.ep_success_buffer or [0.0]))
            length = float(np.mean([each["l"] for each in episodes]))
            self.bar.set_postfix_str(f"success {100 * success:.1f} %, {length:.0f} steps an episode", refresh=False)
        if self.judge is not None and self.judge.due(self.num_timesteps):
            self.play(self.algorithm.phase)
        if self.num_timesteps - self.saved_at >= self.settings.checkpoint_steps:
            self.save()

    def play(self, phase: str) -> None:
        """Add a row to the learning curve, and keep the actor where it does better than ever before."""
        if self.judge is None:
            return
        row = self.judge.judge(self.algorithm.acting(self.model), self.model.num_timesteps, self.seconds, phase)
        if self.judge.is_best(row):
            record = {"steps": row["steps"], "success": row["success"], "time_to_goal": row["time_to_goal"]}
            save_set(self.directory / BEST, checkpoint.KIND, self.algorithm.actor(self.model), record)
        if self.listener is not None:
            self.listener(row)

    def take_best(self) -> int:
        """Take the actor to where it did best on the episodes of the learning curve; returns the steps made until then."""
        if self.judge is None:
            return int(self.model.num_timesteps)
        tensors, record = load_set(self.directory / BEST, checkpoint.KIND)
        self.algorithm.take_actor(self.model, tensors)
        return int(record["steps"])

    def save(self) -> None:
        """Write a checkpoint of the present state."""
        checkpoint.save(self.directory, self.model, self.settings, self.seconds)
        self.saved_at = self.model.num_timesteps
