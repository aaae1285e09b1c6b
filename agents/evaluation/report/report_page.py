"""The report's page: one HTML file that needs nothing else."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from tqdm import tqdm

from agents.evaluation import animation, machine, words
from agents.evaluation.entries import laid_over
from agents.evaluation.film import packed, script
from agents.evaluation.log import TURN_WEIGHT, WATCHED_AMONG, Film, Rollout
from agents.evaluation.pages import data_address, render
from agents.evaluation.quantities import BY_NAME, QUANTITIES, RATES
from agents.evaluation.records import Row, Trial
from agents.evaluation.report import cost_figure, plots_of_episodes
from agents.evaluation.report.answers import anchor, answers, best_row
from agents.evaluation.report.load import Load
from agents.evaluation.report.load import draw as draw_load
from agents.evaluation.report.results import Results
from agents.evaluation.report.texts_of_results import LOAD_HEADS, kind_of, load_cells
from agents.evaluation.statistics import PairedComparison
from agents.evaluation.tables import WORTH_SHOWING, number, plain, seeds_text, signed, thousands
from agents.workers import side_by_side, usable
from vibgym.policies.task_info import TaskInfo
from vibgym.rendering import Scenery
from vibgym.tasks.base import HOLD_PERIODS

TABLES = (
    (
        "",
        "goals",
        ("time_to_goal_median_s", "time_over_bound_median", "position_error_median_m", "heading_error_median_rad",
         "fallen", "steps_per_second"),
    ),
    (
        "Paths",
        "paths",
        ("time_to_goal_median_s", "path_error_median_m", "heading_error_median_rad", "fallen", "steps_per_second"),
    ),
    (
        "Several parts with goals of their own",
        "patterns",
        ("time_to_goal_median_s", "time_over_bound_median", "collisions_mean", "pattern_error_median_m", "coverage_median",
         "position_error_median_m", "fallen"),
    ),
    (
        "Parts that come and go, parts a minute",
        "flows",
        ("rate_over_bound_mean", *(f"{name}_mean" for name in RATES), "transit_mean_s", "on_table_mean"),
    ),
    (
        "Several parts",
        "together",
        ("time_to_goal_median_s", "throughput_median_parts_per_s", "parts_done_mean", "collisions_mean",
         "path_efficiency_median", "position_error_median_m", "fallen"),
    ),
)  # fmt: skip
"""Title, kind of tasks (see :func:`.texts_of_results.kind_of`), and columns of results.csv."""

HEADS = {
    "fallen": "Fallen",
    "steps_per_second": "Steps per second",
    "parts_done_mean": "Parts done",
    "path_efficiency_median": "Path efficiency",
}
"""Of columns that :data:`agents.evaluation.quantities.QUANTITIES` does not have, or calls otherwise."""


def page(results: Results, quiet: bool = False) -> str:
    """The whole page as HTML."""
    settings, surface, infos = results.settings, results.surface, results.tasks
    goals = [task for task, info in infos.items() if info.has_goal]
    flows = [task for task, info in infos.items() if info.flows]
    together = [task for task in infos if task not in goals and task not in flows]
    sections, examples = _drawn(results, (goals, together, flows), quiet)
    tasks = {
        task: {
            "name": task,
            "info": info,
            "episodes": results.episodes(task),
            "inventory": words.inventory(info.parts),
            "asked": words.asked(info),
            "sections": sections[task],
        }
        for task, info in infos.items()
    }
    tables = [
        {
            "title": title,
            "success": kind != "flows",
            "columns": {name: HEADS.get(name) or BY_NAME[name].label.capitalize() for name in columns},
            "tasks": [tasks[task] for task in names],
        }
        for title, kind, columns in TABLES
        if (names := [task for task, info in infos.items() if kind_of(info) == kind])
    ]
    return render(
        Path(__file__).with_name("report.html.j2"),
        results=results,
        answers=answers(results),
        film_script=Markup(script()),
        settings=settings,
        surface=surface,
        loads=words.loads({task: (info, results.episodes(task)) for task, info in infos.items()}),
        goals=goals,
        together=together,
        flows=flows,
        load=None if results.load is None else _load(results.load),
        following=any(info.goal_moves for info in infos.values()),
        several=any(len(info.parts) > 1 for info in infos.values()),
        confidence=f"{100 * settings.confidence:g} %",
        seeds=seeds_text(settings.seed_list()),
        step_time=next(iter(infos.values())).step_time,
        hold=HOLD_PERIODS,
        shown=plots_of_episodes.SHOWN,
        mapped=plots_of_episodes.MAPPED,
        watched_among=WATCHED_AMONG,
        turn_weight=1e3 * TURN_WEIGHT,
        threads=results.provenance["machine"]["cores"] // usable(settings.processes),
        tasks=list(tasks.values()),
        tables=tables,
        hardware=results.hardware,
        machines=machine.cards({name: results.arguments_of(name) for name in results.hardware}, surface),
        prototype=any(_kind(results.arguments_of(name)) == "prototype" for name in results.hardware),
        effects=None if results.effects is None else _effects(results),
        comparisons=[_compared(each) for each in against_best(results)],
        examples=examples,
        colours={name: plots_of_episodes.policy_colour(results, name) for name in results.policies},
        cost=None if results.cost is None else cost_figure.section(results.cost),
        settings_text=json.dumps(plain(settings.as_written()), indent=2),
    )


def _drawn(results: Results, kinds: Sequence[Sequence[str]], quiet: bool) -> tuple[dict[str, list[Any]], list[str]]:
    """Everything that takes time to draw: sections of every task, and an example of each kind of tasks."""
    settings, trials = results.settings, list(results.rollouts)
    places = [(task, hardware) for task in results.tasks for hardware in results.hardware_of(task)]
    with side_by_side(settings.processes) as submit:
        drawn = []
        for trial in tqdm(trials, desc="drawing", unit="pair", disable=quiet or usable(settings.processes) > 1):
            asked = (results.tasks[trial.task], results.scenery[trial.task], settings.animations)
            drawn.append(submit(_pictures, results.rollouts[trial], *asked))
        arrivals = {place: data_address(plots_of_episodes.arrivals(results, *place)) for place in places}
        examples = [_example(results, tasks) for tasks in kinds if tasks and settings.animations]
        cards: dict[tuple[str, str], list[dict[str, Any]]] = {place: [] for place in places}
        for row, pictures in zip(results.rows, drawn, strict=True):
            cards[row.task, row.hardware].append(_card(results, row) | pictures.result())
    sections: dict[str, list[Any]] = {task: [] for task in results.tasks}
    for task, hardware in places:
        shown = {"cards": cards[task, hardware], "arrivals": arrivals[task, hardware]}
        sections[task].append({"hardware": hardware, "episodes": results.episodes(task, hardware), **shown})
    return sections, examples


def _kind(environment: Mapping[str, Any]) -> str:
    """Of the actuators."""
    actuators = environment.get("actuators", "ideal")
    return actuators["kind"] if isinstance(actuators, Mapping) else actuators


def _card(results: Results, row: Row) -> dict[str, Any]:
    """What the table's row and the card of one policy on one task say; ``cells`` are large and small text by column."""
    trial = Trial(row.task, row.hardware, row.policy)
    film, info = results.rollouts[trial].film, results.tasks[row.task]
    return {
        "row": row,
        "anchor": anchor(row),
        "cells": {
            **{
                each.name: (each.text(row).replace(" deg", "°"), each.middle_half(row))
                for each in QUANTITIES
                if each.median
            },
            **{each.name: (each.text(row), None) for each in QUANTITIES if not each.median and hasattr(row, each.name)},
            "collisions_mean": (number(row.collisions_mean, 1), _millimetres(row.clearance_median_m)),
            "parts_done_mean": (number(row.parts_done_mean, 2), f"of {len(info.parts)}"),
            "fallen": (str(row.fallen), None),
            "steps_per_second": (thousands(row.steps_per_second), None),
        },
        "rates": f"policy {thousands(row.policy_steps_per_second)}, "
        f"environment {thousands(row.environment_steps_per_second)}",
        "seed": film.seed,
        "outcome": _outcome(film, info),
        "headline": f"{number(row.good_per_minute_mean, 1)} a minute" if info.flows else f"{row.percent} %",
    }


