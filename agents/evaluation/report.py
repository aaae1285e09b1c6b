"""The report: ``python -m agents evaluate CONFIG`` writes report.html, results.csv, episodes.csv and results.json."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from tqdm import tqdm

from agents import parallel
from agents.evaluation import films, pages, plots
from agents.evaluation.pages import colour, data_address
from agents.evaluation.plots import WORTH_SHOWING
from agents.evaluation.run import Prepared, Results, described, effects_runs, load_runs, main_runs, writable
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.statistics import interval_of, paired, quartiles
from agents.evaluation.table import (
    BY_NAME,
    EFFECTS,
    ENDS,
    LOAD,
    METRICS,
    QUANTITIES,
    RATES,
    REPORT,
    Place,
    ends,
    markdown,
    number,
    percent,
    percent_between,
    quantity,
    signed,
    spread,
    successes,
    summary,
)
from vibgym import checks
from vibgym.files import csv_text, output_files, write_together
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks.base import HOLD_PERIODS

FILES = ("results.csv", "episodes.csv", "results.json", "report.html")

OPEN_BELOW = 0.95
"""Success rate of its best policy below which a task is open."""

Row = Mapping[str, Any]


class Gif(NamedTuple):
    """Film to be written as a GIF file: of one policy on one task, by default on its first hardware."""

    task: str
    policy: str
    path: Path
    hardware: str | None = None


class Kind(NamedTuple):
    """Columns for one kind of tasks.

    Attributes:
        title: of its table on the page.
        summary: figures in Markdown, besides success and time to goal.
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

HEADS = {
    "fallen": "Fallen",
    "steps_per_second": "Steps per second",
    "parts_done_mean": "Parts done",
    "path_efficiency_median": "Path efficiency",
}
"""Heads of columns that differ from the labels of :data:`agents.evaluation.table.QUANTITIES`."""


def kind_of(task: TaskInfo) -> str:
    """Return the kind of a task, one of :data:`KINDS`."""
    if task.flows:
        return "flows"
    if not task.has_goal:
        return "together"
    return "paths" if task.goal_moves else "goals" if len(task.parts) == 1 else "patterns"


def prepare(settings: EvaluationSettings, gif: Gif | None = None) -> Prepared:
    """Build everything that can fail for bad input, before anything runs.

    Raises:
        ValueError: a bad environment setting, an unknown or unfitting policy, or a place that cannot be written to.
    """
    tasks, scenery, runs = main_runs(settings)
    runs += [*effects_runs(settings), *load_runs(settings)]
    film = None if gif is None else (_filmed(gif, [run.place for run in runs if run.place.study == REPORT]), gif.path)
    writable(settings, FILES)
    if gif is not None and gif.path.resolve() in [(Path(settings.output) / name).resolve() for name in FILES]:
        raise checks.refuse("--gif PATH", str(gif.path), "different from the files of the report")
    return Prepared(settings, tasks, tuple(runs), scenery, film=film)


def _filmed(gif: Gif, places: Sequence[Place]) -> Place:
    """Return the place whose film is wanted, checked."""
    checks.choice("--gif TASK", gif.task, tuple(dict.fromkeys(place.task for place in places)))
    some = [place for place in places if place.task == gif.task]
    if gif.hardware is not None:
        checks.choice("--gif-hardware", gif.hardware, tuple(dict.fromkeys(place.hardware for place in some)))
        some = [place for place in some if place.hardware == gif.hardware]
    checks.choice("--gif POLICY", gif.policy, tuple(dict.fromkeys(place.policy for place in some)))
    output_files([gif.path], "--gif PATH")
    return next(place for place in some if place.policy == gif.policy)


def rows(results: Results) -> list[dict[str, Any]]:
    """Return the rows of results.csv: statistics of every policy on every task and hardware."""
    settings, found = results.settings, []
    for place, table in results.table.where(study=REPORT).places().items():
        overall, policy, environment = results.rollouts[place, None].timing.rates()
        rates = {
            "steps_per_second": overall,
            "policy_steps_per_second": policy,
            "environment_steps_per_second": environment,
        }
        labels = {name: value for name, value in place._asdict().items() if name != "study"}
        found.append({**labels, **summary(table, settings.confidence, settings.resamples), **rates})
    return found


