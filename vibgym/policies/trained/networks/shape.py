"""What a network has to know of the rows that it reads and of the actions that it gives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

NEIGHBOUR = "_there"
"""How the name of the first column of each neighbour's block in ``env.unwrapped.parts_layout`` ends."""


CELL = 3
"""Pixels along an edge of the squares that a network of pixels looks at; elements have a multiple of it."""

WAY_SCALES = (0.25, 0.05, 0.01)
"""m, in whose units such a network sees ways, squashed by tanh."""


LEAST_MASS = 1e-6
"""Added to masses, so that the centroid of an empty image is defined; a full square has a mass of about 1."""


class Shape(NamedTuple):
    """Columns of a row of ``observation="parts"``, and numbers of a part's action.

    The row's last ``neighbours * width`` columns are those of the neighbours.
    """

    columns: int  # of a row
    neighbours: int
    width: int  # columns of a neighbour
    action: int  # numbers of an action of one part
    side: int = 0  # of the square of elements that an action is for; 0: it is not for elements
    place: int = -1  # first of the two columns "element": where the centre lies within its element; -1: it is not read

    @property
    def own(self) -> int:
        """Columns of the part itself."""
        return self.columns - self.neighbours * self.width

    @property
    def has_elements(self) -> bool:
        """Whether a network that is applied to every element can act: it has to know where they lie."""
        return self.side > 0 and self.place >= 0

    @classmethod
    def of(cls, layout: Sequence[Any], action: int, side: int = 0) -> Shape:
        """Of an environment's ``parts_layout``."""
        columns = sum(row.width for row in layout)
        blocks = [row.start for row in layout if row.name.endswith(NEIGHBOUR)]
        place = next((row.start for row in layout if row.name == "element"), -1)
        width = (columns - blocks[0]) // len(blocks) if blocks else 0
        return cls(columns, len(blocks), width, action, side, place)


class Picture(NamedTuple):
    """Planes of pixels that a network reads, as one row, and numbers of the part's action."""

    planes: int  # the part in the last images, newest first, and its goal
    height: int
    width: int
    pixel: float  # edge, m
    action: int
    side: int = 0  # it is not for elements

    @property
    def has_elements(self) -> bool:
        """Never: an image is not looked at element by element."""
        return False

    @property
    def columns(self) -> int:
        """Numbers of a row."""
        return self.planes * self.height * self.width


class Squares(NamedTuple):
    """The squares of planes that are not empty, in order."""

    pixels: np.ndarray  # (squares, CELL * CELL) float32, 0 to 1, upper row first
    plane: np.ndarray  # (squares,) int64, counted over all rows
    x: np.ndarray  # (squares,) float32 m, to the right from the middle of the first square ...
    y: np.ndarray  # ... and up, so below zero


def occupied(rows: np.ndarray, shape: Picture) -> Squares:
    """What there is to see in rows (..., columns): images of parts are nearly empty, and only the rest needs to be computed."""
    wide, high = shape.width // CELL, shape.height // CELL
    lines = rows.reshape(-1, CELL, wide * CELL)
    any_row = lines.max(axis=1)
    filled = any_row[:, 0::CELL] > 0
    for column in range(1, CELL):
        filled |= any_row[:, column::CELL] > 0
    line, column = np.divmod(np.flatnonzero(filled), wide)
    plane, row = np.divmod(line, high)
    pixels = lines.reshape(-1, CELL, wide, CELL)[line, :, column].reshape(-1, CELL**2)
    edge = np.float32(shape.pixel * CELL)
    scaled = pixels.astype(np.float32) * np.float32(1.0 / 255.0)
    return Squares(scaled, plane, edge * column.astype(np.float32), -edge * row.astype(np.float32))


def offsets(place: np.ndarray, side: int) -> np.ndarray:
    """Centres of the elements of a patch minus the part's centre, in elements: (..., side, 2), of x and y apart.

    Args:
        place: (..., 2) where the centre lies in its element, -1 to 1, x and y.
        side: elements along a side of the patch, as :class:`vibgym.envs.actions.Patch` lays it about the part.
    """
    within = 0.5 * (place + 1.0)
    first = np.floor(within + (0.5 - 0.5 * side))
    return (first + 0.5 - within)[..., None, :] + np.arange(side, dtype=place.dtype)[:, None]
