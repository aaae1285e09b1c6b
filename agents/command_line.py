"""One way in for every command: grammar, a user's own modules, bad input, failures, interruptions, exit codes.

Exit codes: 0 done, 2 bad input (one line that names file, field and allowed values), 130 interrupted, 1 anything else, as where
published results do not come out again.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from agents.failures import TrainingError
from vibgym import imports, interrupts
from vibgym.checks import Refused
from vibgym.files import WriteError

EXTRAS = {
    "h5py": "data",
    "jinja2": "report",
    "joblib": "report",
    "matplotlib": "report",
    "minari": "data",
    "optuna": "tune",
    "ray": "cluster",
    "scipy": "report",
    "stable_baselines3": "learn",
    "torch": "learn",
}
"""Which of our extras brings a package that a command may need."""


class Command(NamedTuple):
    """What a command takes, and what it does."""

    arguments: Callable[[argparse.ArgumentParser], None]
    """Adds its own arguments; all commands have ``--output``, ``--import`` and ``--quiet``."""

    run: Callable[[argparse.Namespace], int | None]
    """Does its work; None is 0. What it refuses is bad input, see :class:`vibgym.checks.Refused`."""

    output: str = "directory for what is written"
    """What ``--output`` is, which is a directory for every command."""


class Room(NamedTuple):
    """Where a command is at home: its module, with a mapping ``COMMANDS`` by name, is imported when it is asked for."""

    module: str
    help: str


def run_one_of(program: str, description: str, rooms: Mapping[str, Room], argv: Sequence[str] | None = None) -> int:
    """Run the command that the first word names; returns the exit code."""
    result = argparse.ArgumentParser(prog=program, description=description)
    commands = result.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, room in rooms.items():
        commands.add_parser(name, help=room.help, add_help=False)
    words = list(sys.argv[1:] if argv is None else argv)
    name = result.parse_args(words[:1]).command
    help_ = rooms[name].help

    def work() -> int:
        command = importlib.import_module(rooms[name].module).COMMANDS[name]
        return _carried_out(command, f"{program} {name}", help_, words[1:])

    return guarded(name, work)


def run(
    program: str, description: str, command: Command, argv: Sequence[str] | None = None, extra: str | None = None
) -> int:
    """Run the only command of a program; returns the exit code. ``extra``: ours that brings all that it imports."""
    return guarded(program, lambda: _carried_out(command, program, description, argv), extra)


def _carried_out(command: Command, program: str, description: str, argv: Sequence[str] | None) -> int:
    parser = argparse.ArgumentParser(prog=program, description=description)
    command.arguments(parser)
    parser.add_argument("--output", type=Path, metavar="DIR", help=command.output)
    parser.add_argument(
        "--import", dest="imports", action="append", default=[], metavar="PACKAGE",
        help="your own module or package, whose tasks, laws, sensors and so on take part; may be given several times",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="no progress")
    arguments = parser.parse_args(argv)
    imports.take_part(arguments.imports)
    return command.run(arguments) or 0


def guarded(name: str, work: Callable[[], int], extra: str | None = None) -> int:
    """The exit code of some work, whose bad input and failures come out in one line each."""

    def one_line() -> int:
        try:
            return work()
        except Refused as error:  # NoCluster, too
            return _told(error, 2)
        except (TrainingError, WriteError, ConnectionError) as error:  # of a cluster whose nodes are lost for good
            return _told(error, 1)
        except ImportError as error:
            brings = extra or EXTRAS.get((error.name or "").partition(".")[0])
            if brings is None:
                raise
            what = f"{error.name} is not installed" if isinstance(error, ModuleNotFoundError) else error
            return _told(f"{name}: {what}: pip install 'vibgym[{brings}]'", 1)

    return interrupts.run(one_line)


def _told(error: object, code: int) -> int:
    print(" ".join(str(error).split()), file=sys.stderr)
    return code


def config(parser: argparse.ArgumentParser, help: str = "YAML file, see configs/") -> None:
    """The file of settings, which most commands take."""
    parser.add_argument("config", type=Path, metavar="CONFIG", help=help)


def side_by_side(parser: argparse.ArgumentParser, processes: bool = True) -> None:
    """Where the work is done."""
    if processes:
        parser.add_argument("--processes", type=int, default=2, metavar="N", help="side by side on this machine")
    parser.add_argument("--ray", metavar="ADDRESS", help="work on a Ray cluster: auto, local or HOST:PORT")


def some(parser: argparse.ArgumentParser, option: str) -> None:
    """A choice of what a file names, all by default."""
    parser.add_argument(option, action="append", metavar="NAME", help="only this one; may be given several times")


def entered(context: contextlib.AbstractContextManager[object]) -> contextlib.ExitStack:
    """A context that has been entered, to be left by another block."""
    held = contextlib.ExitStack()
    held.enter_context(context)
    return held
