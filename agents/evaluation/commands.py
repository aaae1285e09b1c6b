"""``python -m agents evaluate CONFIG``."""

from __future__ import annotations

import argparse
from pathlib import Path

from agents import command_line
from agents.command_line import Command


def evaluate_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``evaluate`` takes."""
    command_line.config(parser)
    parser.add_argument("--episodes", type=int, metavar="N", help="episodes of each policy on each task")
    command_line.side_by_side(parser, processes=False)
    parser.add_argument(
        "--gif", nargs=3, metavar=("TASK", "POLICY", "PATH"), help="also write the film of this pair as a GIF file"
    )
    parser.add_argument("--gif-hardware", metavar="NAME", help="on which hardware, instead of the first one")


def evaluate(arguments: argparse.Namespace) -> None:
    """Run an evaluation, write its files and print the summary."""
    from agents import evaluation, locks

    settings = evaluation.load_settings(
        arguments.config, arguments.episodes, None if arguments.output is None else str(arguments.output)
    )
    gif = None
    if arguments.gif is None and arguments.gif_hardware is not None:
        raise ValueError(f"--gif-hardware: got {arguments.gif_hardware!r}; allowed: nothing without --gif")
    if arguments.gif is not None:
        task, policy, path = arguments.gif
        gif = evaluation.Gif(task, policy, Path(path), arguments.gif_hardware)
    with command_line.named(arguments.config):
        prepared = evaluation.prepare(settings, gif)
        held = command_line.entered(locks.one_run(Path(settings.output), "evaluation.output"))
    with held:  # the directory is this run's until its files are written
        results = evaluation.evaluate(prepared, arguments.quiet, arguments.ray)
        page = evaluation.write(results, prepared.film, arguments.quiet)
    print(evaluation.summary_table(results))
    print(f"\nreport: {page}")


COMMANDS = {"evaluate": Command(evaluate_arguments, evaluate, "directory for what is written, instead of the file's")}
