"""Films of single episodes: animated WebP for the report, GIF for the README."""

from __future__ import annotations

import bisect
import io
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from PIL import Image

from agents.evaluation.log import Film
from vibgym.rendering import Scenery, SurfacePainter

MOST_FRAMES = 120
WIDTH = 520  # pixels of a film in the report
BORDER = 40  # pixels of a picture that are not table
REST = 1500  # ms that the last frame stays
QUALITIES = (72, 60, 45, 30, 15)
"""Of WebP, best first: a film takes the first that fits into its share of the page."""

METHOD = 2
"""Effort of the WebP encoder, 0 to 6: the next one takes twice as long for files that are a twentieth smaller."""

SAMPLE = 12
"""Frames in a row from the middle of a film that tell how large it will be."""


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


def _durations(frames: Sequence[Any], interval: float) -> list[int]:
    return [max(20, round(1e3 * interval))] * (len(frames) - 1) + [REST]


def webp(frames: Sequence[np.ndarray], interval: float, most: int) -> bytes:
    """A looping WebP animation of at most ``most`` bytes, or of the lowest quality if none is that small.

    Encoding is slow, so that a few frames say which quality to try first.
    """
    images = [Image.fromarray(frame) for frame in frames]
    middle = max(0, (len(images) - SAMPLE) // 2)
    some, first = images[middle : middle + SAMPLE], 0
    if len(some) < len(images):

        def fits(quality: int) -> bool:
            """As far as can be told: the first frame is whole, the others are differences."""
            whole, all_some = (len(_encoded(each, interval, quality)) for each in (some[:1], some))
            return whole + (len(images) - 1) / (len(some) - 1) * (all_some - whole) <= most

        first = bisect.bisect_left(QUALITIES[:-1], True, key=fits)
    data = b""
    for quality in QUALITIES[first:]:
        data = _encoded(images, interval, quality)
        if len(data) <= most:
            break
    return data


def _encoded(images: Sequence[Image.Image], interval: float, quality: int) -> bytes:
    file = io.BytesIO()
    settings: dict[str, Any] = {
        "duration": _durations(images, interval),
        "loop": 0,
        "quality": quality,
        "method": METHOD,
    }
    images[0].save(file, format="WEBP", save_all=True, append_images=images[1:], **settings)
    return file.getvalue()


def png(frame: np.ndarray) -> bytes:
    """A single picture, in 256 colours to keep the page small."""
    file = io.BytesIO()
    Image.fromarray(frame).quantize(256, dither=Image.Dither.NONE).save(file, format="PNG", optimize=True)
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
