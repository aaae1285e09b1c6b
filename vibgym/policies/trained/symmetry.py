"""Quarter turns of the table: rows and actions in a turned scene.

The grid of elements is unchanged by a quarter turn, and the circular motion of the table by a quarter turn a quarter period
later. An element's phasor turns backwards. Two more symmetries are in the rows: headings are coded modulo the part's symmetry,
and networks that do not read the column ``position`` are invariant to shifts by whole elements. Motions are nearly symmetric
under reflections as well, and networks may be averaged over them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from vibgym import Part, checks
from vibgym.policies.trained.networks import BASE, Shape

VECTORS = (
    "position", "element", "way_far", "way_coarse", "way_fine", "way_finest", "velocity", "goal_velocity", "way_ahead",
    "apart", "apart_far", "way", "plan_velocity", "plan_way", "plan_way_fine", "plan_normal",
    "plan_room", "plan_left", "contact_normal", "contact_impulse",
)  # fmt: skip
"""Columns of one or more vectors; names of neighbours' columns without their number."""

SIDES = ("borders", "zone")
"""Columns of the left, right, bottom and top side."""

HEADING = "heading"

ACTION = "action"
"""Name of earlier actions in rows, see ``history`` of :class:`.coding.Coding`."""

TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
"""Rotation of a vector by a quarter turn to the left."""

TURN_SIDES = np.array([[0, 0, 0, 1], [0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]], dtype=np.float64)
"""Permutation of the sides: above to left, below to right, left to below, right to above."""


class Equivalent(NamedTuple):
    """Transformation to an equivalent scene: ``rows[..., order] * sign`` has the outputs ``outputs[..., to] * times``."""

    order: np.ndarray  # (columns,) int64
    sign: np.ndarray  # (columns,) float32
    to: np.ndarray  # (values,) int64
    times: np.ndarray  # (values,) float32

    def back(self) -> np.ndarray:
        """Return the matrix (values, values) from outputs of the transformed scene to those of the first."""
        matrix = np.zeros((len(self.to), len(self.to)), dtype=np.float32)
        matrix[np.arange(len(self.to)), self.to] = self.times
        return matrix

    def after(self, first: Equivalent) -> Equivalent:
        """Return the transformation that does ``first``, then this."""
        return Equivalent(
            first.order[self.order],
            first.sign[self.order] * self.sign,
            first.to[self.to],
            first.times[self.to] * self.times,
        )


class Symmetry(NamedTuple):
    """Equivalent scenes, in which a network is evaluated, and the mean of its outputs, all for the first scene.

    Any network is so exactly equal in all of them (group averaging: Puny et al., "Frame averaging for invariant and equivariant
    network design", ICLR 2022). The arrays are of NumPy or torch.
    """

    order: Any  # (scenes, columns) int64, columns of the first scene that those of the others are, times ``sign``
    sign: Any  # (scenes, columns)
    back: Any  # (scenes * values, values) from the outputs of all scenes to their mean

    @classmethod
    def of(cls, equivalents: Sequence[Equivalent]) -> Symmetry:
        """Return that of some transformations, of which the first changes nothing."""
        order, sign, _, _ = map(np.stack, zip(*equivalents, strict=True))
        back = np.concatenate([each.back() for each in equivalents]) / np.float32(len(equivalents))
        return cls(order, sign, back)

    def rows(self, rows: Any) -> Any:
        """Return the rows (..., scenes, columns) of all scenes for rows (..., columns) of the first."""
        return rows[..., self.order] * self.sign

    def mean(self, outputs: Any) -> Any:
        """Return the mean (..., values) of outputs (..., scenes, values)."""
        return outputs.reshape(*outputs.shape[:-2], -1) @ self.back

    def spread(self, log_std: Any) -> Any:
        """Return the mean (..., values) of logarithmic standard deviations (..., scenes, values), which have no direction."""
        return log_std.reshape(*log_std.shape[:-2], -1) @ abs(self.back)


class Reflection(NamedTuple):
    """What becomes of columns where the scene is reflected: ``numbers[order] * sign``."""

    vector: tuple[list[int], list[float]]  # order and sign of x and y
    heading: tuple[list[int], list[float]]  # of cosine and sine
    sides: list[int]  # order


def diagonal(symmetry: int) -> Reflection:
    """Return the reflection that exchanges x and y, for headings modulo a part's symmetry.

    Cosine and sine of ``symmetry * heading`` become those of ``symmetry * (pi / 2 - heading)``.
    """
    cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[symmetry % 4]
    heading = ([0, 1], [cosine, -cosine]) if cosine else ([1, 0], [sine, sine])
    return Reflection(([1, 0], [1.0, 1.0]), heading, [2, 3, 0, 1])


