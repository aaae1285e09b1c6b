"""Tables that studies and benchmarks print, and keep for the pages when they are asked to: ``--keep``.

A kept table is a file in ``results/tables``: its cells as they are printed, the command that made it, when, at which commit and
on what processor. ``make docs`` writes those tables into the pages, so that no table is typed by hand.
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


class Kept(NamedTuple):
    """A table that was kept."""

    heads: list[str]
    rows: list[list[str]]
    command: str
    time: str
    commit: str | None
    processor: str

    def markdown(self) -> str:
        """The table, and below it where it comes from."""
        at = "" if self.commit is None else f" at commit {self.commit[:7]}"
        return f"{markdown(self.heads, self.rows)}\n\n`{self.command}`, {self.time[:10]}{at}, {self.processor}."


def argument(parser: argparse.ArgumentParser) -> None:
    """Whether to keep what is shown."""
    parser.add_argument(OPTION, action="store_true", help="the tables, in results/tables, for the pages")


def show(
    name: str,
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    keep: bool = False,
    about: Mapping[str, Any] | None = None,
) -> None:
    """Print a table in Markdown, and keep it.

    Args:
        name: of its file, and of the piece that pages include: ``generated/tables/<name>.md``.
        heads: of the columns.
        rows: cells as they are to be read, as many in each as there are heads.
        keep: whether to.
        about: where the figures come from, if it is another run: the result of :func:`agents.provenance.provenance` there, and
            the ``command``.

    Raises:
        ValueError: a row has more or fewer cells; nothing is printed or kept.
    """
    lines = [list(row) for row in rows]
    for line in lines:
        if len(line) != len(heads):
            raise ValueError(f"{name}: got the row {line}, a row has {len(heads)} cells: {', '.join(heads)}")
    print(markdown(heads, lines), end="\n\n", flush=True)
    if keep:
        about = {"command": _command(), **provenance()} if about is None else about
        processor = f"{about['machine']['processor']}, {about['machine']['cores']} cores"
        table = Kept(list(heads), lines, about["command"], about["time"], about["commit"], processor)
        output_directory(DIRECTORY, OPTION)
        write_atomically(DIRECTORY / f"{name}.json", json.dumps(table._asdict(), indent=1, ensure_ascii=False) + "\n")


def tables() -> dict[str, Kept]:
    """All that were kept, by name."""
    paths = sorted(DIRECTORY.glob("*.json"))
    return {path.stem: Kept(**json.loads(path.read_text(encoding="utf-8"))) for path in paths}


def _command() -> str:
    """As one types it."""
    spec = sys.modules["__main__"].__spec__
    module = "?" if spec is None else spec.name.removesuffix(".__main__")
    return shlex.join(["python", "-m", module, *(word for word in sys.argv[1:] if word != OPTION)])
