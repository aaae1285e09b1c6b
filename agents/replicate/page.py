"""One page with the thesis's figures beside ours."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

import jinja2

from agents.replicate.figures import FIGURES
from vibgym import files

PAGE = "replicate.html"


def write(output: Path, names: Sequence[str] | None = None) -> Path:
    """Draw the figures (all of them, or those of ``names``) and write the page into a directory; returns its path.

    Raises:
        ValueError: an unknown figure.  vibgym.files.WriteError: it cannot be written.
    """
    chosen = {name: FIGURES.choose("figure", name) for name in (FIGURES if names is None else names)}
    loader = jinja2.FileSystemLoader(Path(__file__).parent)
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    figures = []
    for name, make in chosen.items():
        figure = make()
        pictures = [
            (f"data:image/png;base64,{base64.b64encode(each.png).decode('ascii')}", each.caption)
            for each in figure.pictures
        ]
        command = f"python -m agents replicate --figure {name}"
        figures.append({"name": name, "figure": figure, "pictures": pictures, "command": command})
    text = environment.get_template("replicate.html.j2").render(figures=figures)
    path = files.output_directory(output) / PAGE
    files.write_atomically(path, text)
    return path
