"""Convert sections and tables of docstrings from Markdown, as ``help()`` shows them, to reST for Sphinx."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

RULE = re.compile(r"\|[\s:|-]+\|$")


def process(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Convert the lines of a docstring in place: a handler of ``autodoc-process-docstring``."""
    if what in ("attribute", "data", "property") and lines:
        lines.insert(0, "")  # otherwise Napoleon reads text before a colon in the first line as a type
    if any(line.lstrip().startswith(("## ", "|--", "| --")) for line in lines):
        lines[:] = converted(lines)


def converted(lines: list[str]) -> list[str]:
    """Convert lines with sections and tables in Markdown to reST."""
    result: list[str] = []
    block: list[str] = []
    for line in [*lines, ""]:
        if line.lstrip().startswith("|"):
            block.append(line)
            continue
        if block:
            result += ["", *table(block), ""]
            block = []
        title = re.match(r"\s*## (.+)", line)
        result += ["", f".. rubric:: {title[1]}", ""] if title else [line]
    return result


def table(block: list[str]) -> Iterator[str]:
    """Convert the lines of a Markdown table to a list table with the same indentation."""
    margin = " " * (len(block[0]) - len(block[0].lstrip()))
    rows = [line.strip().strip("|").split("|") for line in block if not RULE.match(line.strip())]
    yield f"{margin}.. list-table::"
    yield f"{margin}   :header-rows: 1"
    yield ""
    for row in rows:
        for number, cell in enumerate(row):
            yield f"{margin}   {'*' if number == 0 else ' '} - {cell.strip()}"
