"""Results as CSV, JSON and Markdown."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from agents.evaluation.table import plain
from studies.accuracy import comparisons
from studies.accuracy.friction_experiment import Experiment
from studies.accuracy.ladder import Row, SceneResult
from studies.accuracy.report import Report
from vibgym import files


def record(result: SceneResult, row: Row) -> dict[str, Any]:
    """One row of results.csv: SI units but us for the cost; what does not apply is missing."""
    step, success = row.strong_step, row.success_difference
    return {
        "scene": result.scene.name,
        "method": row.candidate.method,
        "setting": row.candidate.setting,
        "cost_us": row.cost,
        "timings": row.timings,
        "worlds": row.worlds,
        "strong_median_m": row.strong.median,
        "strong_p95_m": row.strong.p95,
        "strong_max_m": row.strong.worst,
        "strong_step_median_m": None if step is None else step.median,
        "strong_step_p95_m": None if step is None else step.p95,
        "weak": row.weak,
        "weak_step": row.weak_step,
        "success_rate": row.success,
        "success_difference": None if success is None else success.difference,
        "success_difference_low": None if success is None else success.low,
        "success_difference_high": None if success is None else success.high,
        "failed_worlds": row.failed,
        "failures": "; ".join(f"{kind} ({number})" for kind, number in row.failures.items()),
        "doubtful_worlds": row.doubtful,
        "refused": row.refused,
        "front_strong": row in comparisons.front(result, False),
        "front_weak": row in comparisons.front(result, True),
    }


def csv_text(report: Report) -> str:
    """Every candidate on every scene."""
    rows = [record(result, row) for result in report.results for row in result.rows]
    return files.csv_text(rows)


def json_text(report: Report) -> str:
    """Everything that the page shows."""
    content = {
        "provenance": report.provenance,
        "seconds": report.seconds,
        "settings": report.settings.model_dump(),
        "headlines": [{**asdict(each), "ratios": each.ratios, "passed": each.passed} for each in report.headlines],
        "orders": [{**asdict(each), "passed": each.passed} for each in report.orders],
        "bounds": [{"scene": each.scene, "cost_us": each.cost, **each.bound._asdict()} for each in report.bounds],
        "auto": [asdict(each) for each in report.auto],
        "hard_cases": [
            {"name": case.name, "question": case.question, **outcome._asdict()} for case, outcome in report.hard_cases
        ],
        "friction_experiment": None if report.friction is None else _experiment(report.friction),
        "rigid": report.rigid,
        "scenes": [_scene(report, index) for index in range(len(report.results))],
    }
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"


def _scene(report: Report, index: int) -> dict[str, Any]:
    result = report.results[index]
    scene = result.scene
    return {
        "name": scene.name,
        "worlds": scene.worlds,
        "periods": scene.periods,
        "success_rate": result.success,
        "truth": report.checks[index]._asdict() if report.checks else None,
        "models": [
            {"method": each.method, "strong": each.strong._asdict(), "weak": each.weak} for each in result.models
        ],
        "choices": [
            {
                "weak": each.weak,
                "tolerance": each.tolerance,
                "cheapest": _named(each.row),
                "by_method": {name: _named(row) for name, row in each.by_method.items()},
            }
            for each in comparisons.choices(result)
        ],
        "rows": [record(result, row) for row in result.rows],
    }


def _experiment(found: Experiment) -> dict[str, Any]:
    blocks = [
        {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(block).items()}
        for block in found.blocks
    ]
    return {"frequencies": found.frequencies.tolist(), "noise": found.noise, "blocks": blocks}


def _named(row: Row | None) -> dict[str, Any] | None:
    return (
        None if row is None else {"method": row.candidate.method, "setting": row.candidate.setting, "cost_us": row.cost}
    )


def significant(value: float | None, digits: int = 2) -> str:
    """So many significant digits, without exponent where that is short; a dash for what is missing."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if size < -4 or size > 6:
        return f"{value:.{digits - 1}e}"
    return f"{round(value, digits - 1 - size):.{max(digits - 1 - size, 0)}f}"


def error_text(value: float | None, weak: bool) -> str:
    """An error with its unit: mm or %."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{significant((100.0 if weak else 1e3) * value)} {'%' if weak else 'mm'}"


def summary(report: Report) -> str:
    """What the command prints: the cheapest setting for every tolerance, and the ratios, in Markdown."""
    lines = [_line(("scene", "tolerance", "cheapest", "us per period")), _line(["---"] * 4)]
    for result in report.results:
        for each in comparisons.choices(result):
            of = "mean velocity" if each.weak else "trajectory"
            tolerance = f"{error_text(each.tolerance, each.weak)} of {of}"
            if each.row is None:
                lines.append(_line((result.scene.name, tolerance, "no setting", "–")))
            else:
                candidate = each.row.candidate
                name = f"{candidate.method}: {candidate.setting}"
                lines.append(_line((result.scene.name, tolerance, name, significant(each.row.cost, 3))))
    lines += ["", _line(("at equal error", "wanted", "smallest ratio", "largest", "scenes")), _line(["---"] * 5)]
    for head in report.headlines:
        ratios = head.ratios
        low, high = (f"{pick(ratios):.3g} x" if ratios else "–" for pick in (min, max))
        wanted = "–" if head.wanted is None else f"{head.wanted:g} x"
        lines.append(_line((head.question, wanted, low, high, str(len(ratios)))))
    return "\n".join(lines)


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
