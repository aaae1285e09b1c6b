"""Command line: ``python -m studies.thesis`` draws the thesis's figures beside ours."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from agents import command_line
from agents.command_line import Command


def thesis_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    command_line.some(parser, "--figure")


def thesis(arguments: argparse.Namespace) -> None:
    """Draw, and write the page."""
    from studies.thesis.page import write

    print(f"page: {write(arguments.output or Path('runs/replicate'), arguments.figure)}")


COMMAND = Command(thesis_arguments, thesis, "directory of the page, instead of runs/replicate")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return command_line.run("python -m studies.thesis", "Draw the thesis's figures beside ours.", COMMAND, argv)


if __name__ == "__main__":
    sys.exit(main())
