"""Training: one run from one file, with or without an expert's lessons before; logs, checkpoints, going on."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import torch
from stable_baselines3.common.logger import configure

from agents import locks
from agents.provenance import processor, versions
from agents.training import checkpoint, off_policy, offline, on_policy
from agents.training.checkpoint import Diverged, TrainingError
from agents.training.imitation import Imitation
from agents.training.judging import Judge
from agents.training.progress import Judged, Progress
from agents.training.settings import TrainSettings, load_settings
from vibgym import checks
from vibgym.envs import VibgymVectorEnv
from vibgym.files import WriteError, output_directory, output_files, reason
from vibgym.policies.protocol import Policy
from vibgym.policies.trained.storage import check_name, load_set

POLICY = "policy.json"

ALGORITHMS: dict[str, ModuleType] = {"ppo": on_policy, "sac": off_policy, "offline": offline}
"""Modules with the same names: ``make_env``, ``make_model``, ``acting``, ``actor``, ``take_actor``, ``save_policy``."""

LINES = {"ppo": 1, "sac": 500, "offline": 1}
"""Rollouts, of SAC episodes, or from data sets blocks of updates, between two lines of the log."""


def _saved(directory: Path) -> str:
    """What the checkpoint itself says: an interruption may come between its writing and anything that counts."""
    path = directory / checkpoint.FILE
    if not path.exists():
        return f"no checkpoint was due yet, so nothing is saved in {directory}"
    steps = load_set(path, checkpoint.KIND, checkpoint.VERSION)[1]["steps"]
    return f"{steps} steps are saved in {directory}; the same command goes on from there"


def train(
    config: Path,
    output: Path | None = None,
    quiet: bool = False,
    policy: Path | None = None,
    agent: str | None = None,
    seed: int | None = None,
    *,
    changes: Mapping[str, Any] | None = None,
    judged: Judged | None = None,
) -> Path:
    """Train as the file ``config`` says, from its last checkpoint if there is one.

    A run that was killed, at whatever instant, ends with the weights of one that was not, bit for bit on one machine with as
    many threads: a checkpoint holds all that the rest depends on, and lessons that were cut short begin anew.

    Writes ``checkpoint.json`` with its tensors, ``progress.csv`` and TensorBoard events, ``curve.csv`` where the settings ask
    for a learning curve, and at the end the policy: a JSON file with its tensors beside it.

    Args:
        config: YAML file, see :func:`agents.training.settings.load_settings`.
        output: directory, instead of the file's.
        quiet: no progress bar, no closing line.
        policy: path of the policy's file, instead of ``policy.json`` in the directory.
        agent: which one of a file of many.
        seed: instead of the file's.
        changes: of settings, see :func:`agents.training.settings.load_settings`.
        judged: told of every row of the learning curve, those of earlier sittings first; may raise to end the training.

    Returns:
        Path of the policy's file.

    Raises:
        ValueError: bad settings, a checkpoint of other settings, a place that cannot be written to, or a directory in which
            another run is at work.
        TrainingError: the training diverged; the last checkpoint and the last policy stay.
        WriteError: no space is left, or the like.
    """
    settings = load_settings(config, agent, seed, changes)
    algorithm = ALGORITHMS[settings.algorithm]
    directory = output or Path(settings.output or Path("runs") / config.stem)
    try:
        env = algorithm.make_env(settings)
    except ValueError as error:
        raise ValueError(f"{config}: environment: {error}") from None
    with contextlib.closing(env):
        try:
            model = algorithm.make_model(settings, env)
            scenes = on_policy.experts(settings, env)
            on_policy.begin_with(settings, model, env)
            judge = None if settings.judging is None else Judge(settings, directory)
        except ValueError as error:
            raise ValueError(f"{config}: {error}") from None
        path = policy_path(directory, policy)
        with locks.one_run(directory):
            before = checkpoint.restore(directory, model, settings)
            progress = Progress(algorithm, settings, directory, before, quiet, judge, judged)
            progress.model = model
            try:
                if judge is not None:
                    judge.begin(model.num_timesteps)
                    if judged is not None:
                        for row in judge.rows:
                            judged(row)
                if model.num_timesteps == 0:
                    imitate(model, scenes, settings, progress)
                learn(model, settings, progress)
            except (Diverged, ValueError) as error:
                raise failure(error, model, progress) from error
            except OSError as error:
                raise WriteError(f"training stopped, {progress.saved_at} steps are saved ({reason(error)})") from error
            except KeyboardInterrupt:
                raise KeyboardInterrupt(_saved(directory)) from None
            training = {
                "algorithm": algorithm.TITLE,
                "settings": settings.model_dump(mode="json"),
                "steps": model.num_timesteps,
                "kept_from_step": progress.take_best(),
                "minutes": round(progress.seconds / 60.0, 2),
                "threads": torch.get_num_threads(),
                "processor": processor(),
                "versions": versions(),
            }
            # Others may write policies beside this one, and train elsewhere: a moment's lock, not the directory's.
            with locks.one_run(path.parent, "--policy", f".{path.name}.lock", patience=60.0):
                algorithm.save_policy(path, model, settings, training)
    if not quiet:
        rate = model.num_timesteps / progress.seconds
        print(
            f"{path}: {model.num_timesteps} steps in {progress.seconds:.0f} s, {rate:.0f} steps/s, everything included"
        )
    return path


def imitate(
    model: Any, scenes: list[tuple[Policy, VibgymVectorEnv]], settings: TrainSettings, progress: Progress
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
    progress.play("imitation")
    progress.save()


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


def learn(model: Any, settings: TrainSettings, progress: Progress) -> None:
    """Train to the end, and write the last checkpoint."""
    progress.saved_at = model.num_timesteps  # what was restored, or what the lessons have come to
    sitting = progress.directory / f"log-from-{model.num_timesteps}"
    model.set_logger(configure(str(sitting), ["csv", "tensorboard"]))
    model.begin(settings.seed + model.num_timesteps)
    try:
        if model.num_timesteps < settings.steps:
            todo, line = settings.steps - model.num_timesteps, LINES[settings.algorithm]
            model.learn(todo, callback=progress, log_interval=line, reset_num_timesteps=False)
            checkpoint.check_finite(model)
            progress.play(progress.algorithm.PHASE)
        progress.save()
    finally:
        progress.bar.close()
        model.logger.close()


def failure(error: Exception, model: Any, progress: Progress) -> RuntimeError:
    """What ended a training whose settings were fine."""
    steps = model.num_timesteps
    try:
        checkpoint.check_finite(model)
    except Diverged as found:  # what the error says is then but a consequence
        kept = f"the checkpoint of {progress.saved_at} steps stays" if progress.saved_at else "nothing had been saved"
        return TrainingError(
            f"{progress.directory}: training diverged within {steps} steps ({found}); {kept}; lower "
            f"{progress.algorithm.ADVICE} and train into another output"
        )
    return RuntimeError(f"training failed after {steps} steps: {error}")
