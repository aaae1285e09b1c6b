"""A training run of SAC: progress, checkpoints, learning curve, policy."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from tqdm import tqdm

import vibgym
from agents.learned.storage import load_set
from agents.training import checkpoint, off_policy
from agents.training.adapter import StableBaselinesAdapter
from agents.training.checkpoint import Diverged, TrainingError
from agents.training.judging import Judge
from agents.training.sac import LeanSAC
from agents.training.settings import TrainSettings
from vibgym import checks, locks
from vibgym.envs import VibgymVectorEnv
from vibgym.files import WriteError, reason

EPISODES_A_LINE = 500
"""Between two lines of the log."""


def make_env(settings: TrainSettings) -> StableBaselinesAdapter:
    """The batch of worlds that a run trains on, with goal observations.

    Raises:
        ValueError: settings that ask for another observation, or that the environment refuses.
    """
    checks.choice("observation", settings.environment.get("observation", "goal"), ("goal",))
    if settings.residual is not None:
        raise checks.refuse("residual", settings.residual.model_dump(), "none with 'algorithm: sac'")
    arguments: dict[str, Any] = {
        "num_envs": settings.worlds, "autoreset_mode": "SameStep", **settings.environment, "observation": "goal"
    }  # fmt: skip
    name = settings.environment_name
    env = gym.make_vec(name, **arguments) if name in gym.registry else VibgymVectorEnv(settings.task, **arguments)
    assert isinstance(env, VibgymVectorEnv)
    return StableBaselinesAdapter(env)


class Progress(BaseCallback):
    """Progress bar, learning curve and checkpoints, each between two updates."""

    def __init__(
        self, settings: TrainSettings, directory: Path, seconds_before: float, quiet: bool, curve: Judge | None
    ) -> None:
        super().__init__()
        self.settings, self.directory, self.curve = settings, directory, curve
        self.seconds_before, self.began = seconds_before, time.perf_counter()
        self.bar: Any = tqdm(total=settings.steps, unit="step", unit_scale=True, disable=quiet)
        self.saved_at = 0  # steps of the checkpoint on disk

    @property
    def seconds(self) -> float:
        """Training time so far, over all sittings; the judging of the learning curve does not count."""
        return self.seconds_before + time.perf_counter() - self.began

    def _on_training_start(self) -> None:
        self.bar.initial = self.bar.n = self.num_timesteps
        self.saved_at = self.num_timesteps  # what was restored

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        assert isinstance(self.model, LeanSAC)
        self.bar.update(self.num_timesteps - self.bar.n)
        if self.model.ep_success_buffer:
            success = 100 * float(np.mean(self.model.ep_success_buffer))
            self.bar.set_postfix_str(f"success {success:.1f} %", refresh=False)
        if self.curve is not None and self.curve.due(self.num_timesteps):
            self.judge()
        if self.num_timesteps - self.saved_at >= self.settings.checkpoint_steps:
            self.save()

    def judge(self) -> None:
        """Write a row of the learning curve; its time does not count."""
        if self.curve is not None:
            assert isinstance(self.model, LeanSAC)
            at = time.perf_counter()
            acting = off_policy.acting(self.model, self.settings)
            self.curve.judge(acting, self.num_timesteps, self.seconds, "sac")
            self.began += time.perf_counter() - at

    def save(self) -> None:
        """Write a checkpoint of the present state."""
        assert isinstance(self.model, LeanSAC)
        off_policy.save(self.directory, self.model, self.settings, self.seconds)
        self.saved_at = self.num_timesteps


def train(
    where: str, settings: TrainSettings, directory: Path, policy: Callable[[], Path], quiet: bool = False
) -> Path:
    """Train as ``settings`` say, from the last checkpoint in ``directory`` if there is one.

    Args:
        where: what errors call the settings.
        settings: with ``algorithm: sac``.
        directory: for checkpoint, logs and learning curve.
        policy: gives the path of the policy's file, once it is clear that all can be written.
        quiet: no progress bar, no closing line.

    Returns:
        Path of the policy's file.

    Raises:
        ValueError: bad settings, a checkpoint of other settings, or a directory in which another run is at work.
        TrainingError: the training diverged; the last checkpoint and the last policy stay.
        WriteError: no space is left, or the like.
    """
    try:
        env = make_env(settings)
    except ValueError as error:
        raise ValueError(f"{where}: environment: {error}") from None
    with contextlib.closing(env):
        try:
            model = off_policy.make_model(settings, env)
            curve = None if settings.judging is None else Judge(settings, directory)
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from None
        path = policy()
        with locks.one_run(directory):
            before = off_policy.restore(directory, model, settings)
            if curve is not None:
                curve.begin(model.num_timesteps)
            progress = Progress(settings, directory, before, quiet, curve)
            try:
                learn(model, settings, progress)
            except Diverged as error:
                kept = f"the checkpoint of {progress.saved_at} steps stays" if progress.saved_at else "nothing is saved"
                raise TrainingError(
                    f"{directory}: training diverged within {model.num_timesteps} steps ({error}); {kept}; lower "
                    "sac.learning_rate or sac.tau and train into another output"
                ) from error
            except OSError as error:
                raise WriteError(f"training stopped, {progress.saved_at} steps are saved ({reason(error)})") from error
            except KeyboardInterrupt:
                raise KeyboardInterrupt(_saved(directory)) from None
            training = {
                "algorithm": "SAC with hindsight (on Stable-Baselines3)",
                "settings": settings.model_dump(mode="json"),
                "steps": model.num_timesteps,
                "minutes": round(progress.seconds / 60.0, 2),
                "vibgym": vibgym.__version__,
            }
            with locks.one_run(path.parent, "--policy", f".{path.name}.lock", patience=60.0):
                off_policy.save_policy(path, model, settings, training)
    if not quiet:
        print(f"{path}: {model.num_timesteps} steps in {progress.seconds:.0f} s")
    return path


def learn(model: LeanSAC, settings: TrainSettings, progress: Progress) -> None:
    """Train to the end, and write the last checkpoint and the last row of the curve."""
    sitting = progress.directory / f"log-from-{model.num_timesteps}"
    model.set_logger(configure(str(sitting), ["csv", "tensorboard"]))
    # A sitting that goes on draws other episodes than the ones already seen.
    env = model.get_env()
    assert env is not None
    env.seed(settings.seed + model.num_timesteps)
    try:
        if model.num_timesteps < settings.steps:
            todo = settings.steps - model.num_timesteps
            model.learn(todo, callback=progress, log_interval=EPISODES_A_LINE, reset_num_timesteps=False)
            progress.judge()
        progress.save()
    finally:
        progress.bar.close()
        model.logger.close()


def _saved(directory: Path) -> str:
    """What the checkpoint itself says: an interruption may come between its writing and anything that counts."""
    path = directory / checkpoint.FILE
    if not path.exists():
        return f"no checkpoint was due yet, so nothing is saved in {directory}"
    steps = load_set(path, checkpoint.KIND)[1]["steps"]
    return f"{steps} steps are saved in {directory}; the same command goes on from there"
