"""What a network has to know of the rows that it reads and of the actions that it gives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

NEIGHBOUR = "_there"
"""How the name of the first column of each neighbour's block in ``env.unwrapped.parts_layout`` ends."""


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


def offsets(place: np.ndarray, side: int) -> np.ndarray:
    """Centres of the elements of a patch minus the part's centre, in elements: (..., side, 2), of x and y apart.

    Args:
        place: (..., 2) where the centre lies in its element, -1 to 1, x and y.
        side: elements along a side of the patch, as :class:`vibgym.envs.actions.Patch` lays it about the part.
    """
    within = 0.5 * (place + 1.0)
    first = np.floor(within + (0.5 - 0.5 * side))
    return (first + 0.5 - within)[..., None, :] + np.arange(side, dtype=place.dtype)[:, None]
