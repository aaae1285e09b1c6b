"""Tables of studies and benchmarks: printed, and with ``--keep`` stored for the documentation.

A stored table is a file in ``results/tables``: cells as printed, command, date, commit and processor. ``make docs`` includes
these tables in the pages.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from agents.evaluation.table import markdown
from agents.provenance import provenance
from vibgym.files import output_directory, write_atomically

DIRECTORY = Path(__file__).parents[1] / "results" / "tables"
OPTION = "--keep"


class StoredTable(NamedTuple):
    """Cells of a table and their provenance."""

    heads: list[str]
    rows: list[list[str]]
    command: str
    time: str
    commit: str | None
    processor: str

    def markdown(self) -> str:
        """Return the table in Markdown, with a line of provenance below it."""
        at = "" if self.commit is None else f" at commit {self.commit[:7]}"
        return f"{markdown(self.heads, self.rows)}\n\n`{self.command}`, {self.time[:10]}{at}, {self.processor}."


def argument(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--keep``."""
    parser.add_argument(OPTION, action="store_true", help="store the tables in results/tables, for the documentation")


def show(
    name: str,
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    keep: bool = False,
    about: Mapping[str, Any] | None = None,
) -> None:
    """Print a table in Markdown, and store it if ``keep`` is set.

    Args:
        name: of its file, and of the file that pages include: ``generated/tables/<name>.md``.
        heads: of the columns.
        rows: cells as text, one per column.
        keep: store the table.
        about: provenance of figures of another run: the result of :func:`agents.provenance.provenance`, and the ``command``.

    Raises:
        ValueError: a row has more or fewer cells than columns; nothing is printed or stored.
    """
    lines = [list(row) for row in rows]
    for line in lines:
        if len(line) != len(heads):
            raise ValueError(f"table {name}: a row must have {len(heads)} cells ({', '.join(heads)}), got {line}")
    print(markdown(heads, lines), end="\n\n", flush=True)
    if keep:
        about = {"command": _command(), **provenance()} if about is None else about
        processor = f"{about['host']['processor']}, {about['host']['cores']} cores"
        table = StoredTable(list(heads), lines, about["command"], about["time"], about["commit"], processor)
        output_directory(DIRECTORY, OPTION)
        write_atomically(DIRECTORY / f"{name}.json", json.dumps(table._asdict(), indent=1, ensure_ascii=False) + "\n")


def tables() -> dict[str, StoredTable]:
    """Return all stored tables by name."""
    paths = sorted(DIRECTORY.glob("*.json"))
    return {path.stem: StoredTable(**json.loads(path.read_text(encoding="utf-8"))) for path in paths}


def _command() -> str:
    """Return the command line of this process, without ``--keep``."""
    spec = sys.modules["__main__"].__spec__
    module = "?" if spec is None else spec.name.removesuffix(".__main__")
    return shlex.join(["python", "-m", module, *(word for word in sys.argv[1:] if word != OPTION)])
