"""Style of the plots of all pages: PNG on white, axes without frame, one colour per meaning."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from vibgym.rendering import colours

INK, MUTED, GRID = "#262c38", "#6c7380", "#e3e6ea"
SUCCESS, FAILURE = "#0b7a75", "#d1572a"
POLICY_COLOURS = (
    "#9aa1ac", "#d1572a", "#b8860b", "#2f6fde", "#0b7a75", "#8a4fbf", "#c2478a", "#4c8c2b",
    "#1c2b4a", "#38b2d8", "#7a4a2b", "#f0908a", "#a4c639", "#b9a3e3",
)  # fmt: skip
DPI = 120
"""Dots per inch: about one and a half for each pixel of a card of a page."""

COLOURS = 48
"""Colours of a plot. With fewer, grey letters take on the colour of the lines; with 256, pages are half as large again."""


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, inches."""
    return Figure((width, height), dpi=DPI, layout="constrained", facecolor="white")


def png(figure: Figure) -> bytes:
    """Return the figure as a PNG file. Text is drawn literally: dollar signs in names do not start formulas."""
    for text in figure.findobj(Text):
        text.set_parse_math(False)  # type: ignore[attr-defined]
    canvas, file = FigureCanvasAgg(figure), io.BytesIO()
    canvas.draw()  # once: savefig draws twice, for the layout first
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]).quantize(COLOURS, dither=Image.Dither.NONE)
    image.save(file, format="PNG", optimize=True)
    return file.getvalue()


def style(axes: Axes, **labels: str) -> None:
    """Set the style of axes; ``labels`` are arguments of ``axes.set``."""
    axes.tick_params(colors=MUTED, labelsize=7.5, length=2.5, width=0.6)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set(color="#b6bcc6", linewidth=0.6)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set(**labels)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set(color=MUTED, fontsize=8)
    axes.title.set(color=INK, fontsize=8.5)


def kind_colour(kind: int) -> tuple[float, ...]:
    """Return the colour of a kind of parts, as in the films."""
    return tuple(channel / 255.0 for channel in colours.PARTS[kind % len(colours.PARTS)])
