"""Rows of the report: statistics of every policy on every task and hardware, of the studies, and paired differences."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from tqdm import tqdm

from agents.evaluation.pages import thousands
from agents.evaluation.run import Results
from agents.evaluation.statistics import interval_of, paired, quartiles
from agents.evaluation.table import (
    BY_NAME,
    EFFECTS,
    LOAD,
    RATES,
    ends,
    number,
    quantity,
    signed,
    spread,
    successes,
    summary,
)
from vibgym.policies.task_info import TaskInfo

Row = Mapping[str, Any]


class Kind(NamedTuple):
    """Columns for one kind of tasks.

    Attributes:
        title: of its table on the page.
        summary: figures in Markdown, in addition to success and time to goal.
        columns: on the page.
    """

    title: str
    summary: tuple[str, ...]
    columns: tuple[str, ...]


FLOWS = ("rate_over_bound_mean", *(f"{name}_mean" for name in RATES), "transit_mean_s", "on_table_mean")

KINDS = {
    "goals": Kind(
        "",
        ("time_over_bound_median", "position_error_median_m", "heading_error_median_rad"),
        ("time_to_goal_median_s", "time_over_bound_median", "position_error_median_m", "heading_error_median_rad",
         "fallen", "steps_per_second"),
    ),
    "paths": Kind(
        "Paths",
        ("path_error_median_m", "heading_error_median_rad"),
        ("time_to_goal_median_s", "path_error_median_m", "heading_error_median_rad", "fallen", "steps_per_second"),
    ),
    "patterns": Kind(
        "Several parts with individual goals",
        ("time_over_bound_median", "collisions_mean", "pattern_error_median_m", "coverage_median"),
        ("time_to_goal_median_s", "time_over_bound_median", "collisions_mean", "pattern_error_median_m", "coverage_median",
         "position_error_median_m", "fallen"),
    ),
    "flows": Kind("Parts that come and go, parts a minute", FLOWS, FLOWS),
    "together": Kind(
        "Several parts",
        ("throughput_median_parts_per_s", "collisions_mean", "path_efficiency_median"),
        ("time_to_goal_median_s", "throughput_median_parts_per_s", "parts_done_mean", "collisions_mean",
         "path_efficiency_median", "position_error_median_m", "fallen"),
    ),
}  # fmt: skip
"""Kinds of tasks, see :func:`kind_of`."""

LOAD_HEADS = ("good", *list(RATES.values())[1:], "bound", "transit", "on the table")


def kind_of(task: TaskInfo) -> str:
    """Return the kind of a task, one of :data:`KINDS`."""
    if task.flows:
        return "flows"
    if not task.has_goal:
        return "together"
    return "paths" if task.goal_moves else "goals" if len(task.parts) == 1 else "patterns"


def rows(results: Results) -> list[dict[str, Any]]:
    """Return the rows of results.csv: statistics of every policy on every task and hardware."""
    found = []
    for place, table in results.places.items():
        overall, policy, environment = results.rollouts[place, None].timing.rates()
        rates = {
            "steps_per_second": overall,
            "policy_steps_per_second": policy,
            "environment_steps_per_second": environment,
        }
        found.append({**place.labels, **summary(table, *results.asked), **rates})
    return found


def effects_rows(results: Results) -> list[dict[str, Any]]:
    """Return the cells of the study of effects, case after case."""
    return [
        {
            "case": place.hardware,
            "policy": place.policy,
            **successes(table.by_run("success") > 0.0, *results.asked),
            **spread("time_to_goal", table["time_to_goal_s"], "_s"),
            "position_error_median_m": quartiles(table["position_error_m"]).median,
            "heading_error_median_rad": quartiles(table["heading_error_rad"]).median,
            "fallen": int(table["fallen"].sum()),
        }
        for place, table in results.table.where(study=EFFECTS).places().items()
    ]


def load_rows(results: Results) -> list[dict[str, Any]]:
    """Return the rows of the study of throughput: means a minute by policy and number of parts."""
    return [
        {
            "policy": place.policy,
            "parts": int(place.hardware),
            "episodes": len(table),
            "bound": float(results.rollouts[place, None].rate_bound[0]),
            **{event: float(table[name].mean()) for name, event in RATES.items()},
            **ends("good", interval_of(table["good_per_minute"][None], *results.asked)),
            "transit_s": float(table["transit_s"].mean()),
            "on_table": float(table["on_table"].mean()),
        }
        for place, table in results.table.where(study=LOAD).places().items()
    ]


def comparisons(results: Results, quiet: bool = True) -> list[dict[str, Any]]:
    """Return paired differences of every two policies on the same task and hardware."""
    pairs = [pair for pair in itertools.combinations(results.places, 2) if pair[0][:3] == pair[1][:3]]
    found = []
    for one, other in tqdm(pairs, desc="comparing policies", unit="pair", disable=quiet):
        first, second = results.rollouts[one, None], results.rollouts[other, None]
        labels = {"task": one.task, "hardware": one.hardware, "first": one.policy, "second": other.policy}
        found.append({**labels, "episodes": len(first.seeds), **paired(first, second, *results.asked)})
    return found


def best_row(results: Results, rows: Sequence[Row], task: str, hardware: str) -> Row:
    """Return the best policy: most successes, then the lowest time over its bound, then the lowest time; where parts come and
    go, the most good parts a minute."""
    some = [row for row in rows if (row["task"], row["hardware"]) == (task, hardware)]
    if results.tasks[task].flows:
        return max(some, key=lambda row: row["good_per_minute_mean"])
    times = ("time_over_bound_median", "time_to_goal_median_s")

    def rank(row: Row) -> tuple[float, ...]:
        return -row["successes"], *(row[name] if math.isfinite(row[name]) else math.inf for name in times)

    return min(some, key=rank)


def against_best(results: Results, gaps: Sequence[Row], best: Mapping[tuple[str, str], Row]) -> list[dict[str, Any]]:
    """Return the differences of the best policy on every task and hardware to each other one."""
    found = []
    for each in gaps:
        if results.tasks[each["task"]].flows:  # success does not apply
            continue
        name = best[each["task"], each["hardware"]]["policy"]
        if name == each["first"]:
            found.append(dict(each))
        elif name == each["second"]:
            turned = {"first": name, "second": each["first"]}
            found.append({**each, **turned, **{key: each[key].negative() for key in ("success", "time")}})
    return found


def by_case(cells: Iterable[Row]) -> list[tuple[str, list[Row]]]:
    """Return the cells of the study of effects by case."""
    return [(case, list(those)) for case, those in itertools.groupby(cells, key=lambda cell: cell["case"])]


def cell(row: Row, name: str, parts: int = 0) -> tuple[str, str | None]:
    """Return large and small text of a column; ``parts`` is the number of parts of the task."""
    if name == "collisions_mean":
        clearance = row["clearance_median_m"]
        shown = "–" if math.isnan(clearance) else f"{signed(1e3 * clearance, 2).removeprefix('+')} mm"
        return number(row[name], 1), shown
    if name == "parts_done_mean":
        return number(row[name], 2), f"of {parts}"
    if name == "fallen":
        return str(row[name]), None
    if name == "steps_per_second":
        return thousands(row[name]), None
    return BY_NAME[name].text(row), BY_NAME[name].middle_half(row)


def load_cells(row: Row) -> list[str]:
    """Return the cells of a row of the study of throughput, see :data:`LOAD_HEADS`."""
    rates = [number(row[event], 1) for event in RATES.values()]
    return [*rates, number(row["bound"], 0), quantity(row["transit_s"], 1.0, 2, "s"), number(row["on_table"], 1)]
