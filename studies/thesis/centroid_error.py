"""Fig. 5.8: error of the centroid of a disc from quantisation to whole pixels."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.figure import Figure, figure
from vibgym.kernels.jit import jit
from vibgym.plugins.camera.edges import Grey, share_moments, shares
from vibgym.plugins.camera.image import BOTH, Exposure, hide, normal_quantiles
from vibgym.plugins.camera.objects import Found, Interest, find, new_found
from vibgym.simulation.threads import available_threads

CORNERS = 256
"""Of the polygon of equal area that stands for a disc."""

_LEVEL = 200


@jit(allocates=True)
def _chain(
    radius: float, offset: np.ndarray, exposure: Exposure, interest: Interest, meaning: Grey, blobs: Found,
    bare: np.ndarray, grey: np.ndarray, error: np.ndarray,
) -> None:  # fmt: skip
    """Compute errors (n, 2), px, of discs with centres at ``offset`` (n, 2) from the middle pixel, by image processing."""
    places, box, moment = np.empty((CORNERS, 2)), np.zeros(4, dtype=np.int64), np.empty(6)
    middle = bare.shape[0] // 2
    for n in range(offset.shape[0]):
        for k in range(CORNERS):
            angle = 2.0 * math.pi * k / CORNERS
            places[k, 0] = middle + offset[n, 0] + radius * math.cos(angle)
            places[k, 1] = middle + offset[n, 1] + radius * math.sin(angle)
        hide(places, exposure, BOTH, bare, box)
        for line in range(grey.shape[0]):
            for column in range(grey.shape[1]):
                grey[line, column] = np.uint8(_LEVEL * bare[line, column] + 0.5)
                bare[line, column] = 1.0
        find(grey, interest, blobs)
        best = 0
        for k in range(blobs.count[0]):
            if blobs.moment[k, 0] > blobs.moment[best, 0]:
                best = k
        if meaning.fine:
            share, top, left = shares(grey, meaning, blobs, best)
            share_moments(share, top, left, moment)
        else:
            moment[:] = blobs.moment[best]
        error[n, 0] = moment[1] / moment[0] - middle - offset[n, 0]
        error[n, 1] = moment[2] / moment[0] - middle - offset[n, 1]


@jit
def _centres(radius: float, offset: np.ndarray, error: np.ndarray) -> None:
    """Compute the errors of discs that consist of the pixels whose centres they cover."""
    reach = math.ceil(radius) + 1
    for n in range(offset.shape[0]):
        count, x, y = 0.0, 0.0, 0.0
        for line in range(-reach, reach + 1):
            for column in range(-reach, reach + 1):
                if (column - offset[n, 0]) ** 2 + (line - offset[n, 1]) ** 2 < radius * radius:
                    count, x, y = count + 1.0, x + column, y + line
        error[n, 0], error[n, 1] = x / count - offset[n, 0], y / count - offset[n, 1]


def offsets(trials: int, seed: int = 58) -> np.ndarray:
    """Return random positions (trials, 2) px of a disc's centre within a pixel."""
    return np.random.default_rng(seed).random((trials, 2)) - 0.5


def chain_errors(diameter: float, trials: int, grey: bool = False) -> np.ndarray:
    """Return errors (trials, 2), px, of centroids measured by the camera's image processing for a disc of ``diameter`` px.

    Args:
        diameter: at least 2, so that half of some pixel is always covered.
        grey: use grey levels along the edge; otherwise, a pixel belongs to the disc if at least half of it is covered.
    """
    size = 2 * math.ceil(0.5 * diameter + 4) + 1
    radius = 0.5 * diameter * math.sqrt(2.0 * math.pi / CORNERS / math.sin(2.0 * math.pi / CORNERS))
    level = np.full((size, size), _LEVEL, dtype=np.float32)
    exposure = Exposure(level, 0.0, np.ones(1), np.ones(1), 0.0, normal_quantiles())
    first, last = np.zeros(size, dtype=np.int64), np.full(size, size - 1, dtype=np.int64)
    interest = Interest(first, last, 0.5 * _LEVEL + 1.0, 1, 1, 1)
    error = np.empty((trials, 2))
    _chain(
        radius, offsets(trials), exposure, interest, Grey(level, 1.0, 1, 1, grey), new_found((size, size), 4),
        np.ones((size, size), dtype=np.float32), np.empty((size, size), dtype=np.uint8), error,
    )  # fmt: skip
    return error


def centre_errors(diameter: float, trials: int) -> np.ndarray:
    """Return errors (trials, 2), px, if a pixel belongs to the disc when its centre does."""
    error = np.empty((trials, 2))
    _centres(0.5 * diameter, offsets(trials), error)
    return error


DIAMETERS = tuple(range(2, 41))
TRIALS, GREY_TRIALS = 10_000, 2_000
IN_TABLE = (2, 5, 10, 20, 40)


def draw() -> Figure:
    """Plot mean and standard deviation over the diameter."""
    methods: dict[str, Callable[[int], np.ndarray]] = {
        "centre of the pixel": lambda diameter: centre_errors(diameter, TRIALS),
        "half of its area": lambda diameter: chain_errors(diameter, TRIALS),
        "grey levels": lambda diameter: chain_errors(diameter, GREY_TRIALS, grey=True),
    }
    with ThreadPoolExecutor(available_threads()) as pool:  # kernels release the GIL
        series = {name: list(pool.map(errors, DIAMETERS)) for name, errors in methods.items()}
    centre, half, grey = ({diameter: e.std() for diameter, e in zip(DIAMETERS, s)} for s in series.values())
    binary = [errors for name in list(series)[:2] for errors in series[name]]
    values = {
        "bias": max(float(abs(errors.mean(axis=0)).max()) for errors in binary),
        "scatter": max(float((abs(e.mean(axis=0)) / e.std(axis=0)).max()) * TRIALS**0.5 for e in binary),
        "first": (centre[DIAMETERS[0]], half[DIAMETERS[0]]),
        "last": (centre[DIAMETERS[-1]], half[DIAMETERS[-1]]),
        "finer": 100.0 * max(grey[diameter] / half[diameter] for diameter in DIAMETERS),
    }
    rows = [
        {
            "Diameter": f"{diameter} px", "By pixel centres": f"{centre[diameter]:.4f} px",
            "By half the area": f"{half[diameter]:.4f} px", "By grey levels": f"{grey[diameter]:.4f} px",
        }
        for diameter in IN_TABLE
    ]  # fmt: skip
    return figure("centroid_error", values, [_plot(series)], rows)


def _plot(series: Mapping[str, list[np.ndarray]]) -> bytes:
    picture = new_figure(6.2, 3.2)
    axes = picture.add_subplot()
    for (name, errors), colour in zip(series.items(), (INK, FAILURE, SUCCESS), strict=True):
        axes.plot(DIAMETERS, [error.std() for error in errors], color=colour, linewidth=1.4, label=name)
        axes.plot(DIAMETERS, [error.mean() for error in errors], color=colour, linewidth=0.8, linestyle=":")
    style(axes, xlabel="diameter, px", ylabel="error of the centroid, px")
    axes.set_xlim(0, 40)
    axes.legend(frameon=False, fontsize=7.5, labelcolor=MUTED, title="criterion for a pixel", title_fontsize=7.5)
    axes.annotate("dotted: mean", (39.5, 0.003), ha="right", va="bottom", fontsize=7, color=MUTED)
    return png(picture)
