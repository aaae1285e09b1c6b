"""The report's section on which effect breaks whom."""

from __future__ import annotations

from typing import Any

from agents.evaluation import machine
from agents.evaluation.entries import laid_over
from agents.evaluation.records import Row
from agents.evaluation.report.results import Results
from agents.evaluation.tables import colour, quantity
from agents.evaluation.words import joined


def section(results: Results) -> dict[str, Any]:
    """What the page shows."""
    effects = results.effects
    assert effects is not None
    own: dict[str, list[str]] = {}  # what the sensors of some policies have besides -> these policies
    for column in results.settings.effects.columns(list(results.policies)):  # type: ignore[union-attr]
        if column.sensor:
            said = machine.settings_of_sensor(column.sensor, results.surface)
            own.setdefault(said, []).append(column.name)
    environments = {case: laid_over(results.settings.environment, own) for case, own in effects.cases.items()}
    return {
        "task": effects.task,
        "episodes": len(effects.seeds),
        "policies": effects.policies,
        "rows": [
            {
                "case": case,
                "summary": machine.summary(environments[case], results.surface),
                "cells": [_shown(cell) for cell in cells],
            }
            for case, cells in effects.rows()
        ],
        "own": [{"names": joined(names), "words": said} for said, names in own.items()],
    }


def _shown(cell: Row) -> dict[str, str]:
    return {
        "success": f"{100 * cell.success_rate:.1f} %",
        "interval": f"{100 * cell.success_low:.1f} – {100 * cell.success_high:.1f}",
        "method": cell.success_interval_method,
        "time": quantity(cell.time_to_goal_median_s, 1.0, 2, "s"),
        "colour": colour(cell.success_rate),
    }
