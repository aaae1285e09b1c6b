"""Results as rows, JSON and Markdown."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from agents.evaluation import texts
from agents.evaluation.quantities import BY_NAME
from agents.evaluation.records import ALL, Row, episodes_of
from agents.evaluation.report.effects import Effects
from agents.evaluation.report.results import Results
from agents.evaluation.tables import markdown, number, quantity
from vibgym.policies.task_info import TaskInfo


def json_text(results: Results) -> str:
    """Everything but the trajectories; what does not apply is null."""
    more = {
        "comparisons": [asdict(each) for each in results.comparisons],
        **({} if results.effects is None else {"effects": results.effects.as_values()}),
        **({} if results.cost is None else {"cost_per_period": results.cost.as_values()}),
        "episodes": all_episodes(results),
    }
    settings, tasks = results.settings, results.tasks
    return texts.json_text(results.provenance, settings, tasks, results.hardware, results.rows, more)


def all_episodes(results: Results) -> list[dict[str, Any]]:
    """The rows of episodes.csv."""
    return [one for trial, found in results.rollouts.items() for one in episodes_of(found, ALL, **trial._asdict())]


def summary_table(results: Results) -> str:
    """The tables that the README quotes, in Markdown: success with its interval, and medians.

    Tasks whose parts are done together, without goal poses, have columns of their own, and so have those whose goals move.
    Where there is more than one machine, rows say which. The study of effects has a table of success rates and median times.
    """
    several = len(results.hardware) > 1
    level = f"{100 * results.settings.confidence:g} % interval"
    head = ("task", *(["hardware"] if several else []), "policy", "success", level, "time to goal")
    tables = []
    for kind, more in ENDS.items():
        lines = [
            [
                row.task,
                *([row.hardware] if several else []),
                row.policy,
                f"{row.percent} %",
                f"{row.percent_between()} %",
                BY_NAME["time_to_goal_median_s"].text(row),
                *(_ending(name, row) for name in more),
                str(row.fallen),
            ]
            for row in results.rows
            if kind_of(results.tasks[row.task]) == kind
        ]
        if lines:
            tables.append(markdown((*head, *(BY_NAME[name].label for name in more), "fallen"), lines))
    if results.effects is not None:
        tables.append(effects_table(results.effects))
    return "\n\n".join(tables)


def effects_table(effects: Effects) -> str:
    """Success rate and median time to goal of every policy in every case, in Markdown."""
    lines = ([case, *map(_cell, cells)] for case, cells in effects.rows())
    return markdown((f"{effects.task}: effect", *effects.policies), lines)


def _cell(cell: Row) -> str:
    time = f" ({quantity(cell.time_to_goal_median_s, 1.0, 2, 's')})" if cell.successes else ""
    return f"{cell.percent} %{time}"


def kind_of(task: TaskInfo) -> str:
    """Which of the tables a task belongs in: goals that stay, paths, or parts that are done together."""
    return "together" if not task.has_goal else "paths" if task.goal_moves else "goals"


ENDS = {
    "goals": ("time_over_bound_median", "position_error_median_m", "heading_error_median_rad"),
    "paths": ("path_error_median_m", "heading_error_median_rad"),
    "together": ("throughput_median_parts_per_s", "collisions_mean", "path_efficiency_median"),
}
"""Quantities in the tables beside those that all have, see :func:`kind_of`."""


def _ending(name: str, row: Row) -> str:
    return number(row.collisions_mean, 1) if name == "collisions_mean" else BY_NAME[name].text(row)
