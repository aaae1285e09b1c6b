"""Command line: ``python -m vibgym COMMAND``. Plug-ins add commands by entry points in group ``vibgym.commands``.

Exit codes: 0 done, 2 invalid input, 130 interrupted, 1 anything else (such as no folder for compiled kernels).
"""

from __future__ import annotations

import argparse
import inspect
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from vibgym import checks
from vibgym.registry import Registry

Command = Callable[[argparse.Namespace], int]
"""Function of a command; returns the exit code."""


def warm(parser: argparse.ArgumentParser) -> Command:
    """Compile all kernels and store them in the cache, for container images and clusters."""
    return compile_all


def compile_all(arguments: argparse.Namespace) -> int:
    """Run ``warm``."""
    from vibgym.kernels.jit import cache_folder

    folder = cache_folder()
    if folder is None:
        print("compiled kernels are not stored: VIBGYM_CACHE is 0, or no folder is writable", file=sys.stderr)
        return 1
    from vibgym.warm import warm

    took = warm(print)
    print(f"all kernels compiled in {took:.1f} s, stored in {folder}")
    return 0


def machine(parser: argparse.ArgumentParser) -> Command:
    """Simulate a machine in real time for control loops in other processes (docs/machine.md)."""
    parser.add_argument("task", help="id or short name of an environment, such as Align")
    parser.add_argument("--settings", default="{}", metavar="JSON", help="keyword arguments of the environment")
    parser.add_argument("--seed", type=int, help="of the first episode; each connection begins another one")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=7000, help="0: any free one, which is printed")
    parser.add_argument("--hold", type=int, default=3, help="cycles without a command after which the elements stop")
    parser.add_argument(
        "--lockstep", action="store_true", help="wait for a command in each cycle, instead of real time"
    )
    return serve_machine


def serve_machine(arguments: argparse.Namespace) -> int:
    """Run ``machine``."""
    from vibgym.hardware.command import serve

    return serve(arguments)


def identify(parser: argparse.ArgumentParser) -> Command:
    """Estimate a machine's parameters from a recording; write a page and settings for environments."""
    parser.add_argument("log", type=Path, metavar="LOG", help="recording, written by vibgym.identification.Log.save")
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="for identified.html and machine.yaml; default: that of LOG"
    )
    parser.add_argument("--force", action="store_true", help="write a result that is not to be used, with the reason")
    parser.add_argument("--quiet", action="store_true", help="print the result only")
    return run_identification


def run_identification(arguments: argparse.Namespace) -> int:
    """Run ``identify``."""
    from vibgym.identification.command import identify

    return identify(arguments)


COMMANDS: Registry[Callable[[argparse.ArgumentParser], Command]] = Registry(
    "command",
    {"identify": identify, "machine": machine, "warm": warm},
    "vibgym.commands",
)
"""Commands by name: functions that add arguments to a parser and return the function to run. Their docstring is the help."""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    result = argparse.ArgumentParser(prog="python -m vibgym", description="Vibrating surfaces for learning.")
    commands = result.add_subparsers(dest="command", required=True)
    for name in COMMANDS:
        try:
            add = COMMANDS[name]
        except checks.Refused as error:  # a plug-in that cannot be imported; the other commands still work
            print(error, file=sys.stderr)
            continue
        subparser = commands.add_parser(name, help=(inspect.getdoc(add) or "").partition("\n")[0])
        subparser.set_defaults(run=add(subparser))
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    arguments = parser().parse_args(argv)
    try:
        return arguments.run(arguments)
    except (ValueError, ModuleNotFoundError) as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr, flush=True)
        return 130


if __name__ == "__main__":
    sys.exit(main())
