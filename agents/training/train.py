"""Training: PPO on one task from one file, with or without an expert's lessons before; logs, checkpoints, going on."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from tqdm import tqdm

from agents.evaluation.provenance import processor, versions
from agents.learned.storage import check_name, load_set, save_set
from agents.policy import Policy
from agents.training import checkpoint, sac_run
from agents.training.beginning import acting, begin_with, experts, make_env, make_model
from agents.training.checkpoint import Diverged, TrainingError
from agents.training.imitation import Imitation
from agents.training.judging import Judge
from agents.training.parts_policy import trained_tensors
from agents.training.ppo import PartsPPO
from agents.training.settings import TrainSettings, load_settings
from vibgym import checks, locks
from vibgym.envs import VibgymVectorEnv
from vibgym.files import WriteError, output_directory, output_files, reason

POLICY, BEST = "policy.json", "best.json"


class Progress(BaseCallback):
    """Progress bar, and a checkpoint at a rollout's end when one is due."""

    def __init__(
        self, settings: TrainSettings, directory: Path, seconds_before: float, quiet: bool, judge: Judge | None = None
    ) -> None:
        super().__init__()
        self.settings, self.directory, self.judge = settings, directory, judge
        self.seconds_before, self.began = seconds_before, time.perf_counter()
        self.bar: Any = tqdm(total=settings.steps, unit="step", unit_scale=True, disable=quiet)
        self.saved_at = 0  # steps of the checkpoint on disk

    @property
    def seconds(self) -> float:
        """Training time so far, over all sittings."""
        return self.seconds_before + time.perf_counter() - self.began

    def _on_training_start(self) -> None:
        self.bar.initial = self.bar.n = self.num_timesteps  # steps of earlier sittings do not count in the rate

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self.bar.update(self.num_timesteps - self.bar.n)
        episodes = self.model.ep_info_buffer or []
        if episodes:
            success = float(np.mean(self.model.ep_success_buffer or [0.0]))
            length = float(np.mean([each["l"] for each in episodes]))
            self.bar.set_postfix_str(f"success {100 * success:.1f} %, {length:.0f} steps an episode", refresh=False)

    def _on_rollout_start(self) -> None:
        # Here the last update is complete, so weights and optimizer belong together.
        assert isinstance(self.model, PartsPPO)
        checkpoint.check_finite(self.model)
        if self.judge is not None and self.judge.due(self.num_timesteps):
            self.play("ppo")
        if self.num_timesteps - self.saved_at >= self.settings.checkpoint_steps:
            self.save()

    def play(self, phase: str) -> None:
        """Add a row to the learning curve, and keep the actor where it does better than ever before."""
        assert isinstance(self.model, PartsPPO) and self.judge is not None
        row = self.judge.judge(acting(self.model, self.settings), self.model.num_timesteps, self.seconds, phase)
        if self.judge.is_best(row):
            record = {"steps": row["steps"], "success": row["success"], "time_to_goal": row["time_to_goal"]}
            save_set(self.directory / BEST, checkpoint.KIND, trained_tensors(self.model.policy.actor), record)

    def save(self) -> None:
        """Write a checkpoint of the present state."""
        assert isinstance(self.model, PartsPPO)
        checkpoint.save(self.directory, self.model, self.settings, self.seconds)
        self.saved_at = self.num_timesteps


def _saved(directory: Path) -> str:
    """What the checkpoint itself says: an interruption may come between its writing and anything that counts."""
    path = directory / checkpoint.FILE
    if not path.exists():
        return f"no checkpoint was due yet, so nothing is saved in {directory}"
    steps = load_set(path, checkpoint.KIND)[1]["steps"]
    return f"{steps} steps are saved in {directory}; the same command goes on from there"


