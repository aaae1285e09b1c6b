"""Reproduced figures of the thesis by name, in the order of the pages: HTML, and Markdown of docs/physics.md."""

from __future__ import annotations

import functools
import importlib
import io
from collections.abc import Callable, Sequence
from pathlib import Path

from PIL import Image

from agents.evaluation.pages import data_address, render
from agents.evaluation.table import markdown
from studies.thesis.figure import Figure, texts
from vibgym import files
from vibgym.registry import Registry


def draw(name: str) -> Figure:
    """Draw one figure, by the module of its name."""
    return importlib.import_module(f"studies.thesis.{name}").draw()


FIGURES: Registry[Callable[[], Figure]] = Registry("figure", {name: functools.partial(draw, name) for name in texts()})
"""Functions that compute and draw a figure, each in seconds, in the order of the thesis."""


def drawn(names: Sequence[str] | None) -> dict[str, Figure]:
    """Draw all figures, or those of ``names``.

    Raises:
        ValueError: an unknown figure; none is drawn.
    """
    chosen = {name: FIGURES.choose("figure", name) for name in (FIGURES if names is None else names)}
    return {name: make() for name, make in chosen.items()}


def write(directory: Path, names: Sequence[str] | None = None) -> Path:
    """Draw all figures, or those of ``names``, write them as one HTML page into a directory and return its path.

    Raises:
        ValueError: an unknown figure.  vibgym.files.WriteError: the page cannot be written.
    """
    figures = [
        {
            "name": name, "figure": figure, "command": f"python -m studies.thesis --figure {name}",
            "pictures": [(data_address(picture.png), picture.caption) for picture in figure.pictures],
        }
        for name, figure in drawn(names).items()
    ]  # fmt: skip
    text = render(Path(__file__).with_name("replicate.html.j2"), figures=figures)
    path = files.output_directory(directory) / "replicate.html"
    files.write_atomically(path, text)
    return path


# -- documentation -----------------------------------------------------------------------------------------------------

WIDTH = 900  # pixels at most
COLOURS = 64


def write_markdown(directory: Path, names: Sequence[str] | None = None) -> Path:
    """Draw the same figures, write them as Markdown with pictures beside it and return the path of the page."""
    contents: dict[Path, str | bytes] = {}
    sections = []
    for name, figure in drawn(names).items():
        pictures = {f"{name}-{number}.png": picture.png for number, picture in enumerate(figure.pictures, 1)}
        contents |= {directory / file: small(png) for file, png in pictures.items()}
        sections.append(section(name, figure, list(pictures)))
    path = files.output_directory(directory) / "figures.md"
    files.write_together({**contents, path: "\n\n".join(sections) + "\n"})
    return path


def section(name: str, figure: Figure, pictures: Sequence[str]) -> str:
    """Return the Markdown section of one figure."""
    pieces = [
        f"## {figure.title}",
        escaped(figure.shows),
        table(("compared", "thesis", "vibgym", "difference"), figure.comparisons),
    ]
    for file, picture in zip(pictures, figure.pictures, strict=True):
        pieces.append(f"![{escaped(picture.caption)}](thesis/{file})\n\n*{escaped(picture.caption)}*")
    for more in figure.tables:
        pieces.append(f"{escaped(more.caption)}\n\n{table(more.columns, more.rows)}")
    pieces.append(f"**Difference.** {escaped(figure.differs)}")
    if figure.assumed:
        pieces.append("**Assumptions.**\n\n" + "\n".join(f"- {escaped(text)}" for text in figure.assumed))
    pieces.append(f"`python -m studies.thesis --figure {name}` reproduces this figure.")
    return "\n\n".join(pieces)


def table(heads: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table of cells in plain text."""
    return markdown([escaped(head) for head in heads], [[escaped(cell) for cell in line] for line in lines])


def escaped(text: str) -> str:
    """Escape plain text for Markdown."""
    for sign in "\\`*_|[]<$":
        text = text.replace(sign, f"\\{sign}")
    return " ".join(text.split())


def small(png: bytes) -> bytes:
    """Reduce a PNG picture to the width of a page and few colours."""
    image = Image.open(io.BytesIO(png)).convert("RGB")
    if image.width > WIDTH:
        image = image.resize((WIDTH, round(WIDTH * image.height / image.width)), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(file, format="PNG", optimize=True)
    return file.getvalue()
