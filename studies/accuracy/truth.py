"""Is the truth true? The refined planar run against the independent reference, on a few worlds."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from studies.accuracy import errors, reference
from studies.accuracy.candidates import prepare_model
from studies.accuracy.ladder import lever
from studies.accuracy.scenes import Scene, first_periods
from studies.accuracy.settings import TruthSettings


class TruthCheck(NamedTuple):
    """Of a scene.

    Attributes:
        worlds, periods: how much the reference integrated.
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
    """Integrate the first worlds again, with no kernel of ``vibgym``."""
    worlds = min(settings.reference_worlds, scene.worlds)
    short = first_periods(scene, settings.reference_periods, worlds)
    knobs = settings.model_dump(include={"steps", "substeps", "pieces"})
    pose = prepare_model(short, "planar", knobs)().pose
    began = time.perf_counter()
    arm, gaps, estimates = lever(scene), [], []
    for world in range(worlds):
        at, speed, estimate = short.pose[world], short.velocity[world], 0.0
        try:
            for amplitude, phase, periods in short.segments:
                run = reference.integrate(
                    scene.surface, scene.part, at, speed, amplitude[world], phase[world], periods,
                    tolerance=settings.reference_tolerance,
                )  # fmt: skip
                at, speed = run.pose[-1], run.velocity[-1]
                estimate += float(errors.strong_errors(run.error[-1:], np.zeros((1, 3)), arm)[0])
        except (RuntimeError, ValueError) as error:
            text = " ".join(str(error).split())
            return TruthCheck(worlds, short.periods, np.nan, np.nan, time.perf_counter() - began, text)
        gaps.append(float(errors.strong_errors(pose[world : world + 1], at[None], arm)[0]))
        estimates.append(estimate)
    return TruthCheck(worlds, short.periods, max(gaps), max(estimates), time.perf_counter() - began, "")
