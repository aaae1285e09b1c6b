"""``python -m agents compare CONFIG``."""

from __future__ import annotations

import argparse
from pathlib import Path

from agents import command_line
from agents.command_line import Command


def compare_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``compare`` takes."""
    command_line.config(parser)
    parser.add_argument("--episodes", type=int, metavar="N", help="episodes of each policy on each task")
    command_line.side_by_side(parser, processes=False)


def compare(arguments: argparse.Namespace) -> None:
    """Run a comparison, write its files and print the summary."""
    from agents import locks
    from agents.evaluation import comparison

    settings = comparison.load_settings(
        arguments.config, arguments.episodes, None if arguments.output is None else str(arguments.output)
    )
    with command_line.named(arguments.config):
        prepared = comparison.prepare(settings)
        held = command_line.entered(locks.one_run(Path(settings.output), "comparison.output"))
    with held:
        found = comparison.compare(prepared, arguments.quiet, arguments.ray)
        page = comparison.write(found)
    print(comparison.summary_table(found))
    print(f"\npage: {page}")


COMMANDS = {"compare": Command(compare_arguments, compare, "directory for what is written, instead of the file's")}
