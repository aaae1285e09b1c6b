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
import pandas as pd

from agents.evaluation import pages, plots
from agents.evaluation.pages import Cell, Grid, Heading, Picture, Section, data_address, grid
from agents.evaluation.run import Prepared, Results, main_cases, study_cases, writable
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
    by_run,
    ends,
    percent,
    places,
    quantity,
    span,
    successes,
    table,
    values,
    where,
)
from agents.learning_curve import Curve, read_curve
from vibgym import checks
from vibgym.files import csv_text, write_together
from vibgym.policies.measures import Measures

FILES = ("compare.csv", "compare.json", "compare.html")

UNEQUAL = 1.05
"""Largest ratio of training budgets that count as equal."""

TERMS = (
    "Time to goal: the interquartile mean over all episodes, in which a failure counts as the longest episode. Time / bound: "
    "the same time over the least one in which any policy could have done it (docs/bound.md). The median is that of the "
    "successes alone. Intervals are bootstraps over episodes, and over training runs where there are several (Owen 2007): "
    "look at the runs, too. Exact ones (Clopper-Pearson) where all episodes end alike."
)

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
    tasks, scenery, cases = main_cases(settings, Measures)
    ran = {case.place for case in cases}
    curves: dict[tuple[str, str], dict[int | None, Curve]] = {}
    for task, info in tasks.items():
        for entry in settings.entries():
            if entry.curve is not None and any((place.task, place.policy) == (task, entry.name) for place in ran):
                field = f"comparison.policies ({entry.name}).curve"
                curves[task, entry.name] = {
                    seed: read_curve(entry.curve_path(info.name, seed), field) for seed in entry.seeds
                }
    for index, ladder in enumerate(settings.ladders):
        hardware = settings.ladder_hardware(ladder)
        for name in ladder.policies:
            if Place(REPORT, ladder.task, hardware, name) not in ran:
                where = f"comparison.ladders.{index}.policies"
                raise checks.conflict(f"{where}: {name!r} does not run on {ladder.task}, hardware {hardware}")
    refused: dict[Place, str] = {}
    for index, matrix in enumerate(settings.generalisation):
        where = f"comparison.generalisation.{index}"
        found = list(study_cases(settings, matrix, matrix_label(matrix), where, refused))
        for column in matrix.columns(where, [entry.name for entry in settings.entries()]):
            if not any(case.place.policy == column.name for case in found):
                why = next(text for place, text in refused.items() if place.policy == column.name)
                raise checks.conflict(f"{where}.policies: {column.name!r} can act in none of the cases: {why}")
        cases += found
    writable(settings, FILES)
    return Prepared(settings, tasks, tuple(cases), scenery, refused, curves)


def rows(results: Results) -> list[dict[str, Any]]:
    """Return the rows of compare.csv: every policy on every task and hardware, followed by its training runs.

    Interquartile means are over all episodes, a failure counting as the longest episode; medians are over successes.
    """
    groups, found = {entry.name: entry.group for entry in results.settings.entries()}, []

    def columns(episodes: pd.DataFrame, seed: int | None = None) -> dict[str, Any]:
        group = groups[values(episodes, "policy")[0]]
        return {"group": group, "training_seed": seed, **_statistics(results, episodes)}

    by = ("task", "hardware", "policy")
    for row in table(results.main, by, columns):
        found.append(row)
        if row["runs"] > 1:
            some = where(results.main, **{name: row[name] for name in by})
            for seed in dict.fromkeys(values(some, "training_seed").tolist()):
                runs = where(some, training_seed=seed)
                found += table(runs, by, lambda rows, seed=seed: columns(rows, seed))
    # All policies of one task and hardware together, in the order of the settings.
    there, order = list(dict.fromkeys((row["task"], row["hardware"]) for row in found)), list(groups)
    return sorted(found, key=lambda row: (there.index((row["task"], row["hardware"])), order.index(row["policy"])))


def longest(results: Results, task: str) -> float:
    """Return the duration of a task's longest episode, s."""
    info = results.tasks[task]
    assert info.step_limit is not None
    return info.step_limit * info.step_time


def _limited(results: Results, episodes: pd.DataFrame) -> np.ndarray:
    """Return times to goal (runs, episodes), s, in which a failure counts as the longest episode."""
    limit = longest(results, values(episodes, "task")[0])
    return np.where(by_run(episodes, "success") > 0.0, by_run(episodes, "time_to_goal_s"), limit)


