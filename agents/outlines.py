"""Parts with random outlines, sizes and frictions, on which generalists are trained and tested.

A family draws the proportions of an outline. Some families are used in tests only: their shapes are new to a trained policy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pydantic import Field

from vibgym import Part, checks
from vibgym.config import Settings
from vibgym.scene.outlines import convex_hull

LEAST_SIZE, MOST_SIZE = 0.005, 0.2
"""Range of a part's largest dimension on elements of 26 mm, m."""

LEAST_FRICTION, MOST_FRICTION = 0.05, 3.0
"""Range of friction; parts on the prototype slide permanently up to 3.4 (:meth:`vibgym.Surface.slides_permanently`)."""

DIGITS = 9
"""Decimals of lengths in m, below the tolerance of :func:`vibgym.scene.outlines.symmetry_order`."""


def rectangle(draw: np.random.Generator) -> np.ndarray:
    """Return a rectangle with a ratio of sides between 1 and 3.3."""
    length, width = 1.0, draw.uniform(0.3, 1.0)
    return np.array([[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]])


def regular(draw: np.random.Generator) -> np.ndarray:
    """Return a regular polygon, triangle to octagon."""
    return _round(np.ones(draw.integers(3, 9)))


def convex(draw: np.random.Generator) -> np.ndarray:
    """Return the convex hull of eight points in an ellipse."""
    radius, angle = np.sqrt(draw.uniform(0.2, 1.0, 8)), draw.uniform(0.0, 2.0 * math.pi, 8)
    points = np.stack([radius * np.cos(angle), draw.uniform(0.5, 1.0) * radius * np.sin(angle)], axis=1)
    return convex_hull(points)


def wavy(draw: np.random.Generator) -> np.ndarray:
    """Return ten corners at random distances from a centre."""
    return _round(draw.uniform(0.55, 1.0, 10))


def ell(draw: np.random.Generator) -> np.ndarray:
    """Return an L: a rectangle without a corner."""
    height, x, y = draw.uniform(0.6, 1.0), draw.uniform(0.3, 0.6), draw.uniform(0.3, 0.6)
    y *= height
    return np.array([[0.0, 0.0], [1.0, 0.0], [1.0, y], [x, y], [x, height], [0.0, height]])


def tee(draw: np.random.Generator) -> np.ndarray:
    """Return a T: a bar on a stem."""
    height, bar, stem = draw.uniform(0.6, 1.0), draw.uniform(0.25, 0.5), draw.uniform(0.12, 0.25)
    bar = height * (1.0 - bar)
    left, right = 0.5 - stem, 0.5 + stem
    return np.array(
        [[left, 0.0], [right, 0.0], [right, bar], [1.0, bar], [1.0, height], [0.0, height], [0.0, bar], [left, bar]]
    )


def you(draw: np.random.Generator) -> np.ndarray:
    """Return a U: a rectangle with a notch."""
    height, wall, floor = draw.uniform(0.6, 1.0), draw.uniform(0.2, 0.35), draw.uniform(0.25, 0.5)
    floor *= height
    return np.array(
        [
            [0.0, 0.0], [1.0, 0.0], [1.0, height], [1.0 - wall, height],
            [1.0 - wall, floor], [wall, floor], [wall, height], [0.0, height],
        ]
    )  # fmt: skip


def star(draw: np.random.Generator) -> np.ndarray:
    """Return a star with four to seven points."""
    points = int(draw.integers(4, 8))
    return _round(np.tile([1.0, draw.uniform(0.4, 0.65)], points))


def cross(draw: np.random.Generator) -> np.ndarray:
    """Return a cross of two bars."""
    height, a, b = draw.uniform(0.6, 1.0), draw.uniform(0.15, 0.25), draw.uniform(0.15, 0.25)
    x, y = 0.5, 0.5 * height
    corner = np.array([[x, b * height], [a, b * height], [a, y]])
    return np.concatenate([corner, corner[::-1] * [-1, 1], corner * [-1, -1], corner[::-1] * [1, -1]])


