"""Executes notebooks and keeps what they show: ``python -m studies.notebooks [NAME ...]``, or ``make notebooks``.

A notebook is executed as a whole, in a kernel of its own, with what stands in its cell of parameters; the tests put smaller
numbers there. What is kept are pictures and printed lines, without times of execution, warnings and paths of the machine.
"""

from __future__ import annotations

import argparse
import copy
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents import command_line
from agents.command_line import Command
from vibgym import checks, files

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "notebooks"
LARGEST = 400_000
"""Bytes of a notebook with its pictures."""

PLACES = (str(ROOT), str(Path.home()), sys.prefix, tempfile.gettempdir() + "/")
"""Of this machine, of which outputs say nothing."""


def names() -> list[str]:
    """Of all notebooks, in the order in which they are read."""
    order = ("first_steps", "train_in_three_minutes", "speed_against_error")
    found = {path.stem for path in FOLDER.glob("*.ipynb")}
    return [*(name for name in order if name in found), *sorted(found - {*order})]


def executed(notebook: Any, *, go_on: bool = False, env: dict[str, str] | None = None, **parameters: Any) -> Any:
    """A copy of a notebook with its outputs.

    Args:
        notebook: as nbformat reads it; the checkout's vibgym is what it imports.
        go_on: keep errors as outputs.
        env: environment variables of its kernel, in addition to those of this process.
        **parameters: values for names in the cell that is tagged "parameters".

    Raises:
        ValueError: a parameter that the notebook does not have.
        nbclient.exceptions.CellExecutionError: a cell fails, and ``go_on`` is not set.
    """
    from nbclient import NotebookClient

    result = copy.deepcopy(notebook)
    (cell,) = (each for each in result.cells if "parameters" in each.metadata.get("tags", ()))
    wanted = cell.source
    known = [line.partition(" = ")[0] for line in wanted.splitlines()]
    for name in parameters:
        if name not in known:
            raise checks.refuse("parameters", name, f"one of {', '.join(known)}")
    cell.source = "\n".join([wanted, *(f"{name} = {value!r}" for name, value in parameters.items())])
    where = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(
            result, timeout=900, kernel_name="python3", allow_errors=go_on, record_timing=False, coalesce_streams=True,
            resources={"metadata": {"path": folder}},
        )  # fmt: skip
        client.execute(env={**os.environ, "PYTHONPATH": where, **(env or {})})
    cell.source = wanted
    return result


def tidied(notebook: Any) -> Any:
    """A copy without what differs from one machine to another and is of no use to readers."""
    result = copy.deepcopy(notebook)
    result.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    for cell in result.cells:
        cell.metadata = {key: value for key, value in cell.metadata.items() if key == "tags"}
        if cell.cell_type == "code":
            cell.outputs = [each for each in cell.outputs if each.get("name") != "stderr"]
    return result


def renew(name: str, folder: Path = FOLDER) -> int:
    """Execute a notebook at full size and write it into ``folder``; return its bytes.

    Raises:
        Refused: its outputs are too large, or name a place of this machine; the file is as it was.
    """
    import nbformat

    path = FOLDER / f"{name}.ipynb"
    text = nbformat.writes(tidied(executed(nbformat.read(path, as_version=4)))) + "\n"
    for place in PLACES:
        if place in text:
            raise checks.refuse(f"notebooks/{path.name}", place, "outputs without paths of this machine")
    size = len(text.encode())
    if size > LARGEST:
        raise checks.refuse(f"notebooks/{path.name}", f"{size} bytes", f"at most {LARGEST} with its pictures")
    files.write_atomically(folder / path.name, text)
    return size


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("names", nargs="*", metavar="NAME", help="of notebooks; without, all of them")


def run(asked: argparse.Namespace) -> int:
    """Renew notebooks; return the exit code."""
    from nbclient.exceptions import CellExecutionError

    for name in asked.names:
        if name not in names():
            raise checks.refuse("NAME", name, f"one of {', '.join(names())}")
    files_at = FOLDER if asked.output is None else files.output_directory(asked.output)
    for name in asked.names or names():
        began = time.perf_counter()
        try:
            size = renew(name, files_at)
        except CellExecutionError as error:
            print(f"notebooks/{name}.ipynb: {error.ename}: {error.evalue}", file=sys.stderr)
            return 1
        if not asked.quiet:
            print(f"notebooks/{name}.ipynb: {time.perf_counter() - began:.0f} s, {size / 1e3:.0f} kB", flush=True)
    return 0


COMMAND = Command(arguments, run, "directory for the notebooks, instead of where they stand")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    description = "Executes the notebooks, with pictures and figures kept in them."
    return command_line.run("python -m studies.notebooks", description, COMMAND, argv, extra="notebooks")


if __name__ == "__main__":
    sys.exit(main())
