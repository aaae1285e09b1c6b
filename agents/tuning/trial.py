"""One trial of a study: trainings with the values that it tries, judged as they go."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import optuna
from optuna.trial import TrialState

from agents.failures import TrainingError
from agents.training.train import Training
from agents.tuning.tuning_settings import Tuning
from vibgym.files import write_atomically

RESULT = "result.json"


class Tried(NamedTuple):
    """What became of a trial."""

    number: int
    values: dict[str, Any]  # of what is tuned
    state: str  # "complete", "pruned" or "failed"
    score: float | None  # seconds, see Trial
    reports: dict[int, float]  # steps -> score at that point, mean over the seeds done so far

    def frozen(self, space: Mapping[str, Any]) -> optuna.trial.FrozenTrial:
        """As Optuna has it."""
        states = {"complete": TrialState.COMPLETE, "pruned": TrialState.PRUNED, "failed": TrialState.FAIL}
        return optuna.trial.create_trial(
            state=states[self.state],
            value=self.score if self.state != "failed" else None,
            params=self.values,
            distributions=dict(space),
            intermediate_values=self.reports,
        )


class Pruned(Exception):
    """The trial is not worth going on with."""


def run_trial(
    path: Path, agent: str | None, number: int, values: dict[str, Any], before: Sequence[Tried], directory: Path
) -> Tried:
    """Run a trial, from where it was killed if it was; its result stays in ``directory``.

    The score is the mean time to the goal over the episodes on which a trial is judged, in seconds; an episode that does not
    reach it counts with its limit. The best point of the learning curve counts, as it does where agents are shipped.

    Args:
        path, agent: as :class:`agents.tuning.tuning_settings.Tuning` takes them.
        number: of the trial.
        values: of what is tuned.
        before: trials that this one is measured against.
        directory: of the trial.
    """
    kept = directory / RESULT
    if kept.exists():
        return read(kept)
    tuning = Tuning(path, agent)
    pruner = optuna.create_study(pruner=optuna.pruners.MedianPruner(n_startup_trials=4))
    for each in before:
        pruner.add_trial(each.frozen(tuning.space))
    asked = pruner.ask(tuning.space)
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
                if first:  # of the first seed: later ones are for what has come so far
                    reports[int(row["steps"])] = score
                    asked.report(score, int(row["steps"]))
                    if tuning.settings.prune and asked.should_prune():
                        raise Pruned

            with Training(tuning.of_trial(values, seed), directory / f"seed-{seed}", quiet=True) as training:
                training.run(listener=listener)
    except Pruned:
        state = "pruned"
    except TrainingError:
        state = "failed"
    found = [each for each in best if each < float("inf")]
    score = sum(found) / len(found) if found else None
    if score is None and state == "complete":
        state = "failed"
    tried = Tried(number, values, state, score, reports)
    write_atomically(kept, json.dumps(tried._asdict(), indent=2) + "\n")
    return tried


def read(path: Path) -> Tried:
    """A trial's result again."""
    data = json.loads(path.read_text(encoding="utf-8"))
    return Tried(**{**data, "reports": {int(steps): score for steps, score in data["reports"].items()}})
