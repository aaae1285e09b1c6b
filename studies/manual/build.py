"""Write generated parts of the documentation: tables, pages of environments, the README's table of results."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path

from studies import kept, notebooks, project
from studies.manual import environments, performance, settings
from studies.manual.figures_file import ROOT
from studies.manual.published import TABLES, overview, provenance
from vibgym import checks, files
from vibgym.registration import ENVIRONMENTS

BEGIN, END = "<!-- results: written by python -m studies.manual readme -->", "<!-- end of results -->"


def write(docs: Path) -> int:
    """Write tables, the page of settings and pages of environments into a directory; return the number of changed files."""
    texts = {docs / "environments" / f"{name}.md": text for name, text in pages().items()}
    return replace({**tables(docs), **texts, docs / "settings.md": settings.page()})


def pages() -> dict[str, str]:
    """Return the Markdown page of every registered environment, by name."""
    return {name: environments.page(name) for name in ENVIRONMENTS}


def tables(docs: Path) -> dict[Path, str]:
    """Return the tables of published results and those in ``results/tables``: file -> content."""
    generated = docs / "generated"
    published = {generated / f"{name}.md": make() + "\n" for name, make in TABLES.items()}
    published[generated / "notebooks.md"] = notebook_list()
    published |= {generated / "settings" / f"{name}.md": f"{text}\n" for name, text in settings.included().items()}
    published |= {
        generated / "performance" / f"{name}.md": f"{text}\n" for name, text in performance.generated().items()
    }
    return published | {
        generated / "tables" / f"{name}.md": f"{table.markdown()}\n" for name, table in kept.tables().items()
    }


def notebook_list() -> str:
    """Return the list of notebooks, with links to Colab if the repository is public."""
    lines = []
    for name in notebooks.names():
        path = f"notebooks/{name}.ipynb"
        cells = json.loads((ROOT / path).read_text(encoding="utf-8"))["cells"]
        title = re.search(r"^# (.+)$", "".join(cells[0]["source"]), re.M)
        address = project.colab(path)
        link = "" if address is None else f", [open in Colab]({address})"
        lines.append(f"- {title[1] if title else name}: `{path}`{link}")
    return "\n".join(lines) + "\n"


def replace(contents: Mapping[Path, str]) -> int:
    """Write the files whose content differs, so that Sphinx reads only these again; return their number."""
    changed = {
        path: text for path, text in contents.items() if not path.exists() or path.read_text(encoding="utf-8") != text
    }
    for directory in {path.parent for path in changed}:
        files.output_directory(directory)
    if changed:
        files.write_together(changed)
    return len(changed)


def write_readme(path: Path) -> str:
    """Replace the README's table of results; return "updated" or "unchanged".

    Raises:
        ValueError: there is no such file, or the marks are not in it.
    """
    if not path.is_file():
        raise checks.refuse("README", str(path), "a file with the marks of the table")
    old = path.read_text(encoding="utf-8")
    new = updated_readme(old)
    if new == old:
        return "unchanged"
    files.write_atomically(path, new)
    return "updated"


def updated_readme(text: str) -> str:
    """Return the README with the current table between the marks.

    Raises:
        ValueError: the text does not contain each mark once, in order.
    """
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end) or BEGIN in rest or END in after:
        raise checks.refuse(
            "README",
            f"{text.count(BEGIN)} and {text.count(END)} marks",
            f"a text with {BEGIN!r} and {END!r}, once each",
        )
    table = f"Success and median time to the goal (`make report`). {provenance()}\n\n{overview()}"
    return f"{before}{BEGIN}\n{table}\n{END}{after}"
