"""Command line: ``python -m studies.manual COMMAND`` writes what the documentation shows but nobody types, see ``--help``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from agents.command_line import Entry, run_one_of

MODULE = "studies.manual.commands"
COMMANDS = {
    "docs": Entry(MODULE, "everything that is generated when the pages are built: tables and pages of environments"),
    "environments": Entry(MODULE, "a page for each environment"),
    "published": Entry(MODULE, "the tables of published results"),
    "readme": Entry(MODULE, "the README's table of results"),
    "films": Entry(MODULE, "a short film of each environment (minutes)"),
    "thesis": Entry(MODULE, "the thesis's figures beside ours (minutes)"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return run_one_of("python -m studies.manual", "Write what the documentation shows.", COMMANDS, argv)


if __name__ == "__main__":
    sys.exit(main())
