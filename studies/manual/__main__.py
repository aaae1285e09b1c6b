"""Command line: ``python -m studies.manual COMMAND`` writes generated parts of the documentation, see ``--help``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from agents import command_line
from agents.command_line import Command, Entry
from studies.manual.figures_file import DOCS, ROOT


def docs(arguments: argparse.Namespace) -> None:
    """Write tables and pages of environments."""
    from studies.manual.build import write

    print(f"{write(arguments.output or DOCS)} files changed")


def readme(arguments: argparse.Namespace) -> None:
    """Write the README's table of results."""
    from studies.manual.build import write_readme

    print(f"README: {write_readme((arguments.output or ROOT) / 'README.md')}")


def films(arguments: argparse.Namespace) -> None:
    """Write one film per environment."""
    from studies.manual.films import write

    for path in write(arguments.output or DOCS / "films", arguments.only):
        print(f"{path} {path.stat().st_size / 1e3:.0f} kB", flush=True)


def thesis(arguments: argparse.Namespace) -> None:
    """Write the thesis's figures beside the simulated ones."""
    from studies.thesis.figures import write_markdown

    print(f"page: {write_markdown(arguments.output or DOCS / 'thesis', arguments.only)}")


def site(arguments: argparse.Namespace) -> None:
    """Build the documentation of several versions into one site."""
    from studies.manual.site import build

    print(f"site: {build(arguments.output or ROOT / 'runs' / 'site', arguments.refs)}")


def _refs(parser: argparse.ArgumentParser) -> None:
    help = "branches or tags of Git (default: the checkout, as it is)"
    parser.add_argument("refs", nargs="*", metavar="REF", help=help)


def _only(parser: argparse.ArgumentParser) -> None:
    command_line.some(parser, "--only")


COMMANDS = {
    "docs": Command(lambda parser: None, docs, "directory of the pages (default: docs)"),
    "readme": Command(lambda parser: None, readme, "directory of the README (default: the checkout)"),
    "site": Command(_refs, site, "directory of the site (default: runs/site)"),
    "films": Command(_only, films, "directory of the films (default: docs/films)"),
    "thesis": Command(_only, thesis, "directory of page and pictures (default: docs/thesis)"),
}

MODULE = "studies.manual.__main__"
ENTRIES = {
    "docs": Entry(MODULE, "tables and pages of environments, which the documentation build writes"),
    "readme": Entry(MODULE, "the README's table of results"),
    "site": Entry(MODULE, "the documentation of several versions with a list of them (a minute each)"),
    "films": Entry(MODULE, "one short film per environment (minutes)"),
    "thesis": Entry(MODULE, "the thesis's figures beside the simulated ones (minutes)"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return command_line.run_one_of("python -m studies.manual", "Write parts of the documentation.", ENTRIES, argv)


if __name__ == "__main__":
    sys.exit(main())
