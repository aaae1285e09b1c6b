"""A comparison as JSON and Markdown."""

from __future__ import annotations

from dataclasses import asdict

from agents.evaluation import texts
from agents.evaluation.comparison.results import Comparison
from agents.evaluation.records import Row
from agents.evaluation.tables import markdown, quantity, span


def json_text(found: Comparison) -> str:
    """All of it; what does not apply is null."""
    more = {
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
    hardware = [each.name for each in found.settings.machines()]
    return texts.json_text(found.provenance, found.settings, found.tasks, hardware, found.rows, more)


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
        f"{row.percent} %",
        f"{row.percent_between()} %",
        quantity(row.time_iqm_s, 1.0, 3, "s"),
        span(row.time_iqm_low_s, row.time_iqm_high_s, 3),
        quantity(row.over_bound_iqm, 1.0, 2, ""),
        quantity(row.collisions_mean, 1.0, 2, ""),
    ]
