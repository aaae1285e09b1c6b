"""All measurements of the report."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from agents.provenance import provenance
from studies.accuracy import comparisons, hard_cases, ladder, model_checks, rigid
from studies.accuracy.candidates import Candidate, model_candidate, peer_candidate
from studies.accuracy.scenes import Scene, scenes_from
from studies.accuracy.settings import ReportSettings
from vibgym import checks, files
from vibgym.simulation.simulator import Simulator

FILES = ("results.csv", "results.json", "report.html")


class Prepared(NamedTuple):
    """Checked input; nothing has been run."""

    settings: ReportSettings
    scenes: list[Scene]
    candidates: list[Candidate]
    output: Path


class Report(NamedTuple):
    """All results.

    Attributes:
        results, checks: one for each scene.
        orders, auto, hard_cases: empty if not requested.
        headlines: published ratios.
        rigid: difference between even pressure and a rigid part, as stored by ``python -m studies.accuracy.rigid``.
        provenance: time, host and versions.
        seconds: duration of all measurements.
    """

    settings: ReportSettings
    results: list[ladder.SceneResult]
    checks: list[ladder.TruthCheck]
    orders: list[model_checks.Order]
    headlines: list[comparisons.Headline]
    auto: list[model_checks.AutoRow]
    hard_cases: list[tuple[hard_cases.HardCase, hard_cases.Outcome]]
    rigid: dict[str, Any]
    provenance: dict[str, Any]
    seconds: float


def prepare(settings: ReportSettings) -> Prepared:
    """Return scenes, candidates and the output directory.

    Raises:
        ValueError: the first fault, in one line.
    """
    scenes = scenes_from(settings.scenes, settings.strong_tolerances, settings.weak_tolerances)
    for index, scene in enumerate(scenes):
        with checks.within(f"scenes.{index}"):
            Simulator(
                scene.surface, scene.part
            )  # raises for scenes without truth, which the planar model does not cover
    built = [model_candidate(*pair) for pair in settings.model_settings()]
    built += [peer_candidate(*pair, settings.peer_worlds) for pair in settings.peer_settings()]
    candidates: dict[tuple[str, str], Candidate] = {}
    for candidate in built:
        candidates.setdefault((candidate.method, candidate.setting), candidate)
    output = files.output_directory(Path(settings.output))
    files.output_files((output / name for name in FILES), "output")
    return Prepared(settings, scenes, list(candidates.values()), output)


def run(prepared: Prepared, progress: Callable[[str], Any] = lambda text: None) -> Report:
    """Measure everything."""
    began = time.perf_counter()
    settings = prepared.settings
    results, checked, promises = [], [], []
    for scene in prepared.scenes:

        def here(text: str, name: str = scene.name) -> None:
            progress(f"{name}: {text}")

        results.append(ladder.measure(scene, prepared.candidates, settings.truth, settings.rounds, here))
        if settings.truth.reference_worlds:
            here("independent reference")
            checked.append(ladder.check_truth(scene, settings.truth))
    if settings.orders:
        progress("orders of convergence")
    orders = model_checks.measured_orders() if settings.orders else []
    for scene in prepared.scenes if settings.auto_tolerances else ():
        progress(f"{scene.name}: model='auto'")
        promises += model_checks.auto_rows(scene, settings.auto_tolerances, settings.truth)
    if settings.hard_cases:
        progress("hard cases")
    cases = hard_cases.run_all() if settings.hard_cases else []
    headlines, seconds = comparisons.headlines(results), time.perf_counter() - began
    return Report(settings, results, checked, orders, headlines, promises, cases, rigid.stored(), _about(), seconds)


def _about() -> dict[str, Any]:
    """Return time, commit, host and versions; MuJoCo's and shapely's are those of peers and reference."""
    about = provenance()
    versions: Any = about["versions"]
    peers = {name: metadata.version(name) for name in ("shapely", "mujoco") if importlib.util.find_spec(name)}
    return {**about, "versions": {**versions, **peers}}
