"""Training: ``python -m agents train CONFIG``, one run or several seeds; learning curve, checkpoints, continuing."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, closing
from pathlib import Path
from typing import Any

import torch
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from agents import checkpoint, command_line, locks, parallel
from agents.algorithms import ALGORITHMS
from agents.checkpoint import Diverged
from agents.command_line import Command, TrainingError
from agents.learning_curve import LearningCurve
from agents.provenance import processor, versions
from agents.training_file import load_settings
from agents.training_settings import TrainSettings
from vibgym import checks
from vibgym.files import WriteError, csv_text, output_directory, output_files, reason, write_atomically
from vibgym.policies.trained.storage import load_set, save_set

POLICY, BEST, RUN = "policy.json", "best.json", "run.json"
BEST_KIND = "vibgym-actor"

FREE = {"steps", "checkpoint_steps", "output", "selection", "serves"}
"""Settings that may change when a run continues."""


def train(
    config: Path,
    output: Path | None = None,
    quiet: bool = False,
    agent: str | None = None,
    seed: int | None = None,
    line: int = 0,
) -> Path:
    """Train as the file ``config`` specifies, from its last checkpoint if there is one; see :class:`Training`.

    Args:
        config: YAML file, see :func:`agents.training_file.load_settings`.
        output: directory, instead of the file's.
        quiet: no progress bar, no closing line.
        agent: name, in a file of many agents.
        seed: instead of the file's.
        line: of the progress bar, for runs beside one another: below the first one, without a closing line.

    Returns:
        Path of the policy's file.

    Raises:
        ValueError: invalid settings.
        TrainingError, WriteError: see :meth:`Training.run`.
    """
    settings = load_settings(config, agent, seed)
    with checks.within(config):
        training = Training(settings, output or _output(settings, config), quiet, line)
    with training:
        path = training.run()
    if not quiet and not line:
        steps, seconds = training.learner.steps, training.seconds
        print(f"{path}: {steps} steps in {seconds:.0f} s, {steps / seconds:.0f} steps/s, everything included")
    return path


def _output(settings: TrainSettings, config: Path) -> Path:
    return Path("runs") / config.stem if settings.output is None else Path(settings.output)


def train_seeds(
    config: Path,
    seeds: Sequence[int],
    output: Path | None = None,
    quiet: bool = False,
    agent: str | None = None,
    processes: int = 1,
    ray: str | None = None,
) -> list[Path]:
    """Train once with each seed, in parallel; return the paths of the policies in the order of the seeds.

    Args:
        config, agent, quiet: see :func:`train`.
        seeds: different from each other.
        output: directory with one subdirectory per seed, ``seed-0`` and so on; None: the file's.
        processes, ray: see :func:`agents.parallel.run`.
    """
    if len(set(seeds)) < len(seeds):
        raise checks.refuse("--seeds", list(seeds), "different seeds")
    folders = []
    for seed in seeds:
        settings = load_settings(config, agent, seed)
        if agent is not None and output is None:  # its directory names the seed
            folders.append(_output(settings, config))
        else:
            folders.append((output or _output(settings, config)) / f"seed-{seed}")
    # Each run has a bar of its own, below that of all; not on a cluster, whose nodes write elsewhere.
    calls = [
        (config, folder, quiet or ray is not None, agent, seed, k % parallel.usable(processes) + 1)
        for k, (seed, folder) in enumerate(zip(seeds, folders, strict=True))
    ]
    with tqdm(total=len(seeds), desc="training seeds", disable=quiet) as bar:
        return parallel.run(train, calls, workers=processes, ray=ray, done=bar.update)


class Training(AbstractContextManager["Training"]):
    """One run: its learner, learning curve and checkpoints. A context that closes the environment.

    A run of PPO or from a data set that was killed at any instant ends with the weights of an uninterrupted one, bit for bit
    on one machine with as many threads. Interrupted imitation starts again.

    Args:
        settings: of the run.
        directory: output: ``run.json``, the checkpoint, ``curve.csv`` (learning curve, with ``selection``), at the end the
            policy, and for each session ``log-from-STEPS`` with ``progress.csv`` and the events of both for TensorBoard.
        quiet: no progress bar.
        line: of the progress bar.
    """

    def __init__(self, settings: TrainSettings, directory: Path, quiet: bool = False, line: int = 0) -> None:
        self.settings, self.directory, self.quiet = settings, directory, quiet
        self._bar_options: dict[str, Any] = {"unit": "step", "unit_scale": True, "disable": quiet}
        if line:  # it leaves when the run ends
            self._bar_options |= {"desc": f"seed {settings.seed}", "position": line, "leave": False}
        self.seconds, self.saved_at = 0.0, 0
        self.curve = None if settings.selection is None else LearningCurve(settings, directory)
        self.learner: Any = ALGORITHMS[settings.algorithm.partition(".")[0]](settings)
        self.phase = getattr(self.learner, "phase", settings.algorithm)

    def __exit__(self, *_: object) -> None:
        """Close the environment."""
        getattr(self.learner, "close", lambda: None)()

    def run(self, listener: Callable[[dict[str, Any]], None] = lambda row: None) -> Path:
        """Train to the end and write the policy; return its path.

        Args:
            listener: receives every row of the learning curve, those of earlier sessions first; may raise to end the run.

        Raises:
            ValueError: a checkpoint of other settings, a path that cannot be written, or a directory used by another run.
            TrainingError: the training diverged; the last checkpoint and the last policy stay.
            WriteError: files cannot be written.
        """
        output_directory(self.directory)
        output_files((self.directory / name for name in (POLICY, checkpoint.FILE)), "output")
        with locks.one_run(self.directory):
            self._restore()
            self._listener, self._began = listener, time.perf_counter() - self.seconds
            try:
                total, initial = self.settings.steps, self.learner.steps
                self._log = Log(self.directory / f"log-from-{initial}")
                with tqdm(total=total, initial=initial, **self._bar_options) as self._bar, closing(self._log):
                    self._train()
            except (Diverged, ValueError) as error:
                raise self._failure(error) from error
            except OSError as error:
                raise WriteError(f"training stopped, {self.saved_at} steps are saved ({reason(error)})") from error
            except KeyboardInterrupt:
                saved = f"{self.saved_at} steps are saved in {self.directory}; the same command continues"
                raise KeyboardInterrupt(saved) from None
            return self._write_policy()

    def _restore(self) -> None:
        """Load the last checkpoint, if its settings are those of this run."""
        file, mine = self.directory / RUN, self.settings.model_dump(mode="json")
        if file.exists():
            try:
                record = json.loads(file.read_text(encoding="utf-8"))
                theirs, self.seconds = record["settings"], float(record["seconds"])
                other = {key for key in mine if theirs.get(key) != mine[key]} - FREE
            except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
                raise checks.conflict(f"{file}: not readable ({error}); choose another output") from None
            if other:
                raise checks.conflict(f"{file}: a run with other {', '.join(sorted(other))}; choose another output")
            self.learner.load(self.directory)
        elif self.learner.load(self.directory):
            raise checks.conflict(f"{file}: missing beside a checkpoint; choose another output")
        elif (foreign := self.directory / POLICY).exists():
            raise checks.conflict(f"{foreign}: a policy of another run, without {RUN}; choose another output")
        self.saved_at = self.learner.steps
        self._write_run()

    def _write_run(self) -> None:
        record = {"settings": self.settings.model_dump(mode="json"), "seconds": self.seconds}
        write_atomically(self.directory / RUN, json.dumps(record, indent=2, sort_keys=True) + "\n")

    def _train(self) -> None:
        learner, settings = self.learner, self.settings
        if self.curve is not None:
            self.curve.begin(learner.steps)
            for row in self.curve.rows:
                self._listener(row)
        if learner.steps == 0 and settings.imitation is not None:
            for error in learner.imitate(settings.imitation):
                self._bar.update(learner.steps - self._bar.n)
                self._bar.set_postfix_str(f"imitation, error {error:.2e}", refresh=False)
            self._evaluate("imitation")
            self._save()
        if learner.steps < settings.steps:
            learner.learn(settings.steps, self._between_updates)
            self._evaluate(self.phase)
        self._save()

    def _between_updates(self, metrics: dict[str, float]) -> None:
        """Report progress, measure the learning curve, write a checkpoint: each when it is due."""
        steps = self.learner.steps
        self._bar.update(steps - self._bar.n)
        if metrics:
            self._log.write({"steps": steps, **metrics})
        if "success" in metrics:
            text = f"success {100 * metrics['success']:.1f} %, {metrics['length']:.0f} steps per episode"
            self._bar.set_postfix_str(text, refresh=False)
        if steps >= self.settings.steps:
            return
        if self.curve is not None and self.curve.due(steps):
            self._evaluate(self.phase)
        if steps - self.saved_at >= self.settings.checkpoint_steps:
            self._save()

    def _evaluate(self, phase: str) -> None:
        """Add a row to the learning curve, and keep the actor if it is the best so far."""
        if self.curve is None:
            return
        learner = self.learner
        policy = learner.acting() if hasattr(learner, "acting") else learner
        row = self.curve.measure(policy, learner.steps, time.perf_counter() - self._began, phase)
        if hasattr(learner, "actor") and self.curve.is_best(row):
            record = {"steps": row["steps"], "success": row["success"], "time_to_goal": row["time_to_goal"]}
            save_set(self.directory / BEST, BEST_KIND, learner.actor(), record)
        self._log.add("evaluation", row)
        self._listener(row)

    def _save(self) -> None:
        self.learner.save(self.directory)
        self.saved_at, self.seconds = self.learner.steps, time.perf_counter() - self._began
        self._write_run()

    def _write_policy(self) -> Path:
        """Write the policy with the actor that did best on the learning curve; return the path of its file."""
        learner, kept, path = self.learner, self.learner.steps, self.directory / POLICY
        if self.curve is not None and hasattr(learner, "actor"):
            tensors, record = load_set(self.directory / BEST, BEST_KIND)
            learner.set_actor(tensors)
            kept = int(record["steps"])
        if not hasattr(learner, "save_policy"):
            return path
        training = {
            "algorithm": getattr(learner, "title", self.settings.algorithm),
            "settings": self.settings.model_dump(mode="json"),
            "steps": learner.steps,
            "kept_from_step": kept,
            "minutes": round(self.seconds / 60.0, 2),
            "threads": torch.get_num_threads(),
            "processor": processor(),
            "versions": versions(),
        }
        return learner.save_policy(path, training) or path

    def _failure(self, error: Exception) -> Exception:
        """Return the error to raise: divergence if a weight is not finite."""
        steps = self.learner.steps
        try:
            getattr(self.learner, "check_finite", lambda: None)()
        except Diverged as diverged:  # the other error is a consequence
            error = diverged
        if not isinstance(error, Diverged):
            return RuntimeError(f"training failed after {steps} steps: {error}")
        kept = f"the checkpoint of {self.saved_at} steps stays" if self.saved_at else "no checkpoint was saved"
        advice = getattr(self.learner, "advice", "the learning rate")
        return TrainingError(
            f"{self.directory}: training diverged within {steps} steps ({error}); {kept}; lower {advice} and train into "
            "another output"
        )


class Log:
    """Metrics of updates in ``progress.csv``, whose rows a killed run keeps, and rows of both curves as events of TensorBoard.

    Args:
        directory: created with the first row.
    """

    def __init__(self, directory: Path) -> None:
        self.directory, self.path = directory, directory / "progress.csv"
        self._rows: list[dict[str, float]] = []
        self._names: list[str] = []
        self._events: SummaryWriter | None = None

    def write(self, row: dict[str, float]) -> None:
        """Append a row with ``steps``; the file is rewritten if the row has new columns."""
        self.add("training", row)
        new = [name for name in row if name not in self._names]
        self._names += new
        self._rows.append(row)
        text = csv_text([{name: line.get(name) for name in self._names} for line in (self._rows if new else [row])])
        if new:
            write_atomically(self.path, text)
        else:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(text.partition("\n")[2])

    def add(self, group: str, row: dict[str, Any]) -> None:
        """Add the numbers of a row with ``steps`` as events ``group/name``."""
        if self._events is None:
            self._events = SummaryWriter(self.directory)
        for name, value in row.items():
            if isinstance(value, int | float) and name != "steps":
                self._events.add_scalar(f"{group}/{name}", value, row["steps"])

    def close(self) -> None:
        """Write the events that are left."""
        if self._events is not None:
            self._events.close()


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``train``."""
    command_line.config(parser)
    parser.add_argument("--agent", metavar="NAME", help="agent in a file of many, such as Align/prototype")
    parser.add_argument("--seed", type=int, metavar="N", help="seed, instead of the file's")
    parser.add_argument("--seeds", type=int, nargs="+", metavar="N", help="seeds of runs in parallel")
    command_line.side_by_side(parser)


def command(args: argparse.Namespace) -> None:
    """Train a policy, or several with different seeds."""
    if args.seeds is None:
        if args.ray is not None:
            raise checks.conflict("--ray requires --seeds")
        train(args.config, args.output, args.quiet, args.agent, args.seed)
        return
    if args.seed is not None:
        raise checks.conflict("--seed and --seeds exclude each other")
    paths = train_seeds(args.config, args.seeds, args.output, args.quiet, args.agent, args.processes, args.ray)
    print("\n".join(map(str, paths)))


COMMANDS = {"train": Command(arguments, command, "directory for what is written, instead of the file's")}
