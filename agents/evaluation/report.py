"""Reports: ``python -m agents evaluate CONFIG`` and ``python -m agents compare CONFIG``.

Both play policies on the same seeds and write tables, paired differences and studies. An evaluation also shows paths and films;
a comparison groups policies into learned, hybrid and classical ones.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

from agents import command_line
from agents.command_line import Command
from agents.evaluation import commands, pages
from agents.evaluation.plan import prepare
from agents.evaluation.report_page import page
from agents.evaluation.rows import best_classical, differences, ladders, load_rows, rows, study_rows
from agents.evaluation.run import GIF, Prepared, Results
from agents.evaluation.settings import ComparisonSettings, EvaluationSettings
from agents.evaluation.statistics import Estimate
from agents.evaluation.table import EFFECTS, ENDS, METRICS, REPORT, records, values, where
from vibgym import checks
from vibgym.files import csv_text, output_directory, output_files, write_together

FILES = {
    "evaluation": ("results.csv", "results.json", "report.html", "episodes.csv"),
    "comparison": ("compare.csv", "compare.json", "compare.html"),
}
"""Rows, all results, page, and episodes."""

UNPUBLISHED = ("rate_bound_per_minute", "cost", "filmed")
"""Metrics that are not in the files of a report."""


class Gif(NamedTuple):
    """Film to be written as a GIF file: of one policy on one task, by default on its first hardware."""

    task: str
    policy: str
    path: Path
    hardware: str | None = None


def with_film(prepared: Prepared, gif: Gif) -> Prepared:
    """Return the cases with a film of one of them.

    Raises:
        ValueError: no such case, or a path that cannot be written.
    """
    some = [case for case in prepared.cases if case.place.study == REPORT]
    for option, label, wanted in (
        ("--gif TASK", "task", gif.task),
        ("--gif-hardware", "hardware", gif.hardware),
        ("--gif POLICY", "policy", gif.policy),
    ):
        if wanted is not None:
            checks.choice(option, wanted, tuple(dict.fromkeys(getattr(case.place, label) for case in some)))
            some = [case for case in some if getattr(case.place, label) == wanted]
    output_files([gif.path], "--gif PATH")
    settings = prepared.settings
    if gif.path.resolve() in [(Path(settings.output) / name).resolve() for name in FILES[settings.where]]:
        raise checks.refuse("--gif PATH", str(gif.path), "different from the files of the report")
    filmed = replace(some[0], pictures=(*some[0].pictures, GIF))
    return replace(prepared, cases=tuple(filmed if case is some[0] else case for case in prepared.cases))


def write(results: Results, gif: Gif | None = None, quiet: bool = False) -> tuple[Path, str]:
    """Write :data:`FILES` and a film; return the page's path, and the tables in Markdown.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    settings, all_rows = results.settings, rows(results)
    gaps, rungs = differences(results, all_rows, quiet), ladders(results, all_rows)
    compares = settings.where == "comparison"
    metrics = [name for name in METRICS if name not in UNPUBLISHED]
    episodes = records(results.main, ("task", "hardware", "policy", "seed", *metrics))
    cells = {place: study_rows(results, place, study) for place, study in settings.studies.items()}
    estimates = [{key: asdict(v) if isinstance(v, Estimate) else v for key, v in gap.items()} for gap in gaps]
    more: dict[str, Any] = {"differences" if compares else "comparisons": estimates}
    if compares:
        best = best_classical(all_rows)
        more["best_classical"] = [{key: row[key] for key in ("task", "hardware", "policy")} for row in best.values()]
        more["curves"] = [
            {"task": task, "policy": policy, "training_seed": seed} | curve.to_dict("list")
            for (task, policy), runs in results.curves.items()
            for seed, curve in runs.items()
        ]
    if settings.effects is not None:
        some = where(results.episodes, study=EFFECTS).rename(columns={"hardware": "case"}, errors="raise")
        more["effects"] = {
            "task": settings.effects.task,
            "seeds": list(dict.fromkeys(values(some, "seed").tolist())),
            "cases": settings.effects.cases,
            "results": cells["effects"],
            "episodes": records(some, ("case", "policy", "seed", *ENDS)),
        }
    more["generalisation"] = [
        study.model_dump() | {"results": cells[f"generalisation.{k}"]}
        for k, study in enumerate(settings.generalisation)
    ]
    more["ladders"] = rungs
    load = load_rows(results)
    if settings.under_load is not None:
        more["load"] = {"task": settings.under_load.task, "results": load}
    if not compares:
        more["episodes"] = episodes
    html, text = page(results, all_rows, gaps, cells, rungs, load)
    written = csv_text(all_rows), pages.json_text(results, all_rows, more), html, csv_text(episodes)
    directory, files = output_directory(Path(settings.output), f"{settings.where}.output"), FILES[settings.where]
    contents: dict[Path, str | bytes] = {
        directory / name: content for name, content in zip(files, written, strict=False)
    }
    if gif is not None:
        contents[gif.path] = next(pictures[GIF] for pictures in results.pictures.values() if GIF in pictures)
    write_together(contents)
    return directory / files[2], text


# -- commands ----------------------------------------------------------------------------------------------------------


def _compare_arguments(parser: argparse.ArgumentParser) -> None:
    command_line.config(parser)
    commands.add_episodes(parser)


def _evaluate_arguments(parser: argparse.ArgumentParser) -> None:
    _compare_arguments(parser)
    parser.add_argument(
        "--gif", nargs=3, metavar=("TASK", "POLICY", "PATH"), help="also write the film of this pair as a GIF file"
    )
    parser.add_argument("--gif-hardware", metavar="NAME", help="on which hardware, instead of the first one")


def evaluate(arguments: argparse.Namespace) -> None:
    """Run an evaluation, write its files and print the summary."""
    gif = None
    if arguments.gif is not None:
        task, policy, path = arguments.gif
        gif = Gif(task, policy, Path(path), arguments.gif_hardware)
    elif arguments.gif_hardware is not None:
        raise checks.conflict("--gif-hardware requires --gif")
    _run(EvaluationSettings, arguments, gif)


def compare(arguments: argparse.Namespace) -> None:
    """Run a comparison, write its files and print the summary."""
    _run(ComparisonSettings, arguments)


def _run(kind: type[EvaluationSettings], arguments: argparse.Namespace, gif: Gif | None = None) -> None:
    settings = commands.load(kind, arguments)

    def prepared() -> Prepared:
        ready = prepare(settings)
        return ready if gif is None else with_film(ready, gif)

    with commands.played(prepared, FILES[settings.where], arguments, arguments.config) as results:
        path, text = write(results, gif, arguments.quiet)
        print(f"{text}\n\npage: {path}")


COMMANDS = {
    "evaluate": Command(_evaluate_arguments, evaluate, commands.OUTPUT),
    "compare": Command(_compare_arguments, compare, commands.OUTPUT),
}
