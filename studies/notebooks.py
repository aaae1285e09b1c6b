"""Execute notebooks and store their outputs: ``python -m studies.notebooks [NAME ...]``, or ``make notebooks``.

Every notebook runs in a new kernel with the values of its parameters cell; tests set smaller values. Stored outputs are
pictures and printed lines, without execution times, warnings and local paths. The first line of each notebook links to Colab
if pyproject.toml names a public repository; ``--links`` writes these lines alone.
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
from studies import project
from vibgym import checks, files

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "notebooks"
LARGEST = 400_000
"""Bytes, upper limit of a notebook with its pictures."""

LINK = "[Open in Colab]"

LOCAL_PATHS = (str(ROOT), str(Path.home()), sys.prefix, tempfile.gettempdir() + "/")
"""Paths of this host that outputs must not contain."""


def names() -> list[str]:
    """Return the names of all notebooks, in reading order."""
    order = ("first_steps", "train_in_seconds", "speed_against_error")
    stems = {path.stem for path in FOLDER.glob("*.ipynb")}
    return [*(name for name in order if name in stems), *sorted(stems - {*order})]


def executed(notebook: Any, *, keep_errors: bool = False, env: dict[str, str] | None = None, **parameters: Any) -> Any:
    """Execute a notebook and return a copy with its outputs.

    Args:
        notebook: of nbformat; it imports vibgym from the checkout.
        keep_errors: store errors as outputs instead of raising them.
        env: environment variables of its kernel, in addition to those of this process.
        **parameters: values of names in the cell tagged "parameters".

    Raises:
        ValueError: unknown parameter.
        nbclient.exceptions.CellExecutionError: a cell fails and ``keep_errors`` is not set.
    """
    from nbclient import NotebookClient

    result = copy.deepcopy(notebook)
    (cell,) = (candidate for candidate in result.cells if "parameters" in candidate.metadata.get("tags", ()))
    source = cell.source
    known = [line.partition(" = ")[0] for line in source.splitlines()]
    for name in parameters:
        checks.choice("parameter", name, known)
    cell.source = "\n".join([source, *(f"{name} = {value!r}" for name, value in parameters.items())])
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(
            result, timeout=900, kernel_name="python3", allow_errors=keep_errors, record_timing=False, coalesce_streams=True,
            resources={"metadata": {"path": folder}},
        )  # fmt: skip
        client.execute(env={**os.environ, "PYTHONPATH": path, **(env or {})})
    cell.source = source
    return result


def tidied(notebook: Any) -> Any:
    """Return a copy without metadata and warnings that depend on the host."""
    result = copy.deepcopy(notebook)
    result.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    for cell in result.cells:
        cell.metadata = {key: value for key, value in cell.metadata.items() if key == "tags"}
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
    return result


def linked(notebook: Any, name: str, pyproject: Path = project.PYPROJECT) -> Any:
    """Return a copy whose first cell begins with the link to Colab, or without one if there is no public repository."""
    result = copy.deepcopy(notebook)
    lines = result.cells[0].source.split("\n")
    if lines[0].startswith(LINK):
        lines = lines[2:]
    address = project.colab(f"notebooks/{name}.ipynb", pyproject)
    result.cells[0].source = "\n".join(lines if address is None else [f"{LINK}({address})", "", *lines])
    return result


def update(name: str, folder: Path = FOLDER, execute: bool = True) -> int:
    """Execute a notebook with its stored parameters and write it into ``folder``; return its size in bytes.

    Args:
        name: of the notebook.
        folder: of the result.
        execute: False: update its link to Colab only.

    Raises:
        Refused: its outputs are too large or contain a local path; the file is not changed.
    """
    import nbformat

    path = FOLDER / f"{name}.ipynb"
    notebook = linked(nbformat.read(path, as_version=4), name)
    text = nbformat.writes(tidied(executed(notebook) if execute else notebook)) + "\n"
    for local in LOCAL_PATHS:
        if local in text:
            raise checks.refuse(f"notebooks/{path.name}", local, "free of local paths")
    size = len(text.encode())
    if size > LARGEST:
        raise checks.refuse(f"notebooks/{path.name}", f"{size} bytes", f"at most {LARGEST} bytes")
    files.write_atomically(folder / path.name, text)
    return size


def run(arguments: argparse.Namespace) -> int:
    """Execute notebooks and store them; return the exit code."""
    from nbclient.exceptions import CellExecutionError

    for name in arguments.names:
        checks.choice("notebook", name, names())
    folder = FOLDER if arguments.output is None else files.output_directory(arguments.output)
    for name in arguments.names or names():
        began = time.perf_counter()
        try:
            size = update(name, folder, not arguments.links)
        except CellExecutionError as error:
            print(f"notebooks/{name}.ipynb: {error.ename}: {error.evalue}", file=sys.stderr)
            return 1
        if not arguments.quiet:
            print(f"notebooks/{name}.ipynb: {time.perf_counter() - began:.0f} s, {size / 1e3:.0f} kB", flush=True)
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    program = "python -m studies.notebooks"
    parser = argparse.ArgumentParser(program, description="Execute the notebooks and store them with their outputs.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="notebooks to execute (default: all)")
    parser.add_argument("--links", action="store_true", help="write the links to Colab; execute nothing")
    parser.add_argument("--output", type=Path, metavar="DIR", help="directory of the notebooks (default: notebooks)")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    arguments = parser.parse_args(argv)
    return command_line.guarded(program, lambda: run(arguments), extra="notebooks")


if __name__ == "__main__":
    sys.exit(main())
