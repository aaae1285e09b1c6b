"""The report: ``python -m agents evaluate CONFIG`` writes report.html, results.csv, episodes.csv and results.json."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from tqdm import tqdm

from agents import parallel
from agents.evaluation import films, pages, plots
from agents.evaluation.pages import colour, data_address
from agents.evaluation.run import Prepared, Results, described, effects_runs, load_runs, main_runs, writable
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.statistics import interval_of, paired, quartiles
from agents.evaluation.table import (
    BY_NAME,
    EFFECTS,
    ENDS,
    LOAD,
    METRICS,
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

LOAD_HEADS = ("good", *list(RATES.values())[1:], "bound", "transit", "on the table")


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
    film = None if gif is None else (_filmed(gif, [run.place for run in runs]), gif.path)
    runs += [*effects_runs(settings), *load_runs(settings)]
    writable(settings, FILES)
    if gif is not None and gif.path.resolve() in [(Path(settings.output) / name).resolve() for name in FILES]:
        raise checks.refuse("--gif PATH", str(gif.path), "different from the files of the report")
    return Prepared(settings, tasks, tuple(runs), scenery, film=film)


def _filmed(gif: Gif, places: Sequence[Place]) -> Place:
    """Return the place whose film is wanted, checked."""
    for option, label, wanted in (
        ("--gif TASK", "task", gif.task),
        ("--gif-hardware", "hardware", gif.hardware),
        ("--gif POLICY", "policy", gif.policy),
    ):
        if wanted is not None:
            checks.choice(option, wanted, tuple(dict.fromkeys(getattr(place, label) for place in places)))
            places = [place for place in places if getattr(place, label) == wanted]
    output_files([gif.path], "--gif PATH")
    return places[0]


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


def summary_table(results: Results, found: Sequence[Row] | None = None) -> str:
    """Return the tables of the command in Markdown, one for each kind of tasks and study."""
    found = rows(results) if found is None else found
    labels = ["task", *(["hardware"] if len(results.hardware_of()) > 1 else []), "policy"]
    level = f"{100 * results.settings.confidence:g} % interval"
    tables = []
    for name, kind in KINDS.items():
        heads, lines = [BY_NAME[each].label for each in kind.summary], []
        if name != "flows":
            heads = ["success", level, "time to goal", *heads, "fallen"]
        for row in found:
            if kind_of(results.tasks[row["task"]]) == name:
                cells = [_cell(row, each)[0] for each in kind.summary]
                if name != "flows":
                    time = BY_NAME["time_to_goal_median_s"].text(row)
                    cells = [f"{percent(row)} %", f"{percent_between(row)} %", time, *cells, str(row["fallen"])]
                lines.append([*(row[label] for label in labels), *cells])
        if lines:
            tables.append(markdown([*labels, *heads], lines))
    effects = effects_rows(results)
    if effects:
        policies = list(dict.fromkeys(cell["policy"] for cell in effects))
        lines = [[case, *map(_effect, cells)] for case, cells in _by_case(effects)]
        tables.append(markdown((f"{results.settings.effects.task}: effect", *policies), lines))
    load = load_rows(results)
    if load:
        lines = [[str(row["parts"]), row["policy"], *load_cells(row)] for row in load]
        tables.append(markdown((f"{results.settings.under_load.task}: parts", "policy", *LOAD_HEADS), lines))
    return "\n\n".join(tables)


def _effect(cell: Row) -> str:
    time = f" ({quantity(cell['time_to_goal_median_s'], 1.0, 2, 's')})" if cell["successes"] else ""
    return f"{percent(cell)} %{time}"


def _by_case(cells: Iterable[Row]) -> list[tuple[str, list[Row]]]:
    return [(case, list(those)) for case, those in itertools.groupby(cells, key=lambda cell: cell["case"])]


def load_cells(row: Row) -> list[str]:
    """Return the cells of a row of the study of throughput, see :data:`LOAD_HEADS`."""
    rates = [number(row[event], 1) for event in RATES.values()]
    return [*rates, number(row["bound"], 0), quantity(row["transit_s"], 1.0, 2, "s"), number(row["on_table"], 1)]


def write(results: Results, quiet: bool = False) -> Path:
    """Write report.html, results.csv, episodes.csv, results.json and the film that was asked for; return the page's path.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    settings, found, gaps = results.settings, rows(results), comparisons(results, quiet)
    episodes = results.table.where(study=REPORT).records(("task", "hardware", "policy", "seed", *METRICS))
    more: dict[str, Any] = {
        "comparisons": [each | {name: asdict(each[name]) for name in ("success", "time")} for each in gaps]
    }
    if settings.effects is not None:
        table = results.table.where(study=EFFECTS)
        more["effects"] = {
            "task": settings.effects.task,
            "seeds": list(dict.fromkeys(table["seed"].tolist())),
            "cases": settings.effects.cases,
            "results": effects_rows(results),
            "episodes": [
                {"case": one.pop("hardware"), **one} for one in table.records(("hardware", "policy", "seed", *ENDS))
            ],
        }
    if settings.under_load is not None:
        more["load"] = {"task": settings.under_load.task, "results": load_rows(results)}
    text = pages.json_text(results, found, {**more, "episodes": episodes})
    written = (csv_text(found), csv_text(episodes), text, page(results, found, gaps, quiet))
    directory = Path(settings.output)
    contents: dict[Path, str | bytes] = {directory / name: each for name, each in zip(FILES, written, strict=True)}
    if results.film is not None:
        place, path = results.film
        rollout = results.rollouts[place, None]
        contents[path] = films.film_gif(rollout.film, results.scenery[place.task], rollout.step_time)
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
        cell=_cell,
        figures=lambda row: _figures(row, infos[row["task"]].flows),
        film_script=Markup(films.script()),
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
    """Draw the plot of one policy on one task, and pack its film with a still picture."""
    found: dict[str, Any] = {"plot": data_address(plots.trajectories(rollout, info, scenery)), "film": None}
    if animated:
        still, size = films.still(rollout.film, scenery)
        moving = films.packed(rollout.film, scenery, rollout.step_time)
        found |= {"film": moving, "still": data_address(still), "size": size, "caption": rollout.film.captions[-1]}
    return found


def anchor(row: Row) -> str:
    """Return the id of a card."""
    return "-".join(("card", row["task"], row["hardware"], row["policy"])).replace(" ", "_")


def _cell(row: Row, name: str, parts: int = 0) -> tuple[str, str | None]:
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
        return pages.thousands(row[name]), None
    return BY_NAME[name].text(row), BY_NAME[name].middle_half(row)


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
            for case, those in _by_case(cells)
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
