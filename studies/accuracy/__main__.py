"""Command line: ``python -m studies.accuracy CONFIG`` measures error against cost and writes a report."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Sequence

from agents import command_line
from agents.command_line import Command
from vibgym import checks


def progress(text: str) -> None:
    """Print one line on stderr that is overwritten by the next, or separate lines where stderr is no terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[2K{text[:110]}", end="", file=sys.stderr, flush=True)
    elif text.endswith((": truth", ": independent reference")) or ":" not in text:
        print(text, file=sys.stderr, flush=True)


def accuracy_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    command_line.config(parser, "YAML file, see configs/accuracy/")


def accuracy(arguments: argparse.Namespace) -> None:
    """Run the measurements of the settings and write the report."""
    # Imports come first, so that a missing extra is reported before minutes of measuring.
    from agents import locks
    from studies.accuracy import page, report, settings

    asked = settings.load_settings(arguments.config, None if arguments.output is None else str(arguments.output))
    with contextlib.ExitStack() as lock:  # of the directory, until the files are written
        with checks.within(arguments.config):
            prepared = report.prepare(asked)
            lock.enter_context(locks.one_run(prepared.output))
        results = report.run(prepared, (lambda text: None) if arguments.quiet else progress)
        path = page.write(results, prepared.output)
    if not arguments.quiet and sys.stderr.isatty():
        print("\r\x1b[2K", end="", file=sys.stderr)
    print(page.summary(results))
    print(f"\nreport: {path}")


COMMAND = Command(accuracy_arguments, accuracy, "output directory, instead of the file's")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    description = "Error against cost of the models, on shipped or user-defined scenes."
    return command_line.run("python -m studies.accuracy", description, COMMAND, argv, extra="accuracy")


if __name__ == "__main__":
    sys.exit(main())
