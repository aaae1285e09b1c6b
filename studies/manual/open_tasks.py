"""Tables of the open tasks, from ``results/open``, which ``python -m agents score`` writes."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Collection, Mapping

from agents.evaluation.table import markdown, number, quantity
from studies.manual.figures_file import NOTHING, RESULTS, rows

OPEN = RESULTS / "open"


@functools.cache
def scores() -> list[dict[str, str]]:
    """Return one row per policy, task and hardware model."""
    return rows(OPEN / "scores.csv")


def date() -> str:
    """Return date and commit of the evaluation."""
    about = json.loads((OPEN / "results.json").read_text(encoding="utf-8"))
    return f"{about['time'][:10]} at commit {about['commit'][:7]}"


def suite() -> str:
    """Return the scores of each policy on both hardware models, with intervals of the suite's score."""
    tasks = list(dict.fromkeys(row["task"] for row in scores()))
    of_task = {(row["hardware"], row["policy"], row["task"]): row for row in scores()}
    lines = []
    for row in rows(OPEN / "suite.csv"):
        served = [of_task.get((row["hardware"], row["policy"], task)) for task in tasks]
        lines.append(
            [row["hardware"], row["policy"], _score(row), *(_score(cell) if cell else NOTHING for cell in served)]
        )
    heads = ("hardware", "policy", "score", *tasks)
    return f"Evaluated on {date()}. *score* is that of the suite, with its interval.\n\n{markdown(heads, lines)}"


def of(*tasks: str, policies: Collection[str] | None = None) -> str:
    """Return the table of some tasks, for all policies or those of ``policies``; "" without results."""
    kept = [row for row in scores() if row["task"] in tasks and row["served"] == "True"]
    kept = [row for row in kept if policies is None or row["policy"] in policies]
    kept.sort(key=lambda row: tasks.index(row["task"]))
    columns = {head: [cell(row) for row in kept] for head, cell in COLUMNS.items()}
    columns = {head: cells for head, cells in columns.items() if any(text != NOTHING for text in cells)}
    if len(tasks) == 1:
        columns.pop("task", None)
    return markdown(list(columns), [list(line) for line in zip(*columns.values(), strict=True)]) if kept else ""


def _score(row: Mapping[str, str]) -> str:
    if row.get("served", "True") != "True" or not row["score"]:
        return NOTHING
    text = f"{float(row['score']):.3f}"
    of_suite = row["score_low"] and "task" not in row
    return f"{text} ({float(row['score_low']):.3f} to {float(row['score_high']):.3f})" if of_suite else text


def _value(row: Mapping[str, str], column: str) -> float:
    return float(row[column]) if row[column] else math.nan


def _success(row: Mapping[str, str]) -> str:
    """Return the success rate; a dash for tasks whose parts arrive and leave continuously."""
    return NOTHING if row["good_per_minute"] else quantity(_value(row, "success_rate"), 100.0, 1, "%")


def _time(row: Mapping[str, str]) -> str:
    median, low, high = (_value(row, f"time_to_goal_{name}_s") for name in ("median", "q25", "q75"))
    return NOTHING if math.isnan(median) else f"{median:.2f} s ({low:.2f} to {high:.2f})"


COLUMNS: dict[str, Callable[[Mapping[str, str]], str]] = {
    "task": lambda row: row["task"],
    "hardware": lambda row: row["hardware"],
    "policy": lambda row: row["policy"],
    "score": _score,
    "success": _success,
    "time to goal: median (quartiles)": _time,
    "good parts per minute": lambda row: number(_value(row, "good_per_minute"), 1),
    "transit": lambda row: quantity(_value(row, "transit") or math.nan, 1.0, 2, "s"),
    "on the table": lambda row: number(_value(row, "on_table"), 1),
    "coverage at the end": lambda row: quantity(_value(row, "coverage"), 100.0, 1, "%"),
    "collisions": lambda row: number(_value(row, "collisions_mean"), 2),
    "fallen": lambda row: f"{_value(row, 'fallen'):.0f}",
    "episodes": lambda row: row["episodes"],
}
"""Heading -> cell of a row; a table omits columns without values."""

PAGES = {
    "feed": ("Feed", "FeedHeaps"),
    "swap": ("Swap", "SwapCrowded"),
    "pack": ("Pack", "PackFull"),
    "push": ("Push", "PushAny"),
}
"""Page -> its tasks."""


def page(name: str) -> str:
    """Return the table of classical and learned policies on a page's tasks."""
    table = of(*PAGES[name], policies=("classical", "learned"))
    return f"{table}\n\n`python -m agents score`, {date()}. *fallen*: number of fallen parts in all episodes."


TABLES: dict[str, Callable[[], str]] = {
    "open": suite,
    **{f"open-{name}": functools.partial(page, name) for name in PAGES},
}
"""File name in ``docs/generated``, without suffix -> function that returns its Markdown."""