def _pictures(rollout: Rollout, info: TaskInfo, scenery: Scenery, animated: bool) -> dict[str, Any]:
    """The plot of one policy on one task, and its film with the picture that stands there until it is played."""
    found: dict[str, Any] = {"plot": data_address(plots_of_episodes.trajectories(rollout, info, scenery)), "film": None}
    if animated:
        still, size = animation.still(rollout.film, scenery)
        moving = packed(rollout.film, scenery, rollout.step_time)
        found |= {"film": moving, "still": data_address(still), "size": size, "said": rollout.film.captions[-1]}
    return found


def _outcome(film: Film, info: TaskInfo) -> str:
    if info.has_goal:
        verb = ("reaches", "does not reach") if len(info.parts) == 1 else ("reach", "do not all reach")
        part, goal = ("part", "goal") if len(info.parts) == 1 else ("parts", "goals")
        return f"the {part} {verb[0] if film.success else verb[1]} the {goal}"
    if info.flows:
        return f"{info.step_limit} steps of {len(info.parts)} parts that come and go"
    parts = int(film.present[0].sum())
    return f"all {parts} parts are done" if film.success else f"{film.done:.0f} of {parts} parts are done at the end"


def _millimetres(value: float) -> str:
    """With its sign: negative is an overlap."""
    return "–" if not math.isfinite(value) else f"{signed(1e3 * value, 2).removeprefix('+')} mm"


