"""Command line: ``python -m studies.accuracy CONFIG`` measures error against cost and writes a report.

Exit codes: 0 done, 2 bad input (one line that names file, field and allowed values), 130 interrupted, 1 anything else.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Sequence
from pathlib import Path

from vibgym import interrupts

interrupts.start_command()


def parser() -> argparse.ArgumentParser:
    """The command line's grammar."""
    result = argparse.ArgumentParser(
        prog="python -m studies.accuracy",
        description="Error against cost of the models, on shipped scenes or your own.",
    )
    result.add_argument("config", type=Path, metavar="CONFIG", help="YAML file, see configs/accuracy/")
    result.add_argument("--output", metavar="DIR", help="directory for what is written, instead of the file's")
    result.add_argument("--quiet", action="store_true", help="no progress")
    return result


def progress(text: str) -> None:
    """One line on stderr that is overwritten by the next, or lines where stderr is no terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[2K{text[:110]}", end="", file=sys.stderr, flush=True)
    elif text.endswith((": truth", ": independent reference")) or ":" not in text:
        print(text, file=sys.stderr, flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    arguments = parser().parse_args(argv)
    return interrupts.run(lambda: measure(arguments))


def measure(arguments: argparse.Namespace) -> int:
    """Measure what the file asks for and write the report."""
    try:
        # All of it now: what is missing should not show after minutes of measuring.
        from agents import locks
        from studies.accuracy import page, report, settings, tables
        from vibgym import files
    except ImportError as error:
        print(f"{error}; the report needs more packages: pip install 'vibgym[accuracy]'", file=sys.stderr)
        return 1
    held = contextlib.ExitStack()  # the directory is this run's until its files are written
    try:
        asked = settings.load_settings(arguments.config, arguments.output)
        try:
            prepared = report.prepare(asked)
            held.enter_context(locks.one_run(prepared.output))
        except ValueError as error:
            raise ValueError(f"{arguments.config}: {error}") from None
    except ValueError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 2
    try:
        with held:
            found = report.run(prepared, (lambda text: None) if arguments.quiet else progress)
            path = page.write(found, prepared.output)
    except files.WriteError as error:
        print(error, file=sys.stderr)
        return 1
    if not arguments.quiet and sys.stderr.isatty():
        print("\r\x1b[2K", end="", file=sys.stderr)
    print(tables.summary(found))
    print(f"\nreport: {path}")
    return 0


if __name__ == "__main__":
    interrupts.leave(main())
