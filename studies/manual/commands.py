"""What ``python -m studies.manual`` does, by name."""

from __future__ import annotations

import argparse
from pathlib import Path

from agents import command_line
from agents.command_line import Command
from studies.manual.figures_file import ROOT

DOCS = ROOT / "docs"


def _none(parser: argparse.ArgumentParser) -> None:
    """Takes nothing of its own."""


def _only(parser: argparse.ArgumentParser) -> None:
    command_line.some(parser, "--only")


def docs(arguments: argparse.Namespace) -> None:
    """All that the pages include."""
    from studies.manual.build import write

    count = write(arguments.output or DOCS)
    print(f"{count} files changed")


def environments(arguments: argparse.Namespace) -> None:
    """The pages of environments."""
    from studies.manual.build import environment_pages, replace

    print(f"{replace(environment_pages(arguments.output or DOCS))} files changed")


def published(arguments: argparse.Namespace) -> None:
    """The tables of published results."""
    from studies.manual.build import replace, tables

    print(f"{replace(tables(arguments.output or DOCS))} files changed")


def readme(arguments: argparse.Namespace) -> None:
    """The README's table."""
    from studies.manual.readme import write

    print(f"README: {write((arguments.output or ROOT) / 'README.md')}")


def films(arguments: argparse.Namespace) -> None:
    """A film of each environment."""
    from studies.manual.films import write

    for path in write(arguments.output or DOCS / "films", arguments.only):
        print(f"{path} {path.stat().st_size / 1e3:.0f} kB", flush=True)


def thesis(arguments: argparse.Namespace) -> None:
    """The thesis's figures beside ours."""
    from studies.manual.thesis import write

    print(f"page: {write(arguments.output or Path(DOCS / 'thesis'), arguments.only)}")


COMMANDS = {
    "docs": Command(_none, docs, "directory of the pages, instead of docs"),
    "environments": Command(_none, environments, "directory of the pages, instead of docs"),
    "published": Command(_none, published, "directory of the pages, instead of docs"),
    "readme": Command(_none, readme, "directory of the README, instead of the checkout"),
    "films": Command(_only, films, "directory of the films, instead of docs/films"),
    "thesis": Command(_only, thesis, "directory of page and pictures, instead of docs/thesis"),
}
