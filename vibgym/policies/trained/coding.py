"""From observations by parts to the rows that networks read, and from the parts' actions to the environment's."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from vibgym import Part, Surface, checks
from vibgym.envs.actions import ACTIONS, actions_by_part, patch_size
from vibgym.policies.trained.networks.shape import Shape
from vibgym.policies.trained.symmetry import Turns

TOUCHING = 0.02
"""Of the column that tells the distance to the nearest part, below which it is in touch: 0.7 mm on the prototype."""

NOTHING = np.zeros((0, 0, 0), dtype=np.float32)


class Seen(NamedTuple):
    """A batch of observations, as networks read it; what networks remember of it at the next step."""

    rows: np.ndarray  # (worlds, parts, columns) float32; of images uint8
    mask: np.ndarray  # (worlds, parts) float32, 1 where there is a part
    quarters: np.ndarray = NOTHING  # (worlds, parts) quarter turns by which the rows were turned; empty: never
    where: np.ndarray = NOTHING  # (worlds, parts, 4) columns position and element; empty where actions need them not
    command: np.ndarray = NOTHING  # (worlds, parts, numbers) actions then, in table coordinates; empty: not stored

    def of(self, worlds: Any) -> Seen:
        """Of some of the worlds, or of one, which stays a batch."""
        chosen = np.atleast_1d(worlds)
        return Seen(*(each[chosen] if len(each) else each for each in self))


class Coding:
    """Turns observations by parts into rows, and actions of single parts into the environment's.

    With ``"element"`` and ``"phasor"`` a part's action is for the square of elements around it, as with ``"patch"``, and all
    others rest.

    Args:
        surface, parts: the scene.
        layout: ``env.unwrapped.parts_layout``.
        action: the environment's ``action=``.
        columns: names and widths of the columns that a network reads; None: all. A scene may tell more, such as how old a
            measurement is, of which a network that was trained without knows nothing.
        turned: whether rows are turned by quarter turns until their way leads to the right and up, and actions turned back:
            networks are then the same in all four directions by construction (:mod:`vibgym.policies.trained.symmetry`).
        remembers: whether rows contain, after the part's own columns, its previous action. Measured velocities are means over
            the last period; the previous action determines the velocity at its end.

    Attributes:
        shape: what a network has to know.
        columns: names and widths of what it reads.

    Raises:
        ValueError: an action that has neither rows of parts nor elements, or columns that this scene does not have.
    """

    observation = "parts"
    dtype = np.float32  # of rows

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        layout: Sequence[Any],
        action: str,
        columns: Sequence[Sequence[Any]] | None = None,
        turned: bool = False,
        remembers: bool = False,
    ) -> None:
        self.surface, self.parts, self.action = surface, tuple(parts), action
        whole: int = ACTIONS.choose("action", action)(surface, self.parts).size
        side = patch_size(surface, self.parts)
        self._code: Callable[[np.ndarray], np.ndarray] | None = None
        if action in CODES:
            size, self._code = 2 * side**2, CODES[action]
        elif ACTIONS[action].by_part:
            size = whole // len(self.parts)
        else:
            raise checks.unknown("action", action, (*actions_by_part(), *CODES))
        self._all = sum(row.width for row in layout)
        self._at = [next(row.start for row in layout if row.name == name) for name in ("position", "element")]
        self._pick, layout = picked(layout, columns)
        self.columns = [[row.name, row.width] for row in layout]
        self.shape = Shape.of(layout, size, side if action in (*CODES, "patch") else 0)
        starts = {row.name: row.start for row in layout}
        nearest = [starts[name] for name in ("neighbour_1_there", "neighbour_1_gap") if name in starts]
        # Counted from the end: rows that remember have more before.
        self._nearest = [each - self.shape.columns for each in nearest] if len(nearest) == 2 else None
        self.turned = turned
        self._turns = Turns(self.columns, self.parts, action, self.shape) if turned else None
        self.remembers, self._own = remembers, self.shape.own
        if remembers:
            self.shape = self.shape._replace(columns=self.shape.columns + size)

    def see(self, observation: Any, before: Seen | None = None, start: np.ndarray | None = None) -> Seen:
        """Rows and mask of the parts; of one observation a batch of one.

        Args:
            observation: a dictionary, of one world or many.
            before: what was seen at the last step; None: nothing. Only rows that remember need it.
            start: (worlds,) bool, where an episode has begun since: the previous action is 0.

        Raises:
            ValueError: not an observation by parts, or a memory of other worlds.
        """
        n, columns = len(self.parts), self._all
        allowed = f"a dictionary of 'parts' (..., {n} or more, {columns}) and 'mask' (..., {n} or more)"
        try:
            rows = np.asarray(observation["parts"], dtype=np.float32)
            mask = np.asarray(observation["mask"], dtype=np.float32)
        except (TypeError, KeyError, IndexError, ValueError):
            raise checks.refuse("observation", observation, allowed) from None
        if rows.ndim == 2:
            rows, mask = rows[None], mask[None]
        if rows.ndim != 3 or mask.shape != rows.shape[:2] or rows.shape[1] < n or rows.shape[2] != columns:
            raise checks.refuse("observation", f"arrays of shapes {rows.shape} and {mask.shape}", allowed)
        where = NOTHING
        if self._code is not None:
            where = np.concatenate([rows[:, :n, first : first + 2] for first in self._at], axis=-1)
        rows = rows[:, :n] if self._pick is None else rows[:, :n, self._pick]
        seen = Seen(rows, mask[:, :n], where=where)
        if self._turns is not None:
            quarters = self._turns.ahead(rows)
            seen = seen._replace(rows=self._turns.turn_rows(quarters, rows), quarters=quarters)
        return self._remembered(seen, before, start) if self.remembers else seen

    def _remembered(self, seen: Seen, before: Any, start: np.ndarray | None) -> Seen:
        """Return ``seen`` with the previous actions in its rows, and a buffer of zeros for the next actions."""
        command = np.zeros((*seen.mask.shape, self.shape.action), dtype=np.float32)
        if before is not None:
            if not isinstance(before, Seen) or before.command.shape != command.shape:
                got = f"of shape {before.command.shape}" if isinstance(before, Seen) else type(before).__name__
                raise checks.refuse("state", got, f"None, or what predict() returned last, of shape {command.shape}")
            # Absent parts have no previous action: where parts come and go, a slot is empty before each arrival.
            command[...] = before.command * (before.mask[..., None] > 0.5)
            if start is not None:
                command[np.asarray(start, dtype=bool)] = 0.0
        own, others = seen.rows[..., : self._own], seen.rows[..., self._own :]
        rows = np.concatenate([own, self.to_rows(seen, command), others], axis=-1)
        return seen._replace(rows=rows, command=np.zeros_like(command))

    def touching(self, seen: Seen) -> np.ndarray:
        """(worlds, parts) 1.0 where a part is in touch with another, or nearly; zeros where rows do not tell."""
        if self._nearest is None:
            return np.zeros(seen.mask.shape, dtype=np.float32)
        there, gap = (seen.rows[..., column] for column in self._nearest)
        return ((there > 0.5) & (gap < TOUCHING)).astype(np.float32)

    def to_rows(self, seen: Seen, of_parts: np.ndarray) -> np.ndarray:
        """What networks shall say of turned rows for actions (worlds, parts, size) that parts are to take on the table."""
        return of_parts if self._turns is None else self._turns.turn_actions(seen.quarters, of_parts)

    def single(self, observation: Any) -> bool:
        """Whether it is one observation, and no batch."""
        return np.ndim(observation["mask"]) == 1

    def actions(self, seen: Seen, of_parts: np.ndarray) -> np.ndarray:
        """The environment's actions (worlds, n) float32 of what networks say (worlds, parts, size)."""
        if self._turns is not None:
            of_parts = self._turns.turn_actions(-seen.quarters, of_parts)
        if self.remembers:
            seen.command[...] = of_parts
        if self._code is None:
            return of_parts.reshape(len(of_parts), -1)
        side, surface = self.shape.side, self.surface
        # In elements; where the centre lies in its element says it more finely than where it lies on the table.
        place, element = seen.where[..., :2].astype(np.float64), seen.where[..., 2:].astype(np.float64)
        within = 0.5 * (element + 1.0)
        size = np.array([surface.columns, surface.rows])
        whole = np.rint(0.5 * (place + 1.0) * size - within)
        first = (whole + np.floor(within + (0.5 - 0.5 * side))).astype(np.int64)
        return self._code(self._on_table(first, whole + within, seen.mask > 0.5, of_parts))

    def _on_table(self, first: np.ndarray, centre: np.ndarray, present: np.ndarray, of_parts: np.ndarray) -> np.ndarray:
        """Phasors (worlds, rows, columns, 2) of all elements; one in several patches obeys the part that is nearest.

        Args:
            first: (worlds, parts, 2) column and row of each patch's first element.
            centre: (worlds, parts, 2) of the parts, in elements.
            present: (worlds, parts) bool.
            of_parts: (worlds, parts, side * side * 2).
        """
        worlds, parts = present.shape
        rows, columns, side = self.surface.rows, self.surface.columns, self.shape.side
        table = np.zeros((worlds, rows, columns, 2), dtype=np.float32)
        nearest = np.full((worlds, rows, columns), np.inf)
        patches = of_parts.reshape(worlds, parts, side, side, 2)
        steps = np.arange(side)
        for part in range(parts):
            x, y = first[:, part, 0, None, None] + steps, first[:, part, 1, None, None] + steps[:, None]
            away = (x + 0.5 - centre[:, part, 0, None, None]) ** 2 + (y + 0.5 - centre[:, part, 1, None, None]) ** 2
            inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows) & present[:, part, None, None]
            world, i, j = np.nonzero(np.broadcast_to(inside, (worlds, side, side)))
            at = world, np.broadcast_to(y, (worlds, side, side))[world, i, j], x.repeat(side, 1)[world, i, j]
            distance = away[world, i, j]
            nearer = distance < nearest[at]
            at = tuple(index[nearer] for index in at)
            nearest[at] = distance[nearer]
            table[at] = patches[world[nearer], part, i[nearer], j[nearer]]
        return table