def effects_rows(results: Results) -> list[dict[str, Any]]:
    """Return the cells of the study of effects, case after case."""
    settings, found = results.settings, []
    for place, table in results.table.where(study=EFFECTS).places().items():
        cell = successes(table.by_run("success") > 0.0, settings.confidence, settings.resamples)
        found.append(
            {
                "case": place.hardware,
                "policy": place.policy,
                **cell,
                **spread("time_to_goal", table["time_to_goal_s"], "_s"),
                "position_error_median_m": quartiles(table["position_error_m"]).median,
                "heading_error_median_rad": quartiles(table["heading_error_rad"]).median,
                "fallen": int(table["fallen"].sum()),
            }
        )
    return found


def load_rows(results: Results) -> list[dict[str, Any]]:
    """Return the rows of the study of throughput: means a minute by policy and number of parts."""
    settings, found = results.settings, []
    for place, table in results.table.where(study=LOAD).places().items():
        good = interval_of(table["good_per_minute"][None], settings.confidence, settings.resamples)
        found.append(
            {
                "policy": place.policy,
                "parts": int(place.hardware),
                "episodes": len(table),
                "bound": float(results.rollouts[place, None].rate_bound[0]),
                **{event: float(table[name].mean()) for name, event in RATES.items()},
                **ends("good", good),
                "transit_s": float(table["transit_s"].mean()),
                "on_table": float(table["on_table"].mean()),
            }
        )
    return found


def comparisons(results: Results, quiet: bool = True) -> list[dict[str, Any]]:
    """Return paired differences of every two policies on the same task and hardware."""
    places = [run.place for run in results.prepared.runs if run.place.study == REPORT]
    pairs = [pair for pair in itertools.combinations(places, 2) if pair[0][:3] == pair[1][:3]]
    found, settings = [], results.settings
    for one, other in tqdm(pairs, desc="comparing policies", unit="pair", disable=quiet):
        first, second = results.rollouts[one, None], results.rollouts[other, None]
        gap = paired(first, second, settings.confidence, settings.resamples)
        labels = {"task": one.task, "hardware": one.hardware, "first": one.policy, "second": other.policy}
        found.append({**labels, "episodes": len(first.seeds), **gap})
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


def summary_table(results: Results, found: Sequence[Row] | None = None) -> str:
    """Return the tables of the command in Markdown, one for each kind of tasks and study."""
    found = rows(results) if found is None else found
    several = len(results.hardware_of()) > 1
    level = f"{100 * results.settings.confidence:g} % interval"
    head, succeed = ("task", *(["hardware"] if several else []), "policy"), ("success", level, "time to goal")
    tables = []
    for name, kind in KINDS.items():
        flows, lines = name == "flows", []
        for row in found:
            if kind_of(results.tasks[row["task"]]) == name:
                where = [row["task"], *([row["hardware"]] if several else []), row["policy"]]
                success = [f"{percent(row)} %", f"{percent_between(row)} %", BY_NAME["time_to_goal_median_s"].text(row)]
                more = [_ending(each, row) for each in kind.summary]
                lines.append([*where, *([] if flows else success), *more, *([] if flows else [str(row["fallen"])])])
        if lines:
            labels = [BY_NAME[each].label for each in kind.summary]
            tables.append(
                markdown([*head, *([] if flows else succeed), *labels, *([] if flows else ["fallen"])], lines)
            )
    effects = effects_rows(results)
    if effects:
        policies = list(dict.fromkeys(cell["policy"] for cell in effects))
        lines = [[case, *map(_effect, cells)] for case, cells in _by_case(effects).items()]
        tables.append(markdown((f"{results.settings.effects.task}: effect", *policies), lines))
    load = load_rows(results)
    if load:
        lines = [[str(row["parts"]), row["policy"], *load_cells(row)] for row in load]
        tables.append(markdown((f"{results.settings.under_load.task}: parts", "policy", *LOAD_HEADS), lines))
    return "\n\n".join(tables)


def _ending(name: str, row: Row) -> str:
    return number(row["collisions_mean"], 1) if name == "collisions_mean" else BY_NAME[name].text(row)


def _effect(cell: Row) -> str:
    time = f" ({quantity(cell['time_to_goal_median_s'], 1.0, 2, 's')})" if cell["successes"] else ""
    return f"{percent(cell)} %{time}"


def _by_case(cells: Sequence[Row]) -> dict[str, list[Row]]:
    found: dict[str, list[Row]] = {}
    for cell in cells:
        found.setdefault(cell["case"], []).append(cell)
    return found


