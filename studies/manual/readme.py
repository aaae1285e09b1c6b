"""The README's table of results, between two marks."""

from __future__ import annotations

from pathlib import Path

from studies.manual.published import overview, provenance
from vibgym import checks, files

BEGIN, END = "<!-- results: written by python -m studies.manual readme -->", "<!-- end of results -->"


def write(path: Path) -> str:
    """Renew the table; return what became of the file.

    Raises:
        ValueError: there is no such file, or the marks are not in it.
    """
    if not path.is_file():
        raise checks.refuse("README", str(path), "a file with the marks of the table")
    old = path.read_text(encoding="utf-8")
    new = renewed(old)
    if new == old:
        return "as it was"
    files.write_atomically(path, new)
    return "renewed"


def renewed(text: str) -> str:
    """The text with the table that belongs between the marks.

    Raises:
        ValueError: the marks are not there, each once and in order.
    """
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end) or BEGIN in rest or END in after:
        raise checks.refuse(
            "README", f"{text.count(BEGIN)} and {text.count(END)} marks", f"{BEGIN!r} and {END!r}, once each"
        )
    table = f"Success and median time to the goal (`make report`). {provenance()}\n\n{overview()}"
    return f"{before}{BEGIN}\n{table}\n{END}{after}"
