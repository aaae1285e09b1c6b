"""Comparisons: ``python -m agents compare CONFIG`` writes compare.html, compare.csv and compare.json.

Learned, hybrid and classical policies on the same seeds: intervals, paired differences, learning curves, generalisation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation import pages, plots
from agents.evaluation.pages import data_address
from agents.evaluation.run import Infos, Prepared, Results, main_runs, study_runs, writable
from agents.evaluation.settings import ComparisonSettings
from agents.evaluation.statistics import (
    Estimate,
    interval_of,
    iqm,
    iqm_difference,
    mean_difference,
    quartiles,
    success_difference,
)
from agents.evaluation.study_settings import MatrixSettings
from agents.evaluation.table import (
    REPORT,
    Place,
    Table,
    ends,
    markdown,
    percent,
    percent_between,
    quantity,
    span,
    successes,
)
from agents.learning_curve import Curve, read_curve
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
    infos, refused = Infos(), dict[Place, str]()
    for index, matrix in enumerate(settings.generalisation):
        where = f"comparison.generalisation.{index}"
        found = list(study_runs(settings, matrix, matrix_label(matrix), where, infos, refused))
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
    found = []
    groups = {each.name: each.group for each in results.settings.entries()}
    # All policies of one task and hardware together, in the order of the settings.
    where, order = list(dict.fromkeys(place[1:3] for place in results.places)), list(groups)
    for place, table in sorted(
        results.places.items(), key=lambda each: (where.index(each[0][1:3]), order.index(each[0].policy))
    ):
        labels, runs = {**place.labels, "group": groups[place.policy]}, table.groups("training_seed")
        found.append(_row(results, {**labels, "training_seed": None}, table))
        if len(runs) > 1:
            found += [_row(results, {**labels, "training_seed": seed}, each) for (seed,), each in runs.items()]
    return found


def longest(results: Results, task: str) -> float:
    """Return the duration of a task's longest episode, s."""
    info = results.tasks[task]
    assert info.step_limit is not None
    return info.step_limit * info.step_time


def _limited(results: Results, table: Table) -> np.ndarray:
    """Return times to goal (runs, episodes), s, in which a failure counts as the longest episode."""
    limit = longest(results, str(table["task"][0]))
    return np.where(table.by_run("success") > 0.0, table.by_run("time_to_goal_s"), limit)


