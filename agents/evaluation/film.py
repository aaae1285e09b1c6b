"""Films for pages: what moves as small whole numbers, which ``film.js`` draws on a canvas.

A film is a JSON mapping, compressed by gzip and written in base64. Places are in tenths of a millimetre and headings in tenths
of a degree, each number as its difference from the frame before; an element's oscillation in one of 32 phases and 7 amplitudes
is a single character. Browsers draw what lies between two frames.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.log import Film
from vibgym.plugins.play.drawing import drawn_scene, scripts
from vibgym.rendering import Scenery

MOST_FRAMES = 250
"""Of a film; of longer ones every second step is kept, or fewer."""

PER_METRE, PER_RADIAN, PER_HEIGHT = 1e4, 1800.0 / math.pi, 1e5
"""Whole numbers in a metre, a radian, and a metre of height."""

PHASES, AMPLITUDES = 32, 7
"""Steps of the phase, and of the amplitude above rest."""

REST = 48
"""Character of an element at rest; those after it are phases at the least amplitude, then at the next one."""

FAINTEST = 0.03
"""Fraction of full scale from which an element is shown as moving."""


def frames_shown(film: Film) -> np.ndarray:
    """Numbers of the frames that are kept, the first and the last among them."""
    last = len(film.poses) - 1
    stride = max(1, math.ceil(last / (MOST_FRAMES - 1)))
    return np.array([*range(0, last, stride), last])


def packed(film: Film, scenery: Scenery, step_time: float) -> str:
    """A film as ``film.js`` reads it.

    Args:
        step_time: between two frames of the film, s.
    """
    shown = frames_shown(film)
    there = _there(film, scenery)[shown]
    stride = int(shown[1] - shown[0]) if len(shown) > 1 else 1
    content: dict[str, Any] = {
        "scene": {**drawn_scene(scenery), "paths": [_finite(path) for path in film.paths]},
        "interval": round(1e3 * stride * step_time, 3),
        "frames": len(shown),
        "trail": scenery.trail // stride,
        "captions": [film.captions[frame] for frame in shown],
        "there": ["" if each.all() else "".join("1" if one else "0" for one in each) for each in there.T],
        "poses": _changes(film.poses[shown], there),
        "field": _field(film.phasors[shown]),
    }  # fmt: skip
    if scenery.goal_size:
        content["goals"] = _changes(film.goals[shown], there)
    if any(film.sides[frame] is not None for frame in shown):
        content["sides"] = [_side(film.sides[frame]) for frame in shown]
    data = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
    # Without the time, so that the same film gives the same page.
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode("ascii")


def _finite(path: np.ndarray) -> list[list[float]]:
    """The points of a path that are any, m."""
    return path[np.isfinite(path).all(axis=1)].round(5).tolist()


def script() -> str:
    """What draws and plays the films of a page, as one text."""
    own = Path(__file__).with_name("film.js").read_text(encoding="utf-8")
    return f'(() => {{\n"use strict";\n{scripts()}\n{own}}})();'


def _there(film: Film, scenery: Scenery) -> np.ndarray:
    """(frames, parts) whether a part is on the table or near it: who waits for its turn is far beside it."""
    middle = 0.5 * scenery.element_size * np.array([scenery.columns, scenery.rows])
    place = film.poses[..., :2]
    with np.errstate(invalid="ignore"):
        near = (np.abs(place - middle) <= 2.0 * middle).all(axis=-1)
    return film.present & np.isfinite(film.poses).all(axis=-1) & near


def _changes(poses: np.ndarray, there: np.ndarray) -> list[list[int]]:
    """Poses (frames, parts, 3) as lists of differences, three for each part, the first number of a list whole.

    Who is not there stays where it was. A list of one number says that nothing changes.
    """
    found = []
    for part in range(poses.shape[1]):
        own, kept = poses[:, part], there[:, part]
        for axis, factor in enumerate((PER_METRE, PER_METRE, PER_RADIAN)):
            values = np.where(kept, own[:, axis], 0.0)
            if kept.any():
                last = np.maximum.accumulate(np.where(kept, np.arange(len(kept)), int(kept.argmax())))
                values = values[last]
            whole = np.rint(factor * (np.unwrap(values) if axis == 2 else values)).astype(int)
            steps = np.diff(whole, prepend=0).tolist()
            found.append(steps if any(steps[1:]) else steps[:1])
    return found


def _field(phasors: np.ndarray) -> list[str]:
    """Phasors (frames, rows, columns, 2) as a text for each element, a character for each frame.

    A text of one character says that nothing changes: most elements rest most of the time.
    """
    strength = np.nan_to_num(np.hypot(phasors[..., 0], phasors[..., 1])).clip(0.0, 1.0)
    phase = np.nan_to_num(np.arctan2(phasors[..., 1], phasors[..., 0]))
    step = np.rint(phase * (PHASES / (2.0 * np.pi))).astype(int) % PHASES
    level = np.rint(strength * AMPLITUDES).astype(int).clip(1, AMPLITUDES)
    codes = np.where(strength >= FAINTEST, 1 + (level - 1) * PHASES + step, 0) + REST
    series = codes.reshape(len(codes), -1).T
    return [_text(each) for each in series]


def _text(codes: np.ndarray) -> str:
    return "".join(map(chr, (codes[:1] if (codes == codes[0]).all() else codes).tolist()))


def _side(side: Any) -> list[Any]:
    """Plates as (from, to, height), and the bottom of every part as corners (along, height); empty where it is not seen."""
    if side is None:
        return [[], []]
    scale = np.array([PER_METRE, PER_METRE, PER_HEIGHT])
    bottoms = [
        np.rint(scale[[0, 2]] * bottom[:, [0, 2]]).astype(int).ravel().tolist() if np.isfinite(bottom).all() else []
        for bottom in side.bottoms
    ]
    return [np.rint(scale * side.plates).astype(int).ravel().tolist(), bottoms]
