"""A library of outlines in families, with fixed splits for training, validation, and tests on shapes new to a policy.

Each outline has a size (largest dimension) of 20 to 80 mm and a coefficient of friction of 0.3 to 0.9; small real parts have
the dimensions of their standards. The library is computed from fixed seeds; a test pins its digest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial

import numpy as np

from vibgym import checks
from vibgym.scene.parts import Part

SIZE, FRICTION = (0.020, 0.080), (0.3, 0.9)
"""Ranges of the largest dimension, m, and of the coefficient of sliding friction."""

DIGITS = 9
"""Decimals of lengths in m, below the tolerance of :func:`vibgym.scene.outlines.symmetry_order`."""


def block(draw: np.random.Generator) -> np.ndarray:
    """Return a rectangle with a ratio of sides between 1 and 2."""
    return _rectangle(1.0, draw.uniform(0.5, 1.0))


def bar(draw: np.random.Generator) -> np.ndarray:
    """Return a rectangle with a ratio of sides between 2.5 and 5."""
    return _rectangle(1.0, draw.uniform(0.2, 0.4))


def ell(draw: np.random.Generator) -> np.ndarray:
    """Return an L: a rectangle without a corner."""
    height, x, y = draw.uniform(0.6, 1.0), draw.uniform(0.3, 0.6), draw.uniform(0.3, 0.6)
    y *= height
    return np.array([[0.0, 0.0], [1.0, 0.0], [1.0, y], [x, y], [x, height], [0.0, height]])


def tee(draw: np.random.Generator) -> np.ndarray:
    """Return a T: a bar on a stem."""
    height, top, stem = draw.uniform(0.6, 1.0), draw.uniform(0.25, 0.5), draw.uniform(0.12, 0.25)
    under = height * (1.0 - top)
    left, right = 0.5 - stem, 0.5 + stem
    return np.array(
        [
            [left, 0.0], [right, 0.0], [right, under], [1.0, under],
            [1.0, height], [0.0, height], [0.0, under], [left, under],
        ]
    )  # fmt: skip


def bracket(draw: np.random.Generator) -> np.ndarray:
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
    return _round(np.tile([1.0, draw.uniform(0.4, 0.65)], int(draw.integers(4, 8))))


def blob(draw: np.random.Generator) -> np.ndarray:
    """Return a smooth closed curve of 24 corners: a circle with three random harmonics in its radius."""
    angle = 2.0 * math.pi * np.arange(24) / 24.0
    radius = np.ones(24)
    for order in (2, 3, 4):
        radius += draw.uniform(0.0, 0.45 / order) * np.cos(order * angle + draw.uniform(0.0, 2.0 * math.pi))
    return _round(radius)


FLATS = {8: (13.0, 5.3), 10: (16.0, 6.4), 12: (18.0, 7.5), 16: (24.0, 10.0), 20: (30.0, 12.5), 24: (36.0, 15.0)}
"""Thread in mm -> width across flats of nut and head, height of the head, mm (ISO 4032, ISO 4017)."""


def nut(thread: int) -> np.ndarray:
    """Return a hexagon nut by its thread in mm, m."""
    return 1e-3 * FLATS[thread][0] / math.sqrt(3.0) * _round(np.ones(6))


def bolt(thread: int, length: float) -> np.ndarray:
    """Return a hexagon head screw that lies on its side by its thread and its length below the head in mm, m."""
    flats, head = FLATS[thread]
    corners, half = flats / math.sqrt(3.0), 0.5 * thread
    return 1e-3 * np.array(
        [
            [0.0, -corners], [head, -corners], [head, -half], [head + length, -half],
            [head + length, half], [head, half], [head, corners], [0.0, corners],
        ]
    )  # fmt: skip


def gear(teeth: int) -> np.ndarray:
    """Return a spur gear of module 2.5 mm whose teeth are trapezoids, m."""
    module = 2.5e-3
    pitch, inner, outer = 0.5 * module * teeth, 0.5 * module * (teeth - 2.5), 0.5 * module * (teeth + 2.0)
    share = np.array([[inner, -0.38], [pitch, -0.25], [outer, -0.12], [outer, 0.12], [pitch, 0.25], [inner, 0.38]])
    angle = 2.0 * math.pi / teeth * (np.arange(teeth)[:, None] + share[:, 1])
    return (share[:, 0] * np.stack([np.cos(angle), np.sin(angle)])).reshape(2, -1).T


def lever(one: float, other: float, length: float) -> np.ndarray:
    """Return a lever with round ends by their radii, the larger one first, and the distance of their centres in mm, m."""
    lean = math.asin((one - other) / length)
    ends = []
    for radius, x, begin in ((one, 0.0, 0.5 * math.pi - lean), (other, length, lean - 0.5 * math.pi)):
        angle = begin + np.linspace(0.0, math.pi + 2.0 * lean if x == 0.0 else math.pi - 2.0 * lean, 8)
        ends.append(np.column_stack([x + radius * np.cos(angle), radius * np.sin(angle)]))
    return 1e-3 * np.concatenate(ends)


def _rectangle(length: float, width: float) -> np.ndarray:
    return np.array([[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]])


def _round(radius: np.ndarray) -> np.ndarray:
    """Return corners at equal angles with these distances from the centre."""
    angle = 2.0 * math.pi * np.arange(len(radius)) / len(radius)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


REAL: tuple[Callable[[], np.ndarray] | float, ...] = (
    partial(nut, 20), 30.0, partial(bolt, 10, 40.0), partial(gear, 16), partial(lever, 12.0, 5.0, 60.0), partial(nut, 12),
    44.0, partial(bolt, 16, 50.0), partial(gear, 12), partial(lever, 9.0, 6.0, 40.0), partial(nut, 24), 24.0,
)  # fmt: skip
"""Outlines of small real parts, by their numbers; a number is the outer diameter of a washer in mm (ISO 7089)."""

FAMILIES: dict[str, Callable[[np.random.Generator], np.ndarray] | None] = {
    "block": block, "bar": bar, "ell": ell, "tee": tee, "bracket": bracket, "blob": blob, "real": None, "star": star,
}  # fmt: skip
"""Name of a family -> function that returns an outline (n, 2) of any size; None: :data:`REAL` in turn, with their own sizes."""

HELD_OUT = ("star",)
"""Families that no split but ``"held_out"`` has."""

SPLITS = {"train": 6, "validation": 2, "test": 4, "held_out": 16}
"""Number of parts of each family in a split."""


@cache
def shapes(split: str) -> tuple[Part, ...]:
    """Return the parts of a split.

    Parts alternate between families. Sizes and frictions of a family are stratified over their ranges in each split.

    Args:
        split: ``"train"``, ``"validation"`` and ``"test"`` have different parts of the same families; ``"held_out"`` has parts
            of a family that no other split has.

    Returns:
        Parts named ``family-number``, such as ``"ell-3"``; numbers differ between splits.

    Raises:
        ValueError: an unknown split.
    """
    count = SPLITS[checks.choice("split", split, tuple(SPLITS))]
    begin = 0 if split == "held_out" else sum(list(SPLITS.values())[: list(SPLITS).index(split)])
    families = [family for family in FAMILIES if (family in HELD_OUT) == (split == "held_out")]
    parts = {family: _parts(family, begin, count) for family in families}
    return tuple(parts[family][k] for k in range(count) for family in families)


def _parts(family: str, begin: int, count: int) -> list[Part]:
    """Return ``count`` parts of a family with numbers from ``begin`` on."""
    draw = np.random.default_rng([list(FAMILIES).index(family), begin])
    strata = np.arange(count) + draw.random((2, count))
    sizes, frictions = (
        (low + (high - low) * draw.permutation(stratum) / count).tolist()
        for (low, high), stratum in zip((SIZE, FRICTION), strata, strict=True)
    )
    return [
        _part(family, begin + k, draw, size, round(friction, 4))
        for k, (size, friction) in enumerate(zip(sizes, frictions, strict=True))
    ]


def _part(family: str, number: int, draw: np.random.Generator, size: float, friction: float) -> Part:
    """Return a part of a family."""
    properties = {"friction": friction, "name": f"{family}-{number}"}
    make = FAMILIES[family]
    if make is not None:
        return Part.polygon(scaled(make(draw), size), **properties)
    real = REAL[number]
    if callable(real):
        return Part.polygon(real().round(DIGITS), **properties)
    return Part.disc(0.5e-3 * real, **properties)


def scaled(outline: np.ndarray, size: float) -> np.ndarray:
    """Return an outline (n, 2) of any size with a largest dimension of ``size``, m, about its centroid."""
    centred = Part.polygon(outline * (size / largest_dimension(outline)), friction=0.0).outline
    return centred.round(DIGITS)


def largest_dimension(outline: np.ndarray) -> float:
    """Return the largest distance between two corners of an outline (n, 2)."""
    return float(np.hypot(*(outline[:, None] - outline[None]).transpose(2, 0, 1)).max())
