"""Hyperparameter tuning with Optuna: ``python -m agents tune CONFIG``.

Trials run in batches of ``abreast``. Each batch is proposed by the tree-structured Parzen estimator (TPE; Bergstra et al. 2011)
from the trials of all earlier batches, so a study does not depend on the number of processes, nor on kills: finished trials
are read back, interrupted ones continue from their checkpoints.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.trial import TrialState
from pydantic import Field
from tqdm import tqdm

import vibgym
from agents import command_line, locks, parallel
from agents.command_line import Command
from agents.failures import TrainingError
from agents.train import Training
from agents.training_file import load_settings, load_tuning
from agents.training_settings import JudgingSettings, TrainSettings
from vibgym import checks
from vibgym.config import Settings, parse
from vibgym.files import csv_text, output_directory, write_atomically

STUDY, SETTINGS, TRIALS, RESULT, NAME = "study.db", "tuning.json", "trials.csv", "result.json", "tuning"

FIRST_SEED = 700_000
"""First seed of the episodes on which trials are evaluated; training, reports and tables use others."""

STATES = {"complete": TrialState.COMPLETE, "pruned": TrialState.PRUNED, "failed": TrialState.FAIL}


class TuningSettings(Settings):
    """Section ``tuning`` of a training file."""

    space: dict[str, Any] = Field(min_length=1)
    """Name of a setting, such as ``ppo.learning_rate`` -> a list of values, or a mapping with ``low``, ``high`` and ``log``."""

    trials: int = Field(40, ge=1, le=100_000)
    steps: int | None = Field(None, ge=1)  # of a trial's training; None: the agent's
    seeds: list[int] = Field([900_000], min_length=1, max_length=100)  # of a trial's runs, whose scores are averaged
    startup: int = Field(10, ge=0, le=100_000)  # random trials at the start
    abreast: int = Field(2, ge=1, le=10_000)  # trials in parallel
    seed: int = Field(0, ge=0, lt=2**32)  # of the proposals
    prune: bool = True  # stop trials worse than the median at the same number of steps
    judging: dict[str, Any] = {}  # of trials, in addition to the agent's


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
        if not isinstance(data, dict):
            raise checks.refuse(where, data, "a mapping with 'space'")
        self.settings = parse(TuningSettings, data, where)
        self.base = load_settings(path, agent)
        self.space = {name: distribution(spec, f"{where}: space.{name}") for name, spec in self.settings.space.items()}
        self.of_trial({name: _first_value(each) for name, each in self.space.items()}, self.settings.seeds[0])

    def of_trial(self, values: dict[str, Any], seed: int) -> TrainSettings:
        """Return the settings of a trial's run.

        Raises:
            ValueError: invalid names or values.
        """
        judging = {} if self.base.judging is None else self.base.judging.model_dump()
        judging = JudgingSettings.model_validate({**judging, "first_seed": FIRST_SEED, **self.settings.judging})
        steps = {} if self.settings.steps is None else {"steps": self.settings.steps}
        return load_settings(self.path, self.agent, seed, {"judging": judging.model_dump(), **steps, **values})

    def record(self) -> dict[str, Any]:
        """Return everything that the study's results depend on, as JSON values."""
        tuning = self.settings.model_dump(mode="json", exclude={"trials"})
        return {"tuning": tuning, "agent": self.base.model_dump(mode="json"), "vibgym": vibgym.__version__}


def distribution(spec: Any, where: str) -> BaseDistribution:
    """Return the distribution of a setting from its specification in a file.

    Raises:
        ValueError: neither a list of values nor a range.
    """
    if isinstance(spec, list) and spec and all(isinstance(each, bool | int | float | str | None) for each in spec):
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


def _first_value(each: BaseDistribution) -> Any:
    if isinstance(each, CategoricalDistribution):
        return each.choices[0]
    assert isinstance(each, IntDistribution | FloatDistribution)
    return each.low


class Trial(NamedTuple):
    """Result of a trial."""

    number: int
    values: dict[str, Any]  # of the tuned settings
    state: str  # "complete", "pruned" or "failed"
    score: (
        float | None
    )  # s, mean time to the goal at the best point of the learning curve; failures count with their limit
    reports: dict[int, float]  # steps -> score of the first seed

    def frozen(self, space: Mapping[str, Any]) -> optuna.trial.FrozenTrial:
        """Return it as Optuna's trial."""
        return optuna.trial.create_trial(
            state=STATES[self.state],
            value=self.score if self.state != "failed" else None,
            params=self.values,
            distributions=dict(space),
            intermediate_values=self.reports,
        )


class Pruned(Exception):
    """The trial is worse than the median."""


