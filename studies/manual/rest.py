"""Docstrings that are written in Markdown, for ``help()``, as reST for the pages: sections and tables."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

RULE = re.compile(r"\|[\s:|-]+\|$")


def process(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """What Sphinx calls with the lines of each docstring, which are changed in place."""
    if what in ("attribute", "data", "property") and lines:
        lines.insert(0, "")  # else Napoleon takes what stands before a colon in the first line for a type
    if any(line.lstrip().startswith(("## ", "|--", "| --")) for line in lines):
        lines[:] = converted(lines)


def converted(lines: list[str]) -> list[str]:
    """Lines of reST for lines with sections and tables of Markdown."""
    found: list[str] = []
    block: list[str] = []
    for line in [*lines, ""]:
        if line.lstrip().startswith("|"):
            block.append(line)
            continue
        if block:
            found += ["", *table(block), ""]
            block = []
        title = re.match(r"\s*## (.+)", line)
        found += ["", f".. rubric:: {title[1]}", ""] if title else [line]
    return found


def table(block: list[str]) -> Iterator[str]:
    """A list table for the lines of a table in Markdown, as far in as they are."""
    margin = " " * (len(block[0]) - len(block[0].lstrip()))
    rows = [line.strip().strip("|").split("|") for line in block if not RULE.match(line.strip())]
    yield f"{margin}.. list-table::"
    yield f"{margin}   :header-rows: 1"
    yield ""
    for row in rows:
        for number, cell in enumerate(row):
            yield f"{margin}   {'*' if number == 0 else ' '} - {cell.strip()}"
