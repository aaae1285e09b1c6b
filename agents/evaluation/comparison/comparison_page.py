"""The comparison's page: one HTML file that needs nothing else."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.evaluation import machine, words
from agents.evaluation.comparison.curves import Curve
from agents.evaluation.comparison.paired import Difference, Estimate
from agents.evaluation.comparison.plots import draw_curves, draw_profile, look_of, steps_text
from agents.evaluation.comparison.results import Comparison, Ladder, Matrix
from agents.evaluation.pages import data_address, render
from agents.evaluation.records import Row
from agents.evaluation.tables import number, plain, quantity, seeds_text, signed, span

UNEQUAL = 1.05
"""Budgets of a ladder that differ by more than this factor are said to be different."""


def page(found: Comparison) -> str:
    """The whole page as HTML."""
    settings = found.settings
    names = [each.name for each in settings.contenders()]
    surface = next(iter(found.tasks.values())).surface
    ran = {hardware for _, hardware in found.samples}
    machines = {name: each for name, each in settings.environments().items() if name in ran}
    counted = any(math.isfinite(each.collisions.value) for each in found.differences)
    return render(
        Path(__file__).with_name("compare.html.j2"),
        settings=settings,
        confidence=f"{100 * settings.confidence:g} %",
        power=f"{100 * settings.power:g} %",
        machines=machine.cards(machines, surface),
        hardware=list(machines),
        tasks=[_task(found, task, names) for task in found.tasks],
        seeded=any(row.runs > 1 for row in found.rows),
        differences=[_difference(each, counted) for each in found.differences],
        collisions=counted,
        loads=words.loads({task: (info, len(settings.seed_list(task))) for task, info in found.tasks.items()}),
        curves=[
            {
                "task": task,
                "plot": data_address(draw_curves(runs, names)),
                "rows": [_training(name, curves) for name, curves in runs.items()],
            }
            for task in found.tasks
            if (runs := _curves_of(found, task))
        ],
        ladders=[_ladder(found, each, names) for each in found.ladders],
        matrices=[_matrix(each) for each in found.matrices],
        colours={name: look_of(name, names)["color"] for name in names},
        seeds=seeds_text(settings.seed_list()),
        provenance=found.provenance,
        settings_text=json.dumps(plain(settings.as_written()), indent=2),
    )


def _task(found: Comparison, task: str, names: Sequence[str]) -> dict[str, Any]:
    """Everything of one task on all its hardware."""
    info, sections = found.tasks[task], []
    for hardware in found.hardware_of(task):
        profile = next(each for each in found.profiles if (each.task, each.hardware) == (task, hardware))
        sections.append(
            {
                "hardware": hardware,
                "episodes": len(next(iter(found.samples[task, hardware].values())).seeds),
                "best": found.best.get((task, hardware)),
                "rows": [
                    {"all": _row(row), "runs": [_row(run) for run in runs]}
                    for row, runs in found.rows_of(task, hardware)
                ],
                "unit": profile.unit,
                "profile": data_address(draw_profile(profile, names)),
            }
        )
    assert info.step_limit is not None
    return {
        "name": task,
        "asked": words.asked(info),
        "limit": f"{info.step_limit * info.step_time:g} s",
        "sections": sections,
    }


def _row(row: Row) -> dict[str, Any]:
    return {
        "row": row,
        "time": quantity(row.time_iqm_s, 1.0, 3, "s"),
        "times": span(row.time_iqm_low_s, row.time_iqm_high_s, 3),
        "multiple": quantity(row.over_bound_iqm, 1.0, 3, ""),
        "multiples": span(row.over_bound_iqm_low, row.over_bound_iqm_high, 3),
        "median": quantity(row.time_median_s, 1.0, 2, "s"),
        "collisions": quantity(row.collisions_mean, 1.0, 2, ""),
        "collisions_span": span(row.collisions_low, row.collisions_high, 2),
        "fallen": str(row.fallen),
    }


def _difference(each: Difference, collisions: bool) -> dict[str, Any]:
    return {
        "task": each.task,
        "hardware": each.hardware,
        "first": each.first,
        "second": each.second,
        "runs": each.runs,
        "estimates": [
            _estimate(each.success, 100.0, 1, ""),
            _estimate(each.iqm, 1.0, 3, " s"),
            _estimate(each.time, 1.0, 3, " s"),
            *([_estimate(each.collisions, 1.0, 2, "")] if collisions else []),
        ],
    }


def _estimate(each: Estimate, factor: float, digits: int, unit: str) -> dict[str, Any]:
    """Value, interval, and smallest detectable difference, in words; dashes for what there is not."""
    interval, value = each.interval, each.value
    return {
        "value": "–" if value != value else f"{signed(factor * value, digits)}{unit}",
        "interval": ""
        if interval is None
        else f"{signed(factor * interval.low, digits)} to {signed(factor * interval.high, digits)}",
        "method": "" if interval is None else interval.method,
        "clear": each.clear,
        "detectable": "–"
        if each.detectable != each.detectable
        else f"{number(factor * each.detectable, digits)}{unit}",
    }


def _curves_of(found: Comparison, task: str) -> dict[str, dict[int | None, Curve]]:
    """Policy -> training seed -> curve."""
    return {policy: runs for (each, policy), runs in found.curves.items() if each == task}


def _training(name: str, runs: dict[int | None, Curve]) -> dict[str, Any]:
    """A row of the table below learning curves."""
    curves = list(runs.values())
    return {
        "name": name,
        "runs": len(curves),
        "steps": _from_to([steps_text(curve.steps[-1]) for curve in curves]),
        "minutes": _from_to([f"{curve.seconds[-1] / 60.0:.1f}" for curve in curves]),
        "success": _from_to([f"{100.0 * curve.success[-1]:.1f} %" for curve in curves]),
        "time": _from_to([quantity(float(curve.time_to_goal[-1]), 1.0, 2, "s") for curve in curves]),
    }


def _from_to(texts: Sequence[str]) -> str:
    """Of each run, in the order of the seeds; once where all are the same."""
    return texts[0] if len(set(texts)) == 1 else ", ".join(texts)


def _ladder(found: Comparison, ladder: Ladder, names: Sequence[str]) -> dict[str, Any]:
    steps = [each for step in ladder.steps for each in step.steps]
    curves = {step.policy: found.curves[ladder.task, step.policy] for step in ladder.steps}
    return {
        "name": ladder.name,
        "task": ladder.task,
        "hardware": ladder.hardware,
        "unequal": max(steps) > UNEQUAL * min(steps),
        "plot": data_address(draw_curves(curves, names)),
        "steps": [
            {
                "policy": step.policy,
                "action": step.action,
                "budget": _from_to([steps_text(each) for each in step.steps]),
                "minutes": _from_to([f"{each / 60.0:.1f}" for each in step.seconds]),
                "card": _row(step.row),
                "runs": [_row(run) for run in step.runs],
            }
            for step in ladder.steps
        ],
    }


def _matrix(matrix: Matrix) -> dict[str, Any]:
    reasons = list(dict.fromkeys(cell.refusal for cells in matrix.cells for cell in cells if cell.refusal))
    tasks = {case.task for case in matrix.cases}
    return {
        "name": matrix.name,
        "cases": [{"name": case.name, "task": case.task if len(tasks) > 1 else ""} for case in matrix.cases],
        "task": next(iter(tasks)) if len(tasks) == 1 else "",
        "lines": [
            {
                "name": line.name,
                "trained_on": line.trained_on,
                "cells": [_cell(cell, reasons) for cell in cells],
            }
            for line, cells in zip(matrix.lines, matrix.cells, strict=True)
        ],
        "reasons": reasons,
    }


def _cell(cell: Row, reasons: Sequence[str]) -> dict[str, Any]:
    if cell.refusal:
        return {"refused": 1 + reasons.index(cell.refusal), "why": cell.refusal}
    return {"refused": 0, **cell.shaded(cell.time_median_s), "episodes": cell.episodes, "runs": cell.runs}
