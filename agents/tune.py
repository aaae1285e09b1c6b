"""Hyperparameter tuning with Optuna: ``python -m agents tune CONFIG``.

Trials run in batches of ``abreast``. Each batch is proposed by the tree-structured Parzen estimator (TPE; Bergstra et al. 2011)
from the trials of all earlier batches, so a study does not depend on the number of processes, nor on kills: Optuna's storage
has the finished batches, and the runs of an interrupted one continue from their checkpoints.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.trial import FrozenTrial, TrialState
from pydantic import Field
from tqdm import tqdm

import vibgym
from agents import command_line, locks, parallel
from agents.command_line import Command
from agents.failures import TrainingError
from agents.train import Training
from agents.training_file import load_settings, load_tuning
from agents.training_settings import TrainSettings
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


class Tuning:
    """A study's settings, validated.

    Args:
        path: of a training file.
        agent: name, in a file of many agents.

    Attributes:
        settings: of the study.
        base: settings of the agent.
        space: distribution of every tuned setting.

    Raises:
        ValueError: names file and field.
    """

    def __init__(self, path: Path, agent: str | None = None) -> None:
        self.path, self.agent = path, agent
        data, where = load_tuning(path, agent)
        self.settings = read(TuningSettings, data, where)
        self.base = load_settings(path, agent)
        self.space = {name: distribution(spec, f"{where}: space.{name}") for name, spec in self.settings.space.items()}
        for end in (0, -1):
            self.of_trial({name: _ends(each)[end] for name, each in self.space.items()})

    def of_trial(self, values: dict[str, Any]) -> TrainSettings:
        """Return the settings of a trial's run.

        Raises:
            ValueError: invalid names or values.
        """
        judging = {} if self.base.judging is None else self.base.judging.model_dump()
        steps = {} if self.settings.steps is None else {"steps": self.settings.steps}
        changes = {"judging": {**judging, "first_seed": FIRST_SEED}, **steps, **values}
        return load_settings(self.path, self.agent, SEED, changes)

    def record(self) -> str:
        """Return everything that the study's results depend on, as JSON."""
        tuning = self.settings.model_dump(mode="json", exclude={"trials"})
        agent = self.base.model_dump(mode="json")
        return json.dumps({"tuning": tuning, "agent": agent, "vibgym": vibgym.__version__}, sort_keys=True)


def distribution(spec: Any, where: str) -> BaseDistribution:
    """Return the distribution of a setting from its specification in a file.

    Raises:
        ValueError: neither a list of values nor a range.
    """
    if checks.listed(spec) and spec and all(isinstance(each, bool | int | float | str | None) for each in spec):
        return CategoricalDistribution(spec)
    allowed = "a list of values, or a mapping with 'low', 'high' and optionally 'log: true'"
    if not isinstance(spec, dict) or not {"low", "high"} <= set(spec) <= {"low", "high", "log"}:
        raise checks.refuse(where, spec, allowed)
    low, high, log = spec["low"], spec["high"], spec.get("log", False)
    whole = all(isinstance(each, int) and not isinstance(each, bool) for each in (low, high))
    try:
        return IntDistribution(low, high, log) if whole else FloatDistribution(float(low), float(high), log)
    except (TypeError, ValueError) as error:
        raise checks.refuse(where, spec, f"{allowed} ({error})") from None


def _ends(each: Any) -> tuple[Any, ...]:
    """Return the values of a list, or both ends of a range."""
    return each.choices if isinstance(each, CategoricalDistribution) else (each.low, each.high)


class Pruned(Exception):
    """The trial is worse than the median."""