def _statistics(results: Results, episodes: pd.DataFrame) -> dict[str, Any]:
    asked, limited = results.settings.asked, _limited(results, episodes)
    bound, collisions = by_run(episodes, "bound_s"), by_run(episodes, "collisions")
    time, bounded, counted = (
        interval_of(limited, *asked, statistic=iqm),
        np.isfinite(bound).all(),
        np.isfinite(collisions).all(),
    )
    return {
        "runs": len(limited),
        **successes(by_run(episodes, "success") > 0.0, *asked),  # episodes of one run, successes of all
        "time_iqm_s": float(iqm(limited.ravel())),
        **ends("time_iqm", time, "_s"),
        "over_bound_iqm": float(iqm((limited / bound).ravel())) if bounded else math.nan,
        **ends("over_bound_iqm", interval_of(limited / bound, *asked, statistic=iqm) if bounded else None),
        "iqm_interval_method": "" if time is None else time.method,
        "time_median_s": quartiles(values(episodes, "time_to_goal_s")).median,
        "over_bound_median": quartiles(values(episodes, "time_over_bound")).median,
        "collisions_mean": float(collisions.mean()) if counted else math.nan,
        **ends("collisions", interval_of(collisions, *asked) if counted else None),
        "fallen": int(values(episodes, "fallen").sum()),
        "diverged": int(values(episodes, "diverged").sum()),
    }


def best_classical(found: Sequence[Row]) -> dict[tuple[str, str], str]:
    """Return the best classical policy by task and hardware: most successes, then the lowest interquartile mean of times.

    It is chosen on the episodes on which others are compared with it, so chance may favour it slightly.
    """
    some = [row for row in found if row["group"] == "classical" and row["training_seed"] is None]
    return {
        place: min(
            (row for row in some if (row["task"], row["hardware"]) == place),
            key=lambda row: (-row["successes"], row["time_iqm_s"]),
        )["policy"]
        for place in dict.fromkeys((row["task"], row["hardware"]) for row in some)
    }


def differences(results: Results, found: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the paired differences of learned and hybrid policies to the best classical one."""
    best, gaps, asked, known = best_classical(found), [], results.settings.asked, places(results.main)
    for row in found:
        place = row["task"], row["hardware"]
        if row["group"] == "classical" or row["training_seed"] is not None or place not in best:
            continue
        first, second = (known[Place(REPORT, *place, name)] for name in (row["policy"], best[place]))
        mine, theirs = (by_run(some, "success") > 0.0 for some in (first, second))
        times, collisions = (by_run(first, n) - by_run(second, n) for n in ("time_to_goal_s", "collisions"))
        gaps.append(
            {
                "task": place[0],
                "hardware": place[1],
                "first": row["policy"],
                "second": best[place],
                "episodes": row["episodes"],
                "runs": row["runs"],
                "success": success_difference(mine, theirs, *asked),
                "both": int(np.isfinite(times).sum()),
                "time": mean_difference(times, *asked),
                "iqm": iqm_difference(_limited(results, first), _limited(results, second), *asked),
                "collisions": mean_difference(collisions, *asked),
            }
        )
    return gaps


def matrices(results: Results) -> list[dict[str, Any]]:
    """Return the generalisation matrices: name, policies, cases and one row of statistics per cell."""
    found = []
    for index, matrix in enumerate(results.settings.generalisation):
        where, label = f"comparison.generalisation.{index}", matrix_label(matrix)
        lines = matrix.columns(where, [entry.name for entry in results.settings.entries()])
        tests, cells, known = matrix.tests(where), [], places(results.episodes, label)
        for line in lines:
            for test in tests:
                place = Place(label, matrix.task, test.name, line.name)
                cell = {"runs": 0, "episodes": 0, "success_rate": math.nan, "success_interval_method": ""}
                time = math.nan
                if place in known:
                    success = by_run(known[place], "success") > 0.0
                    cell = {"runs": len(success), **successes(success, *results.settings.asked)}
                    time = quartiles(values(known[place], "time_to_goal_s")).median
                labels = {"policy": line.name, "case": test.name, "refusal": results.refused.get(place, "")}
                cells.append({**labels, **ends("success", None), **cell, "time_median_s": time})
        found.append({"name": matrix.name, "policies": lines, "cases": tests, "results": cells})
    return found


def ladders(results: Results, found: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the ladders: of every policy its action, training budget and rows of statistics."""
    result = []
    actions = {case.place: case.policy.action for case in results.cases if case.policy is not None}
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


def results_table(results: Results, found: Sequence[Row]) -> Grid:
    """Return the table of results; the best classical policies are named so, training runs stand below their policy."""
    names, best = [entry.name for entry in results.settings.entries()], best_classical(found)

    def policy(row: Row) -> Cell:
        if row["training_seed"] is not None:
            return Cell(f"training seed {row['training_seed']}", kind="run")
        tag = "best classical" if best.get((row["task"], row["hardware"])) == row["policy"] else row["group"]
        tag += f", {row['runs']} seeds" if row["runs"] > 1 else ""
        return Cell(row["policy"], tag, "name", dot=_dot(row["policy"], names))

    columns: dict[str, Callable[[Row], Cell | str]] = {
        "task": lambda row: Cell(row["task"], kind="name"),
        "hardware": lambda row: row["hardware"],
        "policy": policy,
        "success": pages.success_cell,
        "time to goal (IQM)": _iqm,
        "time / bound (IQM)": lambda row: _between(row, "over_bound_iqm", 3),
        "median time": lambda row: quantity(row["time_median_s"], 1.0, 2, "s"),
        "collisions": lambda row: _between({**row, "collisions": row["collisions_mean"]}, "collisions", 2),
        "fallen": lambda row: str(row["fallen"]),
    }
    return grid("Results", found, columns)


def _between(row: Row, name: str, digits: int) -> Cell:
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    return Cell(quantity(row[name], 1.0, digits, ""), "" if math.isnan(low) else span(low, high, digits))


def _iqm(row: Row) -> Cell:
    low, high = row["time_iqm_low_s"], row["time_iqm_high_s"]
    small = "" if math.isnan(low) else span(low, high, 3)
    return Cell(quantity(row["time_iqm_s"], 1.0, 3, "s"), small, title=row["iqm_interval_method"])


def summary_table(results: Results) -> str:
    """Return the table of the command in Markdown."""
    found = rows(results)
    return results_table(results, found).markdown()


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
                **matrix,
                "policies": [line.model_dump() for line in matrix["policies"]],
                "cases": [asdict(test) for test in matrix["cases"]],
            }
            for matrix in tested
        ],
        "ladders": rungs,
    }
    contents = csv_text(found), pages.json_text(results, found, more), page(results, found, gaps, tested, rungs)
    write_together({directory / name: text for name, text in zip(FILES, contents, strict=True)})
    return directory / FILES[-1]


