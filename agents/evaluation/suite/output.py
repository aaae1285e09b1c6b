"""Scores as tables: Markdown, CSV, JSON, and a page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.evaluation import machine, texts, words
from agents.evaluation.pages import render
from agents.evaluation.records import Row
from agents.evaluation.suite.run import FILES, Suite
from agents.evaluation.tables import markdown, plain, quantity, seeds_text
from vibgym.files import csv_text, write_together

RATES = ("good", "tilted", "close", "wrong", "lost")


def summary(found: Suite) -> str:
    """The table of scores in Markdown: a line for every policy on every hardware."""
    lines = [[total.hardware, total.policy, _score(total), *map(_score, _of(found, total))] for total in found.totals]
    return markdown(("hardware", "policy", "**score**", *found.settings.tasks), lines)


def details(found: Suite) -> str:
    """What the scores are made of, in Markdown: a line for every policy that has played a task."""
    lines = [
        [row.task, row.hardware, row.policy, _score(row), *_measured(row), quantity(row.seconds_per_step, 1e3, 2, "ms")]
        for row in found.rows
        if row.served
    ]
    return markdown(("task", "hardware", "policy", "score", *MEASURED, "policy, a step"), lines)


MEASURED = ("success", "time to goal", "bound", "collisions", "good a minute", "faulty", "pattern error", "coverage")
"""Heads of :func:`_measured`."""


def _measured(row: Row) -> list[str]:
    """Times or rates, whichever the task goes by, and what is told of it alone."""
    flows = row.rate_bound_per_minute == row.rate_bound_per_minute
    faulty = sum(getattr(row, f"{name}_per_minute") for name in RATES[1:])
    return [
        "–" if flows else quantity(row.success_rate, 100.0, 1, "%"),
        quantity(row.time_to_goal_median_s, 1.0, 2, "s"),
        quantity(row.rate_bound_per_minute, 1.0, 0, "a minute") if flows else quantity(row.bound_median_s, 1.0, 2, "s"),
        quantity(row.collisions_mean, 1.0, 1, ""),
        quantity(row.good_per_minute, 1.0, 1, ""),
        quantity(faulty, 1.0, 1, ""),
        quantity(row.pattern_error, 1e3, 2, "mm"),
        quantity(row.coverage, 100.0, 1, "%"),
    ]


def _of(found: Suite, total: Row) -> list[Row]:
    """The rows of one policy on one hardware, in the order of the tasks."""
    return [row for row in found.rows if (row.hardware, row.policy) == (total.hardware, total.policy)]


def _score(row: Row) -> str:
    """ "0.48 (0.45 to 0.51)", or a dash for a task that a policy does not serve, which counts as 0."""
    if not getattr(row, "served", True):
        return "–"
    between = "" if row.score_low != row.score_low else f" ({row.score_low:.3f} to {row.score_high:.3f})"
    return f"{row.score:.3f}{between}"


def json_text(found: Suite) -> str:
    """All of it."""
    more = {"suite": [vars(each) for each in found.totals]}
    hardware = list(found.settings.named_hardware())
    return texts.json_text(found.provenance, found.settings, found.tasks, hardware, found.rows, more)


def page(found: Suite) -> str:
    """As HTML, one file."""
    settings, surface = found.settings, next(iter(found.tasks.values())).surface
    return render(
        Path(__file__).with_name("scores.html.j2"),
        settings=settings,
        tasks=[
            {"name": name, "summary": info.summary, "inventory": words.inventory(info.parts)}
            for name, info in found.tasks.items()
        ],
        lines=[
            {"total": total, "score": _score(total), "cells": list(map(_score, _of(found, total)))}
            for total in found.totals
        ],
        details=_table(found),
        heads=MEASURED,
        machines=machine.cards({name: settings.environments()[name] for name in settings.named_hardware()}, surface),
        confidence=f"{100 * settings.confidence:g} %",
        provenance=found.provenance,
        seeds=seeds_text(settings.seed_list()),
        settings_text=json.dumps(plain(settings.as_written()), indent=2),
    )


def _table(found: Suite) -> list[dict[str, Any]]:
    """The page's table of what the scores are made of, task by task."""
    return [
        {
            "task": task,
            "rows": [
                {
                    "row": row,
                    "score": _score(row),
                    "cells": _measured(row),
                    "cost": quantity(row.seconds_per_step, 1e3, 2, "ms"),
                }
                for row in found.rows
                if row.task == task and row.served
            ],
        }
        for task in found.settings.tasks
    ]


def write(found: Suite) -> Path:
    """Write :data:`.run.FILES`; returns the page's path.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    directory = Path(found.settings.output)
    contents: Sequence[str] = (
        csv_text([vars(row) for row in found.rows]),
        csv_text([vars(row) for row in found.totals]),
        json_text(found),
        f"{summary(found)}\n\n{details(found)}\n",
        page(found),
    )
    write_together({directory / name: text for name, text in zip(FILES, contents, strict=True)})
    return directory / FILES[-1]
