"""Command line: ``python -m studies.thesis`` draws the thesis's figures beside ours."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from vibgym import interrupts

interrupts.start_command()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.thesis", description="Draw the thesis's figures beside ours."
    )
    parser.add_argument("--output", type=Path, metavar="DIR", default=Path("runs/replicate"), help="of the page")
    parser.add_argument("--figure", action="append", metavar="NAME", help="only this one; may be given several times")
    arguments = parser.parse_args(argv)
    return interrupts.run(lambda: _run(arguments))


def _run(arguments: argparse.Namespace) -> int:
    from studies.thesis.page import write
    from vibgym.files import WriteError

    try:
        page = write(arguments.output, arguments.figure)
    except ValueError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 2
    except WriteError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 1
    print(f"page: {page}")
    return 0


if __name__ == "__main__":
    interrupts.leave(main())
