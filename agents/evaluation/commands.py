"""``python -m agents evaluate CONFIG``, ``compare``, ``score``, ``datasheet``, ``publish`` and ``verify``."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from agents import command_line
from agents.command_line import Command
from vibgym import checks
from vibgym.config import from_text

PUBLISHED = Path("results/report")
SUITE = Path("configs/suite/open.yaml")
FIGURES = "verification.csv"
"""Written by ``verify``: all figures and their tests."""


def _compare_arguments(parser: argparse.ArgumentParser) -> None:
    command_line.config(parser)
    _episodes(parser)
    command_line.side_by_side(parser, processes=False)


def _episodes(parser: argparse.ArgumentParser, of: str = "episodes of each policy on each task") -> None:
    parser.add_argument("--episodes", type=int, metavar="N", help=of)


def _evaluate_arguments(parser: argparse.ArgumentParser) -> None:
    _compare_arguments(parser)
    parser.add_argument(
        "--gif", nargs=3, metavar=("TASK", "POLICY", "PATH"), help="also write the film of this pair as a GIF file"
    )
    parser.add_argument("--gif-hardware", metavar="NAME", help="on which hardware, instead of the first one")


def evaluate(arguments: argparse.Namespace) -> None:
    """Run an evaluation, write its files and print the summary."""
    from agents.evaluation import report
    from agents.evaluation.settings import EvaluationSettings

    settings, gif = _settings(EvaluationSettings, arguments), None
    if arguments.gif is not None:
        task, policy, path = arguments.gif
        gif = report.Gif(task, policy, Path(path), arguments.gif_hardware)
    elif arguments.gif_hardware is not None:
        raise checks.conflict("--gif-hardware requires --gif")
    _run(report, settings, arguments, gif)


def compare(arguments: argparse.Namespace) -> None:
    """Run a comparison, write its files and print the summary."""
    from agents.evaluation import compare as comparison
    from agents.evaluation.settings import ComparisonSettings

    _run(comparison, _settings(ComparisonSettings, arguments), arguments)


def _settings(kind: Any, arguments: argparse.Namespace) -> Any:
    """Return the settings of the file, with options of the command line."""
    output = None if arguments.output is None else str(arguments.output)
    return kind.load(arguments.config, arguments.episodes, output)


@contextlib.contextmanager
def _played(view: Any, settings: Any, arguments: argparse.Namespace, source: Path, *more: Any) -> Iterator[Any]:
    """Prepare and run an evaluation, and hold the lock of its directory; errors of input name ``source``."""
    from agents import locks
    from agents.evaluation import run

    with checks.within(source):
        prepared = view.prepare(settings, *more)
        lock = command_line.entered(locks.one_run(Path(settings.output), f"{settings.where}.output"))
    with lock:
        yield run.evaluate(prepared, arguments.quiet, arguments.ray)


def _run(view: Any, settings: Any, arguments: argparse.Namespace, *more: Any, source: Path | None = None) -> Any:
    """Run what ``view`` (a module) prepares, write its files, print its summary, and return the results."""
    with _played(view, settings, arguments, source or arguments.config, *more) as results:
        page = view.write(results, arguments.quiet)
    print(f"{view.summary_table(results)}\n\npage: {page}")
    return results


def _score_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "config", type=Path, nargs="?", default=SUITE, metavar="CONFIG", help=f"suite (default: {SUITE})"
    )
    parser.add_argument(
        "--policy", type=Path, metavar="FILE", help="score this policy alone: YAML or JSON, as an entry of 'policies'"
    )
    parser.add_argument(
        "--enter", metavar="AUTHORS", help="with --policy: write an entry of these authors into entries/"
    )
    parser.add_argument(
        "--entries",
        type=Path,
        metavar="DIR",
        help="play and rank the entries of a directory",
    )
    parser.add_argument(
        "--trust",
        action="append",
        default=[],
        metavar="NAME",
        help="with --entries: run the code of this entry, in a process of its own; may be repeated",
    )
    _episodes(parser)
    command_line.side_by_side(parser, processes=False)


def score(arguments: argparse.Namespace) -> None:
    """Play a suite, or the rest of it, write the scores and print them."""
    from agents.evaluation import score as suite

    if arguments.enter is not None and arguments.policy is None:
        raise checks.conflict("--enter requires --policy")
    if arguments.trust and arguments.entries is None:
        raise checks.conflict("--trust requires --entries")
    if arguments.entries is not None:
        _rank_entries(arguments)
        return
    settings = _settings(suite.SuiteSettings, arguments)
    if arguments.policy is not None:
        settings = settings.entered_by(arguments.policy)
    if arguments.enter is None:
        _run(suite, settings, arguments, source=arguments.policy)
        return
    from agents.evaluation import entries

    assert arguments.policy is not None
    policy = settings.entries()[0]
    entries.new_folder(policy, arguments.policy, settings)  # refused before anything is played
    _run(suite, settings, arguments, source=arguments.policy)
    print(f"entry: {entries.enter(policy, arguments.policy, arguments.enter, settings)}")


def _rank_entries(arguments: argparse.Namespace) -> None:
    """Play and rank entries."""
    from agents.evaluation import entries
    from agents.evaluation import score as suite

    if arguments.policy is not None:
        raise checks.conflict("--entries excludes --policy")
    settings, protocol = _settings(suite.SuiteSettings, arguments), suite.SuiteSettings.load(arguments.config)
    found = entries.load_entries(arguments.entries, settings, arguments.trust)
    try:
        with _played(suite, entries.entered(settings, found), arguments, arguments.entries, found) as played:
            results = entries.without_failures(played)
            ranked = entries.ranking(found, results)
            text = entries.table(ranked, results, protocol)
            page = entries.write(ranked, text, Path(settings.output))
    finally:
        for entry in found.values():
            if entry.process is not None:
                entry.process.stop()
    print(f"{text}\n\ntable: {page}")


def _datasheet_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "config", type=Path, nargs="?", metavar="CONFIG", help="see configs/datasheets (default: the prototype)"
    )
    parser.add_argument("--machine", metavar="FILE", help="settings of an identified machine, such as machine.yaml")
    parser.add_argument(
        "--part", metavar="PART", help="drawing, name of a shipped part, or a JSON mapping as in CONFIG"
    )
    _episodes(parser, "episodes of each measurement")


def datasheet(arguments: argparse.Namespace) -> None:
    """Measure a surface with a part, write the sheet and print its lines."""
    from agents.evaluation import datasheet, datasheet_page
    from vibgym import files

    given = {name: getattr(arguments, name) for name in ("machine", "part") if getattr(arguments, name) is not None}
    if "part" in given:
        given["part"] = from_text("--part", given["part"])
    output = None if arguments.output is None else str(arguments.output)
    settings = datasheet.DatasheetSettings.given(arguments.config, given, arguments.episodes, output)
    field = "datasheet.output"
    files.output_files([files.output_directory(Path(settings.output), field) / datasheet_page.PAGE], field)
    with contextlib.nullcontext() if arguments.config is None else checks.within(arguments.config):
        found = datasheet.measure(settings, arguments.quiet)
    page = datasheet_page.write(found)
    print(f"{datasheet_page.summary(found)}\n\npage: {page}")


def _publish_arguments(parser: argparse.ArgumentParser) -> None:
    command_line.config(parser, "YAML file of the evaluation")
    parser.add_argument("--run", type=Path, metavar="DIR", help="the evaluation's files (default: its 'output')")


def publish(arguments: argparse.Namespace) -> None:
    """Publish the figures and episodes of an evaluation."""
    from agents.evaluation.published import publish

    print(f"published: {publish(arguments.config, arguments.run, arguments.output or PUBLISHED)}")


def _verify_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("published", type=Path, nargs="?", default=PUBLISHED, metavar="DIR", help="see publish")
    parser.add_argument(
        "--episodes", type=int, default=20, metavar="N", help="new episodes per policy, task and hardware"
    )
    parser.add_argument("--again", type=int, default=5, metavar="N", help="published episodes of each, played again")
    parser.add_argument(
        "--first-seed", type=int, metavar="N", help="of the new episodes (default: after the last published)"
    )
    for option in ("--task", "--policy"):
        command_line.some(parser, option)
    command_line.side_by_side(parser)


def verify(arguments: argparse.Namespace) -> int:
    """Play a sample of published results; the exit code is 1 if a figure cannot be reproduced."""
    from agents.evaluation import published, verify
    from vibgym import files

    sample = verify.Sample(arguments.episodes, arguments.again, arguments.first_seed, arguments.task, arguments.policy)
    checks.count("--processes", arguments.processes, most=256)
    known = published.load(arguments.published)
    if arguments.output is not None:
        files.output_directory(arguments.output, "--output")
        files.output_files([arguments.output / FIGURES], "--output")
    found = verify.verify(known, sample, arguments.processes, arguments.quiet, arguments.ray)
    if arguments.output is not None:
        files.write_atomically(arguments.output / FIGURES, verify.figures_csv(found))
    print(verify.report_of(found))
    return 0 if found.holds else 1


OUTPUT = "output directory (default: that of the file)"

COMMANDS = {
    "evaluate": Command(_evaluate_arguments, evaluate, OUTPUT),
    "compare": Command(_compare_arguments, compare, OUTPUT),
    "score": Command(_score_arguments, score, OUTPUT),
    "datasheet": Command(_datasheet_arguments, datasheet, OUTPUT),
    "publish": Command(_publish_arguments, publish, f"directory of published results (default: {PUBLISHED})"),
    "verify": Command(_verify_arguments, verify, f"directory of {FIGURES}: all figures and their tests"),
}
