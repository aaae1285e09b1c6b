"""Quarter turns of the table: what a turned scene looks like, and what is to be done in it.

The grid of elements looks the same after a quarter turn, and so does the common circular motion a quarter period later. An
element's phasor turns backwards with it: what pushed along x then pushes along y. So each sample is four. Two more symmetries
are in the rows themselves: the part's own, since headings are coded modulo it, and shifts by whole elements, for networks that
do not read the column ``position``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibgym import Part, checks
from vibgym.policies.trained.networks.shape import Shape

VECTORS = (
    "position", "element", "way_far", "way_coarse", "way_fine", "way_finest", "velocity", "goal_velocity", "way_ahead",
    "apart", "apart_far", "way",
)  # fmt: skip
"""Columns that are vectors, one after the other; as they are called after their neighbour's number."""

SIDES = ("borders", "zone")
"""Columns of the left, right, bottom and top side."""

HEADING = "heading"

TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
"""A vector after a quarter turn to the left."""

TURN_SIDES = np.array([[0, 0, 0, 1], [0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]], dtype=np.float64)
"""What was above is on the left, what was below on the right, what was left below, what was right above."""


def turned_rows(columns: Sequence[Sequence[Any]], parts: Sequence[Part]) -> np.ndarray:
    """Matrix (columns, columns) that takes a row to that of the scene after a quarter turn to the left.

    Args:
        columns: names and widths of a row's columns.
        parts: of the scene.

    Raises:
        ValueError: if parts differ in symmetry: the headings of neighbours are then ambiguous.
    """
    symmetries = {part.symmetry for part in parts}
    if len(symmetries) > 1:
        raise checks.refuse("turns", f"parts of symmetries {sorted(symmetries)}", "parts of the same symmetry")
    angle = 0.5 * np.pi * next(iter(symmetries))  # 0 for discs, whose heading is always (1, 0)
    own = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).round()
    matrix = np.eye(sum(width for _, width in columns))
    start = 0
    for name, width in columns:
        kind = name.split("_", 2)[2] if name.startswith("neighbour_") else name
        if kind in VECTORS:
            for first in range(start, start + width, 2):
                matrix[first : first + 2, first : first + 2] = TURN
        elif kind in SIDES:
            matrix[start : start + 4, start : start + 4] = TURN_SIDES
        elif kind == HEADING:
            matrix[start : start + 2, start : start + 2] = own
        start += width
    return matrix.astype(np.float32)


def turned_actions(action: str, shape: Shape) -> np.ndarray:
    """Matrix (numbers, numbers) that takes a part's action to the one that does the same after a quarter turn to the left.

    Args:
        action: ``"wrench"``, ``"field"``, or one of elements, whose numbers are the phasors of a square.
        shape: of the network.

    Raises:
        ValueError: another action, whose behaviour under rotation is not known.
    """
    matrix = np.eye(shape.action)
    if action in ("wrench", "field"):
        matrix[:2, :2] = TURN
        if action == "field":  # squeeze along x and along y
            matrix[2:4, 2:4] = np.array([[0.0, 1.0], [1.0, 0.0]])
        return matrix.astype(np.float32)
    side = shape.side
    if side == 0:
        raise checks.conflict(f"'turned' does not support action {action!r}")
    matrix[:] = 0.0
    for row in range(side):
        for column in range(side):
            old, new = 2 * (row * side + column), 2 * (column * side + side - 1 - row)
            matrix[new : new + 2, old : old + 2] = TURN.T  # a phasor turns backwards
    return matrix.astype(np.float32)


class Turns:
    """Turns samples by quarter turns.

    Args:
        columns, parts: see :func:`turned_rows`.
        action, shape: see :func:`turned_actions`.

    Raises:
        ValueError: no column that says where the way leads, or parts of different symmetry.
    """

    def __init__(self, columns: Sequence[Sequence[Any]], parts: Sequence[Part], action: str, shape: Shape) -> None:
        once, acts = turned_rows(columns, parts), turned_actions(action, shape)
        self.rows = [np.ascontiguousarray(np.linalg.matrix_power(once, k).T) for k in range(4)]
        self.actions = [np.ascontiguousarray(np.linalg.matrix_power(acts, k).T) for k in range(4)]
        starts = np.cumsum([0, *(width for _, width in columns)])
        names = [name for name, _ in columns]
        if "way_far" not in names:
            raise checks.refuse("columns", names, "the column 'way_far' among them, by which rows are turned")
        self._way = int(starts[names.index("way_far")])

    def ahead(self, rows: np.ndarray) -> np.ndarray:
        """Quarter turns after which the way of each part leads to the right and up, or straight right: (...) of 0 to 3."""
        x, y = rows[..., self._way], rows[..., self._way + 1]
        # In the second quadrant three turns, in the third two, in the fourth one.
        return np.where(x > 0.0, np.where(y >= 0.0, 0, 1), np.where(y > 0.0, 3, np.where(x < 0.0, 2, 1))) * (
            (x != 0.0) | (y != 0.0)
        )

    def turn_rows(self, quarters: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Rows (..., columns), each after so many quarter turns (...)."""
        return _each(self.rows, quarters, rows)

    def turn_actions(self, quarters: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """Actions (..., numbers), each after so many quarter turns (...), which may be less than none."""
        return _each(self.actions, quarters % 4, actions)


def _each(matrices: Sequence[np.ndarray], quarters: np.ndarray, values: np.ndarray) -> np.ndarray:
    result = values.copy()
    for k in (1, 2, 3):
        chosen = quarters == k
        result[chosen] = values[chosen] @ matrices[k]
    return result