def picked(layout: Sequence[Any], columns: Sequence[Sequence[Any]] | None) -> tuple[np.ndarray | None, list[Any]]:
    """Which numbers of a row a network reads, None for all, and what they mean, as it counts them.

    Raises:
        ValueError: the row has them not, or in another order.
    """
    if columns is None or list(map(list, columns)) == [[row.name, row.width] for row in layout]:
        return None, list(layout)
    if not len(columns):
        raise checks.refuse("columns", [], f"at least one of {[(row.name, row.width) for row in layout]}")
    wanted = [tuple(each) for each in columns]
    kept = [row for row in layout if (row.name, row.width) in wanted]
    if [(row.name, row.width) for row in kept] != wanted:
        missing = [each for each in wanted if each not in [(row.name, row.width) for row in kept]]
        raise checks.refuse("columns", missing or wanted, f"{[(row.name, row.width) for row in layout]}, in this order")
    starts = np.cumsum([0, *(row.width for row in kept)])
    numbers = np.concatenate([np.arange(row.start, row.start + row.width) for row in kept])
    return numbers, [row._replace(start=int(start)) for row, start in zip(kept, starts[:-1], strict=True)]


def phasor_code(table: np.ndarray) -> np.ndarray:
    """``"phasor"`` actions of phasors (worlds, rows, columns, 2)."""
    return table.reshape(len(table), -1)


def element_code(table: np.ndarray) -> np.ndarray:
    """``"element"`` actions of phasors (worlds, rows, columns, 2): amplitude and phase, as numbers in [-1, 1]."""
    coded = np.zeros(table.shape, dtype=np.float32)
    coded[..., 0] = -1.0  # most elements rest
    moves = np.nonzero((table[..., 0] != 0.0) | (table[..., 1] != 0.0))
    c, s = table[moves].T
    coded[(*moves, 0)] = 2.0 * np.minimum(np.hypot(c, s), 1.0) - 1.0
    coded[(*moves, 1)] = np.arctan2(s, c) / math.pi
    return coded.reshape(len(table), -1)


CODES = {"phasor": phasor_code, "element": element_code}
"""Actions that have numbers for every element of the table, of the phasors of all."""
