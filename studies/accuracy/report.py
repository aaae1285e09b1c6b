"""The whole report: everything that is measured for it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from studies.accuracy import comparisons, friction_experiment, hard_cases, ladder, model_checks, truth
from studies.accuracy.candidates import Candidate, model_candidate
from studies.accuracy.ladder import SceneResult
from studies.accuracy.peers import peer_candidate
from studies.accuracy.provenance import provenance
from studies.accuracy.rigid import stored
from studies.accuracy.scenes import Scene, scenes_from
from studies.accuracy.settings import ReportSettings
from vibgym import checks, files
from vibgym.simulation.schemes import planar_scheme
from vibgym.simulation.simulator import Simulator

FILES = ("results.csv", "results.json", "report.html")


@dataclass(frozen=True)
class Prepared:
    """Everything that can be refused has been checked; nothing has been run."""

    settings: ReportSettings
    scenes: list[Scene]
    candidates: list[Candidate]
    output: Path


@dataclass(frozen=True)
class BoundRow:
    """The planar model as it comes on a scene, beside the bound on its friction."""

    scene: str
    bound: model_checks.Bound
    cost: float


@dataclass(frozen=True)
class Report:
    """All that was measured.

    Attributes:
        results, checks: one for each scene.
        bounds, orders, auto, hard_cases, friction: empty or None where not asked for.
        headlines: the figures that the models are held to.
        rigid: how far even pressure is from a rigid part, as stored by ``python -m studies.accuracy.rigid``.
        seconds: that it all took.
    """

    settings: ReportSettings
    results: list[SceneResult]
    checks: list[truth.TruthCheck]
    orders: list[model_checks.Order]
    bounds: list[BoundRow]
    headlines: list[comparisons.Headline]
    auto: list[model_checks.AutoRow]
    hard_cases: list[tuple[hard_cases.HardCase, hard_cases.Outcome]]
    friction: friction_experiment.Experiment | None
    rigid: dict[str, Any]
    provenance: dict[str, str]
    seconds: float


def prepare(settings: ReportSettings) -> Prepared:
    """Scenes, candidates and the output directory.

    Raises:
        ValueError: the first fault, in one line.
    """
    scenes = scenes_from(settings.scenes, settings.strong_tolerances, settings.weak_tolerances)
    for index, scene in enumerate(scenes):
        with checks.within(f"scenes.{index}"):
            Simulator(scene.surface, scene.part)  # what the planar model does not cover has no truth
    candidates = _candidates(settings)
    output = files.output_directory(Path(settings.output))
    files.output_files((output / name for name in FILES), "output")
    return Prepared(settings, scenes, candidates, output)


def _candidates(settings: ReportSettings) -> list[Candidate]:
    found: dict[tuple[str, str], Candidate] = {}
    for model, knobs in settings.model_settings():
        each = model_candidate(model, knobs)
        found.setdefault((each.method, each.setting), each)
    for peer, knobs in settings.peer_settings():
        each = peer_candidate(peer, knobs, settings.peer_worlds)
        found.setdefault((each.method, each.setting), each)
    return list(found.values())


def run(prepared: Prepared, progress: Callable[[str], Any] = lambda text: None) -> Report:
    """Measure everything."""
    began = time.perf_counter()
    settings = prepared.settings
    finest = settings.truth_settings()
    results, checked = [], []
    for scene in prepared.scenes:

        def here(text: str, name: str = scene.name) -> None:
            progress(f"{name}: {text}")

        results.append(ladder.measure(scene, prepared.candidates, finest, settings.rounds, here))
        if finest.reference_worlds:
            here("independent reference")
            checked.append(truth.check_truth(scene, finest))
    if settings.orders:
        progress("orders of convergence")
    found_orders = model_checks.measured_orders() if settings.orders else []
    bounds = _bounds(results) if settings.bound else []
    promises = []
    for scene in prepared.scenes if settings.auto_tolerances else ():
        progress(f"{scene.name}: model='auto'")
        promises += model_checks.auto_rows(scene, settings.auto_tolerances, finest)
    if settings.friction_experiment:
        progress("friction experiment")
    experiment = friction_experiment.experiment() if settings.friction_experiment else None
    if settings.hard_cases:
        progress("hard cases")
    cases = hard_cases.run_all() if settings.hard_cases else []
    return Report(
        settings,
        results,
        checked,
        found_orders,
        bounds,
        comparisons.headlines(results),
        promises,
        cases,
        experiment,
        stored.load(),
        provenance(),
        time.perf_counter() - began,
    )


def _bounds(results: list[SceneResult]) -> list[BoundRow]:
    found = []
    for result in results:
        rows = [row for row in result.rows if row.candidate.method == "planar" and not row.candidate.knobs]
        for row in rows:
            scheme = planar_scheme(result.scene.surface, result.scene.part)
            found.append(
                BoundRow(result.scene.name, model_checks.friction_bound(scheme.steps * scheme.substeps), row.cost)
            )
    return found
