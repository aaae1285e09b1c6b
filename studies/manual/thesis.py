"""Page piece of the reproduced figures of the thesis: pictures, values and differences."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from agents.evaluation.table import markdown
from studies.thesis.figure import Figure
from studies.thesis.figures import FIGURES
from vibgym import files

PAGE = "figures.md"
WIDTH = 900  # pixels at most
COLOURS = 64


def write(directory: Path, names: Sequence[str] | None = None) -> Path:
    """Draw all figures, or those of ``names``, and write the page; return its path.

    Raises:
        ValueError: an unknown figure.  vibgym.files.WriteError: it cannot be written.
    """
    chosen = {name: FIGURES.choose("--only", name) for name in (names or FIGURES)}
    contents: dict[Path, str | bytes] = {}
    sections = []
    for name, draw in chosen.items():
        figure = draw()
        pictures = {f"{name}-{number}.png": each.png for number, each in enumerate(figure.pictures, 1)}
        contents |= {directory / file: small(png) for file, png in pictures.items()}
        sections.append(section(name, figure, list(pictures)))
    path = files.output_directory(directory) / PAGE
    files.write_together({**contents, path: "\n\n".join(sections) + "\n"})
    return path


def section(name: str, figure: Figure, pictures: Sequence[str]) -> str:
    """Return the Markdown section of one figure."""
    lines = [[each.what, each.thesis, each.ours, each.difference] for each in figure.comparisons]
    pieces = [
        f"## {figure.title}",
        escaped(figure.shows),
        table(("compared", "thesis", "vibgym", "difference"), lines),
    ]
    for file, each in zip(pictures, figure.pictures, strict=True):
        pieces.append(f"![{escaped(each.caption)}](thesis/{file})\n\n*{escaped(each.caption)}*")
    for each in figure.tables:
        pieces.append(f"{escaped(each.caption)}\n\n{table(each.columns, each.rows)}")
    pieces.append(f"**Difference.** {escaped(figure.differs)}")
    if figure.assumed:
        pieces.append("**Assumptions.**\n\n" + "\n".join(f"- {escaped(each)}" for each in figure.assumed))
    pieces.append(f"`python -m studies.thesis --figure {name}` reproduces this figure.")
    return "\n\n".join(pieces)


def table(heads: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table of cells in plain text."""
    return markdown([escaped(each) for each in heads], [[escaped(each) for each in line] for line in lines])


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
