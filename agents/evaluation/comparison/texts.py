"""A comparison as JSON and Markdown."""

from __future__ import annotations

import json
from dataclasses import asdict

from agents.evaluation.comparison.results import Comparison
from agents.evaluation.entries import laid_over
from agents.evaluation.machine import sentences
from agents.evaluation.records import Row
from agents.evaluation.tables import markdown, plain, quantity, span
from agents.evaluation.words import facts


def json_text(found: Comparison) -> str:
    """All of it; what does not apply is null."""
    settings = found.settings
    machines = {each.name: laid_over(settings.environment, each.arguments) for each in settings.machines()}
    surface = next(iter(found.tasks.values())).surface
    content = {
        **found.provenance,
        "settings": settings.as_written(),
        "seeds": settings.seed_list(),
        "tasks": {name: facts(info, len(settings.seed_list(name))) for name, info in found.tasks.items()},
        "hardware": {name: sentences(arguments, surface) for name, arguments in machines.items()},
        "results": [vars(row) for row in found.rows],
        "best_classical": [
            {"task": task, "hardware": hardware, "policy": policy} for (task, hardware), policy in found.best.items()
        ],
        "differences": [asdict(each) for each in found.differences],
        "profiles": [each.as_values() for each in found.profiles],
        "curves": [
            {"task": task, "policy": policy, "training_seed": seed, **curve.as_values()}
            for (task, policy), runs in found.curves.items()
            for seed, curve in runs.items()
        ],
        "generalisation": [
            {
                "name": matrix.name,
                "policies": [asdict(line) for line in matrix.lines],
                "cases": [asdict(case) for case in matrix.cases],
                "results": [vars(cell) for cells in matrix.cells for cell in cells],
            }
            for matrix in found.matrices
        ],
        "ladders": [asdict(each) for each in found.ladders],
    }
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"


def summary_table(found: Comparison) -> str:
    """All policies in Markdown: success and interquartile mean of the time to goal, with their intervals."""
    several = len({row.hardware for row in found.rows}) > 1
    level = f"{100 * found.settings.confidence:g} %"
    heads = [
        "task",
        *(["hardware"] if several else []),
        "policy",
        "success",
        f"{level} interval",
        "time to goal (IQM)",
        f"{level} interval",
        "time / bound",
        "collisions",
    ]
    return markdown(heads, ([text for text in _texts(row, several)] for row in found.rows if row.training_seed is None))


def _texts(row: Row, several: bool) -> list[str]:
    return [
        row.task,
        *([row.hardware] if several else []),
        row.policy if row.runs == 1 else f"{row.policy} ({row.runs} seeds)",
        f"{100 * row.success_rate:.1f} %",
        f"{100 * row.success_low:.1f} to {100 * row.success_high:.1f} %",
        quantity(row.time_iqm_s, 1.0, 3, "s"),
        span(row.time_iqm_low_s, row.time_iqm_high_s, 3),
        quantity(row.over_bound_iqm, 1.0, 2, ""),
        quantity(row.collisions_mean, 1.0, 2, ""),
    ]
