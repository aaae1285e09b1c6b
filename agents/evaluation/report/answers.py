"""What the report says first: how every policy does on every task, which is the best of each, and what is still open."""

from __future__ import annotations

import math
from typing import Any

from agents.evaluation.quantities import BY_NAME
from agents.evaluation.records import Row
from agents.evaluation.report.results import Results
from agents.evaluation.tables import colour, number

OPEN_BELOW = 0.95
"""Success rate of its best policy below which a task is still open."""


def best_row(results: Results, task: str, hardware: str) -> Row:
    """The policy with the most successes on a task and hardware; of equal ones the fastest to the goal: by its time over the
    least possible one, where that is known, which tells more apart than whole steps do.

    Where parts come and go, that with the most good parts a minute.
    """
    rows = [row for row in results.rows if (row.task, row.hardware) == (task, hardware)]
    if results.tasks[task].flows:
        return max(rows, key=lambda row: row.good_per_minute_mean)
    times = ("time_over_bound_median", "time_to_goal_median_s")

    def rank(row: Row) -> tuple[float, ...]:
        return -row.successes, *(math.inf if _no(time := getattr(row, name)) else time for name in times)

    return min(rows, key=rank)


def anchor(row: Row) -> str:
    """Of a card, without spaces, which an address cannot have."""
    return "-".join(("card", row.task, row.hardware, row.policy)).replace(" ", "_")


def answers(results: Results) -> dict[str, Any]:
    """The first screen: a table for every machine, the best policies, and the open tasks."""
    places = [(task, hardware) for hardware in results.hardware for task in results.tasks]
    places = [(task, hardware) for task, hardware in places if hardware in results.hardware_of(task)]
    best = {place: best_row(results, *place) for place in places}
    tables = [
        {
            "hardware": hardware,
            "rows": [
                {"task": task, "cells": _cells(results, task, hardware, best[task, hardware])}
                for task, machine in places
                if machine == hardware
            ],
        }
        for hardware in results.hardware
    ]
    return {
        "policies": list(results.policies),
        "tables": tables,
        "best": [_told(results, row) for row in best.values()],
        "open": [_told(results, row) for row in best.values() if is_open(results, row)],
        "limit": f"{100 * OPEN_BELOW:g} %",
    }


def is_open(results: Results, best: Row) -> bool:
    """Whether the best policy fails more often than is good enough; where parts come and go, success says nothing."""
    return not results.tasks[best.task].flows and best.success_rate < OPEN_BELOW


def _cells(results: Results, task: str, hardware: str, best: Row) -> list[dict[str, Any] | None]:
    """One for each policy of the report; None where it did not run."""
    rows = {row.policy: row for row in results.rows if (row.task, row.hardware) == (task, hardware)}
    return [
        None if (row := rows.get(name)) is None else {**_figures(results, row), "best": row is best, "to": anchor(row)}
        for name in results.policies
    ]


def _figures(results: Results, row: Row) -> dict[str, Any]:
    """The large and the small figure of a cell, and its colour, which only repeats what they say."""
    if results.tasks[row.task].flows:
        share = row.rate_over_bound_mean
        large, small = (
            f"{number(row.good_per_minute_mean, 1)} / min",
            "" if _no(share) else f"{100 * share:.0f} % of bound",
        )
        rank, tint = row.good_per_minute_mean, colour(0.5 if _no(share) else min(share, 1.0))
    else:
        large, rank, tint = f"{_short(row)} %", row.success_rate, colour(row.success_rate)
        ratio, time = row.time_over_bound_median, row.time_to_goal_median_s
        small = f"{number(ratio, 2)} ×" if not _no(ratio) else "" if _no(time) else f"{number(time, 2)} s"
    return {"large": large, "small": small, "rank": "" if _no(rank) else f"{rank:.6g}", "colour": tint}


def _told(results: Results, row: Row) -> dict[str, Any]:
    """A policy as the best of its place."""
    flows = results.tasks[row.task].flows
    return {
        "row": row,
        "to": anchor(row),
        "flows": flows,
        "rate": f"{number(row.good_per_minute_mean, 1)} good parts a minute" if flows else f"{row.percent} %",
        "interval": "" if flows else f"{row.percent_between()} %",
        "time": BY_NAME["time_to_goal_median_s"].text(row),
        "bound": BY_NAME["rate_over_bound_mean" if flows else "time_over_bound_median"].text(row),
        "open": is_open(results, row),
    }


def _short(row: Row) -> str:
    """Success rate without a decimal where it has none to tell."""
    return f"{100 * row.success_rate:g}" if row.success_rate in (0.0, 1.0) else row.percent


def _no(value: float) -> bool:
    return not math.isfinite(value)