def train(
    config: Path,
    output: Path | None = None,
    quiet: bool = False,
    policy: Path | None = None,
    agent: str | None = None,
    seed: int | None = None,
) -> Path:
    """Train as the file ``config`` says, from its last checkpoint if there is one.

    Writes ``checkpoint.json`` with its tensors, ``progress.csv`` and TensorBoard events, ``curve.csv`` where the settings ask
    for a learning curve, and at the end the policy: a JSON file with its tensors beside it.

    Args:
        config: YAML file, see :func:`agents.training.settings.load_settings`.
        output: directory, instead of the file's.
        quiet: no progress bar, no closing line.
        policy: path of the policy's file, instead of ``policy.json`` in the directory.
        agent: which one of a file of many.
        seed: instead of the file's.

    Returns:
        Path of the policy's file.

    Raises:
        ValueError: bad settings, a checkpoint of other settings, a place that cannot be written to, or a directory in which
            another run is at work.
        TrainingError: the training diverged; the last checkpoint and the last policy stay.
        WriteError: no space is left, or the like.
    """
    settings = load_settings(config, agent, seed)
    directory = output or Path(settings.output or Path("runs") / config.stem)
    if settings.algorithm == "sac":
        return sac_run.train(str(config), settings, directory, lambda: policy_path(directory, policy), quiet)
    try:
        env = make_env(settings)
    except ValueError as error:
        raise ValueError(f"{config}: environment: {error}") from None
    with contextlib.closing(env):
        try:
            model = make_model(settings, env)
            scenes = experts(settings, env)
            begin_with(settings, model, env)
            judge = None if settings.judging is None else Judge(settings, directory)
        except ValueError as error:
            raise ValueError(f"{config}: {error}") from None
        path = policy_path(directory, policy)
        with locks.one_run(directory):
            progress = Progress(settings, directory, checkpoint.restore(directory, model, settings), quiet, judge)
            try:
                if judge is not None:
                    judge.begin(model.num_timesteps)
                if model.num_timesteps == 0:
                    imitate(model, scenes, settings, progress)
                learn(model, settings, progress)
            except (Diverged, ValueError) as error:
                raise failure(error, model, progress) from error
            except OSError as error:
                raise WriteError(f"training stopped, {progress.saved_at} steps are saved ({reason(error)})") from error
            except KeyboardInterrupt:
                raise KeyboardInterrupt(_saved(directory)) from None
            kept_from = model.num_timesteps if judge is None else take_best(directory, model)
            training = {
                "algorithm": "PPO with parts as samples (on Stable-Baselines3)",
                "settings": settings.model_dump(mode="json"),
                "steps": model.num_timesteps,
                "kept_from_step": kept_from,
                "minutes": round(progress.seconds / 60.0, 2),
                "threads": torch.get_num_threads(),
                "processor": processor(),
                "versions": versions(),
            }
            # Others may write policies beside this one, and train elsewhere: a moment's lock, not the directory's.
            with locks.one_run(path.parent, "--policy", f".{path.name}.lock", patience=60.0):
                checkpoint.save_policy(path, model, settings, env.env, training)
    if not quiet:
        rate = model.num_timesteps / progress.seconds
        print(
            f"{path}: {model.num_timesteps} steps in {progress.seconds:.0f} s, {rate:.0f} steps/s, everything included"
        )
    return path


def take_best(directory: Path, model: PartsPPO) -> int:
    """Take the actor to where it did best on the episodes of the learning curve; returns the steps made until then."""
    tensors, record = load_set(directory / BEST, checkpoint.KIND)
    model.policy.actor.load_state_dict({name: torch.from_numpy(value.copy()) for name, value in tensors.items()})
    return int(record["steps"])


def imitate(
    model: PartsPPO, scenes: list[tuple[Policy, VibgymVectorEnv]], settings: TrainSettings, progress: Progress
) -> None:
    """Let the actor learn from the experts; the steps count."""
    if settings.imitation is None:
        return
    lessons = Imitation(model.policy, scenes, settings.imitation, settings.seed)
    for loss in lessons.rounds():
        model.num_timesteps = lessons.steps
        checkpoint.check_finite(model)
        progress.bar.update(lessons.steps - progress.bar.n)
        progress.bar.set_postfix_str(f"imitation, error {loss:.2e}", refresh=False)
    if progress.judge is not None:
        progress.model = model
        progress.play("imitation")
    checkpoint.save(progress.directory, model, settings, progress.seconds)


def policy_path(directory: Path, policy: Path | None) -> Path:
    """Where the policy goes, once it is clear that all can be written that a training writes.

    Raises:
        ValueError: it cannot.
    """
    tensors = f"-{'0' * 12}.safetensors"
    output_directory(directory)
    output_files((directory / name for name in (POLICY, checkpoint.FILE)), "output")
    if policy is None:
        return directory / POLICY
    check_name("--policy", policy)
    output_files((policy, policy.with_name(policy.stem + tensors)), "--policy")
    if policy.resolve() == (directory / checkpoint.FILE).resolve():
        raise checks.refuse("--policy", str(policy), "another file than the checkpoint")
    return policy


def learn(model: PartsPPO, settings: TrainSettings, progress: Progress) -> None:
    """Train to the end, and write the last checkpoint."""
    progress.saved_at = model.num_timesteps  # what was restored
    sitting = progress.directory / f"log-from-{model.num_timesteps}"
    model.set_logger(configure(str(sitting), ["csv", "tensorboard"]))
    # A sitting that goes on draws other episodes than the ones already seen.
    model.get_env().seed(settings.seed + model.num_timesteps)  # type: ignore[union-attr]
    try:
        if model.num_timesteps < settings.steps:
            todo = settings.steps - model.num_timesteps
            model.learn(todo, callback=progress, log_interval=1, reset_num_timesteps=False)
            checkpoint.check_finite(model)
            if progress.judge is not None:
                progress.play("ppo")
        checkpoint.save(progress.directory, model, settings, progress.seconds)
    finally:
        progress.bar.close()
        model.logger.close()


def failure(error: Exception, model: PartsPPO, progress: Progress) -> RuntimeError:
    """What ended a training whose settings were fine."""
    steps = model.num_timesteps
    try:
        checkpoint.check_finite(model)
    except Diverged as found:  # what the error says is then but a consequence
        kept = f"the checkpoint of {progress.saved_at} steps stays" if progress.saved_at else "nothing had been saved"
        return TrainingError(
            f"{progress.directory}: training diverged within {steps} steps ({found}); {kept}; lower ppo.learning_rate, "
            "ppo.ent_coef, ppo.log_std_init or ppo.clip_range and train into another output"
        )
    return RuntimeError(f"training failed after {steps} steps: {error}")