# -- page --------------------------------------------------------------------------------------------------------------


def page(
    results: Results, found: Sequence[Row], gaps: Sequence[Row], tested: Sequence[Row], rungs: Sequence[Row]
) -> str:
    """Return the page as HTML."""
    names = [entry.name for entry in results.settings.entries()]
    sections = [
        Section("asked", "Tasks", [pages.task_cards(results)]),
        Section("results", "Results", [TERMS, results_table(results, found)]),
    ]
    if gaps:
        sections.append(Section("differences", "Against the best classical policy", _differences(gaps)))
    if results.curves:
        sections.append(Section("curves", "Learning curves", _curves(results, names)))
    if rungs:
        sections.append(
            Section("ladders", "Ladders", [each for ladder in rungs for each in _ladder(results, ladder, names)])
        )
    if tested:
        sections.append(Section("generalisation", "Generalisation", [each for one in tested for each in _matrix(one)]))
    lead = "Learned, hybrid and classical policies on the same starts and goals."
    return pages.page(results, "compare", f"Comparison: {', '.join(results.tasks)}", lead, sections)


def _dot(name: str, names: Sequence[str]) -> str:
    return plots.look_of(name, names)["color"]


def _differences(gaps: Sequence[Row]) -> list[Any]:
    text = (
        "Episode by episode, learned or hybrid policy minus the best classical one; bold: zero is outside the interval in "
        "small print. The best classical policy was chosen on these episodes, so chance may favour it a little."
    )
    columns: dict[str, Callable[[Row], Cell | str]] = {
        "task": lambda gap: Cell(gap["task"], kind="name"),
        "hardware": lambda gap: gap["hardware"],
        "policies": lambda gap: Cell(gap["first"], f"against {gap['second']}", "left"),
        "success, points": lambda gap: pages.estimate_cell(gap["success"], 100, 1),
        "time (IQM)": lambda gap: pages.estimate_cell(gap["iqm"], 1, 3, " s"),
        "mean time, both succeed": lambda gap: pages.estimate_cell(gap["time"], 1, 3, " s"),
        "collisions": lambda gap: pages.estimate_cell(gap["collisions"], 1, 2),
    }
    return [text, grid("Differences", gaps, columns)]


