"""Training: PPO on one task from one file, with logs, checkpoints, and going on after an interruption."""

from __future__ import annotations

import contextlib
import math
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from tqdm import tqdm

import vibgym
from agents.learned import checkpoint, sac_run
from agents.learned.adapter import StableBaselinesAdapter
from agents.learned.checkpoint import Diverged, TrainingError
from agents.learned.settings import TrainSettings, load_settings
from agents.learned.storage import check_name, load_set
from vibgym import checks, locks
from vibgym.envs import VibgymVectorEnv
from vibgym.files import WriteError, output_directory, output_files, reason

MOST_ROLLOUT = 4e9
"""Bytes of a rollout: what Stable-Baselines3 keeps of ``ppo.n_steps`` steps of all worlds before it learns from them."""

POLICY = "policy.json"

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}


def make_env(settings: TrainSettings) -> StableBaselinesAdapter:
    """The batch of worlds that a run trains on; policies are trained and act on the flat state."""
    checks.choice("observation", settings.environment.get("observation", "state"), ("state",))
    arguments: dict[str, Any] = {"num_envs": settings.worlds, "autoreset_mode": "SameStep", **settings.environment}
    name = settings.environment_name
    env = gym.make_vec(name, **arguments) if name in gym.registry else VibgymVectorEnv(settings.task, **arguments)
    assert isinstance(env, VibgymVectorEnv)
    return StableBaselinesAdapter(env)


def make_model(settings: TrainSettings, env: StableBaselinesAdapter) -> PPO:
    """An untrained PPO model.

    Raises:
        ValueError: a rollout that is too short to learn from, or too large to keep.
    """
    ppo = settings.ppo
    if ppo.n_steps * settings.worlds < 2:
        raise checks.refuse("ppo.n_steps", ppo.n_steps, "2 or more with one world")
    numbers = sum(math.prod(space.shape or ()) for space in (env.observation_space, env.action_space)) + 6
    size = 4 * numbers * ppo.n_steps * settings.worlds
    if size > MOST_ROLLOUT:
        allowed = f"a rollout of at most {MOST_ROLLOUT:.1e} bytes; with {settings.worlds} worlds it has {size:.1e}"
        raise checks.refuse("ppo.n_steps", ppo.n_steps, allowed)

    def learning_rate(remaining: float) -> float:
        return ppo.final_learning_rate + remaining * (ppo.learning_rate - ppo.final_learning_rate)

    return PPO(
        "MlpPolicy",
        env,
        n_steps=ppo.n_steps,
        batch_size=ppo.batch_size,
        n_epochs=ppo.n_epochs,
        learning_rate=learning_rate,
        gamma=ppo.gamma,
        gae_lambda=ppo.gae_lambda,
        clip_range=ppo.clip_range,
        ent_coef=ppo.ent_coef,
        policy_kwargs={
            "net_arch": list(ppo.net),
            "activation_fn": ACTIVATIONS[ppo.activation],
            "log_std_init": ppo.log_std_init,
        },
        seed=settings.seed,
        device="cpu",
    )


class Progress(BaseCallback):
    """Progress bar, and a checkpoint at a rollout's end when one is due."""

    def __init__(self, settings: TrainSettings, directory: Path, seconds_before: float, quiet: bool) -> None:
        super().__init__()
        self.settings, self.directory = settings, directory
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
        assert isinstance(self.model, PPO)
        checkpoint.check_finite(self.model)
        if self.num_timesteps - self.saved_at >= self.settings.checkpoint_steps:
            self.save()

    def save(self) -> None:
        """Write a checkpoint of the present state."""
        assert isinstance(self.model, PPO)
        checkpoint.save(self.directory, self.model, self.settings, self.seconds)
        self.saved_at = self.num_timesteps


def _saved(directory: Path) -> str:
    """What the checkpoint itself says: an interruption may come between its writing and anything that counts."""
    path = directory / checkpoint.FILE
    if not path.exists():
        return f"no checkpoint was due yet, so nothing is saved in {directory}"
    steps = load_set(path, checkpoint.KIND)[1]["steps"]
    return f"{steps} steps are saved in {directory}; the same command goes on from there"


def train(config: Path, output: Path | None = None, quiet: bool = False, policy: Path | None = None) -> Path:
    """Train as the file ``config`` says, from its last checkpoint if there is one.

    Writes ``checkpoint.json`` with its tensors, ``progress.csv`` and TensorBoard events, and at the end the policy: a
    JSON file with its tensors beside it.

    Args:
        config: YAML file of :class:`TrainSettings`.
        output: directory, instead of the file's.
        quiet: no progress bar, no closing line.
        policy: path of the policy's file, instead of ``policy.json`` in the directory.

    Returns:
        Path of the policy's file.

    Raises:
        ValueError: bad settings, a checkpoint of other settings, a place that cannot be written to, or a directory in which
            another run is at work.
        TrainingError: the training diverged; the last checkpoint and the last policy stay.
        WriteError: no space is left, or the like.
    """
    settings = load_settings(config)
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
        except ValueError as error:
            raise ValueError(f"{config}: {error}") from None
        path = policy_path(directory, policy)
        with locks.one_run(directory):
            progress = Progress(settings, directory, checkpoint.restore(directory, model, settings), quiet)
            try:
                learn(model, settings, progress)
            except (Diverged, ValueError) as error:
                raise failure(error, model, progress) from error
            except OSError as error:
                raise WriteError(f"training stopped, {progress.saved_at} steps are saved ({reason(error)})") from error
            except KeyboardInterrupt:
                raise KeyboardInterrupt(_saved(directory)) from None
            training = {
                "algorithm": "PPO (Stable-Baselines3)",
                "settings": settings.model_dump(mode="json"),
                "steps": model.num_timesteps,
                "minutes": round(progress.seconds / 60.0, 2),
                "vibgym": vibgym.__version__,
            }
            # Others may write policies beside this one, and train elsewhere: a moment's lock, not the directory's.
            with locks.one_run(path.parent, "--policy", f".{path.name}.lock", patience=60.0):
                checkpoint.save_policy(path, model, settings, training)
    if not quiet:
        rate = model.num_timesteps / progress.seconds
        print(
            f"{path}: {model.num_timesteps} steps in {progress.seconds:.0f} s, {rate:.0f} steps/s, everything included"
        )
    return path


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


def learn(model: PPO, settings: TrainSettings, progress: Progress) -> None:
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
        checkpoint.save(progress.directory, model, settings, progress.seconds)
    finally:
        progress.bar.close()
        model.logger.close()


def failure(error: Exception, model: PPO, progress: Progress) -> RuntimeError:
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