def _round(radius: np.ndarray) -> np.ndarray:
    """Return corners at equal angles with these distances from the centre."""
    angle = 2.0 * math.pi * np.arange(len(radius)) / len(radius)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


DISC = "disc"

FAMILIES: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    each.__name__: each for each in (rectangle, regular, convex, wavy, ell, tee, you, star, cross)
}
"""Name of a family -> function that returns an outline (n, 2) of any size; discs are the tenth family."""

TRAINING = (DISC, "rectangle", "regular", "convex", "wavy", "ell", "tee")
UNSEEN = ("you", "star", "cross")
"""Families for training, and for tests only."""


class OutlineSettings(Settings):
    """Scenes of one part each with random outline, size and friction, see :func:`scenes`."""

    count: int = Field(48, ge=1, le=10_000)
    seed: int = Field(0, ge=0, lt=2**63)
    families: list[str] = list(TRAINING)
    size: list[float] = Field([0.020, 0.080], min_length=2, max_length=2)  # m, of the largest dimension
    friction: list[float] = Field([0.3, 0.9], min_length=2, max_length=2)


def scenes(
    count: int,
    seed: int,
    families: Sequence[str] = TRAINING,
    size: tuple[float, float] = (0.020, 0.080),
    friction: tuple[float, float] = (0.3, 0.9),
) -> list[dict[str, Any]]:
    """Return environment arguments of scenes, ``{"parts": [part]}`` each, with JSON values.

    Families alternate. Sizes and frictions are stratified over their ranges: one from each of ``count`` equal intervals.

    Args:
        count: number of scenes.
        seed: the same seed gives the same scenes.
        families: names among :data:`FAMILIES`, and ``"disc"``.
        size: m, least and most of the largest dimension.
        friction: least and most coefficient of sliding friction.

    Raises:
        ValueError: an unknown family, none, or a bad range.
    """
    count = checks.count("outlines.count", count)
    seed = checks.count("outlines.seed", seed, least=0)
    if not families:
        raise checks.refuse("outlines.families", families, f"names among {', '.join((DISC, *FAMILIES))}")
    for family in families:
        checks.choice("outlines.families", family, (DISC, *FAMILIES))
    sizes = checks.interval("outlines.size", list(size), LEAST_SIZE, MOST_SIZE)
    frictions = checks.interval("outlines.friction", list(friction), LEAST_FRICTION, MOST_FRICTION)
    draw = np.random.default_rng(seed)
    drawn = zip(_spread(draw, count, *sizes), _spread(draw, count, *frictions), strict=True)
    return [
        {"parts": [part(families[k % len(families)], draw, own_size, own_friction)]}
        for k, (own_size, own_friction) in enumerate(drawn)
    ]


def part(family: str, draw: np.random.Generator, size: float, friction: float) -> dict[str, Any]:
    """Return a part of a family as a mapping of JSON values, see :class:`vibgym.config.PartSettings`.

    Args:
        family: name among :data:`FAMILIES`, or ``"disc"``.
        draw: random generator of the proportions.
        size: m, the largest dimension.
        friction: coefficient of sliding friction.
    """
    friction = round(friction, 4)
    if family == DISC:
        return {"shape": "disc", "radius": round(0.5 * size, DIGITS), "friction": friction, "name": family}
    outline = FAMILIES[family](draw)
    across = np.hypot(*(outline[:, None] - outline[None]).transpose(2, 0, 1)).max()
    centred = Part.polygon(outline * (size / across), friction=friction).outline
    return {"shape": "polygon", "vertices": centred.round(DIGITS).tolist(), "friction": friction, "name": family}


def _spread(draw: np.random.Generator, count: int, low: float, high: float) -> list[float]:
    """Return a random value from each of ``count`` equal intervals, in random order."""
    return (low + (high - low) * (draw.permutation(count) + draw.random(count)) / count).tolist()