def _curves(results: Results, names: Sequence[str]) -> list[Any]:
    blocks: list[Any] = [
        "Deterministic evaluations during training, one line a training seed. Dashed: imitation of a controller."
    ]
    for task in results.tasks:
        runs = {policy: curves for (each, policy), curves in results.curves.items() if each == task}
        if runs:
            alt = f"Success rate and median time to goal over environment steps, {task}"
            columns: dict[str, Callable[[Any], Cell | str]] = {
                "policy": lambda each: Cell(each[0], kind="name", dot=_dot(each[0], names)),
                "training seeds": lambda each: str(len(each[1])),
                **{head: lambda each, what=what: _last(what, each[1]) for what, (head, _) in TEXTS.items()},
            }
            lines = grid(f"Learning curves, {task}", list(runs.items()), columns)
            blocks += [Heading(task), Picture(data_address(plots.draw_curves(runs, names)), alt), lines]
    return blocks


TEXTS: dict[str, tuple[str, Callable[[float], str]]] = {
    "steps": ("steps", plots.steps_text),
    "seconds": ("minutes", lambda value: f"{value / 60.0:.1f}"),
    "success": ("last success", lambda value: f"{100.0 * value:.1f} %"),
    "time_to_goal": ("last median time", lambda value: quantity(value, 1.0, 2, "s")),
}
"""Head and text of the last values of learning curves; seconds are shown as minutes."""


def _last(name: str, curves: Mapping[int | None, Curve]) -> str:
    return _listed(name, [getattr(curve, name)[-1] for curve in curves.values()])


def _listed(name: str, values: Iterable[float]) -> str:
    """Return values with commas, or one if their texts are equal; ``name`` is one of :data:`TEXTS`."""
    found = [TEXTS[name][1](value) for value in values]
    return found[0] if len(set(found)) == 1 else ", ".join(found)


def _ladder(results: Results, ladder: Row, names: Sequence[str]) -> list[Any]:
    steps = ladder["steps"]
    budgets = [count for step in steps for count in step["steps"]]
    unequal = max(budgets) > UNEQUAL * min(budgets)
    columns: dict[str, Callable[[Row], Cell | str]] = {
        "policy": lambda step: Cell(step["policy"], kind="name", dot=_dot(step["policy"], names)),
        "action": lambda step: step["action"],
        "success": lambda step: pages.success_cell(step["row"]),
        "of each seed": lambda step: ", ".join(f"{percent(run)} %" for run in step["runs"]) or "–",
        "time (IQM)": lambda step: _iqm(step["row"]),
        "time of each seed": lambda step: (
            ", ".join(quantity(run["time_iqm_s"], 1.0, 3, "s") for run in step["runs"]) or "–"
        ),
        "time / bound": lambda step: quantity(step["row"]["over_bound_iqm"], 1.0, 3, ""),
        "steps": lambda step: _listed("steps", step["steps"]),
        "minutes": lambda step: _listed("seconds", step["seconds"]),
    }
    plot = plots.draw_curves({step["policy"]: results.curves[ladder["task"], step["policy"]] for step in steps}, names)
    text = "The training budgets differ." if unequal else "All were trained with the same number of steps."
    return [
        Heading(ladder["name"]),
        f"{ladder['task']}, {ladder['hardware']} hardware. {text}",
        grid(f"Ladder {ladder['name']}", steps, columns),
        Picture(data_address(plot), f"Learning curves of {ladder['name']}"),
    ]


def _matrix(matrix: Row) -> list[Any]:
    reasons = list(dict.fromkeys(cell["refusal"] for cell in matrix["results"] if cell["refusal"]))

    def shown(cell: Row) -> Cell:
        if cell["refusal"]:
            return Cell(f"cannot act ({reasons.index(cell['refusal']) + 1})", title=cell["refusal"])
        time = quantity(cell["time_median_s"], 1.0, 2, "s")
        title = f"{cell['runs']} × {cell['episodes']} episodes, median time {time}, {cell['success_interval_method']}"
        return pages.success_cell(cell, title=title)

    columns: dict[str, Callable[[Any], Cell | str]] = {
        "policy": lambda line: Cell(line.name, f"trained on {line.trained_on}" if line.trained_on else "", "left")
    }
    for test in matrix["cases"]:
        columns[f"{test.name} ({test.task})"] = lambda line, name=test.name: next(
            shown(cell) for cell in matrix["results"] if (cell["policy"], cell["case"]) == (line.name, name)
        )
    text = "Rows: policies, and what they were trained on. Columns: what they are tested on, nothing trained again."
    lines = grid(f"Generalisation, {matrix['name']}", matrix["policies"], columns, "matrix")
    return [Heading(matrix["name"]), text, lines, *([tuple(reasons)] if reasons else [])]
