"""``python -m agents tune CONFIG``."""

from __future__ import annotations

import argparse

from agents import command_line
from agents.command_line import Command


def tune_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``tune`` takes."""
    command_line.config(parser)
    parser.add_argument("--agent", metavar="NAME", help="which one of a file of many, such as Align/ideal")
    parser.add_argument("--trials", type=int, metavar="N", help="in all, instead of the file's")
    command_line.side_by_side(parser)


def tune(arguments: argparse.Namespace) -> None:
    """Look for better hyperparameters."""
    from agents.tuning.tune import tune

    asked = vars(arguments)
    names = ("config", "agent", "trials", "output", "quiet", "processes", "ray")
    page, best = tune(**{name: asked[name] for name in names})
    if best is not None:
        print(f"best: trial {best.number}, {best.score:.3f} s, {best.values}")
    print(f"page: {page}")


COMMANDS = {"tune": Command(tune_arguments, tune, "directory of the study, instead of runs/tuning/NAME")}