LOAD_HEADS = ("good", *list(RATES.values())[1:], "bound", "transit", "on the table")


def load_cells(row: Row) -> list[str]:
    """Return the cells of a row of the study of throughput, see :data:`LOAD_HEADS`."""
    rates = [number(row[event], 1) for event in RATES.values()]
    return [*rates, number(row["bound"], 0), quantity(row["transit_s"], 1.0, 2, "s"), number(row["on_table"], 1)]


def write(results: Results, quiet: bool = False) -> Path:
    """Write report.html, results.csv, episodes.csv, results.json and the film that was asked for; return the page's path.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    directory, found, gaps = Path(results.settings.output), rows(results), comparisons(results, quiet)
    labels = ("task", "hardware", "policy", "seed")
    episodes = results.table.where(study=REPORT).records((*labels, *METRICS))
    more: dict[str, Any] = {
        "comparisons": [{key: asdict(value) if hasattr(value, "interval") else value for key, value in each.items()}
                        for each in gaps]
    }  # fmt: skip
    if results.settings.effects is not None:
        table = results.table.where(study=EFFECTS)
        cases = {case: each for case, each in results.settings.effects.cases.items()}
        each = [{"case": one.pop("hardware"), **one} for one in table.records(("hardware", "policy", "seed", *ENDS))]
        head = {"task": results.settings.effects.task, "seeds": table["seed"].tolist(), "cases": cases}
        head["seeds"] = list(dict.fromkeys(head["seeds"]))
        more["effects"] = {**head, "results": effects_rows(results), "episodes": each}
    if results.settings.under_load is not None:
        more["load"] = {"task": results.settings.under_load.task, "results": load_rows(results)}
    contents: dict[Path, str | bytes] = dict(
        zip(
            [directory / name for name in FILES],
            (
                csv_text(found),
                csv_text(episodes),
                pages.json_text(results, found, {**more, "episodes": episodes}),
                page(results, found, gaps, quiet),
            ),
            strict=True,
        )
    )
    if results.prepared.film is not None:
        place, path = results.prepared.film
        rollout = results.rollouts[place, None]
        contents[path] = films.film_gif(rollout.film, results.prepared.scenery[place.task], rollout.step_time)
    write_together(contents)
    return directory / FILES[-1]


def page(results: Results, found: Sequence[Row], gaps: Sequence[Row], quiet: bool = False) -> str:
    """Return the page as HTML."""
    settings, infos = results.settings, results.tasks
    goals = [task for task, info in infos.items() if info.has_goal]
    flows = [task for task, info in infos.items() if info.flows]
    together = [task for task in infos if task not in goals and task not in flows]
    best = {(row["task"], row["hardware"]): row for row in found}
    best = {place: best_row(results, found, *place) for place in best}
    sections, examples = _drawn(results, found, best, (goals, together, flows), quiet)
    policies = described(results.prepared)
    tasks = {
        task: {
            "name": task,
            "info": info,
            "episodes": len(settings.seed_list(task)),
            "inventory": pages.inventory(info.parts),
            "criterion": pages.success_criterion(info),
            "sections": sections[task],
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
    return pages.render(
        "report.html.j2",
        **pages.common(results),
        answers=_answers(results, found, best),
        film_script=Markup(films.script()),
        surface=results.surface,
        policies=policies,
        goals=goals,
        together=together,
        flows=flows,
        load=_load(results),
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
        comparisons=[_compared(each) for each in against_best(results, gaps, best)],
        examples=examples,
        colours={name: plots.policy_colour(results, name) for name in policies},
    )


def _drawn(
    results: Results,
    found: Sequence[Row],
    best: Mapping[tuple[str, str], Row],
    kinds: Sequence[Sequence[str]],
    quiet: bool,
) -> tuple[dict[str, list[Any]], list[str]]:
    """Draw all pictures; return the sections of every task, and an example picture for each kind of tasks."""
    settings, scenery = results.settings, results.prepared.scenery
    items = [
        (_rollout(results, row), results.tasks[row["task"]], scenery[row["task"]], settings.animations) for row in found
    ]
    with tqdm(total=len(items), desc="drawing", unit="run", disable=quiet) as bar:
        drawn = parallel.run(_pictures, items, workers=settings.processes, done=bar.update)
    arrivals = {place: data_address(plots.arrivals(results, *place)) for place in best}
    examples = [_example(results, found, best, tasks) for tasks in kinds if tasks and settings.animations]
    cards: dict[tuple[str, str], list[dict[str, Any]]] = {place: [] for place in best}
    for row, pictures in zip(found, drawn, strict=True):
        cards[row["task"], row["hardware"]].append(_card(results, row) | pictures)
    most = {each.name: each.episodes for each in settings.hardware_entries()}
    sections: dict[str, list[Any]] = {task: [] for task in results.tasks}
    for (task, hardware), shown in cards.items():
        episodes = len(settings.seed_list(task, most[hardware]))
        each = {"hardware": hardware, "episodes": episodes, "cards": shown, "arrivals": arrivals[task, hardware]}
        sections[task].append(each)
    return sections, examples


def _rollout(results: Results, row: Row) -> films.Rollout:
    return results.rollout(row["task"], row["hardware"], row["policy"])


def anchor(row: Row) -> str:
    """Return the id of a card."""
    return "-".join(("card", row["task"], row["hardware"], row["policy"])).replace(" ", "_")


def _card(results: Results, row: Row) -> dict[str, Any]:
    """Return row and card of one policy on one task; ``cells`` are large and small text by column."""
    film, info = _rollout(results, row).film, results.tasks[row["task"]]
    clearance = row["clearance_median_m"]
    shown = "–" if math.isnan(clearance) else f"{signed(1e3 * clearance, 2).removeprefix('+')} mm"
    cells = {
        each.name: (each.text(row).replace(" deg", "°"), each.middle_half(row))
        for each in QUANTITIES
        if each.name in row
    }
    return {
        "row": row,
        "anchor": anchor(row),
        "cells": {
            **cells,
            "collisions_mean": (number(row["collisions_mean"], 1), shown),
            "parts_done_mean": (number(row["parts_done_mean"], 2), f"of {len(info.parts)}"),
            "fallen": (str(row["fallen"]), None),
            "steps_per_second": (pages.thousands(row["steps_per_second"]), None),
        },
        "rates": f"policy {pages.thousands(row['policy_steps_per_second'])}, "
        f"environment {pages.thousands(row['environment_steps_per_second'])}",
        "seed": film.seed,
        "outcome": _outcome(film, info),
        "headline": f"{number(row['good_per_minute_mean'], 1)} a minute" if info.flows else f"{percent(row)} %",
    }  # fmt: skip


def _pictures(rollout: films.Rollout, info: TaskInfo, scenery: Any, animated: bool) -> dict[str, Any]:
    """Draw the plot of one policy on one task, and pack its film with a still picture."""
    found: dict[str, Any] = {"plot": data_address(plots.trajectories(rollout, info, scenery)), "film": None}
    if animated:
        still, size = films.still(rollout.film, scenery)
        moving = films.packed(rollout.film, scenery, rollout.step_time)
        found |= {"film": moving, "still": data_address(still), "size": size, "caption": rollout.film.captions[-1]}
    return found


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


def _answers(results: Results, found: Sequence[Row], best: Mapping[tuple[str, str], Row]) -> dict[str, Any]:
    """Return the first screen: a table for every hardware model, the best policies, and the open tasks."""
    by_place = {(row["task"], row["hardware"], row["policy"]): row for row in found}
    names = list(dict.fromkeys(row["policy"] for row in found))
    names = [each.name for each in results.settings.entries() if each.name in names]
    tables = []
    for hardware in results.hardware_of():
        lines = []
        for task in results.tasks:
            if (task, hardware) in best:
                cells = [by_place.get((task, hardware, name)) for name in names]
                shown = [
                    row and {**_figures(results, row), "best": row is best[task, hardware], "to": anchor(row)} for row in cells
                ]  # fmt: skip
                lines.append({"task": task, "cells": shown})
        tables.append({"hardware": hardware, "rows": lines})
    ordered = [best[task, hardware] for hardware in results.hardware_of() for task in results.tasks
               if (task, hardware) in best]  # fmt: skip
    shown = [_best(results, row) for row in ordered]
    return {
        "policies": names,
        "tables": tables,
        "best": shown,
        "open": [each for each in shown if each["open"]],
        "limit": f"{100 * OPEN_BELOW:g} %",
    }


def _figures(results: Results, row: Row) -> dict[str, Any]:
    """Return the large and small figure of a cell and its colour."""
    if results.tasks[row["task"]].flows:
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


def _best(results: Results, row: Row) -> dict[str, Any]:
    """Return a row of the table of best policies."""
    flows = results.tasks[row["task"]].flows
    return {
        "row": row,
        "to": anchor(row),
        "rate": f"{number(row['good_per_minute_mean'], 1)} good parts a minute" if flows else f"{percent(row)} %",
        "interval": "" if flows else f"{percent_between(row)} %",
        "time": BY_NAME["time_to_goal_median_s"].text(row),
        "bound": BY_NAME["rate_over_bound_mean" if flows else "time_over_bound_median"].text(row),
        "open": not flows and row["success_rate"] < OPEN_BELOW,
    }


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


def _compared(each: Row) -> dict[str, Any]:
    success, time = each["success"], each["time"]
    low, high = 100 * success.interval.low, 100 * success.interval.high
    times = time.interval
    return {
        **{key: each[key] for key in ("task", "hardware", "first", "second", "both")},
        "success": signed(100 * success.value, 1),
        "success_interval": f"{signed(low, 1)} to {signed(high, 1)}",
        "success_clear": success.clear,
        "time": f"{signed(time.value, 2)} s" if each["both"] else "–",
        "time_interval": "" if times is None else f"{signed(times.low, 2)} to {signed(times.high, 2)}",
        "time_clear": time.clear,
    }


def shaded(cell: Row, median_time: float) -> dict[str, str]:
    """Return what a cell of a study shows, coloured by its success rate."""
    return {
        "success": f"{percent(cell)} %",
        "interval": percent_between(cell, " – "),
        "method": cell["success_interval_method"],
        "time": quantity(median_time, 1.0, 2, "s"),
        "colour": colour(cell["success_rate"]),
    }


def _effects(results: Results) -> dict[str, Any] | None:
    """Return the section on the study of effects."""
    asked, cells = results.settings.effects, effects_rows(results)
    if asked is None:
        return None
    names = [each.name for each in results.settings.entries()]
    own = [each for each in asked.columns("evaluation.effects", names) if each.sensor]
    return {
        "task": asked.task,
        "episodes": cells[0]["episodes"],
        "policies": list(dict.fromkeys(cell["policy"] for cell in cells)),
        "rows": [
            {
                "case": case,
                "summary": pages.as_yaml(asked.cases[case], flow=True) if asked.cases[case] else "",
                "cells": [shaded(cell, cell["time_to_goal_median_s"]) for cell in those],
            }
            for case, those in _by_case(cells).items()
        ],
        "own": [{"name": each.name, "sensor": pages.as_yaml(each.sensor, flow=True)} for each in own],
    }


def _load(results: Results) -> dict[str, Any] | None:
    """Return the section on the study of throughput."""
    asked, found = results.settings.under_load, load_rows(results)
    if asked is None:
        return None
    return {
        "task": asked.task,
        "episodes": max(row["episodes"] for row in found),
        "plot": data_address(plots.throughput(found)),
        "rows": [{"row": row, "cells": load_cells(row)} for row in found],
        "heads": LOAD_HEADS,
    }


def _example(results: Results, found: Sequence[Row], best: Mapping[tuple[str, str], Row], tasks: Sequence[str]) -> str:
    """Draw a large picture: of policies that succeed at times, the film whose elements vary most half way to the goal."""
    chosen: tuple[Any, ...] | None = None
    for row in found:
        place = row["task"], row["hardware"]
        if row["task"] in tasks and (row["success_rate"] >= WORTH_SHOWING or best[place] is row):
            film, radius = _rollout(results, row).film, results.tasks[row["task"]].parts[0].radius
            moved = (film.poses - film.poses[0])[..., :2]
            travelled = np.where(film.present & film.present[0], np.hypot(moved[..., 0], moved[..., 1]), 0.0).sum(
                axis=1
            )
            frame = int((travelled >= 0.5 * travelled.max()).argmax())
            variety = bool(travelled[frame] > radius), float(film.phasors[frame].var(axis=(0, 1)).sum())
            if chosen is None or variety > chosen[0]:
                chosen = variety, film, frame, row["task"]
    assert chosen is not None  # there is a best policy
    _, film, frame, task = chosen
    scenery = results.prepared.scenery[task]
    return data_address(films.png(films.picture(film, scenery, frame, films.painter_for(scenery, 1064))))
