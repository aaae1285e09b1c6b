"""Command line: ``python -m studies.manual COMMAND`` writes generated parts of the documentation, see ``--help``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from agents import command_line
from agents.command_line import Command, Entry
from studies.manual.figures_file import ROOT

DOCS = ROOT / "docs"


def _none(parser: argparse.ArgumentParser) -> None:
    """Add no arguments."""


def _only(parser: argparse.ArgumentParser) -> None:
    """Add the selection by name."""
    command_line.some(parser, "--only")


def docs(arguments: argparse.Namespace) -> None:
    """Write everything that the pages include."""
    from studies.manual.build import write

    print(f"{write(arguments.output or DOCS)} files changed")


def readme(arguments: argparse.Namespace) -> None:
    """Write the README's table of results."""
    from studies.manual.readme import write

    print(f"README: {write((arguments.output or ROOT) / 'README.md')}")


def films(arguments: argparse.Namespace) -> None:
    """Write a film of each environment."""
    from studies.manual.films import write

    for path in write(arguments.output or DOCS / "films", arguments.only):
        print(f"{path} {path.stat().st_size / 1e3:.0f} kB", flush=True)


def thesis(arguments: argparse.Namespace) -> None:
    """Write the thesis's figures beside the repeated ones."""
    from studies.manual.thesis import write

    print(f"page: {write(arguments.output or DOCS / 'thesis', arguments.only)}")


COMMANDS = {
    "docs": Command(_none, docs, "directory of the pages, instead of docs"),
    "readme": Command(_none, readme, "directory of the README, instead of the checkout"),
    "films": Command(_only, films, "directory of the films, instead of docs/films"),
    "thesis": Command(_only, thesis, "directory of page and pictures, instead of docs/thesis"),
}

MODULE = "studies.manual.__main__"
ENTRIES = {
    "docs": Entry(MODULE, "everything that is generated when the pages are built: tables and pages of environments"),
    "readme": Entry(MODULE, "the README's table of results"),
    "films": Entry(MODULE, "a short film of each environment (minutes)"),
    "thesis": Entry(MODULE, "the thesis's figures beside ours (minutes)"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return command_line.run_one_of("python -m studies.manual", "Write parts of the documentation.", ENTRIES, argv)


if __name__ == "__main__":
    sys.exit(main())
