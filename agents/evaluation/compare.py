"""Comparisons: ``python -m agents compare CONFIG`` writes compare.html, compare.csv and compare.json.

Learned, hybrid and classical policies on the same seeds: intervals, paired differences, learning curves, generalisation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation import pages, plots
from agents.evaluation.curves import COLUMNS, Curve, read_curve
from agents.evaluation.pages import data_address
from agents.evaluation.report import shaded
from agents.evaluation.run import Infos, Prepared, Results, Run, main_runs, study_runs, writable
from agents.evaluation.settings import ComparisonSettings, MatrixSettings
from agents.evaluation.statistics import (
    Estimate,
    interval_of,
    iqm,
    iqm_difference,
    mean_difference,
    quartiles,
    success_difference,
)
from agents.evaluation.table import (
    REPORT,
    Place,
    Table,
    ends,
    markdown,
    percent,
    percent_between,
    quantity,
    signed,
    span,
    successes,
)
from vibgym import checks
from vibgym.files import csv_text, write_together
from vibgym.policies.measures import Measures

FILES = ("compare.csv", "compare.json", "compare.html")

UNEQUAL = 1.05
"""Largest ratio of training budgets that count as equal."""

Row = Mapping[str, Any]


def matrix_label(matrix: MatrixSettings) -> str:
    """Return the study label of a generalisation matrix."""
    return f"generalisation: {matrix.name}"


def prepare(settings: ComparisonSettings) -> Prepared:
    """Build everything that can fail for bad input, before anything runs.

    Raises:
        ValueError: a bad environment setting, an unknown or unfitting policy, a bad learning curve, or a place that cannot be
            written to.
    """
    tasks, scenery, runs = main_runs(settings, Measures)
    ran = {run.place for run in runs}
    curves: dict[tuple[str, str], dict[int | None, Curve]] = {}
    for task, info in tasks.items():
        for each in settings.entries():
            if each.curve is not None and any((run.task, run.policy) == (task, each.name) for run in ran):
                field = f"comparison.policies ({each.name}).curve"
                curves[task, each.name] = {
                    seed: read_curve(each.curve_path(info.name, seed), field) for seed in each.seeds
                }
    for index, ladder in enumerate(settings.ladders):
        for name in ladder.policies:
            hardware = settings.ladder_hardware(ladder)
            if Place(REPORT, ladder.task, hardware, name) not in ran:
                where = f"comparison.ladders.{index}.policies"
                raise checks.conflict(f"{where}: {name!r} does not run on {ladder.task}, hardware {hardware}")
    infos, refused = Infos(), {}
    for index, matrix in enumerate(settings.generalisation):
        where = f"comparison.generalisation.{index}"
        found: list[Run] = []
        for case, policy, cell in study_runs(settings, matrix, matrix_label(matrix), where, infos):
            if isinstance(cell, ValueError):
                refused[Place(matrix_label(matrix), matrix.task, case.name, policy)] = " ".join(str(cell).split())
            else:
                found += cell
        for column in matrix.columns(where, [each.name for each in settings.entries()]):
            if not any(run.place.policy == column.name for run in found):
                why = next(text for place, text in refused.items() if place.policy == column.name)
                raise checks.conflict(f"{where}.policies: {column.name!r} can act in none of the cases: {why}")
        runs += found
    writable(settings, FILES)
    return Prepared(settings, tasks, tuple(runs), scenery, refused, curves)


def rows(results: Results) -> list[dict[str, Any]]:
    """Return the rows of compare.csv: every policy on every task and hardware, followed by its training runs.

    Interquartile means are over all episodes, a failure counting as the longest episode; medians are over successes.
    """
    settings, found = results.settings, []
    groups = {each.name: each.group for each in settings.entries()}
    order = {name: index for index, name in enumerate(groups)}
    places = results.table.where(study=REPORT).places()
    for place, table in sorted(places.items(), key=lambda each: order[each[0].policy]):
        labels = {"task": place.task, "hardware": place.hardware, "policy": place.policy, "group": groups[place.policy]}
        runs = table.groups("training_seed")
        found.append(_row(results, {**labels, "training_seed": None}, table))
        if len(runs) > 1:
            found += [_row(results, {**labels, "training_seed": seed}, each) for (seed,), each in runs.items()]
    # All policies of one task and hardware together, in the order of the settings.
    where = list(dict.fromkeys(place[1:3] for place in places))
    return sorted(found, key=lambda row: where.index((row["task"], row["hardware"])))


def _limited(results: Results, table: Table) -> np.ndarray:
    """Return times to goal (runs, episodes), s, in which a failure counts as the longest episode."""
    info = results.tasks[str(table["task"][0])]
    assert info.step_limit is not None
    return np.where(table.by_run("success") > 0.0, table.by_run("time_to_goal_s"), info.step_limit * info.step_time)


def _row(results: Results, labels: Row, table: Table) -> dict[str, Any]:
    settings = results.settings
    asked = settings.confidence, settings.resamples
    limited, bound, collisions = _limited(results, table), table.by_run("bound_s"), table.by_run("collisions")
    time, bounded = interval_of(limited, *asked, iqm), bool(np.isfinite(bound).all())
    counted = bool(np.isfinite(collisions).all())
    return {
        **labels,
        "runs": len(limited),
        **successes(table.by_run("success") > 0.0, *asked),  # episodes of one run, successes of all
        "time_iqm_s": float(iqm(limited.ravel())),
        **ends("time_iqm", time, "_s"),
        "over_bound_iqm": float(iqm((limited / bound).ravel())) if bounded else math.nan,
        **ends("over_bound_iqm", interval_of(limited / bound, *asked, iqm) if bounded else None),
        "iqm_interval_method": "" if time is None else time.method,
        "time_median_s": quartiles(table["time_to_goal_s"]).median,
        "over_bound_median": quartiles(table["time_over_bound"]).median,
        "collisions_mean": float(collisions.mean()) if counted else math.nan,
        **ends("collisions", interval_of(collisions, *asked) if counted else None),
        "fallen": int(table["fallen"].sum()),
        "diverged": int(table["diverged"].sum()),
    }


def best_classical(found: Sequence[Row]) -> dict[tuple[str, str], str]:
    """Return the best classical policy by task and hardware: most successes, then the lowest interquartile mean of times.

    It is chosen on the episodes on which others are compared with it, so chance may favour it slightly.
    """
    best: dict[tuple[str, str], Row] = {}
    for row in found:
        if row["group"] == "classical" and row["training_seed"] is None:
            place = row["task"], row["hardware"]
            rank = -row["successes"], row["time_iqm_s"]
            if place not in best or rank < (-best[place]["successes"], best[place]["time_iqm_s"]):
                best[place] = row
    return {place: row["policy"] for place, row in best.items()}


def differences(results: Results, found: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the paired differences of learned and hybrid policies to the best classical one."""
    settings, best, gaps = results.settings, best_classical(found), []
    asked = settings.confidence, settings.resamples
    places = results.table.where(study=REPORT).places()
    for row in found:
        place = row["task"], row["hardware"]
        if row["group"] == "classical" or row["training_seed"] is not None or place not in best:
            continue
        first, second = (places[Place(REPORT, *place, name)] for name in (row["policy"], best[place]))
        times = first.by_run("time_to_goal_s") - second.by_run("time_to_goal_s")
        gaps.append(
            {
                "task": place[0],
                "hardware": place[1],
                "first": row["policy"],
                "second": best[place],
                "episodes": row["episodes"],
                "runs": row["runs"],
                "success": success_difference(first.by_run("success") > 0.0, second.by_run("success") > 0.0, *asked),
                "both": int(np.isfinite(times).sum()),
                "time": mean_difference(times, *asked),
                "iqm": iqm_difference(_limited(results, first), _limited(results, second), *asked),
                "collisions": mean_difference(first.by_run("collisions") - second.by_run("collisions"), *asked),
            }
        )
    return gaps