def run_trial(
    path: Path, agent: str | None, values: dict[str, Any], before: Sequence[FrozenTrial], directory: Path
) -> FrozenTrial:
    """Run a trial, or continue it from its checkpoint.

    The score is the mean time to the goal (s) at the best point of the learning curve; failures count with their limit.

    Args:
        path, agent: see :class:`Tuning`.
        values: of the tuned settings.
        before: trials of earlier batches, for pruning.
        directory: of the trial's run.
    """
    tuning = Tuning(path, agent)
    study = optuna.create_study(pruner=optuna.pruners.MedianPruner(n_startup_trials=4))
    study.add_trials(before)
    trial = study.ask(tuning.space)
    scores: dict[int, float] = {}

    def listener(row: dict[str, Any]) -> None:
        steps, score = int(row["steps"]), float(row["mean_time"])
        scores[steps] = score
        trial.report(score, steps)
        if trial.should_prune():
            raise Pruned

    state = TrialState.COMPLETE
    try:
        with Training(tuning.of_trial(values), directory, quiet=True) as training:
            training.run(listener=listener)
    except Pruned:
        state = TrialState.PRUNED
    except TrainingError:
        state = TrialState.FAIL
    return optuna.trial.create_trial(
        state=state,
        value=None if state is TrialState.FAIL else min(scores.values()),
        params=values,
        distributions=tuning.space,
        intermediate_values=scores,
    )


def propose(tuning: Tuning, number: int, before: Sequence[FrozenTrial]) -> dict[str, Any]:
    """Return the values of trial ``number``, a function of the trials of earlier batches alone."""
    sampler = optuna.samplers.TPESampler(n_startup_trials=tuning.settings.startup, seed=1_000_003 * number)
    study = optuna.create_study(sampler=sampler)
    study.add_trials(before)
    return dict(study.ask(tuning.space).params)


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
        config, agent: see :class:`Tuning`.
        trials: in all, instead of the file's.
        output: directory of the study, instead of ``runs/tuning/<agent>``.
        quiet: no progress bar.
        processes, ray: see :func:`agents.parallel.run`.

    Returns:
        Path of ``trials.csv``, and the best trial; None if none is complete.

    Raises:
        ValueError: invalid settings, a study of other settings, or one used by another process.
    """
    tuning = Tuning(config, agent)
    count = tuning.settings.trials if trials is None else checks.count("--trials", trials, least=1, most=100_000)
    directory = output or Path("runs/tuning") / (agent or config.stem).replace("/", "-")
    output_directory(directory)
    abreast = tuning.settings.abreast
    with locks.one_run(directory), parallel.pool(processes, ray) as run:
        study = _study(tuning, directory)
        done = study.trials
        with tqdm(total=count, initial=len(done), desc="tuning", unit="trial", disable=quiet) as bar:
            while len(done) < count:
                first = len(done) // abreast * abreast  # of the batch
                calls = []
                for number in range(len(done), min(first + abreast, count)):
                    values = propose(tuning, number, done[:first])
                    calls.append((config, agent, values, done[:first], directory / f"trial-{number:03d}"))
                study.add_trials(run(run_trial, calls, bar.update))
                done = study.trials
    rows = [{"trial": t.number, "state": t.state.name.lower(), "score_s": t.value, **t.params} for t in done]
    write_atomically(directory / TRIALS, csv_text(rows))
    complete = [each for each in done if each.state is TrialState.COMPLETE]
    return directory / TRIALS, min(complete, key=lambda each: (each.value, each.number), default=None)


def _study(tuning: Tuning, directory: Path) -> optuna.Study:
    """Return the study in ``directory``, a new one if there is none.

    Raises:
        ValueError: it has other settings, or is damaged.
    """
    path, mine = directory / STUDY, tuning.record()
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


def command(given: argparse.Namespace) -> None:
    """Tune hyperparameters."""
    path, found = tune(given.config, given.agent, given.trials, given.output, given.quiet, given.processes, given.ray)
    if found is not None:
        print(f"best: trial {found.number}, {found.value:.3f} s, {found.params}")
    print(f"trials: {path}")


COMMANDS = {"tune": Command(arguments, command, "directory of the study, instead of runs/tuning/NAME")}

optuna.logging.set_verbosity(optuna.logging.WARNING)
