"""One scene, all candidates: run, timed in turn, and compared with the truth; and the check of the truth."""

from __future__ import annotations

import math
import statistics
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from studies.accuracy import errors, reference
from studies.accuracy.candidates import Candidate, Outcome, Runner, curve_of, prepare_model
from studies.accuracy.errors import Spread
from studies.accuracy.scenes import Scene, first_periods
from studies.accuracy.settings import TruthSettings

REFINED_AVERAGED = 16
"""Steps per period of the averaged models at which the step error is negligible."""

SLOW = 0.25  # s; longer runs that are not compiled are timed once
SHORT = 2e-3  # s; shorter runs are repeated within a timing
BUDGET = 0.7  # s per candidate and scene for all its timings, beyond three

UNKNOWN = Spread(math.nan, math.nan, math.nan)


@dataclass
class Row:
    """A candidate on a scene.

    Attributes:
        refused: why there is no run, or "".
        cost: us per period, world and core; the median of ``timings`` rounds.
        worlds: number of worlds that it ran.
        strong, strong_step: error against the truth and against the refined run of its own model, m.
        weak, weak_step: likewise of the mean velocity, relative.
        failures: kind of failure -> number of worlds.
        doubtful: number of worlds that the model itself does not certify.
        strong_each: (worlds,) error against the truth, m.
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


class Refined(NamedTuple):
    """A model without step error, against the truth; planar's truth is the independent reference."""

    method: str
    strong: Spread
    weak: float


class SceneResult(NamedTuple):
    """All results on a scene."""

    scene: Scene
    models: list[Refined]
    rows: list[Row]

    def curve(self, method: str, weak: bool = False) -> tuple[list[Row], list[float], list[float]]:
        """Return the usable rows of a method, their costs and errors."""
        rows = [row for row in self.rows if row.candidate.method == method and row.usable]
        return rows, [row.cost for row in rows], [row.weak if weak else row.strong.median for row in rows]

    @property
    def methods(self) -> list[str]:
        """Names in order of appearance."""
        return list(dict.fromkeys(row.candidate.method for row in self.rows))


def compare(scene: Scene, outcome: Outcome, truth: Outcome) -> tuple[np.ndarray, float]:
    """Return the strong errors (worlds,) m and the weak error of a run of the scene's first worlds."""
    k = len(outcome.pose)
    duration = (scene.periods - scene.settle) * scene.surface.period
    drift, right = ((each.pose - each.settled)[:k, :2] / duration for each in (outcome, truth))
    return errors.strong_errors(outcome.pose, truth.pose[:k], scene.lever), errors.weak_error(drift, right)


def failures(outcome: Outcome, truth: Outcome) -> dict[str, int]:
    """Return the number of worlds by kind of failure."""
    fell = truth.fallen[: len(outcome.pose)]
    found = Counter(outcome.trouble)
    found["fell, though it does not"] = int(np.sum(outcome.fallen & ~fell))
    found["did not fall, though it does"] = int(np.sum(fell & ~outcome.fallen & np.isfinite(outcome.pose).all(axis=1)))
    return {kind: number for kind, number in found.items() if number}


def measure(
    scene: Scene,
    candidates: Sequence[Candidate],
    truth_settings: TruthSettings,
    rounds: int,
    progress: Callable[[str], Any] = lambda text: None,
) -> SceneResult:
    """Run all candidates on a scene and time those that can be repeated in turn: A B C A B C ..."""
    progress("truth")
    truth = prepare_model(scene, "planar", truth_settings.knobs, threads=2)()
    refined: dict[str, Outcome] = {"planar": truth}
    models: list[Refined] = []
    for order in (1, 2):
        finest = {"order": order, "steps": REFINED_AVERAGED}
        try:
            outcome = prepare_model(scene, "averaged", finest)()
        except ValueError:
            continue  # the candidates' rows name the reason
        name = curve_of("averaged", finest)
        refined[name] = outcome
        strong, weak = compare(scene, outcome, truth)
        models.append(Refined(name, errors.spread(strong), weak))

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
        row.worlds, row.failures, row.doubtful = (
            len(outcome.pose),
            failures(outcome, truth),
            int(outcome.doubtful.sum()),
        )
        row.strong_each, row.weak = compare(scene, outcome, truth)
        row.strong = errors.spread(row.strong_each)
        if row.candidate.method in refined:
            strong, row.weak_step = compare(scene, outcome, refined[row.candidate.method])
            row.strong_step = errors.spread(strong)
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
    return SceneResult(scene, models, rows)


def timed(runner: Runner) -> float:
    """Return the mean time (s) of a run, over enough of them."""
    total, runs = 0.0, 0
    while total < SHORT:
        total += runner().seconds
        runs += 1
    return total / runs


class TruthCheck(NamedTuple):
    """The refined planar run against the independent reference.

    Attributes:
        worlds, periods: that the reference integrated.
        gap: largest difference of the two (displacement of the outline), m.
        estimate: largest error that the reference states of itself, m.
        seconds: that the reference took.
        trouble: why there is no check, or "".
    """

    worlds: int
    periods: int
    gap: float
    estimate: float
    seconds: float
    trouble: str


def check_truth(scene: Scene, settings: TruthSettings) -> TruthCheck:
    """Integrate the first worlds again, without kernels of ``vibgym``."""
    worlds = min(settings.reference_worlds, scene.worlds)
    short = first_periods(scene, settings.reference_periods, worlds)
    pose = prepare_model(short, "planar", settings.knobs)().pose
    began = time.perf_counter()
    ends, estimates = np.empty((worlds, 3)), []
    for world in range(worlds):
        at, speed, estimate = short.pose[world], short.velocity[world], 0.0
        try:
            for amplitude, phase, periods in short.segments:
                given = at, speed, amplitude[world], phase[world], periods
                run = reference.integrate(scene.surface, scene.part, *given, tolerance=settings.reference_tolerance)
                at, speed = run.pose[-1], run.velocity[-1]
                estimate += float(errors.strong_errors(run.error[-1:], np.zeros((1, 3)), scene.lever)[0])
        except (RuntimeError, ValueError) as error:
            text = " ".join(str(error).split())
            return TruthCheck(worlds, short.periods, np.nan, np.nan, time.perf_counter() - began, text)
        ends[world] = at
        estimates.append(estimate)
    gap = float(errors.strong_errors(pose, ends, scene.lever).max())
    return TruthCheck(worlds, short.periods, gap, max(estimates), time.perf_counter() - began, "")