def matrices(results: Results) -> list[dict[str, Any]]:
    """Return the generalisation matrices: name, policies, cases and one row of statistics per cell."""
    settings, found = results.settings, []
    for index, matrix in enumerate(settings.generalisation):
        where = f"comparison.generalisation.{index}"
        lines = matrix.columns(where, [each.name for each in settings.entries()])
        cases, cells = matrix.tested(where), []
        places = results.table.where(study=matrix_label(matrix)).places()
        for line in lines:
            for case in cases:
                place = Place(matrix_label(matrix), matrix.task, case.name, line.name)
                labels = {"policy": line.name, "case": case.name, "refusal": results.prepared.refused.get(place, "")}
                if place in places:
                    table = places[place]
                    success = table.by_run("success") > 0.0
                    cell = {"runs": len(success), **successes(success, settings.confidence, settings.resamples)}
                    cells.append({**labels, **cell, "time_median_s": quartiles(table["time_to_goal_s"]).median})
                else:
                    none = {"success_rate": math.nan, **ends("success", None), "success_interval_method": ""}
                    cells.append({**labels, "runs": 0, "episodes": 0, **none, "time_median_s": math.nan})
        found.append({"name": matrix.name, "policies": lines, "cases": cases, "results": cells})
    return found


def ladders(results: Results, found: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the ladders: of every policy its action, training budget and rows of statistics."""
    settings, result = results.settings, []
    actions = {run.place: run.policy.action for run in results.prepared.runs if run.policy is not None}
    for ladder in settings.ladders:
        hardware, steps = settings.ladder_hardware(ladder), []
        for name in ladder.policies:
            those = [
                row for row in found if (row["task"], row["hardware"], row["policy"]) == (ladder.task, hardware, name)
            ]
            curves = results.prepared.curves[ladder.task, name].values()
            steps.append(
                {
                    "policy": name,
                    "action": actions[Place(REPORT, ladder.task, hardware, name)],
                    "steps": [int(curve.steps[-1]) for curve in curves],
                    "seconds": [float(curve.seconds[-1]) for curve in curves],
                    "row": those[0],
                    "runs": those[1:],
                }
            )
        result.append({"name": ladder.name, "task": ladder.task, "hardware": hardware, "steps": steps})
    return result


def summary_table(results: Results, found: Sequence[Row] | None = None) -> str:
    """Return the table of the command in Markdown."""
    found = rows(results) if found is None else found
    several = len({row["hardware"] for row in found}) > 1
    level = f"{100 * results.settings.confidence:g} % interval"
    heads = ["task", *(["hardware"] if several else []), "policy", "success", level, "time to goal (IQM)", level]
    lines = [
        [
            row["task"],
            *([row["hardware"]] if several else []),
            row["policy"] if row["runs"] == 1 else f"{row['policy']} ({row['runs']} seeds)",
            f"{percent(row)} %",
            f"{percent_between(row)} %",
            quantity(row["time_iqm_s"], 1.0, 3, "s"),
            span(row["time_iqm_low_s"], row["time_iqm_high_s"], 3),
            quantity(row["over_bound_iqm"], 1.0, 2, ""),
            quantity(row["collisions_mean"], 1.0, 2, ""),
        ]
        for row in found
        if row["training_seed"] is None
    ]
    return markdown([*heads, "time / bound", "collisions"], lines)


def write(results: Results) -> Path:
    """Write compare.csv, compare.json and compare.html; return the page's path.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    directory, found = Path(results.settings.output), rows(results)
    gaps, tested, rungs = differences(results, found), matrices(results), ladders(results, found)
    curves = [
        {"task": task, "policy": policy, "training_seed": seed, **{k: list(v) for k, v in vars(curve).items()}}
        for (task, policy), runs in results.prepared.curves.items()
        for seed, curve in runs.items()
    ]
    for curve in curves:
        curve.update({key: np.asarray(curve[key]).tolist() for key in COLUMNS})
    more = {
        "best_classical": [
            {"task": task, "hardware": hardware, "policy": policy}
            for (task, hardware), policy in best_classical(found).items()
        ],
        "differences": [
            {key: asdict(value) if isinstance(value, Estimate) else value for key, value in gap.items()} for gap in gaps
        ],
        "curves": curves,
        "generalisation": [
            {**each, "policies": [asdict(line) for line in each["policies"]], "cases": [asdict(case) for case in each["cases"]]}
            for each in tested
        ],
        "ladders": rungs,
    }  # fmt: skip
    contents = csv_text(found), pages.json_text(results, found, more), page(results, found, gaps, tested, rungs)
    write_together({directory / name: text for name, text in zip(FILES, contents, strict=True)})
    return directory / FILES[-1]


def page(
    results: Results, found: Sequence[Row], gaps: Sequence[Row], tested: Sequence[Row], rungs: Sequence[Row]
) -> str:
    """Return the page as HTML."""
    settings = results.settings
    names = [each.name for each in settings.entries()]
    counted = any(math.isfinite(gap["collisions"].value) for gap in gaps)
    curves = {
        task: {policy: runs for (each, policy), runs in results.prepared.curves.items() if each == task}
        for task in results.tasks
    }
    return pages.render(
        "compare.html.j2",
        **pages.common(results),
        tasks=[_task(results, task, found) for task in results.tasks],
        seeded=any(row["runs"] > 1 for row in found),
        differences=[_difference(gap, counted) for gap in gaps],
        collisions=counted,
        curves=[
            {
                "task": task,
                "plot": data_address(plots.draw_curves(runs, names)),
                "rows": [_training(name, list(each.values())) for name, each in runs.items()],
            }
            for task, runs in curves.items()
            if runs
        ],
        ladders=[_ladder(results, each, names) for each in rungs],
        matrices=[_matrix(each) for each in tested],
        colours={name: plots.look_of(name, names)["color"] for name in names},
    )


def _task(results: Results, task: str, found: Sequence[Row]) -> dict[str, Any]:
    info, sections, best = results.tasks[task], [], best_classical(found)
    assert info.step_limit is not None
    for hardware in results.hardware_of(task):
        some = [row for row in found if (row["task"], row["hardware"]) == (task, hardware)]
        shown = [
            {**_cells(row), "runs": [_cells(run) for run in some if run["policy"] == row["policy"] and run is not row]}
            for row in some
            if row["training_seed"] is None
        ]
        sections.append(
            {"hardware": hardware, "episodes": some[0]["episodes"], "best": best.get((task, hardware)), "rows": shown}
        )
    criterion = pages.success_criterion(info)
    return {
        "name": task,
        "criterion": criterion,
        "limit": f"{info.step_limit * info.step_time:g} s",
        "sections": sections,
    }


def _cells(row: Row) -> dict[str, Any]:
    return {
        "row": row,
        "time": quantity(row["time_iqm_s"], 1.0, 3, "s"),
        "times": span(row["time_iqm_low_s"], row["time_iqm_high_s"], 3),
        "multiple": quantity(row["over_bound_iqm"], 1.0, 3, ""),
        "multiples": span(row["over_bound_iqm_low"], row["over_bound_iqm_high"], 3),
        "median": quantity(row["time_median_s"], 1.0, 2, "s"),
        "collisions": quantity(row["collisions_mean"], 1.0, 2, ""),
        "collisions_span": span(row["collisions_low"], row["collisions_high"], 2),
        "fallen": str(row["fallen"]),
    }


def _difference(gap: Row, collisions: bool) -> dict[str, Any]:
    shown = [("success", 100.0, 1, ""), ("iqm", 1.0, 3, " s"), ("time", 1.0, 3, " s")]
    shown += [("collisions", 1.0, 2, "")] if collisions else []
    estimates = []
    for name, factor, digits, unit in shown:
        each = gap[name]
        between = ""
        if each.interval is not None:
            low, high = (signed(factor * end, digits) for end in (each.interval.low, each.interval.high))
            between = f"{low} to {high}"
        value = "–" if math.isnan(each.value) else f"{signed(factor * each.value, digits)}{unit}"
        method = "" if each.interval is None else each.interval.method
        estimates.append({"value": value, "interval": between, "method": method, "clear": each.clear})
    return {**{key: gap[key] for key in ("task", "hardware", "first", "second", "runs")}, "estimates": estimates}


def _training(name: str, curves: Sequence[Curve]) -> dict[str, Any]:
    """Return a row of the table below learning curves."""
    return {
        "name": name,
        "runs": len(curves),
        "steps": _listed([plots.steps_text(curve.steps[-1]) for curve in curves]),
        "minutes": _listed([f"{curve.seconds[-1] / 60.0:.1f}" for curve in curves]),
        "success": _listed([f"{100.0 * curve.success[-1]:.1f} %" for curve in curves]),
        "time": _listed([quantity(float(curve.time_to_goal[-1]), 1.0, 2, "s") for curve in curves]),
    }


def _listed(texts: Sequence[str]) -> str:
    return texts[0] if len(set(texts)) == 1 else ", ".join(texts)


def _ladder(results: Results, ladder: Row, names: Sequence[str]) -> dict[str, Any]:
    steps = [each for step in ladder["steps"] for each in step["steps"]]
    curves = {step["policy"]: results.prepared.curves[ladder["task"], step["policy"]] for step in ladder["steps"]}
    return {
        **{key: ladder[key] for key in ("name", "task", "hardware")},
        "unequal": max(steps) > UNEQUAL * min(steps),
        "plot": data_address(plots.draw_curves(curves, names)),
        "steps": [
            {
                "policy": step["policy"],
                "action": step["action"],
                "card": _cells(step["row"]),
                "runs": [_cells(run) for run in step["runs"]] or [_cells(step["row"])],
                "budget": _listed([plots.steps_text(each) for each in step["steps"]]),
                "minutes": _listed([f"{each / 60.0:.1f}" for each in step["seconds"]]),
            }
            for step in ladder["steps"]
        ],
    }


def _matrix(matrix: Row) -> dict[str, Any]:
    cases, reasons = matrix["cases"], []
    tasks = {case.task for case in cases}
    lines = []
    for line in matrix["policies"]:
        cells: list[dict[str, Any]] = []
        for cell in matrix["results"]:
            if cell["policy"] != line.name:
                continue
            if cell["refusal"]:
                if cell["refusal"] not in reasons:
                    reasons.append(cell["refusal"])
                cells.append({"refused": reasons.index(cell["refusal"]) + 1, "why": cell["refusal"]})
            else:
                facts = {key: cell[key] for key in ("runs", "episodes")}
                cells.append({"refused": 0, **shaded(cell, cell["time_median_s"]), **facts})
        lines.append({"name": line.name, "trained_on": line.trained_on, "cells": cells})
    return {
        "name": matrix["name"],
        "task": next(iter(tasks)) if len(tasks) == 1 else "",
        "cases": [{"name": case.name, "task": case.task if len(tasks) > 1 else ""} for case in cases],
        "lines": lines,
        "reasons": reasons,
    }
