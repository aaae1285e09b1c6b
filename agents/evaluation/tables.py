"""Results as rows, JSON and Markdown."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from agents.evaluation import machine
from agents.evaluation.effects import Cell, Effects
from agents.evaluation.log import Rollout
from agents.evaluation.results import Results, Row, Trial
from agents.evaluation.words import facts
from vibgym.policies.task_info import TaskInfo


def episodes_of(trial: Trial, rollout: Rollout) -> list[dict[str, Any]]:
    """One mapping per episode: the rows of episodes.csv."""
    columns = {
        "seed": rollout.seeds,
        "success": rollout.success.tolist(),
        "steps": rollout.steps.tolist(),
        "time_to_goal_s": rollout.time_to_goal.tolist(),
        "bound_s": rollout.bound.tolist(),
        "time_over_bound": rollout.time_over_bound.tolist(),
        "position_error_m": rollout.position_error.tolist(),
        "heading_error_rad": rollout.heading_error.tolist(),
        "path_error_m": rollout.path_error.tolist(),
        "fallen": rollout.fallen.tolist(),
        "diverged": rollout.diverged.tolist(),
        "return": rollout.returns.tolist(),
        "path_length_m": rollout.path_length.tolist(),
        "path_efficiency": rollout.path_efficiency.tolist(),
        "parts_done": _whole(rollout.parts_done),
        "throughput_parts_per_s": rollout.throughput.tolist(),
        "collisions": _whole(rollout.collisions),
        "clearance_m": rollout.clearance.tolist(),
    }
    head = trial._asdict()
    return [head | dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def _whole(values: np.ndarray) -> list[int | float]:
    """Counts as whole numbers, where there are any."""
    return [int(value) if math.isfinite(value) else value for value in values.tolist()]


def json_text(results: Results) -> str:
    """Everything but the trajectories; what does not apply is null."""
    settings = results.settings
    content = {
        **results.provenance,
        "settings": settings.as_written(),
        "seeds": settings.seed_list(),
        "tasks": {name: facts(info, results.episodes(name)) for name, info in results.tasks.items()},
        "hardware": {name: machine.sentences(results.arguments_of(name), results.surface) for name in results.hardware},
        "results": [asdict(row) for row in results.rows],
        "comparisons": [asdict(each) for each in results.comparisons],
        **({} if results.effects is None else {"effects": results.effects.as_values()}),
        **({} if results.cost is None else {"cost_per_period": results.cost.as_values()}),
        "episodes": [one for trial, rollout in results.rollouts.items() for one in episodes_of(trial, rollout)],
    }
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"


def plain(value: Any) -> Any:
    """JSON values: numbers that are not finite become None, objects their description."""
    if _missing(value):
        return None
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return value if isinstance(value, str | int | float | bool | None) else repr(value)


def _missing(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


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


def _cell(cell: Cell) -> str:
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


def quantity(value: float, factor: float, digits: int, unit: str) -> str:
    """A number >= 0 with its unit, in ``digits`` decimals or one from 10 up.

    A dash stands for what does not apply, "< 0.01" for what is small but not zero.
    """
    if _missing(value):
        return "–"
    text, space = number(factor * value, digits), "" if unit in ("°", "") else " "
    if value > 0.0 and float(text) == 0.0:
        text = f"< {10.0**-digits:.{digits}f}"
    return f"{text}{space}{unit}"


def number(value: float, digits: int) -> str:
    """A number >= 0 in ``digits`` decimals, or one at most from 10 up; a dash for what does not apply."""
    return "–" if math.isnan(value) else f"{value:.{digits if value < 9.995 else min(digits, 1)}f}"


def markdown(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "\n".join([_line(heads), _line("-" * len(each) for each in heads), *map(_line, lines)])


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
