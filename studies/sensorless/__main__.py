"""Command line: ``python -m studies.sensorless CONFIG``.

Searches for schedules, compares them with hand-made ones, and writes the best of each part and hardware model, and a page.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from agents import command_line
from agents.command_line import Command


def sensorless_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    command_line.config(parser, "YAML file, see configs/sensorless.yaml")
    parser.add_argument("--page", type=Path, metavar="PATH", help="path of the page (default: sensorless.md in DIR)")


def sensorless(arguments: argparse.Namespace) -> None:
    """Search, evaluate, and write schedules and page."""
    from studies.sensorless.settings import load_settings
    from studies.sensorless.study import study
    from vibgym.files import output_directory, write_atomically

    settings = load_settings(arguments.config)
    directory = output_directory(arguments.output or Path("runs/sensorless"))
    page = arguments.page or directory / "sensorless.md"
    write_atomically(page, study(settings, str(arguments.config), directory))
    print(f"page: {page}")


COMMAND = Command(sensorless_arguments, sensorless, "directory of the schedules (default: runs/sensorless)")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return command_line.run(
        "python -m studies.sensorless", "Search for sensorless schedules and evaluate them.", COMMAND, argv
    )


if __name__ == "__main__":
    sys.exit(main())
