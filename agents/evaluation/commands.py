"""``python -m agents evaluate CONFIG``, ``compare``, ``score``, ``datasheet``, ``publish`` and ``verify``."""

from __future__ import annotations

import argparse
import contextlib
from pathlib import Path
from typing import Any

from agents import command_line
from agents.command_line import Command
from vibgym import checks

PUBLISHED = Path("results/report")
FIGURES = "verification.csv"
"""In the directory of a verification: all figures and their intervals."""


def compare_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``compare`` takes, and ``evaluate`` too."""
    command_line.config(parser)
    parser.add_argument("--episodes", type=int, metavar="N", help="episodes of each policy on each task")
    command_line.side_by_side(parser, processes=False)


def evaluate_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``evaluate`` takes."""
    compare_arguments(parser)
    parser.add_argument(
        "--gif", nargs=3, metavar=("TASK", "POLICY", "PATH"), help="also write the film of this pair as a GIF file"
    )
    parser.add_argument("--gif-hardware", metavar="NAME", help="on which hardware, instead of the first one")


def evaluate(arguments: argparse.Namespace) -> None:
    """Run an evaluation, write its files and print the summary."""
    from agents import evaluation

    settings, gif = _settings(evaluation, arguments), None
    if arguments.gif is None and arguments.gif_hardware is not None:
        raise checks.refuse("--gif-hardware", arguments.gif_hardware, "nothing without --gif")
    if arguments.gif is not None:
        task, policy, path = arguments.gif
        gif = evaluation.Gif(task, policy, Path(path), arguments.gif_hardware)
    with checks.within(arguments.config):
        prepared = evaluation.prepare(settings, gif)
        held = _held(settings)
    with held:
        results = evaluation.evaluate(prepared, arguments.quiet, arguments.ray)
        page = evaluation.write(results, prepared.film, arguments.quiet)
    print(f"{evaluation.summary_table(results)}\n\nreport: {page}")


def compare(arguments: argparse.Namespace) -> None:
    """Run a comparison, write its files and print the summary."""
    from agents.evaluation import comparison

    settings = _settings(comparison, arguments)
    with checks.within(arguments.config):
        prepared = comparison.prepare(settings)
        held = _held(settings)
    with held:
        found = comparison.compare(prepared, arguments.quiet, arguments.ray)
        page = comparison.write(found)
    print(f"{comparison.summary_table(found)}\n\npage: {page}")


def _settings(room: Any, arguments: argparse.Namespace) -> Any:
    """Of the file, with what the command says instead."""
    output = None if arguments.output is None else str(arguments.output)
    return room.load_settings(arguments.config, arguments.episodes, output)


def _held(settings: Any) -> Any:
    """The directory is this run's until its files are written."""
    from agents import locks

    return command_line.entered(locks.one_run(Path(settings.output), f"{settings.where}.output"))


def publish_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``publish`` takes."""
    command_line.config(parser, "YAML file of the evaluation")
    parser.add_argument("--run", type=Path, metavar="DIR", help="the evaluation's files, instead of its 'output'")


def publish(arguments: argparse.Namespace) -> None:
    """Keep what an evaluation has found."""
    from agents.evaluation import verification

    record = verification.publish(arguments.config, arguments.run, arguments.output or PUBLISHED)
    print(f"published: {record}")


def verify_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``verify`` takes."""
    parser.add_argument("published", type=Path, nargs="?", default=PUBLISHED, metavar="DIR", help="see publish")
    parser.add_argument("--episodes", type=int, default=20, metavar="N", help="fresh ones of each policy in each place")
    parser.add_argument("--again", type=int, default=5, metavar="N", help="published ones of each, played again")
    parser.add_argument("--first-seed", type=int, metavar="N", help="of the fresh ones, instead of the next one")
    for option in ("--task", "--policy"):
        command_line.some(parser, option)
    command_line.side_by_side(parser)


def verify(arguments: argparse.Namespace) -> int:
    """Play a sample of published results and say whether each figure comes out again."""
    from agents.evaluation import verification
    from vibgym import files

    asked = verification.Asked(
        arguments.episodes, arguments.again, arguments.first_seed, arguments.task, arguments.policy
    )
    checks.count("--processes", arguments.processes, most=256)
    published = verification.load_published(arguments.published)
    if arguments.output is not None:
        files.output_directory(arguments.output, "--output")
        files.output_files([arguments.output / FIGURES], "--output")
    found = verification.verify(published, asked, arguments.processes, arguments.quiet, arguments.ray)
    if arguments.output is not None:
        files.write_atomically(arguments.output / FIGURES, verification.figures_csv(found))
    print(verification.report_of(found))
    return 0 if found.holds else 1


SUITE = Path("configs/suite/open.yaml")


def score_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``score`` takes."""
    parser.add_argument(
        "config", type=Path, nargs="?", default=SUITE, metavar="CONFIG", help=f"the suite, else {SUITE}"
    )
    parser.add_argument(
        "--policy", type=Path, metavar="FILE", help="your own, YAML or JSON as 'policies' have it: score it alone"
    )
    parser.add_argument(
        "--episodes", type=int, metavar="N", help="of each policy on each task, instead of the protocol's"
    )
    command_line.side_by_side(parser, processes=False)


def score(arguments: argparse.Namespace) -> None:
    """Play a suite, or go on where it was left, write its scores and print them."""
    from agents.evaluation import suite

    settings = _settings(suite, arguments)
    if arguments.policy is not None:
        settings = settings.entered_by(arguments.policy)
    with checks.within(arguments.policy or arguments.config):
        prepared = suite.prepare(settings)
        held = _held(settings)
    with held:
        found = suite.score(prepared, arguments.quiet, arguments.ray)
        page = suite.write(found)
    print(f"{suite.summary(found)}\n\npage: {page}")


def datasheet_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``datasheet`` takes."""
    parser.add_argument(
        "config", type=Path, nargs="?", metavar="CONFIG", help="YAML file, see configs/datasheets; else the prototype's"
    )
    parser.add_argument("--episodes", type=int, metavar="N", help="of each measurement")


def datasheet(arguments: argparse.Namespace) -> None:
    """Measure what a surface does with a part, write the sheet and print its lines."""
    from agents.evaluation import datasheet as sheets
    from vibgym import files

    output = None if arguments.output is None else str(arguments.output)
    settings = sheets.load_settings(arguments.config, arguments.episodes, output)
    files.output_files(
        [files.output_directory(Path(settings.output), "datasheet.output") / sheets.PAGE], "datasheet.output"
    )
    with contextlib.ExitStack() as where:
        if arguments.config is not None:
            where.enter_context(checks.within(arguments.config))
        found = sheets.measure(settings, arguments.quiet)
    page = sheets.write(found)
    print(f"{sheets.summary(found)}\n\npage: {page}")


OUTPUT = "directory for what is written, instead of the file's"

COMMANDS = {
    "evaluate": Command(evaluate_arguments, evaluate, OUTPUT),
    "compare": Command(compare_arguments, compare, OUTPUT),
    "score": Command(score_arguments, score, OUTPUT),
    "datasheet": Command(datasheet_arguments, datasheet, OUTPUT),
    "publish": Command(publish_arguments, publish, f"directory for what is kept, instead of {PUBLISHED}"),
    "verify": Command(verify_arguments, verify, f"directory of {FIGURES}: all figures and their intervals"),
}
