"""Command line: ``python -m vibgym warm`` compiles all kernels, so that no first step has to wait for them;
``python -m vibgym play`` serves a page to play on.

Exit codes: 0 done, 2 bad input, 130 interrupted, 1 anything else (such as no folder that compiled kernels can be kept in).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from vibgym.play import command


def parser() -> argparse.ArgumentParser:
    """The command line's grammar."""
    result = argparse.ArgumentParser(prog="python -m vibgym", description="Vibrating surfaces for learning.")
    commands = result.add_subparsers(dest="command", required=True)
    warm = commands.add_parser("warm", help="compile all kernels and keep them, for images of machines and clusters")
    warm.add_argument(
        "--ship",
        type=Path,
        metavar="FOLDER",
        help="write there what a wheel holds of them, as its build does (docs/numba.md)",
    )
    play = commands.add_parser("play", help="serve a page to play with a world by hand (extra 'play')")
    command.arguments(play)
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    arguments = parser().parse_args(argv)
    try:
        return played(arguments) if arguments.command == "play" else compiled(arguments.ship)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr, flush=True)
        return 130


def played(arguments: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C; returns the exit code, 2 for bad input."""
    try:
        return command.run(arguments)
    except (ValueError, ModuleNotFoundError) as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 2


def compiled(ship: Path | None = None) -> int:
    """Compile all kernels, and write to a folder what wheels hold of them; returns the exit code."""
    from vibgym.kernels.jit import cache_folder

    folder = cache_folder()
    if folder is None:
        print("compiled kernels are not kept: VIBGYM_CACHE is 0, or no folder can be written", file=sys.stderr)
        return 1
    from vibgym.warm import warm

    if ship is not None:
        from vibgym.kernels.jit import collect

        collect(ship)
    took = warm(print)
    print(f"all kernels compiled in {took:.1f} s, kept in {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
