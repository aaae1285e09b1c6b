"""Tables of the open tasks, from ``results/open``: what ``python -m agents score`` found."""

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
    """A row for each policy on each task and machine."""
    return rows(OPEN / "scores.csv")


def found() -> str:
    """When, at which commit."""
    about = json.loads((OPEN / "results.json").read_text(encoding="utf-8"))
    return f"{about['time'][:10]} at commit {about['commit'][:7]}"


def suite() -> str:
    """The score of each policy, on both machines, with intervals of the whole."""
    tasks = list(dict.fromkeys(row["task"] for row in scores()))
    of_task = {(row["hardware"], row["policy"], row["task"]): row for row in scores()}
    lines = []
    for row in rows(OPEN / "suite.csv"):
        served = [of_task.get((row["hardware"], row["policy"], task)) for task in tasks]
        lines.append(
            [row["hardware"], row["policy"], _score(row), *(_score(each) if each else NOTHING for each in served)]
        )
    heads = ("hardware", "policy", "score", *tasks)
    return f"Found on {found()}; the score is that of all tasks, with its interval.\n\n{markdown(heads, lines)}"


def of(*tasks: str, policies: Collection[str] | None = None) -> str:
    """All figures of some tasks, of all policies or of some; empty if there are none."""
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
    known = row["score_low"] and "task" not in row
    return f"{text} ({float(row['score_low']):.3f} to {float(row['score_high']):.3f})" if known else text


def _value(row: Mapping[str, str], column: str) -> float:
    return float(row[column]) if row[column] else math.nan


def _success(row: Mapping[str, str]) -> str:
    """Tasks whose parts come and go have none."""
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
    "good a minute": lambda row: number(_value(row, "good_per_minute"), 1),
    "transit": lambda row: quantity(_value(row, "transit") or math.nan, 1.0, 2, "s"),
    "on the table": lambda row: number(_value(row, "on_table"), 1),
    "coverage at the end": lambda row: quantity(_value(row, "coverage"), 100.0, 1, "%"),
    "collisions": lambda row: number(_value(row, "collisions_mean"), 2),
    "fallen": lambda row: f"{_value(row, 'fallen'):.0f}",
    "episodes": lambda row: row["episodes"],
}
"""What a table may show: those columns that say nothing of any row are left out."""

PAGES = {
    "feed": ("Feed", "FeedHeaps"),
    "swap": ("Swap", "SwapCrowded"),
    "pack": ("Pack", "PackFull"),
    "push": ("Push", "PushAny"),
}
"""Tasks by the page that tells of them."""


def page(name: str) -> str:
    """Of the law and the agents of a page's tasks."""
    table = of(*PAGES[name], policies=("classical", "learned"))
    return f"{table}\n\n`python -m agents score`, {found()}. *fallen*: parts, in all episodes together."


TABLES: dict[str, Callable[[], str]] = {
    "open": suite,
    **{f"open-{name}": functools.partial(page, name) for name in PAGES},
}
"""By the name of the file in ``docs/generated``."""
