"""The page of the report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from tqdm import tqdm

from agents import parallel
from agents.evaluation import films, pages, plots
from agents.evaluation.pages import colour, data_address
from agents.evaluation.report_rows import (
    KINDS,
    LOAD_HEADS,
    Row,
    against_best,
    best_row,
    by_case,
    cell,
    effects_rows,
    kind_of,
    load_cells,
    load_rows,
)
from agents.evaluation.run import Results, described
from agents.evaluation.table import BY_NAME, number, percent
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks.base import HOLD_PERIODS

OPEN_BELOW = 0.95
"""Success rate of its best policy below which a task is open."""

HEADS = {
    "fallen": "Fallen",
    "steps_per_second": "Steps per second",
    "parts_done_mean": "Parts done",
    "path_efficiency_median": "Path efficiency",
}
"""Heads of columns that differ from the labels of :data:`agents.evaluation.table.QUANTITIES`."""


def page(results: Results, found: Sequence[Row], gaps: Sequence[Row], quiet: bool = False) -> str:
    """Return the page as HTML."""
    settings, infos = results.settings, results.tasks
    goals = [task for task, info in infos.items() if info.has_goal]
    flows = [task for task, info in infos.items() if info.flows]
    together = [task for task in infos if task not in goals and task not in flows]
    best = {(row["task"], row["hardware"]): row for row in found}
    best = {place: best_row(results, found, *place) for place in best}
    cards = _cards(results, found, quiet)
    most = {each.name: each.episodes for each in settings.hardware_entries()}
    tasks = {
        task: {
            "name": task,
            "info": info,
            "episodes": len(settings.seed_list(task)),
            "inventory": pages.inventory(info.parts),
            "criterion": pages.success_criterion(info),
            "sections": [
                {
                    "hardware": hardware,
                    "episodes": len(settings.seed_list(task, most[hardware])),
                    "cards": [each for each in cards if each["place"] == (task, hardware)],
                    "arrivals": data_address(plots.arrivals(results, task, hardware)),
                }
                for name, hardware in best
                if name == task
            ],
        }
        for task, info in infos.items()
    }
    tables = [
        {
            "title": kind.title,
            "success": name != "flows",
            "columns": {each: HEADS.get(each) or BY_NAME[each].label.capitalize() for each in kind.columns},
            "tasks": [tasks[task] for task in names],
        }
        for name, kind in KINDS.items()
        if (names := [task for task, info in infos.items() if kind_of(info) == name])
    ]
    environments = [settings.environments()[name].get("actuators", "ideal") for name in results.hardware_of()]
    leading = [best[task, hardware] for hardware in results.hardware_of() for task in infos if (task, hardware) in best]
    load, policies = load_rows(results), described(results)
    return pages.render(
        "report.html.j2",
        **pages.common(results),
        rows={(row["task"], row["hardware"], row["policy"]): row for row in found},
        best=best,
        leading=leading,
        open=[row for row in leading if row["task"] not in flows and row["success_rate"] < OPEN_BELOW],
        open_below=OPEN_BELOW,
        anchor=anchor,
        cell=cell,
        figures=lambda row: _figures(row, infos[row["task"]].flows),
        surface=next(iter(infos.values())).surface,
        policies=policies,
        names=[each.name for each in settings.entries() if each.name in policies],
        goals=goals,
        together=together,
        flows=flows,
        load=load,
        load_plot=data_address(plots.throughput(load)) if load else "",
        load_heads=LOAD_HEADS,
        load_cells=load_cells,
        following=any(info.goal_moves for info in infos.values()),
        several=any(len(info.parts) > 1 for info in infos.values()),
        step_time=next(iter(infos.values())).step_time,
        hold=HOLD_PERIODS,
        shown=plots.SHOWN,
        mapped=plots.MAPPED,
        watched_among=films.WATCHED_AMONG,
        turn_weight=1e3 * films.TURN_WEIGHT,
        threads=results.provenance["machine"]["cores"] // parallel.usable(settings.processes),
        tasks=list(tasks.values()),
        tables=tables,
        prototype=any((each["kind"] if isinstance(each, Mapping) else each) == "prototype" for each in environments),
        effects=_effects(results),
        comparisons=against_best(results, gaps, best),
        examples=[_example(results, found, best, each) for each in (goals, together, flows) if each]
        if settings.animations
        else [],
        colours={name: plots.policy_colour(results, name) for name in policies},
    )


def _cards(results: Results, found: Sequence[Row], quiet: bool) -> list[dict[str, Any]]:
    """Draw the pictures of every policy on every task and hardware; return its card for each row of ``found``."""
    places = [(row["task"], row["hardware"]) for row in found]
    rollouts = [results.rollout(*place, row["policy"]) for place, row in zip(places, found, strict=True)]
    infos = [results.tasks[task] for task, _ in places]
    sceneries, animated = [results.scenery[task] for task, _ in places], [results.settings.animations] * len(found)
    with tqdm(total=len(found), desc="drawing", unit="run", disable=quiet) as bar:
        items = list(zip(rollouts, infos, sceneries, animated, strict=True))
        pictures = parallel.run(_pictures, items, workers=results.settings.processes, done=bar.update)
    return [
        {"place": place, "row": row, "seed": each.film.seed, "outcome": _outcome(each.film, info), **drawn}
        for place, row, each, info, drawn in zip(places, found, rollouts, infos, pictures, strict=True)
    ]


def _pictures(rollout: films.Rollout, info: TaskInfo, scenery: Any, animated: bool) -> dict[str, Any]:
    """Draw the plot and the film of one policy on one task."""
    plot = data_address(plots.trajectories(rollout, info, scenery))
    if not animated:
        return {"plot": plot, "film": None}
    film = films.film_gif(rollout.film, scenery, rollout.step_time, films.PAGE)
    return {"plot": plot, "film": data_address(film, "gif")}


def anchor(row: Row) -> str:
    """Return the id of a card."""
    return "-".join(("card", row["task"], row["hardware"], row["policy"])).replace(" ", "_")


def _outcome(film: films.Film, info: TaskInfo) -> str:
    if info.has_goal:
        one = len(info.parts) == 1
        verb = ("reaches", "does not reach") if one else ("reach", "do not all reach")
        part, goal = ("part", "goal") if one else ("parts", "goals")
        return f"the {part} {verb[0] if film.success else verb[1]} the {goal}"
    if info.flows:
        return f"{info.step_limit} steps of {len(info.parts)} parts that come and go"
    parts = int(film.present[0].sum())
    return f"all {parts} parts are done" if film.success else f"{film.done:.0f} of {parts} parts are done at the end"


def _figures(row: Row, flows: bool) -> dict[str, Any]:
    """Return the large and small figure of a cell of the first table, its sort key and its colour."""
    if flows:
        share, good = row["rate_over_bound_mean"], row["good_per_minute_mean"]
        known = math.isfinite(share)
        large, small = f"{number(good, 1)} / min", f"{100 * share:.0f} % of bound" if known else ""
        rank, tint = good, colour(min(share, 1.0) if known else 0.5)
    else:
        rate, ratio, time = row["success_rate"], row["time_over_bound_median"], row["time_to_goal_median_s"]
        large = f"{100 * rate:g} %" if rate in (0.0, 1.0) else f"{percent(row)} %"
        rank, tint = rate, colour(rate)
        small = (
            f"{number(ratio, 2)} ×" if math.isfinite(ratio) else f"{number(time, 2)} s" if math.isfinite(time) else ""
        )
    return {"large": large, "small": small, "rank": f"{rank:.6g}" if math.isfinite(rank) else "", "colour": tint}


def _effects(results: Results) -> dict[str, Any] | None:
    """Return the section on the study of effects."""
    asked, cells = results.settings.effects, effects_rows(results)
    if asked is None:
        return None
    names = [each.name for each in results.settings.entries()]
    return {
        "task": asked.task,
        "episodes": cells[0]["episodes"],
        "policies": list(dict.fromkeys(cell["policy"] for cell in cells)),
        "rows": [
            {"case": case, "summary": pages.as_yaml(asked.cases[case], flow=True), "cells": those}
            for case, those in by_case(cells)
        ],
        "own": [
            {"name": each.name, "sensor": pages.as_yaml(each.sensor, flow=True)}
            for each in asked.columns("evaluation.effects", names)
            if each.sensor
        ],
    }


def _example(results: Results, found: Sequence[Row], best: Mapping[tuple[str, str], Row], tasks: Sequence[str]) -> str:
    """Draw a large picture: of policies that succeed at times, the film whose elements vary most half way to the goal."""
    chosen: list[tuple[tuple[bool, float], films.Film, int, str]] = []
    for row in found:
        place = row["task"], row["hardware"]
        if row["task"] in tasks and (row["success_rate"] >= plots.WORTH_SHOWING or best[place] is row):
            film, radius = results.rollout(*place, row["policy"]).film, results.tasks[row["task"]].parts[0].radius
            moved = (film.poses - film.poses[0])[..., :2]
            there = film.present & film.present[0]
            travelled = np.where(there, np.hypot(moved[..., 0], moved[..., 1]), 0.0).sum(axis=1)
            frame = int((travelled >= 0.5 * travelled.max()).argmax())
            variety = bool(travelled[frame] > radius), float(film.phasors[frame].var(axis=(0, 1)).sum())
            chosen.append((variety, film, frame, row["task"]))
    _, film, frame, task = max(chosen, key=lambda each: each[0])
    scenery = results.scenery[task]
    return data_address(films.png(films.picture(film, scenery, frame, films.painter_for(scenery, 1064))))
