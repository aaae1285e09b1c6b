"""One scene, all candidates: run, timed in turn, and compared with the truth."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from studies.accuracy import errors
from studies.accuracy.candidates import Candidate, Outcome, Runner, curve_of, prepare_model
from studies.accuracy.errors import RateDifference, Spread
from studies.accuracy.scenes import Scene
from studies.accuracy.settings import TruthSettings

REFINED_AVERAGED = 16
"""Steps per period of the averaged models that count as free of step error."""

SLOW = 0.25  # s; what is not compiled and takes longer is timed once
SHORT = 2e-3  # s; a timing repeats its run until it has lasted so long
BUDGET = 0.7  # s per candidate and scene for all its timings, beyond three


UNKNOWN = Spread(math.nan, math.nan, math.nan)


@dataclass
class Row:
    """A candidate on a scene.

    Attributes:
        refused: why there is no run, or "".
        cost: us per period, world and core; the median of ``timings`` rounds.
        worlds: how many it ran.
        strong, strong_step: error against the truth and against the refined run of its own model, m.
        weak, weak_step: likewise of the mean velocity, relative.
        success: success rate, and its difference from the truth on the same worlds; None without a criterion.
        failures: kind of failure -> number of worlds.
        doubtful: worlds that the model itself does not vouch for.
    """

    candidate: Candidate
    refused: str = ""
    cost: float = math.nan
    timings: int = 0
    worlds: int = 0
    strong: Spread = UNKNOWN
    strong_step: Spread | None = None
    weak: float = math.nan
    weak_step: float | None = None
    success: float | None = None
    success_difference: RateDifference | None = None
    failures: dict[str, int] = field(default_factory=dict)
    doubtful: int = 0
    strong_each: np.ndarray = field(default_factory=lambda: np.empty(0), repr=False)

    @property
    def failed(self) -> int:
        """Number of worlds that failed."""
        return sum(self.failures.values())

    @property
    def usable(self) -> bool:
        """Whether it may be on a front: it ran, and no world failed."""
        return not self.refused and not self.failed


@dataclass(frozen=True)
class Refined:
    """A model without step error, against the truth; planar's truth is the independent reference."""

    method: str
    outcome: Outcome
    strong: Spread
    weak: float


@dataclass(frozen=True)
class SceneResult:
    """All that was found out about a scene.

    Attributes:
        truth: of the planar model, refined.
        success: true success rate, or None.
    """

    scene: Scene
    truth: Outcome
    success: float | None
    models: list[Refined]
    rows: list[Row]

    def curve(self, method: str, weak: bool = False) -> tuple[list[Row], list[float], list[float]]:
        """Usable rows of a method, their costs and errors."""
        rows = [row for row in self.rows if row.candidate.method == method and row.usable]
        return rows, [row.cost for row in rows], [row.weak if weak else row.strong.median for row in rows]

    @property
    def methods(self) -> list[str]:
        """Names in order of appearance."""
        return list(dict.fromkeys(row.candidate.method for row in self.rows))


def drift(scene: Scene, outcome: Outcome) -> np.ndarray:
    """(worlds, 2) mean velocity after the settling periods, m/s."""
    duration = (scene.periods - scene.settle) * scene.surface.period
    return (outcome.pose - outcome.settled)[:, :2] / duration


def lever(scene: Scene) -> float:
    """The radius at which a turn counts, m: none for discs."""
    return scene.part.radius if scene.part.symmetry else 0.0


def failures(outcome: Outcome, truth: Outcome) -> dict[str, int]:
    """What went wrong, by kind, and in how many worlds."""
    k = len(outcome.pose)
    found: dict[str, int] = {}
    for message in outcome.trouble:
        found[message] = found.get(message, 0) + 1
    wrongly = int(np.sum(outcome.fallen & ~truth.fallen[:k]))
    missed = int(np.sum(truth.fallen[:k] & ~outcome.fallen & np.isfinite(outcome.pose).all(axis=1)))
    if wrongly:
        found["fell, though it does not"] = wrongly
    if missed:
        found["did not fall, though it does"] = missed
    return found


def compare(scene: Scene, row: Row, outcome: Outcome, truth: Outcome, refined: Outcome | None) -> None:
    """Fill in a row's errors."""
    k = len(outcome.pose)
    arm, velocity = lever(scene), drift(scene, outcome)
    row.worlds = k
    row.strong_each = errors.strong_errors(outcome.pose, truth.pose[:k], arm)
    row.strong = errors.spread(row.strong_each)
    row.weak = errors.weak_error(velocity, drift(scene, truth)[:k])
    if refined is not None:
        row.strong_step = errors.spread(errors.strong_errors(outcome.pose, refined.pose[:k], arm))
        row.weak_step = errors.weak_error(velocity, drift(scene, refined)[:k])
    if scene.success is not None:
        mine, right = scene.success(outcome.pose), scene.success(truth.pose[:k])
        row.success = float(np.mean(mine))
        row.success_difference = errors.rate_difference(mine, right)
    row.failures = failures(outcome, truth)
    row.doubtful = int(outcome.doubtful.sum())


def measure(
    scene: Scene,
    candidates: Sequence[Candidate],
    truth_settings: TruthSettings,
    rounds: int,
    progress: Callable[[str], Any] = lambda text: None,
) -> SceneResult:
    """Run all candidates on a scene and time those that can be repeated in turn: A B C A B C ..."""
    progress("truth")
    knobs = truth_settings.model_dump(include={"steps", "substeps", "pieces"})
    truth = prepare_model(scene, "planar", knobs, threads=2)()
    refined: dict[str, Outcome] = {"planar": truth}
    models: list[Refined] = []
    for order in (1, 2):
        finest = {"order": order, "steps": REFINED_AVERAGED}
        try:
            outcome = prepare_model(scene, "averaged", finest)()
        except ValueError:
            continue  # the candidates' rows say why
        refined[curve_of("averaged", finest)] = outcome
    for name, outcome in refined.items():
        if outcome is not truth:
            strong = errors.spread(errors.strong_errors(outcome.pose, truth.pose, lever(scene)))
            models.append(Refined(name, outcome, strong, errors.weak_error(drift(scene, outcome), drift(scene, truth))))

    rows = [Row(each) for each in candidates]
    runners: list[tuple[Row, Runner, list[float], int]] = []
    for row in rows:
        progress(f"{row.candidate.method}, {row.candidate.setting}")
        try:
            runner = row.candidate.prepare(scene)
            outcome = runner()
        except (ValueError, ImportError) as error:
            row.refused = " ".join(str(error).split())
            continue
        compare(scene, row, outcome, truth, refined.get(row.candidate.method))
        if not row.candidate.compiled and not outcome.seconds <= SLOW:
            runners.append((row, runner, [outcome.seconds], 0))
        else:
            again = runner().seconds
            runners.append((row, runner, [], int(min(max(3, BUDGET / max(again, 1e-9)), rounds))))
    progress("timing in turn")
    for number in range(rounds):
        for _, runner, times, wanted in runners:
            if number < wanted:
                times.append(timed(runner))
    for row, _, times, _ in runners:
        row.cost = 1e6 * statistics.median(times) / (row.worlds * scene.periods)
        row.timings = len(times)
    success = None if scene.success is None else float(np.mean(scene.success(truth.pose)))
    return SceneResult(scene, truth, success, models, rows)


def timed(runner: Runner) -> float:
    """Seconds of one run, as the mean over enough of them."""
    total, runs = 0.0, 0
    while total < SHORT:
        total += runner().seconds
        runs += 1
    return total / runs
