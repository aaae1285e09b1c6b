"""Pictures of single episodes: the last one for the report, whose films are drawn in the browser, and GIFs for the README."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from PIL import Image

from agents.evaluation.log import Film
from vibgym.rendering import Scenery, SurfacePainter

MOST_FRAMES = 120
WIDTH = 520  # pixels of a picture in the report
BORDER = 40  # pixels of a picture that are not table
REST = 1500  # ms that the last frame stays
CUT, SIDE = 4, 110
"""Pixels under the table that are left out of a still picture, and those of a view from the side."""

STILL_COLOURS = 64


def painter_for(scenery: Scenery, width: int) -> SurfacePainter:
    """A painter whose pictures are about ``width`` pixels wide."""
    return scenery.painter(max(4, (width - BORDER) // scenery.columns) / scenery.element_size)


def picture(film: Film, scenery: Scenery, frame: int, painter: SurfacePainter) -> np.ndarray:
    """Frame of a film, (height, width, 3) uint8."""
    trail = film.poses[: frame + 1, :, :2]
    shown = (
        film.poses[frame],
        film.present[frame],
        film.goals[frame],
        film.phasors[frame],
        trail,
        film.captions[frame],
    )
    return painter.paint(scenery.view(*shown, film.paths, film.sides[frame]))


def frames_of(film: Film, scenery: Scenery, step_time: float, width: int = WIDTH) -> tuple[list[np.ndarray], float]:
    """Frames of a film and the time between them in s: every step of a short one, fewer of a long one, true to time."""
    last = len(film.poses) - 1
    stride = max(1, math.ceil(last / (MOST_FRAMES - 1)))
    painter = painter_for(replace(scenery, side=film.sides[0] is not None), width)
    return [picture(film, scenery, k, painter) for k in [*range(0, last, stride), last]], stride * step_time


def _durations(frames: Sequence[object], interval: float) -> list[int]:
    return [max(20, round(1e3 * interval))] * (len(frames) - 1) + [REST]


def still(film: Film, scenery: Scenery) -> tuple[bytes, tuple[int, int]]:
    """The last picture of a film as a PNG, as a canvas draws it in its place.

    Returns:
        The file, its width and height. What stands under the table in other pictures is left out; a view from the side stays.
    """
    tilting = film.sides[0] is not None
    pixels, last = max(4, (WIDTH - BORDER) // scenery.columns), len(film.poses) - 1
    painter = painter_for(replace(scenery, side=tilting), WIDTH)
    whole = picture(film, scenery, last, painter)[:, : scenery.columns * pixels + BORDER]
    top = whole[: scenery.rows * pixels + BORDER - CUT]
    shown = np.concatenate([top, whole[len(whole) - SIDE :]]) if tilting else top
    return png(shown, STILL_COLOURS), (shown.shape[1], shown.shape[0])


def png(frame: np.ndarray, colours: int = 256) -> bytes:
    """A single picture, in few colours to keep the page small."""
    file = io.BytesIO()
    Image.fromarray(frame).quantize(colours, dither=Image.Dither.NONE).save(file, format="PNG", optimize=True)
    return file.getvalue()


def gif(frames: Sequence[np.ndarray], fps: float) -> bytes:
    """A looping GIF.

    Args:
        frames: pictures (height, width, 3) uint8 of one size, at least one; the last one stays for a while.
        fps: frames per second; browsers show at most 50.
    """
    # One palette for all frames, from pictures spread over the film: colours do not flicker, and the file is smaller.
    chosen = [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, 8).astype(int))]
    palette = Image.fromarray(np.concatenate(chosen)).quantize(255, method=Image.Quantize.MEDIANCUT)
    images = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    file = io.BytesIO()
    images[0].save(
        file,
        format="GIF",
        save_all=True,
        append_images=images[1:],
        duration=_durations(frames, 1.0 / fps),
        loop=0,
        optimize=True,
    )
    return file.getvalue()


def film_gif(film: Film, scenery: Scenery, step_time: float, width: int = 840) -> bytes:
    """A film as a GIF, for the README."""
    frames, interval = frames_of(film, scenery, step_time, width)
    return gif(frames, 1.0 / interval)
