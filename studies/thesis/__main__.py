"""Command line: ``python -m studies.thesis`` draws the figures of the thesis with values of the thesis and of vibgym."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from agents import command_line
from agents.command_line import Command


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    command_line.some(parser, "--figure")


def _write_page(arguments: argparse.Namespace) -> None:
    from studies.thesis.figures import write

    print(f"page: {write(arguments.output or Path('runs/replicate'), arguments.figure)}")


COMMAND = Command(_add_arguments, _write_page, "directory of the page (default: runs/replicate)")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return command_line.run("python -m studies.thesis", "Reproduce the figures of the thesis.", COMMAND, argv)


if __name__ == "__main__":
    sys.exit(main())