def run_trial(
    path: Path, agent: str | None, number: int, values: dict[str, Any], before: Sequence[Trial], directory: Path
) -> Trial:
    """Run a trial, or continue it where it was killed; its result is kept in ``directory``.

    Args:
        path, agent: see :class:`Tuning`.
        number: of the trial.
        values: of the tuned settings.
        before: earlier trials, for pruning.
        directory: of the trial.
    """
    file = directory / RESULT
    if file.exists():
        data = json.loads(file.read_text(encoding="utf-8"))
        return Trial(**{**data, "reports": {int(steps): score for steps, score in data["reports"].items()}})
    tuning = Tuning(path, agent)
    study = optuna.create_study(pruner=optuna.pruners.MedianPruner(n_startup_trials=4))
    for each in before:
        study.add_trial(each.frozen(tuning.space))
    trial = study.ask(tuning.space)
    reports: dict[int, float] = {}
    best: list[float] = []
    state = "complete"
    try:
        for seed in tuning.settings.seeds:
            best.append(float("inf"))
            first = not reports

            def listener(row: dict[str, Any], first: bool = first) -> None:
                score = float(row["mean_time"])
                best[-1] = min(best[-1], score)
                if first:
                    reports[int(row["steps"])] = score
                    trial.report(score, int(row["steps"]))
                    if tuning.settings.prune and trial.should_prune():
                        raise Pruned

            with Training(tuning.of_trial(values, seed), directory / f"seed-{seed}", quiet=True) as training:
                training.run(listener=listener)
    except Pruned:
        state = "pruned"
    except TrainingError:
        state = "failed"
    found = [each for each in best if each < float("inf")]
    score = sum(found) / len(found) if found else None
    result = Trial(number, values, "failed" if score is None and state == "complete" else state, score, reports)
    write_atomically(file, json.dumps(result._asdict(), indent=2) + "\n")
    return result


def propose(tuning: Tuning, number: int, before: Sequence[Trial]) -> dict[str, Any]:
    """Return the values of trial ``number``, a function of the earlier trials alone."""
    sampler = optuna.samplers.TPESampler(
        n_startup_trials=tuning.settings.startup, seed=tuning.settings.seed + 1_000_003 * number
    )
    study = optuna.create_study(sampler=sampler)
    for each in before:
        study.add_trial(each.frozen(tuning.space))
    return dict(study.ask(tuning.space).params)


def best(trials: Sequence[Trial]) -> Trial | None:
    """Return the complete trial with the lowest score; the first of equals."""
    whole = [each for each in trials if each.state == "complete" and each.score is not None]
    return min(whole, key=lambda each: (each.score, each.number), default=None)


def tune(
    config: Path,
    agent: str | None = None,
    trials: int | None = None,
    output: Path | None = None,
    quiet: bool = False,
    processes: int = 2,
    ray: str | None = None,
) -> tuple[Path, Trial | None]:
    """Run a study, or continue it; write ``study.db`` (for Optuna and its dashboard) and ``trials.csv``.

    Args:
        config, agent: see :class:`Tuning`.
        trials: in all, instead of the file's.
        output: directory of the study, instead of ``runs/tuning/<agent>``.
        quiet: no progress bar.
        processes, ray: see :func:`agents.parallel.run`.

    Returns:
        Path of ``trials.csv``, and the best trial; None if there is none.

    Raises:
        ValueError: invalid settings, a study of other settings, or one used by another process.
    """
    tuning = Tuning(config, agent)
    count = tuning.settings.trials if trials is None else checks.count("--trials", trials, least=1, most=100_000)
    directory = output or Path("runs/tuning") / (agent or config.stem).replace("/", "-")
    output_directory(directory)
    done: list[Trial] = []
    with locks.one_run(directory), parallel.pool(processes, ray) as run:
        _check_same(tuning, directory)
        with tqdm(total=count, desc="tuning", unit="trial", disable=quiet) as bar:
            while len(done) < count:
                batch = range(len(done), min(len(done) + tuning.settings.abreast, count))
                calls = [
                    (config, agent, k, propose(tuning, k, done), done, directory / f"trial-{k:03d}") for k in batch
                ]
                done = [*done, *run(run_trial, calls, bar.update)]
                found = best(done)
                if found is not None:
                    bar.set_postfix_str(f"best {found.score:.3f} s, trial {found.number}", refresh=False)
        _write(tuning, done, directory)
    return directory / TRIALS, best(done)


def _write(tuning: Tuning, trials: Sequence[Trial], directory: Path) -> None:
    (directory / STUDY).unlink(missing_ok=True)
    study = optuna.create_study(storage=f"sqlite:///{directory / STUDY}", study_name=NAME)
    study.add_trials([each.frozen(tuning.space) for each in trials])
    rows = [{"trial": t.number, "state": t.state, "score_s": t.score, **t.values} for t in trials]
    write_atomically(directory / TRIALS, csv_text(rows))


def _check_same(tuning: Tuning, directory: Path) -> None:
    """Write the study's settings, or compare them with those written.

    Raises:
        ValueError: they differ.
    """
    path, mine = directory / SETTINGS, tuning.record()
    if not path.exists():
        write_atomically(path, json.dumps(mine, indent=2, sort_keys=True) + "\n")
        return
    try:
        theirs = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise checks.conflict(f"{path}: not readable ({error}); remove it or choose another output") from None
    if theirs != json.loads(json.dumps(mine)):
        raise checks.conflict(f"{path}: a study with other settings; remove it or choose another output")


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
        print(f"best: trial {found.number}, {found.score:.3f} s, {found.values}")
    print(f"trials: {path}")


COMMANDS = {"tune": Command(arguments, command, "directory of the study, instead of runs/tuning/NAME")}

optuna.logging.set_verbosity(optuna.logging.WARNING)
