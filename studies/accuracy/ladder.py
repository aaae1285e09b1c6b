"""One scene, all candidates: run, timed in turn, and compared with the truth; and the check of the truth."""

from __future__ import annotations

import math
import statistics
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

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

ROW: dict[str, Any] = {
    "scene": "",
    "method": "",
    "setting": "",
    "cost_us": math.nan,  # per period, world and core; the median of ``timings`` rounds
    "timings": 0,
    "worlds": 0,  # that it ran
    "strong_median_m": math.nan,  # error against the truth, over worlds
    "strong_p95_m": math.nan,
    "strong_max_m": math.nan,
    "strong_step_median_m": math.nan,  # error against the refined run of its own model
    "strong_step_p95_m": math.nan,
    "weak": math.nan,  # error of the mean velocity, relative
    "weak_step": math.nan,
    "failed_worlds": 0,
    "failures": {},  # kind of failure -> number of worlds
    "doubtful_worlds": 0,  # that the model itself does not certify
    "refused": "",  # why there is no run
    "peer": False,
    "strong_each": np.empty(0),  # (worlds,) error against the truth, m
}
"""Columns of the table of results, SI units, and their values without a run."""


class Refined(NamedTuple):
    """A model without step error, against the truth; planar's truth is the independent reference."""

    method: str
    strong: Spread
    weak: float


class SceneResult(NamedTuple):
    """All results on a scene."""

    scene: Scene
    models: list[Refined]
    table: Any
    """:class:`pandas.DataFrame`, a row per candidate: the columns of :data:`ROW`, ``front_strong`` and ``front_weak``."""

    def curve(self, method: str, weak: bool = False) -> Any:
        """Return the rows of a method that ran without a failed world, with the column ``error``."""
        return usable(self.table[self.table["method"] == method], weak)

    @property
    def methods(self) -> list[str]:
        """Names in order of appearance."""
        return self.table["method"].unique().tolist()


def usable(table: Any, weak: bool) -> Any:
    """Return the rows that may be on a front, with the column ``error``: weak, or the median of the strong ones."""
    table = table.assign(error=table["weak" if weak else "strong_median_m"])
    return table[(table["refused"] == "") & (table["failed_worlds"] == 0)]


def compare(scene: Scene, outcome: Outcome, truth: Outcome) -> tuple[np.ndarray, float]:
    """Return the strong errors (worlds,) m and the weak error of a run of the scene's first worlds."""
    k = len(outcome.pose)
    duration = (scene.periods - scene.settle) * scene.surface.period
    drift, right = ((run.pose - run.settled)[:k, :2] / duration for run in (outcome, truth))
    return errors.strong_errors(outcome.pose, truth.pose[:k], scene.lever), errors.weak_error(drift, right)


def failures(outcome: Outcome, truth: Outcome) -> dict[str, int]:
    """Return the number of worlds by kind of failure."""
    fell = truth.fallen[: len(outcome.pose)]
    kinds = Counter(outcome.trouble)
    kinds["fell, though it does not"] = int(np.sum(outcome.fallen & ~fell))
    kinds["did not fall, though it does"] = int(np.sum(fell & ~outcome.fallen & np.isfinite(outcome.pose).all(axis=1)))
    return {kind: number for kind, number in kinds.items() if number}


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

    rows: list[dict[str, Any]] = []
    runs: list[tuple[dict[str, Any], Runner, list[float], int]] = []
    for candidate in candidates:
        progress(f"{candidate.method}, {candidate.setting}")
        about = {"scene": scene.name, "method": candidate.method, "setting": candidate.setting, "peer": candidate.peer}
        rows.append(ROW | about)
        try:
            runner = candidate.prepare(scene)
            outcome = runner()
        except (ValueError, ImportError) as error:
            rows[-1]["refused"] = " ".join(str(error).split())
            continue
        rows[-1] |= _errors(scene, outcome, truth, refined.get(candidate.method))
        if not candidate.compiled and not outcome.seconds <= SLOW:
            runs.append((rows[-1], runner, [outcome.seconds], 0))
        else:
            again = runner().seconds
            runs.append((rows[-1], runner, [], int(min(max(3, BUDGET / max(again, 1e-9)), rounds))))
    progress("timing in turn")
    for number in range(rounds):
        for _, runner, times, wanted in runs:
            if number < wanted:
                times.append(timed(runner))
    for row, _, times, _ in runs:
        row |= {"cost_us": 1e6 * statistics.median(times) / (row["worlds"] * scene.periods), "timings": len(times)}
    table: Any = pd.DataFrame(rows, columns=list(ROW))
    for name, weak in (("front_strong", False), ("front_weak", True)):
        some = usable(table, weak)
        table[name] = table.index.isin(some.index[errors.pareto(some["cost_us"].tolist(), some["error"].tolist())])
    return SceneResult(scene, models, table)


def _errors(scene: Scene, outcome: Outcome, truth: Outcome, refined: Outcome | None) -> dict[str, Any]:
    """Return the columns of a run; without ``refined`` its model has none."""
    kinds = failures(outcome, truth)
    strong, weak = compare(scene, outcome, truth)
    median, p95, worst = errors.spread(strong)
    row = {
        "worlds": len(outcome.pose), "failures": kinds, "failed_worlds": sum(kinds.values()),
        "doubtful_worlds": int(outcome.doubtful.sum()), "strong_each": strong, "weak": weak,
        "strong_median_m": median, "strong_p95_m": p95, "strong_max_m": worst,
    }  # fmt: skip
    if refined is not None:
        step, weak_step = compare(scene, outcome, refined)
        median, p95, _ = errors.spread(step)
        row |= {"strong_step_median_m": median, "strong_step_p95_m": p95, "weak_step": weak_step}
    return row


def timed(runner: Runner) -> float:
    """Return the mean time (s) of a run, over enough of them."""
    total, runs = 0.0, 0
    while total < SHORT:
        total += runner().seconds
        runs += 1
    return total / runs


class TruthCheck(NamedTuple):
    """The refined planar run against the independent reference."""

    worlds: int  # that the reference integrated
    periods: int
    gap: float  # m, largest difference of the two (displacement of the outline)
    estimate: float  # m, largest error that the reference states of itself
    seconds: float  # that the reference took
    trouble: str  # why there is no check, or ""


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
                start = at, speed, amplitude[world], phase[world], periods
                run = reference.integrate(scene.surface, scene.part, *start, tolerance=settings.reference_tolerance)
                at, speed = run.pose[-1], run.velocity[-1]
                estimate += float(errors.strong_errors(run.error[-1:], np.zeros((1, 3)), scene.lever)[0])
        except (RuntimeError, ValueError) as error:
            text = " ".join(str(error).split())
            return TruthCheck(worlds, short.periods, np.nan, np.nan, time.perf_counter() - began, text)
        ends[world] = at
        estimates.append(estimate)
    gap = float(errors.strong_errors(pose, ends, scene.lever).max())
    return TruthCheck(worlds, short.periods, gap, max(estimates), time.perf_counter() - began, "")
