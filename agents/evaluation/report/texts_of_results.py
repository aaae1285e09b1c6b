"""Results as rows, JSON and Markdown."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from agents.evaluation import machine
from agents.evaluation.records import ALL, Row, episodes_of
from agents.evaluation.report.effects import Effects
from agents.evaluation.report.results import Results
from agents.evaluation.tables import markdown, number, plain, quantity
from agents.evaluation.words import facts
from vibgym.policies.task_info import TaskInfo


def json_text(results: Results) -> str:
    """Everything but the trajectories; what does not apply is null."""
    settings = results.settings
    content = {
        **results.provenance,
        "settings": settings.as_written(),
        "seeds": settings.seed_list(),
        "tasks": {name: facts(info, results.episodes(name)) for name, info in results.tasks.items()},
        "hardware": {name: machine.sentences(results.arguments_of(name), results.surface) for name in results.hardware},
        "results": [vars(row) for row in results.rows],
        "comparisons": [asdict(each) for each in results.comparisons],
        **({} if results.effects is None else {"effects": results.effects.as_values()}),
        **({} if results.cost is None else {"cost_per_period": results.cost.as_values()}),
        "episodes": all_episodes(results),
    }
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"


def all_episodes(results: Results) -> list[dict[str, Any]]:
    """The rows of episodes.csv."""
    return [one for trial, found in results.rollouts.items() for one in episodes_of(found, ALL, **trial._asdict())]


def summary_table(results: Results) -> str:
    """The tables that the README quotes, in Markdown: success with its interval, and medians.

    Tasks whose parts are done together, without goal poses, have columns of their own, and so have those whose goals move.
    Where there is more than one machine, rows say which. The study of effects has a table of success rates and median times.
    """
    columns: list[tuple[str, Callable[[Row], str]]] = [
        ("task", lambda row: row.task),
        *([("hardware", lambda row: row.hardware)] if len(results.hardware) > 1 else []),
        ("policy", lambda row: row.policy),
        ("success", lambda row: f"{100 * row.success_rate:.1f} %"),
        (
            f"{100 * results.settings.confidence:g} % interval",
            lambda row: f"{100 * row.success_low:.1f} to {100 * row.success_high:.1f} %",
        ),
        ("time to goal", lambda row: quantity(row.time_to_goal_median_s, 1.0, 2, "s")),
    ]
    tables = []
    for kind, more in ENDS.items():
        rows = [row for row in results.rows if kind_of(results.tasks[row.task]) == kind]
        if rows:
            heads, texts = zip(*columns, *more, strict=True)
            tables.append(markdown(heads, ([text(row) for text in texts] for row in rows)))
    if results.effects is not None:
        tables.append(effects_table(results.effects))
    return "\n\n".join(tables)


def effects_table(effects: Effects) -> str:
    """Success rate and median time to goal of every policy in every case, in Markdown."""
    lines = ([case, *map(_cell, cells)] for case, cells in effects.rows())
    return markdown((f"{effects.task}: effect", *effects.policies), lines)


def _cell(cell: Row) -> str:
    time = f" ({quantity(cell.time_to_goal_median_s, 1.0, 2, 's')})" if cell.successes else ""
    return f"{100 * cell.success_rate:.1f} %{time}"


def kind_of(task: TaskInfo) -> str:
    """Which of the tables a task belongs in: goals that stay, paths, or parts that are done together."""
    return "together" if not task.has_goal else "paths" if task.goal_moves else "goals"


_HEADING = ("heading error", lambda row: quantity(row.heading_error_median_rad, 180.0 / math.pi, 2, "deg"))
_FALLEN = ("fallen", lambda row: str(row.fallen))

ENDS: dict[str, tuple[tuple[str, Callable[[Row], str]], ...]] = {
    "goals": (
        ("time / bound", lambda row: quantity(row.time_over_bound_median, 1.0, 2, "")),
        ("position error", lambda row: quantity(row.position_error_median_m, 1e3, 2, "mm")),
        _HEADING,
        _FALLEN,
    ),
    "paths": (
        ("path error (rms)", lambda row: quantity(row.path_error_median_m, 1e3, 2, "mm")),
        _HEADING,
        _FALLEN,
    ),
    "together": (
        ("throughput", lambda row: quantity(row.throughput_median_parts_per_s, 1.0, 2, "parts/s")),
        ("collisions", lambda row: number(row.collisions_mean, 1)),
        ("efficiency", lambda row: quantity(row.path_efficiency_median, 100.0, 0, "%")),
        _FALLEN,
    ),
}
"""The last columns of the tables, see :func:`kind_of`."""
