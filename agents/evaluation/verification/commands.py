"""``python -m agents publish CONFIG`` and ``verify``."""

from __future__ import annotations

import argparse
from pathlib import Path

from agents import command_line
from agents.command_line import Command

PUBLISHED = Path("results/report")
FIGURES = "verification.csv"
"""In the directory of a verification: all figures and their intervals."""


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
    from vibgym import checks, files

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


COMMANDS = {
    "publish": Command(publish_arguments, publish, f"directory for what is kept, instead of {PUBLISHED}"),
    "verify": Command(verify_arguments, verify, f"directory of {FIGURES}: all figures and their intervals"),
}
