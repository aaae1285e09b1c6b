"""What the commands of evaluations have in common."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from agents import command_line, locks
from agents.evaluation.run import Prepared, Results, evaluate
from vibgym import checks
from vibgym.files import output_directory, output_files

OUTPUT = "output directory (default: that of the file)"


def add_episodes(parser: argparse.ArgumentParser) -> None:
    """Add the options of commands that play a settings file."""
    parser.add_argument("--episodes", type=int, metavar="N", help="episodes of each policy on each task")
    command_line.side_by_side(parser, processes=False)


def load(kind: Any, arguments: argparse.Namespace) -> Any:
    """Return the settings of the file, with options of the command line."""
    output = None if arguments.output is None else str(arguments.output)
    return kind.load(arguments.config, arguments.episodes, output)


@contextlib.contextmanager
def played(
    prepare: Callable[[], Prepared], files: Sequence[str], arguments: argparse.Namespace, source: Path
) -> Iterator[Results]:
    """Prepare and run an evaluation, and hold the lock of its directory.

    Args:
        prepare: returns the cases.
        files: names of the files that will be written.
        arguments: of the command line.
        source: file or directory of the settings, which errors name.
    """
    with contextlib.ExitStack() as lock:
        with checks.within(source):
            prepared = prepare()
            directory, field = Path(prepared.settings.output), f"{prepared.settings.where}.output"
            output_files((output_directory(directory, field) / name for name in files), field)
            lock.enter_context(locks.one_run(directory, field))
        yield evaluate(prepared, arguments.quiet, arguments.ray)
