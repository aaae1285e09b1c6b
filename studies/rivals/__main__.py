"""Command line: ``python -m studies.rivals NAME`` compares the segmented surface with the other machines of Table 1.1.

- ``figures`` evaluates all machines on the tasks and writes ``results/rivals.csv``; ``--task`` updates one task.
- ``push`` writes ``results/rivals-push.csv``: the largest simultaneous pushes of each machine on several parts.
- ``film`` writes ``docs/squeeze-line.gif``: a moving squeeze line.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from agents import command_line
from agents.command_line import Command, Entry


def figures(arguments: argparse.Namespace) -> None:
    """Evaluate, and write the table."""
    from studies.rivals.figures import EPISODES, FIGURES, merged, read, rows, written
    from vibgym import checks

    for each in arguments.task or ():
        checks.choice("--task", each, tuple(EPISODES))
    path = (arguments.output or Path()) / FIGURES
    chosen = {task: EPISODES[task] for task in EPISODES if task in (arguments.task or EPISODES)}
    found = rows(chosen, report=(lambda _: None) if arguments.quiet else lambda text: print(text, flush=True))
    print(f"table: {written(path, merged(read(path), found))}")


def push(arguments: argparse.Namespace) -> None:
    """Solve the linear programmes, and write the table."""
    from studies.rivals.figures import PUSH, written
    from studies.rivals.reach import rows

    print(f"table: {written((arguments.output or Path()) / PUSH, rows())}")


def film(arguments: argparse.Namespace) -> None:
    """Write the film."""
    from studies.rivals.film import write

    print(f"film: {write(arguments.output or Path())}")


ROOT = "directory of results/ and docs/ (default: the current one)"

COMMANDS = {
    "figures": Command(lambda parser: command_line.some(parser, "--task"), figures, ROOT),
    "push": Command(lambda parser: None, push, ROOT),
    "film": Command(lambda parser: None, film, ROOT),
}

HELP = {
    "figures": "evaluate all machines on the tasks: results/rivals.csv",
    "push": "largest simultaneous pushes on several parts: results/rivals-push.csv",
    "film": "a moving squeeze line: docs/squeeze-line.gif",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    entries = {name: Entry("studies.rivals.__main__", help) for name, help in HELP.items()}
    description = "Compare the segmented surface with the other machines of Table 1.1."
    return command_line.run_one_of("python -m studies.rivals", description, entries, argv)


if __name__ == "__main__":
    sys.exit(main())
