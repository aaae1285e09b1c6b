"""Page of an evaluation or comparison, from its rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from agents.evaluation import pages, plots
from agents.evaluation.pages import Card, Cards, Cell, Grid, Heading, Picture, Section, data_address, grid
from agents.evaluation.rows import Row, against_best, best_classical, best_rows
from agents.evaluation.run import FILM, PLOT, Results
from agents.evaluation.settings import Study
from agents.evaluation.table import (
    BY_NAME,
    QUANTITIES,
    RATES,
    REPORT,
    Place,
    number,
    percent,
    percent_between,
    quantity,
    span,
    where,
)

OPEN_BELOW = 0.95
"""Success rate of its best policy below which a task is open."""

PRINTED = ("results", "effects", "load")
"""Sections whose tables the command prints."""

UNEQUAL = 1.05
"""Largest ratio of training budgets that count as equal."""

TERMS = {
    "evaluation": (
        "Medians, with the middle half of the episodes in small print. Times count successes only and include the hold; "
        "errors are those at the end of all episodes. Time / bound: over the least time in which any policy could have done "
        "it (docs/bound.md); a dash where no bound is known. Throughput: parts done at the end over the simulated time. "
        "Collisions: pairs newly in touch, mean of the episodes. Efficiency: straight ways over ways travelled, of "
        "successes. Steps a second, policy and environment together, depend on the host and its load."
    ),
    "comparison": (
        "Time to goal: the interquartile mean over all episodes, in which a failure counts as the longest episode. Time / "
        "bound: the same time over the least one in which any policy could have done it (docs/bound.md). The median is that "
        "of the successes alone. Intervals are bootstraps over episodes, and over training runs where there are several "
        "(Owen 2007): look at the runs, too. Exact ones (Clopper-Pearson) where all episodes end alike."
    ),
}


def _figure(name: str) -> Callable[[Row], Cell]:
    """Return the function of a row that makes the cell of a figure."""
    return lambda row: Cell(BY_NAME[name].text(row).replace(" deg", "°"), BY_NAME[name].middle_half(row))


def _between(row: Row, name: str, digits: int, unit: str = "", suffix: str = "") -> Cell:
    low, high = row[f"{name}_low{suffix}"], row[f"{name}_high{suffix}"]
    small = "" if math.isnan(low) else span(low, high, digits)
    return Cell(quantity(row[f"{name}{suffix}"], 1.0, digits, unit), small, title=row["iqm_interval_method"])


def _iqm(row: Row) -> Cell:
    return _between(row, "time_iqm", 3, "s", "_s")


Columns = dict[str, Callable[[Any], Cell | str]]

FIGURES: dict[str, Columns] = {
    "evaluation": {
        **{figure.label: _figure(figure.name) for figure in QUANTITIES if not figure.rate},
        "fallen": lambda row: str(row["fallen"]),
        "thousand steps a second": lambda row: number(1e-3 * row["steps_per_second"], 0),
    },
    "comparison": {
        "time to goal (IQM)": _iqm,
        "time / bound (IQM)": lambda row: _between(row, "over_bound_iqm", 3),
        "median time": lambda row: quantity(row["time_to_goal_median_s"], 1.0, 2, "s"),
        "collisions": lambda row: _between({**row, "collisions": row["collisions_mean"]}, "collisions", 2),
        "fallen": lambda row: str(row["fallen"]),
    },
}

LOAD_FIGURES: Columns = {
    "policy": lambda row: Cell(row["policy"], kind="name"),
    "parts": lambda row: str(row["parts"]),
    **{event: lambda row, event=event: number(row[event], 1) for event in RATES.values()},
    "bound": lambda row: number(row["bound"], 0),
    "transit": lambda row: quantity(row["transit_s"], 1.0, 2, "s"),
    "on the table": lambda row: number(row["on_table"], 1),
}


def tables(results: Results, all_rows: Sequence[Row]) -> list[Grid]:
    """Return the tables of all figures: tasks with the same figures together. In a comparison there is one, the best classical
    policies are named so, and training runs stand below their policy."""
    compares, alike = results.settings.where == "comparison", dict[tuple[str, ...], list[Row]]()
    best = best_classical(all_rows)

    def policy(row: Row) -> Cell:
        if row["training_seed"] is not None:
            return Cell(f"training seed {row['training_seed']}", kind="run")
        if not compares:
            return Cell(row["policy"], kind="name")
        tag = "best classical" if best.get((row["task"], row["hardware"])) is row else row["group"]
        tag += f", {row['runs']} seeds" if row["runs"] > 1 else ""
        return Cell(row["policy"], tag, "name", dot=_dot(results, row["policy"]))

    for task in results.tasks:
        some = [row for row in all_rows if row["task"] == task]
        names = [f.name for f in QUANTITIES if not f.rate and any(math.isfinite(row[f.name]) for row in some)]
        always = "time_to_goal_median_s", "time_over_bound_median", "path_efficiency_median"  # of successes
        key = () if compares else tuple(name for name in names if name not in always)
        alike.setdefault(key, []).extend(some)
    grids = []
    for some in alike.values():
        columns: Columns = {
            "task": lambda row: Cell(row["task"], kind="name"),
            "hardware": lambda row: row["hardware"],
            "policy": policy,
        }
        if not results.tasks[some[0]["task"]].continuous_feed:
            columns["success"] = pages.success_cell
        names = ", ".join(dict.fromkeys(row["task"] for row in some))
        grids.append(grid(f"Results: {names}", some, columns | FIGURES[results.settings.where]))
    return grids


def study_table(results: Results, study: Study, cells: Sequence[Row]) -> tuple[Grid, tuple[str, ...]]:
    """Return the table of a study, a line for every case and a column for every policy, and why policies cannot act."""
    reasons = tuple(dict.fromkeys(cell["refusal"] for cell in cells if cell["refusal"]))
    known = {(cell["case"], cell["policy"]): cell for cell in cells}

    def shown(cell: Row) -> Cell:
        if cell["refusal"]:
            return Cell(f"cannot act ({reasons.index(cell['refusal']) + 1})", title=cell["refusal"])
        time = quantity(cell["time_to_goal_median_s"], 1.0, 2, "s")
        title = f"{cell['runs']} × {cell['episodes']} episodes, median time {time}, {cell['success_interval_method']}"
        return pages.success_cell(cell, title=title)

    columns: Columns = {
        f"{study.task}: case": lambda case: Cell(case, pages.as_yaml(study.cases[case], flow=True), "left")
    }
    for column in study.policies:
        head = column.name + (f", trained on {column.trained_on}" if column.trained_on else "")
        columns[head] = lambda case, name=column.name: shown(known[case, name])
    return grid(study.name, list(study.cases), columns, "matrix"), reasons


def page(
    results: Results,
    all_rows: Sequence[Row],
    gaps: Sequence[Row],
    cells: Mapping[str, Sequence[Row]],
    rungs: Sequence[Row],
    load: Sequence[Row],
) -> tuple[str, str]:
    """Return the page as HTML, and the tables of the sections :data:`PRINTED` in Markdown."""
    settings, best = results.settings, best_rows(results, all_rows)
    compares, names = settings.where == "comparison", ", ".join(results.tasks)
    sections = [
        Section("tasks", "Tasks", [pages.task_cards(results)]),
        Section("results", "Results", [TERMS[settings.where], *tables(results, all_rows)]),
    ]
    if not compares:
        gaps = against_best(results, gaps, best)
        sections.insert(0, Section("answers", "Answers", _answers(results, all_rows, best)))
    if gaps:
        title = "Against the best classical policy" if compares else "Differences on the same seeds"
        sections.append(Section("differences", title, _differences(gaps, compares)))
    if results.curves:
        sections.append(Section("curves", "Learning curves", _curves(results)))
    if rungs:
        blocks = [block for ladder in rungs for block in _ladder(results, ladder)]
        sections.append(Section("ladders", "Ladders", blocks))
    if settings.effects is not None:
        blocks = _study(results, settings.effects, cells["effects"])
        sections.append(Section("effects", "Effects of the hardware", blocks))
    if settings.generalisation:
        blocks = []
        for k, study in enumerate(settings.generalisation):
            blocks += [Heading(study.name), *_study(results, study, cells[f"generalisation.{k}"])]
        sections.append(Section("generalisation", "Generalisation", blocks))
    sections += _tasks(results, all_rows) if settings.draws else []
    if settings.under_load is not None:
        text = "Parts a minute by what became of them, without the warm-up. Dashed: the bound; band: interval of good parts."
        picture = Picture(data_address(plots.throughput(load)), "Parts a minute against the number of parts", text)
        lines = grid("Parts a minute under load", load, LOAD_FIGURES)
        sections.append(Section("load", f"{settings.under_load.task} under load", [picture, lines]))
    if compares:
        lead = "Learned, hybrid and classical policies on the same starts and goals."
        html = pages.page(results, "compare", f"Comparison: {names}", lead, sections)
    else:
        lead = "Every policy meets the same starts and goals, on the same seeds."
        html = pages.page(results, "evaluate", f"How well each policy does: {names}", lead, sections)
    printed = [block for section in sections if section.id in PRINTED for block in section.blocks]
    return html, "\n\n".join(block.markdown() for block in printed if isinstance(block, Grid))


def _dot(results: Results, name: str) -> str:
    return plots.look_of(name, results.settings.names)["color"]


def anchor(row: Row) -> str:
    """Return the id of a card."""
    return "-".join(("card", row["task"], row["hardware"], row["policy"])).replace(" ", "_")


def _answers(results: Results, all_rows: Sequence[Row], best: Mapping[tuple[str, str], Row]) -> list[Any]:
    """Return the matrix of policies by tasks, and the tasks that are open."""
    known = {(row["task"], row["hardware"], row["policy"]): row for row in all_rows if row["training_seed"] is None}
    columns: Columns = {"task": lambda place: Cell(place[0], kind="name"), "hardware": lambda place: place[1]}
    for name in dict.fromkeys(row["policy"] for row in all_rows):
        columns[name] = lambda place, name=name: _answer(results, known.get((*place, name)), best[place])
    text = (
        "Share of the episodes that succeed; in small print the median time over the least possible one, or in seconds where "
        "no bound is known. Where parts come and go: good parts a minute. Framed: the best policy of a task."
    )
    some = tuple(
        f"{task}, {machine} hardware: {row['policy']} with {percent(row)} % ({percent_between(row)} %)"
        for (task, machine), row in best.items()
        if not results.tasks[task].continuous_feed and row["success_rate"] < OPEN_BELOW
    )
    about = f"Open: tasks whose best policy succeeds in fewer than {100 * OPEN_BELOW:g} % of the episodes."
    lines = grid("Success of every policy on every task", list(best), columns, "matrix")
    return [text, lines, *([about, some] if some else [])]


def _answer(results: Results, row: Row | None, best: Row) -> Cell:
    if row is None:
        return Cell("–", sort="")
    more = {"link": anchor(row), "kind": "best" if row is best else ""}
    if results.tasks[row["task"]].continuous_feed:
        share, good = row["rate_over_bound_mean"], row["good_per_minute_mean"]
        known = math.isfinite(share)
        small = f"{100 * share:.0f} % of bound" if known else ""
        return Cell(f"{number(good, 1)} / min", small, colour=pages.colour(min(share, 1.0) if known else 0.5), **more)
    ratio, time = row["time_over_bound_median"], BY_NAME["time_to_goal_median_s"].text(row)
    small = f"{number(ratio, 2)} ×" if math.isfinite(ratio) else time if row["successes"] else ""
    return Cell(f"{percent(row)} %", small, colour=pages.colour(row["success_rate"]), **more)


def _differences(gaps: Sequence[Row], compares: bool) -> list[Any]:
    text = (
        "Episode by episode, learned or hybrid policy minus the best classical one, which was chosen on these episodes, so "
        "chance may favour it a little."
        if compares
        else "Each task's best policy against every other one, seed by seed."
    )
    columns: Columns = {
        "task": lambda gap: Cell(gap["task"], kind="name"),
        "hardware": lambda gap: gap["hardware"],
        "policies": lambda gap: Cell(gap["first"], f"against {gap['second']}", "left"),
        "success, points": lambda gap: pages.estimate_cell(gap["success"], 100, 1),
        "both succeed on": lambda gap: f"{gap['both']} seeds",
        "mean time, both succeed": lambda gap: pages.estimate_cell(gap["time"], 1, 3, " s"),
        "time (IQM)": lambda gap: pages.estimate_cell(gap.get("iqm"), 1, 3, " s"),
        "collisions": lambda gap: pages.estimate_cell(gap.get("collisions"), 1, 2),
    }
    return [f"{text} Bold: zero is outside the interval in small print.", grid("Differences", gaps, columns)]


TEXTS: dict[str, tuple[str, Callable[[float], str]]] = {
    "steps": ("steps", plots.steps_text),
    "seconds": ("minutes", lambda value: f"{value / 60.0:.1f}"),
    "success": ("last success", lambda value: f"{100.0 * value:.1f} %"),
    "time_to_goal": ("last median time", lambda value: quantity(value, 1.0, 2, "s")),
}
"""Head and text of the last values of learning curves; seconds are shown as minutes."""


def _listed(name: str, values: Iterable[float]) -> str:
    """Return values with commas, or one if their texts are equal; ``name`` is one of :data:`TEXTS`."""
    texts = [TEXTS[name][1](value) for value in values]
    return texts[0] if len(set(texts)) == 1 else ", ".join(texts)


def _curves(results: Results) -> list[Any]:
    blocks: list[Any] = [
        "Deterministic evaluations during training, one line a training seed. Dashed: imitation of a controller."
    ]
    for task in results.tasks:
        runs = {policy: curves for (other, policy), curves in results.curves.items() if other == task}
        if runs:
            alt = f"Success rate and median time to goal over environment steps, {task}"
            columns: Columns = {
                "policy": lambda run: Cell(run[0], kind="name", dot=_dot(results, run[0])),
                "training seeds": lambda run: str(len(run[1])),
            }
            for name, (head, _) in TEXTS.items():
                columns[head] = lambda run, name=name: _listed(name, [c[name].iloc[-1] for c in run[1].values()])
            lines = grid(f"Learning curves, {task}", list(runs.items()), columns)
            picture = Picture(data_address(plots.draw_curves(runs, results.settings.names)), alt)
            blocks += [Heading(task), picture, lines]
    return blocks


def _ladder(results: Results, ladder: Row) -> list[Any]:
    steps = ladder["steps"]
    budgets = [count for step in steps for count in step["steps"]]
    columns: Columns = {
        "policy": lambda step: Cell(step["policy"], kind="name", dot=_dot(results, step["policy"])),
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
    curves = {step["policy"]: results.curves[ladder["task"], step["policy"]] for step in steps}
    text = (
        "The training budgets differ."
        if max(budgets) > UNEQUAL * min(budgets)
        else "All were trained with the same number of steps."
    )
    return [
        Heading(ladder["name"]),
        f"{ladder['task']}, {ladder['hardware']} hardware. {text}",
        grid(f"Ladder {ladder['name']}", steps, columns),
        Picture(
            data_address(plots.draw_curves(curves, results.settings.names)), f"Learning curves of {ladder['name']}"
        ),
    ]


def _study(results: Results, study: Study, cells: Sequence[Row]) -> list[Any]:
    lines, reasons = study_table(results, study, cells)
    text = f"{study.task} again, nothing trained anew: success rate and its interval of each policy in each case."
    sensors = tuple(
        f"{column.name}: sensor with {pages.as_yaml(column.sensor, flow=True)}"
        for column in study.policies
        if column.sensor
    )
    return [text, lines, *([reasons] if reasons else []), *([sensors] if sensors else [])]


def _tasks(results: Results, all_rows: Sequence[Row]) -> list[Section]:
    """Return the section of each task: arrivals, and a card with pictures of every policy."""
    sections, about, names = [], results.policies(), results.settings.names
    for task, info in results.tasks.items():
        blocks: list[Any] = [info.summary]
        machines = results.hardware_of(task)
        for machine in machines:
            if len(machines) > 1:
                blocks.append(Heading(f"On {machine} hardware"))
            some = where(results.main, task=task, hardware=machine)
            alt = "Parts a minute" if info.continuous_feed else "Share of episodes at the goal over time"
            blocks.append(
                Picture(data_address(plots.arrivals(some, names, info.continuous_feed)), f"{alt}, for each policy")
            )
            cards = []
            for row in all_rows:
                if (row["task"], row["hardware"], row["training_seed"]) == (task, machine, None):
                    rate = (
                        f"{row['good_per_minute_mean']:.1f} a minute" if info.continuous_feed else f"{percent(row)} %"
                    )
                    cards.append(
                        Card(
                            row["policy"], about[row["policy"]], aside=rate, dot=_dot(results, row["policy"]),
                            id=anchor(row), pictures=_pictures(results, row),
                        )
                    )  # fmt: skip
            blocks.append(Cards(cards, wide=True))
        sections.append(Section(task, task, blocks))
    return sections


def _pictures(results: Results, row: Row) -> list[Picture]:
    """Return the film and the plot of one policy on one task."""
    name, task = row["policy"], row["task"]
    place = Place(REPORT, task, row["hardware"], name)
    drawn, shown = results.pictures[place], []
    if FILM in drawn:
        (film,) = where(results.main, task=task, hardware=row["hardware"], policy=name, filmed=1.0).to_dict("records")
        done = "" if results.tasks[task].continuous_feed else ": success" if film["success"] else ": no success"
        source, text = data_address(drawn[FILM], "gif"), f"Film of seed {film['seed']}{done}"
        shown.append(Picture(source, f"Film of {name} on {task}, seed {film['seed']}", summary=text))
    diverged = f" {row['diverged']} episodes diverged." if row["diverged"] else ""
    text = (
        f"Paths, to scale (ring: start, dot: end, circle: goal), and errors over time, of the first episodes.{diverged}"
    )
    alt = f"Paths of {name} on {task} and their errors over time"
    return [*shown, Picture(data_address(drawn[PLOT]), alt, text)]
