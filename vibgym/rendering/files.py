"""Pictures and films as PNG and GIF files, by Pillow."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from PIL import Image

REST = 1500
"""Duration of the last frame of a film, ms."""


def png(picture: np.ndarray, colours: int = 256) -> bytes:
    """Return a picture (height, width, 3) uint8 as a PNG file, with few colours to keep pages small."""
    file = io.BytesIO()
    Image.fromarray(picture).quantize(colours, dither=Image.Dither.NONE).save(file, format="PNG", optimize=True)
    return file.getvalue()


def gif(frames: Sequence[np.ndarray], interval: float, colours: int = 255) -> bytes:
    """Return a looping GIF file.

    Args:
        frames: pictures (height, width, 3) uint8 of one size, at least one; the last one has a longer duration.
        interval: time between frames, s; browsers show at most 50 frames per second.
        colours: of all frames together, at most 256.
    """
    # One palette for all frames, from pictures spread over the film: colours do not flicker, and the file is smaller. An octree
    # keeps the hues of few elements, which the median cut loses.
    chosen = [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, 8).astype(int))]
    palette = Image.fromarray(np.concatenate(chosen)).quantize(colours, method=Image.Quantize.FASTOCTREE)
    images = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [max(20, round(1e3 * interval))] * (len(frames) - 1) + [REST]
    file = io.BytesIO()
    images[0].save(
        file, format="GIF", save_all=True, append_images=images[1:], duration=durations, loop=0, optimize=True
    )
    return file.getvalue()
