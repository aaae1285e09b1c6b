"""One page with the thesis's figures beside ours."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from agents.evaluation.pages import data_address, render
from studies.thesis.figures import FIGURES
from vibgym import files

PAGE = "replicate.html"


def write(output: Path, names: Sequence[str] | None = None) -> Path:
    """Draw the figures (all of them, or those of ``names``) and write the page into a directory; return its path.

    Raises:
        ValueError: an unknown figure.  vibgym.files.WriteError: it cannot be written.
    """
    chosen = {name: FIGURES.choose("figure", name) for name in (FIGURES if names is None else names)}
    figures = []
    for name, make in chosen.items():
        figure = make()
        pictures = [(data_address(each.png), each.caption) for each in figure.pictures]
        command = f"python -m studies.thesis --figure {name}"
        figures.append({"name": name, "figure": figure, "pictures": pictures, "command": command})
    text = render(Path(__file__).with_name("replicate.html.j2"), figures=figures)
    path = files.output_directory(output) / PAGE
    files.write_atomically(path, text)
    return path
