"""Command line: ``python -m studies.sensorless CONFIG``.

Searches schedules, judges them beside hand-made ones, and writes the best of each part and hardware and a page. Exit codes are
those of ``python -m agents``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from vibgym import interrupts

interrupts.start_command()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m studies.sensorless", description="Find sensorless schedules.")
    parser.add_argument("config", type=Path, metavar="CONFIG", help="YAML file, see configs/sensorless.yaml")
    parser.add_argument("--output", type=Path, metavar="DIR", default=Path("runs/sensorless"), help="of the schedules")
    parser.add_argument("--page", type=Path, metavar="PATH", help="of the page, instead of sensorless.md in DIR")
    parser.add_argument("--quiet", action="store_true", help="no progress bars")
    arguments = parser.parse_args(argv)
    return interrupts.run(lambda: _run(arguments))


def _run(arguments: argparse.Namespace) -> int:
    from studies.sensorless.settings import load_settings
    from studies.sensorless.study import study
    from vibgym.files import WriteError, output_directory, write_atomically

    try:
        settings = load_settings(arguments.config)
        output_directory(arguments.output)
    except ValueError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 2
    page = arguments.output / "sensorless.md" if arguments.page is None else arguments.page
    try:
        write_atomically(page, study(settings, str(arguments.config), arguments.output, arguments.quiet))
    except WriteError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 1
    print(f"page: {page}")
    return 0


if __name__ == "__main__":
    interrupts.leave(main())
