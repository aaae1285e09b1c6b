"""Results as rows, JSON and Markdown."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from agents.evaluation import texts
from agents.evaluation.quantities import BY_NAME, RATES
from agents.evaluation.records import ALL, Row, episodes_of
from agents.evaluation.report.effects import Effects
from agents.evaluation.report.load import Load
from agents.evaluation.report.results import Results
from agents.evaluation.tables import markdown, number, quantity
from vibgym.policies.task_info import TaskInfo


def json_text(results: Results) -> str:
    """Everything but the trajectories; what does not apply is null."""
    more = {
        "comparisons": [asdict(each) for each in results.comparisons],
        **({} if results.effects is None else {"effects": results.effects.as_values()}),
        **({} if results.load is None else {"load": results.load.as_values()}),
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
    head, succeed = ("task", *(["hardware"] if several else []), "policy"), ("success", level, "time to goal")
    tables = []
    for kind, more in ENDS.items():
        lines = [
            [
                row.task,
                *([row.hardware] if several else []),
                row.policy,
                *([] if kind == "flows" else _success(row)),
                *(_ending(name, row) for name in more),
                *([] if kind == "flows" else [str(row.fallen)]),
            ]
            for row in results.rows
            if kind_of(results.tasks[row.task]) == kind
        ]
        if lines:
            first, last = ((), ()) if kind == "flows" else (succeed, ("fallen",))
            tables.append(markdown((*head, *first, *(BY_NAME[name].label for name in more), *last), lines))
    if results.effects is not None:
        tables.append(effects_table(results.effects))
    if results.load is not None:
        tables.append(load_table(results.load))
    return "\n\n".join(tables)


def _success(row: Row) -> list[str]:
    """How often, and how fast."""
    return [f"{row.percent} %", f"{row.percent_between()} %", BY_NAME["time_to_goal_median_s"].text(row)]


def effects_table(effects: Effects) -> str:
    """Success rate and median time to goal of every policy in every case, in Markdown."""
    lines = ([case, *map(_cell, cells)] for case, cells in effects.rows())
    return markdown((f"{effects.task}: effect", *effects.policies), lines)


def load_table(load: Load) -> str:
    """Parts a minute of every policy with every number of parts, in Markdown."""
    lines = ([str(row.parts), row.policy, *load_cells(row)] for row in load.rows)
    return markdown((f"{load.task}: parts", "policy", *LOAD_HEADS), lines)


LOAD_HEADS = ("good", *list(RATES.values())[1:], "bound", "transit", "on the table")
"""Heads of :func:`load_cells`."""


def load_cells(row: Row) -> list[str]:
    """What is told of a policy with some number of parts."""
    rates = [number(getattr(row, event), 1) for event in RATES.values()]
    return [*rates, number(row.bound, 0), quantity(row.transit_s, 1.0, 2, "s"), number(row.on_table, 1)]


def _cell(cell: Row) -> str:
    time = f" ({quantity(cell.time_to_goal_median_s, 1.0, 2, 's')})" if cell.successes else ""
    return f"{cell.percent} %{time}"


def kind_of(task: TaskInfo) -> str:
    """Which of the tables a task belongs in: parts that come and go, goals of one part or of several, paths, or parts that
    are done together."""
    if task.flows:
        return "flows"
    if not task.has_goal:
        return "together"
    return "paths" if task.goal_moves else "goals" if len(task.parts) == 1 else "patterns"


ENDS = {
    "goals": ("time_over_bound_median", "position_error_median_m", "heading_error_median_rad"),
    "patterns": ("time_over_bound_median", "collisions_mean", "pattern_error_median_m", "coverage_median"),
    "flows": ("rate_over_bound_mean", *(f"{name}_mean" for name in RATES), "transit_mean_s", "on_table_mean"),
    "paths": ("path_error_median_m", "heading_error_median_rad"),
    "together": ("throughput_median_parts_per_s", "collisions_mean", "path_efficiency_median"),
}
"""Quantities in the tables beside those that all have, see :func:`kind_of`."""


def _ending(name: str, row: Row) -> str:
    return number(row.collisions_mean, 1) if name == "collisions_mean" else BY_NAME[name].text(row)
