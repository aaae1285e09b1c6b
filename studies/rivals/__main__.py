"""The segmented surface and the other machines of Table 1.1: ``python -m studies.rivals NAME``.

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
from studies import common
from studies.rivals import figures, film, reach
from vibgym import checks


def run(asked: argparse.Namespace) -> int:
    """Run a command; return the exit code."""
    if asked.name == "film":
        print(f"film: {film.write(asked.output)}")
    elif asked.name == "push":
        print(f"table: {figures.store(asked.output / figures.PUSH, reach.rows())}")
    else:
        for task in asked.task:
            checks.choice("--task", task, tuple(figures.EPISODES))
        chosen = {task: count for task, count in figures.EPISODES.items() if task in (asked.task or figures.EPISODES)}
        rows = figures.rows(chosen, report=lambda text: None if asked.quiet else print(text, flush=True))
        print(f"table: {figures.store(asked.output / figures.FIGURES, rows)}")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("name", metavar="NAME", choices=("figures", "push", "film"), help="figures, push or film")
    parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="directory of results/ and docs/")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    command_line.some(parser, "--task")
    parser.set_defaults(task=[])
    asked = parser.parse_args(argv)
    return command_line.guarded("python -m studies.rivals", lambda: run(asked))


if __name__ == "__main__":
    sys.exit(main())
