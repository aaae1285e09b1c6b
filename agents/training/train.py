"""Training: one run from one file, with or without an expert's lessons before; logs, checkpoints, going on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.logger import configure

from agents import locks
from agents.failures import Diverged, TrainingError
from agents.provenance import processor, versions
from agents.training import checkpoint
from agents.training.algorithms import ALGORITHMS
from agents.training.imitation import Imitation, experts
from agents.training.judging import Judge
from agents.training.ppo.algorithm import PPO
from agents.training.progress import Listener, Progress
from agents.training.train_settings import TrainSettings
from agents.training.training_file import load_settings
from vibgym import checks
from vibgym.files import WriteError, output_directory, output_files, reason
from vibgym.policies.trained.storage import check_name, load_set

POLICY = "policy.json"


def train(
    config: Path,
    output: Path | None = None,
    quiet: bool = False,
    policy: Path | None = None,
    agent: str | None = None,
    seed: int | None = None,
) -> Path:
    """Train as the file ``config`` says, from its last checkpoint if there is one; see :class:`Training`.

    Args:
        config: YAML file, see :func:`agents.training.training_file.load_settings`.
        output: directory, instead of the file's.
        quiet: no progress bar, no closing line.
        policy: path of the policy's file, instead of ``policy.json`` in the directory.
        agent: which one of a file of many.
        seed: instead of the file's.

    Returns:
        Path of the policy's file.

    Raises:
        ValueError: bad settings, or see :meth:`Training.run`.
        TrainingError: the training diverged; the last checkpoint and the last policy stay.
        WriteError: no space is left, or the like.
    """
    settings = load_settings(config, agent, seed)
    directory = output or Path(settings.output or Path("runs") / config.stem)
    with checks.within(config):
        training = Training(settings, directory, quiet)
    with training:
        path = training.run(policy)
    if not quiet:
        steps, seconds = training.model.num_timesteps, training.seconds
        print(f"{path}: {steps} steps in {seconds:.0f} s, {steps / seconds:.0f} steps/s, everything included")
    return path


class Training:
    """One run: its worlds, its model, its experts and its judge. A context that closes the worlds.

    A run that was killed, at whatever instant, ends with the weights of one that was not, bit for bit on one machine with as
    many threads: a checkpoint holds all that the rest depends on, and lessons that were cut short begin anew.

    Args:
        settings: of the run.
        directory: of what it writes: ``checkpoint.json`` with its tensors, ``progress.csv`` and TensorBoard events,
            ``curve.csv`` where the settings ask for a learning curve, and at the end the policy: a JSON file with its tensors.
        quiet: no progress bar.

    Raises:
        ValueError: settings that do not fit together, or that the environment refuses.
    """

    def __init__(self, settings: TrainSettings, directory: Path, quiet: bool = False) -> None:
        self.settings, self.directory, self.quiet = settings, directory, quiet
        self.algorithm = ALGORITHMS[settings.algorithm](settings)
        self.seconds = 0.0
        with checks.within("environment"):
            self.env = self.algorithm.make_env()
        try:
            self.model = self.algorithm.make_model(self.env)
            lessons = settings.imitation
            self.scenes = experts(lessons, settings.action, settings.seed, self.env) if lessons is not None else []
            if isinstance(self.algorithm, PPO):
                self.algorithm.begin_with(self.model)
            self.judge = None if settings.judging is None else Judge(settings, directory)
        except ValueError:
            self.env.close()
            raise

    def __enter__(self) -> Training:
        return self

    def __exit__(self, *_: object) -> None:
        self.env.close()

    def run(self, policy: Path | None = None, listener: Listener | None = None) -> Path:
        """Train to the end and write the policy; returns its path.

        Args:
            policy: path of the policy's file, instead of ``policy.json`` in the directory.
            listener: told of every row of the learning curve, those of earlier sittings first; may raise to end the training.

        Raises:
            ValueError: a checkpoint of other settings, a place that cannot be written to, or a directory in which another run
                is at work.
            TrainingError: the training diverged; the last checkpoint and the last policy stay.
            WriteError: no space is left, or the like.
        """
        settings, model = self.settings, self.model
        path = policy_path(self.directory, policy)
        with locks.one_run(self.directory):
            before = checkpoint.restore(self.directory, model, settings)
            progress = Progress(self.algorithm, settings, self.directory, before, self.quiet, self.judge, listener)
            progress.model = model
            try:
                if self.judge is not None:
                    self.judge.begin(model.num_timesteps)
                    for row in self.judge.rows if listener is not None else ():
                        listener(row)  # type: ignore[misc] - it is one
                if model.num_timesteps == 0 and settings.imitation is not None:
                    lessons = Imitation(model.policy, self.scenes, settings.imitation, settings.seed)
                    imitate(model, lessons, progress)
                learn(model, settings, progress)
            except (Diverged, ValueError) as error:
                raise failure(error, model, progress) from error
            except OSError as error:
                raise WriteError(f"training stopped, {progress.saved_at} steps are saved ({reason(error)})") from error
            except KeyboardInterrupt:
                raise KeyboardInterrupt(_saved(self.directory)) from None
            self.seconds = progress.seconds
            training = {
                "algorithm": self.algorithm.title,
                "settings": settings.model_dump(mode="json"),
                "steps": model.num_timesteps,
                "kept_from_step": progress.take_best(),
                "minutes": round(self.seconds / 60.0, 2),
                "threads": torch.get_num_threads(),
                "processor": processor(),
                "versions": versions(),
            }
            # Others may write policies beside this one, and train elsewhere: a moment's lock, not the directory's.
            with locks.one_run(path.parent, "--policy", f".{path.name}.lock", patience=60.0):
                self.algorithm.save_policy(path, model, training)
        return path


def _saved(directory: Path) -> str:
    """What the checkpoint itself says: an interruption may come between its writing and anything that counts."""
    path = directory / checkpoint.FILE
    if not path.exists():
        return f"no checkpoint was due yet, so nothing is saved in {directory}"
    steps = load_set(path, checkpoint.KIND, checkpoint.VERSION)[1]["steps"]
    return f"{steps} steps are saved in {directory}; the same command goes on from there"


def imitate(model: Any, lessons: Imitation, progress: Progress) -> None:
    """Let the actor learn from the experts; the steps count."""
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
            todo, line = settings.steps - model.num_timesteps, progress.algorithm.log_interval
            model.learn(todo, callback=progress, log_interval=line, reset_num_timesteps=False)
            checkpoint.check_finite(model)
            progress.play(progress.algorithm.phase)
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
            f"{progress.algorithm.advice} and train into another output"
        )
    return RuntimeError(f"training failed after {steps} steps: {error}")
