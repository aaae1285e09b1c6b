"""Does ``model="auto"`` keep its promise on scenes that it was not fitted to?"""

from __future__ import annotations

import statistics
from dataclasses import dataclass

import numpy as np

from studies.accuracy import errors
from studies.accuracy.candidates import prepare_model, prepare_simulator
from studies.accuracy.ladder import timed
from studies.accuracy.scenes import Scene, first_periods
from studies.accuracy.settings import TruthSettings
from vibgym.simulation.choice import PERIODS
from vibgym.simulation.simulator import Simulator

ROUNDS = 3


@dataclass(frozen=True)
class AutoRow:
    """A scene and a tolerance.

    Attributes:
        tolerance: m, asked for.
        refused: what the simulator says where it has nothing good enough, or "".
        model, setting, reason: its choice.
        promised, measured: m, median over worlds of how far the part's outline strays in 25 periods.
        promised_95, measured_95: the same for the 95th percentile, which is told and not promised.
        cost, planar_cost: us per period, world and core, of the choice and of the planar model as it comes.
        held: whether the measured median is within the tolerance.
    """

    scene: str
    tolerance: float
    refused: str = ""
    model: str = ""
    setting: str = ""
    reason: str = ""
    promised: float | None = None
    measured: float | None = None
    promised_95: float | None = None
    measured_95: float | None = None
    cost: float | None = None
    planar_cost: float | None = None
    held: bool | None = None


def auto_rows(scene: Scene, tolerances: list[float], settings: TruthSettings) -> list[AutoRow]:
    """One row for each tolerance, over the scene's first 25 periods, which is what the promise is about."""
    short = first_periods(scene, PERIODS, scene.worlds)
    per_call = min(each.periods for each in short.segments)
    truth = prepare_model(short, "planar", settings.model_dump(include={"steps", "substeps", "pieces"}), threads=2)()
    planar = prepare_model(short, "planar", {})
    planar()
    found = []
    for tolerance in tolerances:
        try:
            simulator = Simulator(
                scene.surface, scene.part, worlds=scene.worlds, threads=1, model="auto", tolerance=tolerance,
                periods_per_call=per_call,
            )  # fmt: skip
        except ValueError as error:
            found.append(AutoRow(scene.name, tolerance, refused=" ".join(str(error).split())))
            continue
        choice = simulator.choice
        runner = prepare_simulator(short, simulator)
        outcome = runner()
        strayed = errors.strong_errors(outcome.pose, truth.pose, scene.part.radius)
        strayed[outcome.fallen != truth.fallen] = np.inf
        found_error = errors.spread(strayed)
        times = [(timed(runner), timed(planar)) for _ in range(ROUNDS)]
        cost, planar_cost = (
            1e6 * statistics.median(each) / (scene.worlds * short.periods) for each in zip(*times, strict=True)
        )
        found.append(
            AutoRow(
                scene=scene.name,
                tolerance=tolerance,
                model=choice.model,
                setting=", ".join(f"{name}={value}" for name, value in choice.knobs.items()),
                reason=choice.reason,
                promised=choice.error,
                measured=found_error.median,
                promised_95=choice.error_95,
                measured_95=found_error.p95,
                cost=cost,
                planar_cost=planar_cost,
                held=found_error.median <= tolerance,
            )
        )
    return found
