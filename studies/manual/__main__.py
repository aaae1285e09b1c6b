"""Command line: ``python -m studies.manual COMMAND`` writes what the documentation shows but nobody types, see ``--help``."""

from __future__ import annotations

from collections.abc import Sequence

from vibgym import interrupts

interrupts.start_command()

from agents.command_line import Room, run_one_of  # noqa: E402 - imports take seconds in which Ctrl-C is in hand already

MODULE = "studies.manual.commands"
ROOMS = {
    "docs": Room(MODULE, "everything that is generated when the pages are built: tables and pages of environments"),
    "environments": Room(MODULE, "a page for each environment"),
    "published": Room(MODULE, "the tables of published results"),
    "readme": Room(MODULE, "the README's table of results"),
    "films": Room(MODULE, "a short film of each environment (minutes)"),
    "thesis": Room(MODULE, "the thesis's figures beside ours (minutes)"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return run_one_of("python -m studies.manual", "Write what the documentation shows.", ROOMS, argv)


if __name__ == "__main__":
    interrupts.leave(main())