def _row(results: Results, labels: Row, table: Table) -> dict[str, Any]:
    limited, bound, collisions = _limited(results, table), table.by_run("bound_s"), table.by_run("collisions")
    time, bounded = interval_of(limited, *results.asked, iqm), bool(np.isfinite(bound).all())
    counted = bool(np.isfinite(collisions).all())
    return {
        **labels,
        "runs": len(limited),
        **successes(table.by_run("success") > 0.0, *results.asked),  # episodes of one run, successes of all
        "time_iqm_s": float(iqm(limited.ravel())),
        **ends("time_iqm", time, "_s"),
        "over_bound_iqm": float(iqm((limited / bound).ravel())) if bounded else math.nan,
        **ends("over_bound_iqm", interval_of(limited / bound, *results.asked, iqm) if bounded else None),
        "iqm_interval_method": "" if time is None else time.method,
        "time_median_s": quartiles(table["time_to_goal_s"]).median,
        "over_bound_median": quartiles(table["time_over_bound"]).median,
        "collisions_mean": float(collisions.mean()) if counted else math.nan,
        **ends("collisions", interval_of(collisions, *results.asked) if counted else None),
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
            other = best.setdefault((row["task"], row["hardware"]), row)
            if (-row["successes"], row["time_iqm_s"]) < (-other["successes"], other["time_iqm_s"]):
                best[row["task"], row["hardware"]] = row
    return {place: row["policy"] for place, row in best.items()}


def differences(results: Results, found: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the paired differences of learned and hybrid policies to the best classical one."""
    best, gaps, asked, places = best_classical(found), [], results.asked, results.places
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
    found = []
    for index, matrix in enumerate(results.settings.generalisation):
        where, label = f"comparison.generalisation.{index}", matrix_label(matrix)
        lines = matrix.columns(where, [each.name for each in results.settings.entries()])
        cases, cells = matrix.tested(where), []
        places = results.table.where(study=label).places()
        for line in lines:
            for case in cases:
                place = Place(label, matrix.task, case.name, line.name)
                labels = {"policy": line.name, "case": case.name, "refusal": results.refused.get(place, "")}
                if place in places:
                    success = places[place].by_run("success") > 0.0
                    cell = {"runs": len(success), **successes(success, *results.asked)}
                    time = quartiles(places[place]["time_to_goal_s"]).median
                else:
                    none = {"success_rate": math.nan, **ends("success", None), "success_interval_method": ""}
                    cell, time = {"runs": 0, "episodes": 0, **none}, math.nan
                cells.append({**labels, **cell, "time_median_s": time})
        found.append({"name": matrix.name, "policies": lines, "cases": cases, "results": cells})
    return found


def ladders(results: Results, found: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the ladders: of every policy its action, training budget and rows of statistics."""
    result = []
    actions = {run.place: run.policy.action for run in results.runs if run.policy is not None}
    for ladder in results.settings.ladders:
        hardware, steps = results.settings.ladder_hardware(ladder), []
        for name in ladder.policies:
            where = (ladder.task, hardware, name)
            first, *others = (row for row in found if (row["task"], row["hardware"], row["policy"]) == where)
            curves = results.curves[ladder.task, name].values()
            steps.append(
                {
                    "policy": name,
                    "action": actions[Place(REPORT, *where)],
                    "steps": [int(curve.steps[-1]) for curve in curves],
                    "seconds": [float(curve.seconds[-1]) for curve in curves],
                    "row": first,
                    "runs": others,
                }
            )
        result.append({"name": ladder.name, "task": ladder.task, "hardware": hardware, "steps": steps})
    return result


def summary_table(results: Results) -> str:
    """Return the table of the command in Markdown."""
    found = rows(results)
    labels = ["task", *(["hardware"] if len(results.hardware_of()) > 1 else [])]
    level = f"{100 * results.settings.confidence:g} % interval"
    heads = [*labels, "policy", "success", level, "time to goal (IQM)", level, "time / bound", "collisions"]
    lines = [
        [
            *(row[label] for label in labels),
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
    return markdown(heads, lines)


def write(results: Results, quiet: bool = False) -> Path:
    """Write compare.csv, compare.json and compare.html; return the page's path.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    directory, found = Path(results.settings.output), rows(results)
    gaps, tested, rungs = differences(results, found), matrices(results), ladders(results, found)
    more = {
        "best_classical": [
            {"task": task, "hardware": hardware, "policy": policy}
            for (task, hardware), policy in best_classical(found).items()
        ],
        "differences": [
            {key: asdict(value) if isinstance(value, Estimate) else value for key, value in gap.items()} for gap in gaps
        ],
        "curves": [
            {"task": task, "policy": policy, "training_seed": seed}
            | {name: np.asarray(values).tolist() for name, values in vars(curve).items()}
            for (task, policy), runs in results.curves.items()
            for seed, curve in runs.items()
        ],
        "generalisation": [
            {
                **each,
                "policies": [line.model_dump() for line in each["policies"]],
                "cases": [asdict(case) for case in each["cases"]],
            }
            for each in tested
        ],
        "ladders": rungs,
    }
    contents = csv_text(found), pages.json_text(results, found, more), page(results, found, gaps, tested, rungs)
    write_together({directory / name: text for name, text in zip(FILES, contents, strict=True)})
    return directory / FILES[-1]


def page(
    results: Results, found: Sequence[Row], gaps: Sequence[Row], tested: Sequence[Row], rungs: Sequence[Row]
) -> str:
    """Return the page as HTML."""
    names, best = [each.name for each in results.settings.entries()], best_classical(found)
    curves = {
        task: {policy: runs for (each, policy), runs in results.curves.items() if each == task}
        for task in results.tasks
    }
    return pages.render(
        "compare.html.j2",
        **pages.common(results),
        tasks=[
            {
                "name": task,
                "criterion": pages.success_criterion(info),
                "limit": f"{longest(results, task):g} s",
                "sections": [
                    {
                        "hardware": hardware,
                        "rows": [row for row in found if (row["task"], row["hardware"]) == (task, hardware)],
                        "best": best.get((task, hardware)),
                    }
                    for hardware in results.hardware_of(task)
                ],
            }
            for task, info in results.tasks.items()
        ],
        seeded=any(row["runs"] > 1 for row in found),
        differences=gaps,
        collisions=any(math.isfinite(gap["collisions"].value) for gap in gaps),
        curves=[
            {
                "task": task,
                "plot": data_address(plots.draw_curves(runs, names)),
                "runs": {name: list(each.values()) for name, each in runs.items()},
            }
            for task, runs in curves.items()
            if runs
        ],
        listed=_listed,
        ladders=[
            {
                **each,
                "plot": data_address(
                    plots.draw_curves({step["policy"]: curves[each["task"]][step["policy"]] for step in each["steps"]}, names)
                ),
                "unequal": max(budgets) > UNEQUAL * min(budgets),
            }
            for each in rungs
            if (budgets := [steps for step in each["steps"] for steps in step["steps"]])
        ],
        matrices=[_matrix(each) for each in tested],
        colours={name: plots.look_of(name, names)["color"] for name in names},
    )  # fmt: skip


TEXTS: dict[str, Callable[[float], str]] = {
    "steps": plots.steps_text,
    "seconds": lambda value: f"{value / 60.0:.1f}",
    "success": lambda value: f"{100.0 * value:.1f} %",
    "time_to_goal": lambda value: quantity(value, 1.0, 2, "s"),
}
"""How the page writes the last values of learning curves; seconds are shown as minutes."""


def _listed(name: str, values: Iterable[float]) -> str:
    """Return values with commas, or one if their texts are equal; ``name`` is one of :data:`TEXTS`."""
    found = [TEXTS[name](value) for value in values]
    return found[0] if len(set(found)) == 1 else ", ".join(found)


def _matrix(matrix: Row) -> dict[str, Any]:
    """Return what the page shows of a matrix: cells by policy, with the refusals numbered."""
    tasks = list(dict.fromkeys(case.task for case in matrix["cases"]))
    return {
        **matrix,
        "task": tasks[0] if len(tasks) == 1 else "",
        "lines": [
            (line, [cell for cell in matrix["results"] if cell["policy"] == line.name]) for line in matrix["policies"]
        ],
        "reasons": list(dict.fromkeys(cell["refusal"] for cell in matrix["results"] if cell["refusal"])),
    }
