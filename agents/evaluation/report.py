"""The report: ``python -m agents evaluate CONFIG`` writes report.html, results.csv, episodes.csv and results.json."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from tqdm import tqdm

from agents import parallel
from agents.evaluation import films, pages, plots
from agents.evaluation.pages import Card, Cards, Cell, Grid, Heading, Picture, Section, data_address, grid
from agents.evaluation.run import Prepared, Results, described, effects_cases, load_cases, main_cases, writable
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.statistics import interval_of, mean_difference, success_difference
from agents.evaluation.table import (
    BY_NAME,
    EFFECTS,
    ENDS,
    LOAD,
    METRICS,
    QUANTITIES,
    RATES,
    Place,
    by_run,
    ends,
    mean,
    number,
    percent,
    percent_between,
    places,
    quantity,
    records,
    summary,
    table,
    values,
    where,
)
from vibgym import checks
from vibgym.files import csv_text, output_files, write_together
from vibgym.policies.task_info import TaskInfo

FILES = ("results.csv", "episodes.csv", "results.json", "report.html")

OPEN_BELOW = 0.95
"""Success rate of its best policy below which a task is open."""

Row = Mapping[str, Any]


TERMS = (
    "Medians, with the middle half of the episodes in small print. Times count successes only and include the hold; "
    "errors are those at the end of all episodes. Time / bound: over the least time in which any policy could have done it "
    "(docs/bound.md); a dash where no bound is known. Throughput: parts done at the end over the simulated time. Collisions: "
    "pairs newly in touch, mean of the episodes. Efficiency: straight ways over ways travelled, of successes. Steps a second, "
    "policy and environment together, depend on the host and its load."
)


class Gif(NamedTuple):
    """Film to be written as a GIF file: of one policy on one task, by default on its first hardware."""

    task: str
    policy: str
    path: Path
    hardware: str | None = None


def prepare(settings: EvaluationSettings, gif: Gif | None = None) -> Prepared:
    """Build everything that can fail for bad input, before anything runs.

    Raises:
        ValueError: a bad environment setting, an unknown or unfitting policy, or a place that cannot be written to.
    """
    tasks, scenery, cases = main_cases(settings)
    film = None if gif is None else (_filmed(gif, [case.place for case in cases]), gif.path)
    cases += [*effects_cases(settings), *load_cases(settings)]
    writable(settings, FILES)
    if gif is not None and gif.path.resolve() in [(Path(settings.output) / name).resolve() for name in FILES]:
        raise checks.refuse("--gif PATH", str(gif.path), "different from the files of the report")
    return Prepared(settings, tasks, tuple(cases), scenery, film=film)


def _filmed(gif: Gif, among: Sequence[Place]) -> Place:
    """Return the place whose film is wanted, checked."""
    for option, label, wanted in (
        ("--gif TASK", "task", gif.task),
        ("--gif-hardware", "hardware", gif.hardware),
        ("--gif POLICY", "policy", gif.policy),
    ):
        if wanted is not None:
            checks.choice(option, wanted, tuple(dict.fromkeys(getattr(place, label) for place in among)))
            among = [place for place in among if getattr(place, label) == wanted]
    output_files([gif.path], "--gif PATH")
    return among[0]


# -- rows --------------------------------------------------------------------------------------------------------------


def rows(results: Results) -> list[dict[str, Any]]:
    """Return the rows of results.csv: statistics of every policy on every task and hardware."""
    found = table(
        results.main, ("task", "hardware", "policy"), lambda episodes: summary(episodes, *results.settings.asked)
    )
    names = ("steps_per_second", "policy_steps_per_second", "environment_steps_per_second")
    for row in found:
        timing = results.rollout(row["task"], row["hardware"], row["policy"]).timing
        row |= dict(zip(names, timing.rates(), strict=True))
    return found


def effects_rows(results: Results) -> list[dict[str, Any]]:
    """Return the cells of the study of effects, case after case."""
    return table(_effects_episodes(results), ("case", "policy"), lambda some: summary(some, *results.settings.asked))


def _effects_episodes(results: Results) -> pd.DataFrame:
    some = where(results.episodes, study=EFFECTS)
    return some.assign(case=some["hardware"])


def load_rows(results: Results) -> list[dict[str, Any]]:
    """Return the rows of the study of throughput: means a minute by policy and number of parts."""
    return [
        {
            "policy": place.policy,
            "parts": int(place.hardware),
            "episodes": len(some),
            "bound": float(values(some, "rate_bound_per_minute")[0]),
            **{event: mean(some, name) for name, event in RATES.items()},
            **ends("good", interval_of(by_run(some, "good_per_minute"), *results.settings.asked)),
            "transit_s": mean(some, "transit_s"),
            "on_table": mean(some, "on_table"),
        }
        for place, some in places(results.episodes, LOAD).items()
    ]


def comparisons(results: Results, quiet: bool = True) -> list[dict[str, Any]]:
    """Return paired differences of every two policies on the same task and hardware, seed by seed."""
    known, found = places(results.main), []
    pairs = [pair for pair in itertools.combinations(known, 2) if pair[0][:3] == pair[1][:3]]
    for one, other in tqdm(pairs, desc="comparing policies", unit="pair", disable=quiet):
        first, second = known[one], known[other]
        times = by_run(first, "time_to_goal_s") - by_run(second, "time_to_goal_s")  # nan unless both succeed
        one_success, other_success = (by_run(some, "success") > 0.0 for some in (first, second))
        found.append({
            "task": one.task, "hardware": one.hardware, "first": one.policy, "second": other.policy,
            "episodes": len(first),
            "success": success_difference(one_success, other_success, *results.settings.asked),
            "both": int((times == times).sum()),
            "time": mean_difference(times, *results.settings.asked),
        })  # fmt: skip
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


def best_rows(results: Results, rows: Sequence[Row]) -> dict[tuple[str, str], Row]:
    """Return the best policy by task and hardware."""
    return {place: best_row(results, rows, *place) for place in dict.fromkeys((r["task"], r["hardware"]) for r in rows)}


def against_best(results: Results, gaps: Sequence[Row], best: Mapping[tuple[str, str], Row]) -> list[dict[str, Any]]:
    """Return the differences of the best policy on every task and hardware to each other one."""
    found = []
    for gap in gaps:
        if results.tasks[gap["task"]].flows:  # success does not apply
            continue
        name = best[gap["task"], gap["hardware"]]["policy"]
        if name == gap["first"]:
            found.append(dict(gap))
        elif name == gap["second"]:
            turned = {"first": name, "second": gap["first"]}
            found.append({**gap, **turned, **{key: gap[key].negative() for key in ("success", "time")}})
    return found


# -- tables ------------------------------------------------------------------------------------------------------------


def _figure(name: str) -> Callable[[Row], Cell]:
    """Return the function of a row that makes the cell of a figure."""

    def cell(row: Row) -> Cell:
        figure = BY_NAME[name]
        return Cell(figure.text(row).replace(" deg", "°"), figure.middle_half(row))

    return cell


_time = BY_NAME["time_to_goal_median_s"].text

LABELS: dict[str, Callable[[Row], Cell | str]] = {
    "task": lambda row: Cell(row["task"], kind="name"),
    "hardware": lambda row: row["hardware"],
    "policy": lambda row: Cell(row["policy"], kind="name"),
}

FIGURES: dict[str, Callable[[Row], Cell | str]] = {
    **{figure.label: _figure(figure.name) for figure in QUANTITIES if not figure.rate},
    "fallen": lambda row: str(row["fallen"]),
    "thousand steps a second": lambda row: number(1e-3 * row["steps_per_second"], 0),
}

LOAD_FIGURES: dict[str, Callable[[Row], Cell | str]] = {
    "policy": lambda row: Cell(row["policy"], kind="name"),
    "parts": lambda row: str(row["parts"]),
    **{event: lambda row, event=event: number(row[event], 1) for event in RATES.values()},
    "bound": lambda row: number(row["bound"], 0),
    "transit": lambda row: quantity(row["transit_s"], 1.0, 2, "s"),
    "on the table": lambda row: number(row["on_table"], 1),
}


def tables(results: Results, found: Sequence[Row]) -> list[Grid]:
    """Return the tables of all figures: tasks with the same figures together."""
    alike: dict[tuple[str, ...], list[Row]] = {}
    for task in results.tasks:
        some = [row for row in found if row["task"] == task]
        names = tuple(f.name for f in QUANTITIES if not f.rate and any(math.isfinite(row[f.name]) for row in some))
        always = "time_to_goal_median_s", "time_over_bound_median", "path_efficiency_median"  # of successes
        alike.setdefault(tuple(name for name in names if name not in always), []).extend(some)
    grids = []
    for some in alike.values():
        flows = results.tasks[some[0]["task"]].flows
        success = {} if flows else {"success": pages.success_cell}
        names = ", ".join(dict.fromkeys(row["task"] for row in some))
        grids.append(grid(f"Results: {names}", some, {**LABELS, **success, **FIGURES}))
    return grids


def effects_table(results: Results) -> Grid:
    """Return the table of the study of effects: a line for every case, a column for every policy."""
    asked, cells = results.settings.effects, effects_rows(results)
    lines = [list(some) for _, some in itertools.groupby(cells, key=lambda row: row["case"])]
    columns: dict[str, Callable[[Any], Cell | str]] = {
        f"{asked.task}: effect": lambda some: Cell(
            some[0]["case"], pages.as_yaml(asked.cases[some[0]["case"]], flow=True), "left"
        )
    }
    for k, row in enumerate(lines[0]):
        columns[row["policy"]] = lambda some, k=k: pages.success_cell(some[k], title=f"median time {_time(some[k])}")
    return grid("Effects of the hardware", lines, columns, "matrix")


def _case(asked: Any, name: str) -> Cell:
    return Cell(name, pages.as_yaml(asked.cases[name], flow=True), "left")


def summary_table(results: Results) -> str:
    """Return the tables of the command in Markdown."""
    grids = tables(results, rows(results))
    if results.settings.effects is not None:
        grids.append(effects_table(results))
    if results.settings.under_load is not None:
        grids.append(grid("Under load", load_rows(results), LOAD_FIGURES))
    return "\n\n".join(each.markdown() for each in grids)


def write(results: Results, quiet: bool = False) -> Path:
    """Write report.html, results.csv, episodes.csv, results.json and the film that was asked for; return the page's path.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    settings, found, gaps = results.settings, rows(results), comparisons(results, quiet)
    metrics = [name for name in METRICS if name not in ("rate_bound_per_minute", "cost")]
    episodes = records(results.main, ("task", "hardware", "policy", "seed", *metrics))
    more: dict[str, Any] = {
        "comparisons": [gap | {name: asdict(gap[name]) for name in ("success", "time")} for gap in gaps]
    }
    if settings.effects is not None:
        some = _effects_episodes(results)
        more["effects"] = {
            "task": settings.effects.task,
            "seeds": list(dict.fromkeys(values(some, "seed").tolist())),
            "cases": settings.effects.cases,
            "results": effects_rows(results),
            "episodes": records(some, ("case", "policy", "seed", *ENDS)),
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


# -- page --------------------------------------------------------------------------------------------------------------


def page(results: Results, found: Sequence[Row], gaps: Sequence[Row], quiet: bool = False) -> str:
    """Return the page as HTML."""
    best = best_rows(results, found)
    sections = [
        Section("answers", "Answers", _answers(results, found, best)),
        Section("asked", "Tasks", [pages.task_cards(results)]),
        Section("results", "Results", [TERMS, *tables(results, found)]),
    ]
    compared = against_best(results, gaps, best)
    if compared:
        sections.append(Section("differences", "Differences on the same seeds", _differences(compared)))
    if results.settings.effects is not None:
        sections.append(Section("effects", "Effects of the hardware", _effects(results)))
    sections += _tasks(results, found, quiet)
    load = load_rows(results)
    if load:
        rate = "Parts a minute by what became of them, without the warm-up. Dashed: the bound; band: interval of good parts."
        picture = Picture(data_address(plots.throughput(load)), "Parts a minute against the number of parts", rate)
        lines = grid("Parts a minute under load", load, LOAD_FIGURES)
        sections.append(Section("load", f"{results.settings.under_load.task} under load", [picture, lines]))
    lead = "Every policy meets the same starts and goals, on the same seeds."
    title = f"How well each policy does: {', '.join(results.tasks)}"
    return pages.page(results, "evaluate", title, lead, sections)


def anchor(row: Row) -> str:
    """Return the id of a card."""
    return "-".join(("card", row["task"], row["hardware"], row["policy"])).replace(" ", "_")


def _answers(results: Results, found: Sequence[Row], best: Mapping[tuple[str, str], Row]) -> list[Any]:
    """Return the matrix of policies by tasks, and the tasks that are open."""
    known = {(row["task"], row["hardware"], row["policy"]): row for row in found}
    columns: dict[str, Callable[[Any], Cell | str]] = {
        "task": lambda place: Cell(place[0], kind="name"),
        "hardware": lambda place: place[1],
    }
    for name in dict.fromkeys(row["policy"] for row in found):
        columns[name] = lambda place, name=name: _answer(results, known.get((*place, name)), best[place])
    text = (
        "Share of the episodes that succeed; in small print the median time over the least possible one, or in seconds where "
        "no bound is known. Where parts come and go: good parts a minute. Framed: the best policy of a task."
    )
    some = [
        f"{task}, {machine} hardware: {row['policy']} with {percent(row)} % ({percent_between(row)} %)"
        for (task, machine), row in best.items()
        if not results.tasks[task].flows and row["success_rate"] < OPEN_BELOW
    ]
    about = f"Open: tasks whose best policy succeeds in fewer than {100 * OPEN_BELOW:g} % of the episodes."
    return [
        text,
        grid("Success of every policy on every task", list(best), columns, "matrix"),
        *([about, tuple(some)] if some else []),
    ]


def _answer(results: Results, row: Row | None, best: Row) -> Cell:
    if row is None:
        return Cell("–", sort="")
    more = {"link": anchor(row), "kind": "best" if row is best else ""}
    if results.tasks[row["task"]].flows:
        share, good = row["rate_over_bound_mean"], row["good_per_minute_mean"]
        known = math.isfinite(share)
        small = f"{100 * share:.0f} % of bound" if known else ""
        return Cell(f"{number(good, 1)} / min", small, colour=pages.colour(min(share, 1.0) if known else 0.5), **more)
    ratio = row["time_over_bound_median"]
    small = f"{number(ratio, 2)} ×" if math.isfinite(ratio) else _time(row) if row["successes"] else ""
    return Cell(f"{percent(row)} %", small, colour=pages.colour(row["success_rate"]), **more)


def _differences(gaps: Sequence[Row]) -> list[Any]:
    columns: dict[str, Callable[[Row], Cell | str]] = {
        "task": LABELS["task"],
        "hardware": LABELS["hardware"],
        "policies": lambda gap: Cell(f"{gap['first']} against {gap['second']}", kind="left"),
        "success, points": lambda gap: pages.estimate_cell(gap["success"], 100, 1),
        "both succeed on": lambda gap: f"{gap['both']} seeds",
        "mean time to goal": lambda gap: pages.estimate_cell(gap["time"], 1, 2, " s"),
    }
    text = (
        "Each task's best policy against every other one, seed by seed: success rates, and times on those seeds where both "
        "succeed. Bold: zero is outside the interval in small print."
    )
    return [text, grid("Differences on the same seeds", gaps, columns)]


def _effects(results: Results) -> list[Any]:
    asked = results.settings.effects
    names = [entry.name for entry in results.settings.entries()]
    own = tuple(
        f"{column.name}: sensor with {pages.as_yaml(column.sensor, flow=True)}"
        for column in asked.columns("evaluation.effects", names)
        if column.sensor
    )
    return [f"{asked.task} again: success rate and its interval.", effects_table(results), *([own] if own else [])]


def _tasks(results: Results, found: Sequence[Row], quiet: bool) -> list[Section]:
    """Return the section of each task: arrivals, and a card with pictures of every policy."""
    cards, sections, what = _cards(results, found, quiet), [], described(results)
    order = [entry.name for entry in results.settings.entries()]
    for task, info in results.tasks.items():
        blocks: list[Any] = [info.summary]
        machines = results.hardware_of(task)
        for machine in machines:
            if len(machines) > 1:
                blocks.append(Heading(f"On {machine} hardware"))
            alt = "Parts a minute" if info.flows else "Share of episodes at the goal over time"
            blocks.append(Picture(data_address(plots.arrivals(results, task, machine)), f"{alt}, for each policy"))
            some = []
            for row, pictures in cards:
                if (row["task"], row["hardware"]) == (task, machine):
                    rate = f"{row['good_per_minute_mean']:.1f} a minute" if info.flows else f"{percent(row)} %"
                    name = row["policy"]
                    dot = plots.look_of(name, order)["color"]
                    some.append(Card(name, what[name], aside=rate, dot=dot, id=anchor(row), pictures=pictures))
            blocks.append(Cards(some, wide=True))
        sections.append(Section(task, task, blocks))
    return sections


def _cards(results: Results, found: Sequence[Row], quiet: bool) -> list[tuple[Row, list[Picture]]]:
    """Draw the pictures of every policy on every task and hardware, for each row of ``found``."""
    rollouts = [results.rollout(row["task"], row["hardware"], row["policy"]) for row in found]
    items = [
        (rollout, results.tasks[row["task"]], results.scenery[row["task"]], results.settings.animations, row)
        for row, rollout in zip(found, rollouts, strict=True)
    ]
    with tqdm(total=len(found), desc="drawing", unit="run", disable=quiet) as bar:
        pictures = parallel.run(_pictures, items, workers=results.settings.processes, done=bar.update)
    return list(zip(found, pictures, strict=True))


def _pictures(rollout: films.Rollout, info: TaskInfo, scenery: Any, animated: bool, row: Row) -> list[Picture]:
    """Draw the film and the plot of one policy on one task."""
    diverged = f" {row['diverged']} episodes diverged." if row["diverged"] else ""
    plot = Picture(
        data_address(plots.trajectories(rollout, info, scenery)),
        f"Paths of {row['policy']} on {row['task']} and their errors over time",
        f"Paths, to scale (ring: start, dot: end, circle: goal), and errors over time, of the first episodes.{diverged}",
    )
    if not animated:
        return [plot]
    film = films.film_gif(rollout.film, scenery, rollout.step_time, films.PAGE)
    seed, done = rollout.film.seed, "success" if rollout.film.success else "no success"
    name = f"Film of {row['policy']} on {row['task']}, seed {seed}"
    return [
        Picture(data_address(film, "gif"), name, summary=f"Film of seed {seed}{'' if info.flows else f': {done}'}"),
        plot,
    ]
