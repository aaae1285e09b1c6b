"""Entry point of all commands: arguments, user modules, error messages and exit codes.

Exit codes: 0 done, 2 invalid input (one line), 130 interrupted, 1 anything else, such as results that cannot be reproduced.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import logging
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from vibgym import imports
from vibgym.checks import Refused
from vibgym.files import WriteError

EXTRAS = {
    "h5py": "data",
    "jinja2": "report",
    "joblib": "report",
    "matplotlib": "report",
    "minari": "data",
    "optuna": "tune",
    "pandas": "report",
    "ray": "cluster",
    "scipy": "report",
    "stable_baselines3": "learn",
    "torch": "learn",
}
"""Package -> the extra that provides it."""


class TrainingError(RuntimeError):
    """A training with valid settings diverged."""


class Command(NamedTuple):
    """A subcommand: its arguments and its function."""

    arguments: Callable[[argparse.ArgumentParser], None]
    """Adds its arguments; every command also has ``--output``, ``--import`` and ``--quiet``."""

    run: Callable[[argparse.Namespace], int | None]
    """Runs it and returns the exit code; None is 0. Invalid input raises :class:`vibgym.checks.Refused`."""

    output: str = "output directory"
    """Help text of ``--output``."""


class Entry(NamedTuple):
    """A subcommand by module, which is imported only when the subcommand runs: ``COMMANDS[name]`` of that module."""

    module: str
    help: str


def run_one_of(program: str, description: str, entries: Mapping[str, Entry], argv: Sequence[str] | None = None) -> int:
    """Run the subcommand named by the first argument; return the exit code."""
    parser = argparse.ArgumentParser(prog=program, description=description)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, entry in entries.items():
        commands.add_parser(name, help=entry.help, add_help=False)
    words = list(sys.argv[1:] if argv is None else argv)
    name = parser.parse_args(words[:1]).command

    def work() -> int:
        command = importlib.import_module(entries[name].module).COMMANDS[name]
        return _run(command, f"{program} {name}", entries[name].help, words[1:])

    return guarded(name, work)


def run(
    program: str, description: str, command: Command, argv: Sequence[str] | None = None, extra: str | None = None
) -> int:
    """Run a program with one command; return the exit code. ``extra``: the extra that provides all its imports."""
    return guarded(program, lambda: _run(command, program, description, argv), extra)


def _run(command: Command, program: str, description: str, argv: Sequence[str] | None) -> int:
    parser = argparse.ArgumentParser(prog=program, description=description)
    command.arguments(parser)
    parser.add_argument("--output", type=Path, metavar="DIR", help=command.output)
    parser.add_argument(
        "--import", dest="imports", action="append", default=[], metavar="PACKAGE",
        help="module or package that registers user-defined tasks, controllers, sensors, ...; may be repeated",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="no progress")
    arguments = parser.parse_args(argv)
    imports.import_user_modules(arguments.imports)
    return command.run(arguments) or 0


class AboveBars(logging.StreamHandler[Any]):
    """Writes log messages to stderr, above progress bars where tqdm draws some."""

    def emit(self, record: logging.LogRecord) -> None:
        self.stream, tqdm = sys.stderr, sys.modules.get("tqdm")
        with contextlib.nullcontext() if tqdm is None else tqdm.tqdm.external_write_mode(file=sys.stderr):
            super().emit(record)


def guarded(name: str, work: Callable[[], int], extra: str | None = None) -> int:
    """Return the exit code of ``work``; invalid input, known failures and Ctrl-C print one line instead of a traceback."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a character that the terminal lacks must not fail a run
    if not (logger := logging.getLogger("vibgym")).handlers:
        logger.addHandler(AboveBars())
    try:
        return work()
    except KeyboardInterrupt as interrupt:  # a command may report what is saved
        return _fail(f"interrupted: {interrupt}" if str(interrupt) else "interrupted", 130)
    except Refused as error:
        return _fail(error, 2)
    except (TrainingError, WriteError, ConnectionError) as error:  # ConnectionError: the nodes of a cluster are lost
        return _fail(error, 1)
    except ImportError as error:
        package = (error.name or "").partition(".")[0]
        provides = extra or EXTRAS.get(package)
        if provides is None:
            raise
        what = f"{package} is not installed" if isinstance(error, ModuleNotFoundError) else error
        return _fail(f"{name}: {what}: pip install 'vibgym[{provides}]'", 1)


def _fail(error: object, code: int) -> int:
    print(" ".join(str(error).split()), file=sys.stderr, flush=True)
    return code


def config(parser: argparse.ArgumentParser, help: str = "YAML file, see configs/") -> None:
    """Add the argument for the settings file."""
    parser.add_argument("config", type=Path, metavar="CONFIG", help=help)


def side_by_side(parser: argparse.ArgumentParser, processes: bool = True) -> None:
    """Add the arguments for parallel execution."""
    if processes:
        parser.add_argument("--processes", type=int, default=2, metavar="N", help="processes on this host")
    parser.add_argument("--ray", metavar="ADDRESS", help="run on a Ray cluster: auto, local or HOST:PORT")


def some(parser: argparse.ArgumentParser, option: str) -> None:
    """Add an option that selects entries of the settings file by name; by default all."""
    parser.add_argument(option, action="append", metavar="NAME", help="only this one; may be repeated")
