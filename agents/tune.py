"""Hyperparameter tuning with Optuna: ``python -m agents tune CONFIG``.

Trials run in batches of ``abreast``. Each batch is proposed by the tree-structured Parzen estimator (TPE; Bergstra et al. 2011)
from the trials of all earlier batches, so a study does not depend on the number of processes, nor on kills: Optuna's storage
has the finished batches, and the runs of an interrupted one continue from their checkpoints.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.trial import FrozenTrial, TrialState
from pydantic import Field
from tqdm import tqdm

import vibgym
from agents import command_line, locks, parallel
from agents.command_line import Command, TrainingError
from agents.train import Training
from agents.training_file import load_settings, load_tuning
from vibgym import checks
from vibgym.files import csv_text, output_directory, write_atomically
from vibgym.settings import BaseSettings, read

STUDY, TRIALS, NAME, SETTINGS = "study.db", "trials.csv", "tuning", "settings"

SEED, FIRST_SEED = 900_000, 700_000
"""Seed of trials' runs, and first seed of their evaluation, which is not that of other learning curves."""


class TuningSettings(BaseSettings):
    """Section ``tuning`` of a training file."""

    space: dict[str, Any] = Field(min_length=1)
    """Name of a setting, such as ``ppo.learning_rate`` -> a list of values, or a mapping with ``low``, ``high`` and ``log``."""

    trials: int = Field(default=40, ge=1, le=100_000)
    """In all."""

    steps: int | None = Field(default=None, ge=1)
    """Of a trial's training; None: the agent's."""

    startup: int = Field(default=10, ge=0, le=100_000)
    """Random trials at the start."""

    abreast: int = Field(default=2, ge=1, le=10_000)
    """Trials in parallel."""


def distribution(entry: Any, where: str) -> BaseDistribution:
    """Return the distribution of a setting from its entry in a file."""
    if checks.listed(entry) and entry and all(isinstance(choice, bool | int | float | str | None) for choice in entry):
        return CategoricalDistribution(entry)
    allowed = "a list of values, or a mapping with 'low', 'high' and optionally 'log: true'"
    if not isinstance(entry, dict) or not {"low", "high"} <= set(entry) <= {"low", "high", "log"}:
        raise checks.refuse(where, entry, allowed)
    low, high, log = entry["low"], entry["high"], entry.get("log", False)
    whole = all(isinstance(end, int) and not isinstance(end, bool) for end in (low, high))
    try:
        return IntDistribution(low, high, log) if whole else FloatDistribution(float(low), float(high), log)
    except (TypeError, ValueError) as error:
        raise checks.refuse(where, entry, f"{allowed} ({error})") from None


def run_trial(
    config: Path,
    agent: str | None,
    common: dict[str, Any],
    startup: int,
    space: dict[str, BaseDistribution],
    before: list[FrozenTrial],
    number: int,
    directory: Path,
) -> FrozenTrial:
    """Propose a trial from those of earlier batches alone and run it, or continue its run.

    The score is the mean time to the goal (s) at the best point of the learning curve; failures count with their limit.

    Args:
        config, agent: see :func:`tune`.
        common: settings of all trials, instead of the file's.
        startup: number of random trials.
        space: distributions of settings.
        before: trials of earlier batches.
        number: of the trial.
        directory: of its run.
    """
    sampler = optuna.samplers.TPESampler(n_startup_trials=startup, seed=1_000_003 * number)
    study = optuna.create_study(sampler=sampler, pruner=optuna.pruners.MedianPruner(n_startup_trials=4))
    study.add_trials(before)
    trial = study.ask(space)
    scores, state = dict[int, float](), TrialState.COMPLETE

    def listener(row: dict[str, Any]) -> None:
        scores[int(row["steps"])] = float(row["mean_time"])
        trial.report(float(row["mean_time"]), int(row["steps"]))
        if trial.should_prune():
            raise optuna.TrialPruned

    try:
        with Training(
            load_settings(config, agent, SEED, {**common, **trial.params}), directory, quiet=True
        ) as training:
            training.run(listener=listener)
    except optuna.TrialPruned:
        state = TrialState.PRUNED
    except TrainingError:
        state = TrialState.FAIL
    return optuna.trial.create_trial(
        state=state,
        value=None if state is TrialState.FAIL else min(scores.values()),
        params=trial.params,
        distributions=trial.distributions,
        intermediate_values=scores,
    )