def against_best(results: Results) -> list[PairedComparison]:
    """Comparisons of the best policy on every task and hardware with each other one, the best one first."""
    found = []
    for each in results.comparisons:
        if results.tasks[each.task].flows:  # they know no success
            continue
        best = best_row(results, each.task, each.hardware).policy
        if best == each.first:
            found.append(each)
        elif best == each.second:
            found.append(each.turned())
    return found


def _effects(results: Results) -> dict[str, Any]:
    """The section on which effect breaks whom."""
    effects = results.effects
    assert effects is not None
    own: dict[str, list[str]] = {}  # what the sensors of some policies have besides -> these policies
    for column in results.settings.effects.columns(list(results.policies)):  # type: ignore[union-attr]
        if column.sensor:
            said = machine.settings_of_sensor(column.sensor, results.surface)
            own.setdefault(said, []).append(column.name)
    environments = {case: laid_over(results.settings.environment, own) for case, own in effects.cases.items()}
    return {
        "task": effects.task,
        "episodes": len(effects.seeds),
        "policies": effects.policies,
        "rows": [
            {
                "case": case,
                "summary": machine.summary(environments[case], results.surface),
                "cells": [cell.shaded(cell.time_to_goal_median_s) for cell in cells],
            }
            for case, cells in effects.rows()
        ],
        "own": [{"names": words.joined(names), "words": said} for said, names in own.items()],
    }


def _load(load: Load) -> dict[str, Any]:
    """The section on parts a minute against the number of parts."""
    rows = [{"row": row, "cells": load_cells(row)} for row in load.rows]
    return {
        "task": load.task,
        "episodes": load.episodes,
        "plot": data_address(draw_load(load)),
        "rows": rows,
        "heads": LOAD_HEADS,
    }


def _compared(each: PairedComparison) -> dict[str, Any]:
    low, high = 100 * each.success_interval.low, 100 * each.success_interval.high
    time = each.time_interval
    return {
        "task": each.task,
        "hardware": each.hardware,
        "first": each.first,
        "second": each.second,
        "success": signed(100 * each.success_difference, 1),
        "success_interval": f"{signed(low, 1)} to {signed(high, 1)}",
        "success_clear": low > 0.0 or high < 0.0,
        "both": each.both,
        "time": f"{signed(each.time_difference, 2)} s" if each.both else "–",
        "time_interval": "" if time is None else f"{signed(time.low, 2)} to {signed(time.high, 2)}",
        "time_clear": time is not None and (time.low > 0.0 or time.high < 0.0),
    }


def _example(results: Results, tasks: Sequence[str]) -> str:
    """A large picture for the reading aid: of the policies that ever work, the film with the most varied field."""
    best = {
        Trial(task, hardware, best_row(results, task, hardware).policy)
        for task in tasks
        for hardware in results.hardware_of(task)
    }
    frames: dict[Trial, int] = {}
    variety: dict[Trial, tuple[bool, float]] = {}
    for row in results.rows:
        trial = Trial(row.task, row.hardware, row.policy)
        if row.task in tasks and (row.success_rate >= WORTH_SHOWING or trial in best):
            film, radius = results.rollouts[trial].film, results.tasks[row.task].parts[0].radius
            # Half way there: the lines behind the parts show, and the goals are still free, if the task moves them at all.
            way = (film.poses - film.poses[0])[..., :2]
            travelled = np.where(film.present & film.present[0], np.hypot(way[..., 0], way[..., 1]), 0.0).sum(axis=1)
            frames[trial] = frame = int((travelled >= 0.5 * travelled.max()).argmax())
            moved = bool(travelled[frame] > radius)
            variety[trial] = (moved, float(film.phasors[frame].var(axis=(0, 1)).sum()))
    chosen = max(variety, key=lambda trial: variety[trial])
    film, scenery = results.rollouts[chosen].film, results.scenery[chosen.task]
    shown = animation.picture(film, scenery, frames[chosen], animation.painter_for(scenery, 1064))
    return data_address(animation.png(shown))
