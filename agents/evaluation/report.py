"""The report: ``python -m agents evaluate CONFIG`` writes report.html, results.csv, episodes.csv and results.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from agents.evaluation import films, pages
from agents.evaluation.report_page import page
from agents.evaluation.report_rows import (
    KINDS,
    LOAD_HEADS,
    Row,
    by_case,
    cell,
    comparisons,
    effects_rows,
    kind_of,
    load_cells,
    load_rows,
    rows,
)
from agents.evaluation.run import Prepared, Results, effects_runs, load_runs, main_runs, writable
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.table import (
    BY_NAME,
    EFFECTS,
    ENDS,
    METRICS,
    REPORT,
    Place,
    markdown,
    percent,
    percent_between,
    quantity,
)
from vibgym import checks
from vibgym.files import csv_text, output_files, write_together

FILES = ("results.csv", "episodes.csv", "results.json", "report.html")


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


def summary_table(results: Results) -> str:
    """Return the tables of the command in Markdown, one for each kind of tasks and study."""
    found = rows(results)
    labels = ["task", *(["hardware"] if len(results.hardware_of()) > 1 else []), "policy"]
    level = f"{100 * results.settings.confidence:g} % interval"
    tables = []
    for name, kind in KINDS.items():
        heads, lines = [BY_NAME[each].label for each in kind.summary], []
        if name != "flows":
            heads = ["success", level, "time to goal", *heads, "fallen"]
        for row in found:
            if kind_of(results.tasks[row["task"]]) == name:
                cells = [cell(row, each)[0] for each in kind.summary]
                if name != "flows":
                    time = BY_NAME["time_to_goal_median_s"].text(row)
                    cells = [f"{percent(row)} %", f"{percent_between(row)} %", time, *cells, str(row["fallen"])]
                lines.append([*(row[label] for label in labels), *cells])
        if lines:
            tables.append(markdown([*labels, *heads], lines))
    effects = effects_rows(results)
    if effects:
        policies = list(dict.fromkeys(cell["policy"] for cell in effects))
        lines = [[case, *map(_effect, cells)] for case, cells in by_case(effects)]
        tables.append(markdown((f"{results.settings.effects.task}: effect", *policies), lines))
    load = load_rows(results)
    if load:
        lines = [[str(row["parts"]), row["policy"], *load_cells(row)] for row in load]
        tables.append(markdown((f"{results.settings.under_load.task}: parts", "policy", *LOAD_HEADS), lines))
    return "\n\n".join(tables)


def _effect(cell: Row) -> str:
    time = f" ({quantity(cell['time_to_goal_median_s'], 1.0, 2, 's')})" if cell["successes"] else ""
    return f"{percent(cell)} %{time}"


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