def tune(
    config: Path,
    agent: str | None = None,
    trials: int | None = None,
    output: Path | None = None,
    quiet: bool = False,
    processes: int = 2,
    ray: str | None = None,
) -> tuple[Path, FrozenTrial | None]:
    """Run a study, or continue it; write ``study.db`` (for Optuna and its dashboard) and ``trials.csv``.

    Args:
        config: training file with a section ``tuning``.
        agent: name, in a file of many agents.
        trials: in all, instead of the file's.
        output: directory of the study, instead of ``runs/tuning/<agent>``.
        quiet: no progress bar.
        processes, ray: see :func:`agents.parallel.run`.

    Returns:
        Path of ``trials.csv``, and the best trial; None if none is complete.

    Raises:
        ValueError: invalid settings, a study of other settings, or one used by another process.
    """
    data, where = load_tuning(config, agent)
    tuning, base = read(TuningSettings, data, where), load_settings(config, agent)
    selection = {} if base.selection is None else base.selection.model_dump()
    common: dict[str, Any] = {"selection": {**selection, "first_seed": FIRST_SEED}}
    if tuning.steps is not None:
        common["steps"] = tuning.steps
    space: dict[str, Any] = {
        name: distribution(entry, f"{where}: space.{name}") for name, entry in tuning.space.items()
    }
    for end in (0, -1):  # of every list and range
        values = {
            name: span.choices[end] if hasattr(span, "choices") else (span.low, span.high)[end]
            for name, span in space.items()
        }
        load_settings(config, agent, SEED, {**common, **values})
    count = tuning.trials if trials is None else checks.count("--trials", trials, least=1, most=100_000)
    directory = output or Path("runs/tuning") / (agent or config.stem).replace("/", "-")
    output_directory(directory)
    record = {"tuning": tuning.model_dump(mode="json", exclude={"trials"}), "agent": base.model_dump(mode="json")}
    with locks.one_run(directory):
        study = _study(directory / STUDY, json.dumps({**record, "vibgym": vibgym.__version__}, sort_keys=True))
        with tqdm(total=count, initial=len(study.trials), desc="tuning", unit="trial", disable=quiet) as bar:
            while (finished := len(study.trials)) < count:
                first = finished // tuning.abreast * tuning.abreast  # of the batch
                numbers = range(finished, min(first + tuning.abreast, count))
                trial = (config, agent, common, tuning.startup, space, study.trials[:first])
                calls = [(*trial, number, directory / f"trial-{number:03d}") for number in numbers]
                study.add_trials(parallel.run(run_trial, calls, workers=processes, ray=ray, done=bar.update))
        done = study.trials
    rows = [{"trial": t.number, "state": t.state.name.lower(), "score_s": t.value, **t.params} for t in done]
    write_atomically(directory / TRIALS, csv_text(rows))
    complete = [trial for trial in done if trial.state is TrialState.COMPLETE]
    return directory / TRIALS, min(complete, key=lambda trial: (trial.value, trial.number), default=None)


def _study(path: Path, mine: str) -> optuna.Study:
    """Return the study in a file, or a new one; ``mine`` is everything that its results depend on."""
    try:
        study = optuna.create_study(storage=f"sqlite:///{path}", study_name=NAME, load_if_exists=True)
        theirs = study.user_attrs.get(SETTINGS, None if study.trials else mine)
    except Exception as error:  # of SQLAlchemy
        raise checks.conflict(f"{path}: not readable ({error}); remove it or choose another output") from None
    if theirs != mine:
        raise checks.conflict(f"{path}: a study with other settings; remove it or choose another output")
    study.set_user_attr(SETTINGS, mine)
    return study


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``tune``."""
    command_line.config(parser)
    parser.add_argument("--agent", metavar="NAME", help="agent in a file of many, such as Align/ideal")
    parser.add_argument("--trials", type=int, metavar="N", help="in all, instead of the file's")
    command_line.side_by_side(parser)


def command(args: argparse.Namespace) -> None:
    """Tune hyperparameters."""
    path, best = tune(args.config, args.agent, args.trials, args.output, args.quiet, args.processes, args.ray)
    if best is not None:
        print(f"best: trial {best.number}, {best.value:.3f} s, {best.params}")
    print(f"trials: {path}")


COMMANDS = {"tune": Command(arguments, command, "directory of the study, instead of runs/tuning/NAME")}

optuna.logging.set_verbosity(optuna.logging.WARNING)