def reflected(columns: Sequence[Sequence[Any]], reflection: Reflection) -> tuple[np.ndarray, np.ndarray]:
    """Return order (columns,) and sign (columns,) of columns, given by names and widths, in the reflected scene.

    A column :data:`.networks.BASE` or :data:`ACTION` is an action of motions.
    """
    every = sum(width for _, width in columns)
    order, sign, start = np.arange(every), np.ones(every, dtype=np.float32), 0
    for name, width in columns:
        kind = name.split("_", 2)[2] if name.startswith("neighbour_") else name
        moves = kind in (BASE, ACTION)  # a vector and a turn
        if kind in VECTORS or kind == HEADING or moves:
            pair, signs = reflection.heading if kind == HEADING else reflection.vector
            for first in range(start, start + width - moves, 2):
                order[first : first + 2], sign[first : first + 2] = first + np.array(pair), signs
        if moves:
            sign[start + 2] = -1.0
        elif kind in SIDES:
            order[start : start + 4] = start + np.array(reflection.sides)
        elif kind == "plan_push":  # strength, turn, way round, arrival
            sign[start + 1 : start + 3] = -1.0
        elif kind.startswith(("turn", "spin")) or kind.endswith(("spin", "turn")):
            sign[start : start + width] = -1.0
        start += width
    return order, sign


def both_ways(columns: Sequence[Sequence[Any]], symmetry: int) -> Symmetry:
    """Return the symmetry of rows of motions, which are turned by quarter turns, under :func:`diagonal`."""
    order, sign = reflected(columns, diagonal(symmetry))
    to, times = reflected([[ACTION, 3]], diagonal(symmetry))
    same = Equivalent(np.arange(len(order)), np.ones_like(sign), np.arange(3), np.ones_like(times))
    return Symmetry.of([same, Equivalent(order, sign, to, times)])


def turned_rows(columns: Sequence[Sequence[Any]], parts: Sequence[Part]) -> np.ndarray:
    """Return the matrix (columns, columns) that maps a row to the row of the scene after a quarter turn to the left.

    Args:
        columns: names and widths of a row's columns.
        parts: of the scene.

    Raises:
        ValueError: parts of different symmetry; the headings of neighbours are then ambiguous.
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
    """Return the matrix (values, values) that maps a part's action to the equivalent one after a quarter turn to the left.

    Args:
        action: an action of motions, ``"field"``, or an action of elements, whose values are the phasors of a patch.
        shape: of the network.

    Raises:
        ValueError: another action, whose behaviour under rotation is not known.
    """
    matrix = np.eye(shape.action)
    if action in ("wrench", "velocity", "target", "field"):
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
    """Quarter turns of rows and actions.

    Args:
        columns, parts: see :func:`turned_rows`.
        action, shape: see :func:`turned_actions`.
        recalled: names and widths of the columns that follow the action in :meth:`turn_steps`.

    Raises:
        ValueError: no column ``way_far``, or parts of different symmetry.
    """

    def __init__(
        self,
        columns: Sequence[Sequence[Any]],
        parts: Sequence[Part],
        action: str,
        shape: Shape,
        recalled: Sequence[Sequence[Any]] = (),
    ) -> None:
        once, acts, seen = turned_rows(columns, parts), turned_actions(action, shape), turned_rows(recalled, parts)
        apart = np.zeros((len(acts), len(seen)), dtype=np.float32)
        self.rows, self.actions, self.steps = (
            [np.ascontiguousarray(np.linalg.matrix_power(turn, k).T) for k in range(4)]
            for turn in (once, acts, np.block([[acts, apart], [apart.T, seen]]))
        )
        starts = np.cumsum([0, *(width for _, width in columns)])
        names = [name for name, _ in columns]
        if "way_far" not in names:
            raise checks.refuse("columns", names, "the column 'way_far' among them, by which rows are turned")
        self._way = int(starts[names.index("way_far")])

    def ahead(self, rows: np.ndarray) -> np.ndarray:
        """Return the quarter turns (...), 0 to 3, after which the displacement of each part points right and up."""
        x, y = rows[..., self._way], rows[..., self._way + 1]
        # In the second quadrant three turns, in the third two, in the fourth one.
        return np.where(x > 0.0, np.where(y >= 0.0, 0, 1), np.where(y > 0.0, 3, np.where(x < 0.0, 2, 1))) * (
            (x != 0.0) | (y != 0.0)
        )

    def turn_rows(self, quarters: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return rows (..., columns) after ``quarters`` (...) quarter turns."""
        return _each(self.rows, quarters, rows)

    def turn_actions(self, quarters: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """Return actions (..., values) after ``quarters`` (...) quarter turns, which may be negative."""
        return _each(self.actions, quarters % 4, actions)

    def turn_steps(self, quarters: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Return earlier steps (..., steps, values), an action and recalled columns each, after ``quarters`` (...) turns."""
        return _each(self.steps, quarters, steps)


def _each(matrices: Sequence[np.ndarray], quarters: np.ndarray, values: np.ndarray) -> np.ndarray:
    result = values.copy()
    for k in (1, 2, 3):
        chosen = quarters == k
        result[chosen] = values[chosen] @ matrices[k]
    return result
