"""Command line: ``python -m studies.rivals NAME`` compares the segmented surface with the other machines of Table 1.1.

- ``figures`` plays the tasks, and writes ``results/rivals.csv``; with ``--task`` those lines alone.
- ``push`` writes ``results/rivals-push.csv``: how hard each machine can push several parts at once.
- ``film`` writes ``docs/squeeze-line.gif``: a squeeze line that moves.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from agents import command_line
from agents.command_line import Command, Entry


def _nothing(parser: argparse.ArgumentParser) -> None:
    """No arguments of its own."""


def _tasks(parser: argparse.ArgumentParser) -> None:
    """What ``figures`` takes."""
    command_line.some(parser, "--task")


def figures(arguments: argparse.Namespace) -> None:
    """Play, and write the table."""
    from studies.rivals.figures import EPISODES, rows
    from studies.rivals.tables import FIGURES, merged, read, written
    from vibgym import checks

    for each in arguments.task or ():
        checks.choice("--task", each, tuple(EPISODES))
    path = (arguments.output or Path()) / FIGURES
    chosen = {task: EPISODES[task] for task in EPISODES if task in (arguments.task or EPISODES)}
    found = rows(chosen, report=(lambda _: None) if arguments.quiet else lambda text: print(text, flush=True))
    print(f"table: {written(path, merged(read(path), found))}")


def push(arguments: argparse.Namespace) -> None:
    """Solve the linear programmes, and write the table."""
    from studies.rivals.reach import rows
    from studies.rivals.tables import PUSH, written

    print(f"table: {written((arguments.output or Path()) / PUSH, rows())}")


def film(arguments: argparse.Namespace) -> None:
    """Write the film."""
    from studies.rivals.film import write

    print(f"film: {write(arguments.output or Path())}")


ROOT = "directory of results/ and docs/, instead of the present one"

COMMANDS = {
    "figures": Command(_tasks, figures, ROOT),
    "push": Command(_nothing, push, ROOT),
    "film": Command(_nothing, film, ROOT),
}

ENTRIES = {
    "figures": Entry("studies.rivals.__main__", "play the tasks: results/rivals.csv"),
    "push": Entry("studies.rivals.__main__", "how hard each machine can push several parts: results/rivals-push.csv"),
    "film": Entry("studies.rivals.__main__", "a squeeze line that moves: docs/squeeze-line.gif"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    return command_line.run_one_of(
        "python -m studies.rivals", "Compare the segmented surface with Table 1.1's other machines.", ENTRIES, argv
    )


if __name__ == "__main__":
    sys.exit(main())
