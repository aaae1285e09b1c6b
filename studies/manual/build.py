"""Write the pieces of the documentation that are made when it is built."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from studies import kept
from studies.manual import environments
from studies.manual.published import TABLES
from vibgym import files


def write(docs: Path) -> int:
    """Write tables and pages of environments into the directory of pages; return how many files have changed."""
    return replace({**tables(docs), **environment_pages(docs)})


def tables(docs: Path) -> dict[Path, str]:
    """The tables of published results, and those that studies have kept, by their files."""
    generated = docs / "generated"
    published = {generated / f"{name}.md": make() + "\n" for name, make in TABLES.items()}
    return published | {
        generated / "tables" / f"{name}.md": f"{each.markdown()}\n" for name, each in kept.tables().items()
    }


def environment_pages(docs: Path) -> dict[Path, str]:
    """The pages of environments, by their files."""
    return {docs / "environments" / f"{name}.md": text for name, text in environments.pages().items()}


def replace(contents: Mapping[Path, str]) -> int:
    """Write what differs from the files that are there, which Sphinx need not read again otherwise; return how many."""
    fresh = {
        path: text for path, text in contents.items() if not path.exists() or path.read_text(encoding="utf-8") != text
    }
    for directory in {path.parent for path in fresh}:
        files.output_directory(directory)
    if fresh:
        files.write_together(fresh)
    return len(fresh)
