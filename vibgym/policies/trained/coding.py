"""Conversion of observations to network inputs, and of network outputs to actions of the environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from vibgym import Part, Surface, checks
from vibgym.envs.actions import ACTIONS, actions_by_part
from vibgym.envs.local_actions import patch_size
from vibgym.envs.motions import MOTIONS
from vibgym.envs.observations import PIXELS
from vibgym.policies.foreign import element_code
from vibgym.policies.trained.networks import ImageShape, Shape
from vibgym.policies.trained.symmetry import ACTION, Symmetry, Turns, both_ways

TOUCHING = 0.02
"""Largest value of the column of the nearest part's gap at which two parts touch: 0.7 mm on the prototype."""

FRAMES = 3
"""Images of the part that ``pixels`` networks read: two give a velocity to a rounded pixel, a third refines it."""

MAX_REMEMBERED = 100
"""Largest number of steps that rows contain."""

NOTHING = np.zeros((0, 0, 0), dtype=np.float32)


class Inputs(NamedTuple):
    """Network inputs of a batch of observations; also the memory for the next step."""

    rows: np.ndarray  # (worlds, parts, columns) float32; of images uint8
    mask: np.ndarray  # (worlds, parts) float32, 1 where there is a part
    quarters: np.ndarray = NOTHING  # (worlds, parts) quarter turns of the rows; empty without 'turned'
    where: np.ndarray = NOTHING  # (worlds, parts, 4) columns position and element; empty unless actions need them
    # (worlds, parts, values) the action, then the rest of the memory, in table coordinates; empty without 'history'
    command: np.ndarray = NOTHING
    frame: np.ndarray = NOTHING  # (worlds, 2) cosine and sine of the anchor's heading; of network 'joint' only

    def of(self, worlds: Any) -> Inputs:
        """Return the inputs of some worlds, or of one as a batch of one."""
        chosen = np.atleast_1d(worlds)
        return Inputs(*(array[chosen] if len(array) else array for array in self))


class Coding:
    """Conversion for networks that read ``observation="parts"`` row by row.

    With ``"element"`` and ``"phasor"`` a part's action drives the square of elements around it, as with ``"patch"``; all other
    elements rest.

    Args:
        surface, parts: the scene.
        layout: ``env.unwrapped.parts_layout``.
        action: the environment's ``action=``.
        columns: names and widths of the columns that the network reads; None: all. A scene may have more columns than the
            training had.
        turned: turn each row by quarter turns until its displacement points right and up, and turn the actions back. The
            network is then equal in all four directions (:mod:`vibgym.policies.trained.symmetry`).
        history: number of steps of which rows contain, after the part's own columns, its action, the last step first; zeros
            before the start of an episode and before a part has arrived. True: 1. Measured velocities are means over the last
            period; the previous action determines the velocity at its end. With a delay more actions are under way.
        history_columns: names of the part's own columns that rows also contain as they were before each of these actions.

    Attributes:
        shape: of rows and actions.
        columns: names and widths of the columns that the network reads.
        slots: rows of a world.
        equivalents: transformations of rows and outputs, see :class:`.joint.JointCoding`; empty in this class.
        symmetry: of networks that do the same in equivalent scenes, which in this class are a scene and its reflection; None
            unless rows are turned and actions are motions.
        adds_velocities: whether a correction of a base policy (:mod:`.residual`) is added to the velocities of its action, and
            not to the values.

    Raises:
        ValueError: an action that is neither by part nor by element, columns that this scene does not have, a number of steps
            outside [0, 100], or ``history_columns`` without ``history``.
    """

    observation: str = "parts"
    dtype: Any = np.float32  # of rows
    shape: Any
    equivalents: Sequence[Any] = ()
    symmetry: Symmetry | None = None
    adds_velocities = False
    turned, history = False, 0
    history_columns: Sequence[str] = ()
    _code: Callable[[np.ndarray], np.ndarray] | None = None
    _turns: Turns | None = None
    _nearest: list[int] | None = None

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        layout: Sequence[Any],
        action: str,
        columns: Sequence[Sequence[Any]] | None = None,
        turned: bool = False,
        history: int = 0,
        history_columns: Sequence[str] = (),
    ) -> None:
        self.surface, self.parts, self.action, self.slots = surface, tuple(parts), action, len(parts)
        whole: int = ACTIONS.choose("action", action)(surface, self.parts).size
        side = patch_size(surface, self.parts)
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
        if len(nearest) == 2:  # counted from the end, since rows that remember have more columns before
            self._nearest = [start - self.shape.columns for start in nearest]
        self._own = self.shape.own
        self.history = steps_of(history)
        recalled = recalled_of(history_columns, [row for row in layout if row.start < self._own], self.history)
        self.history_columns = [row.name for row in recalled]
        self._recall = [k for row in recalled for k in range(row.start, row.start + row.width)]
        self.turned = turned
        if turned:
            seen = [[row.name, row.width] for row in recalled]
            self._turns = Turns(self.columns, self.parts, action, self.shape, seen)
            if action in MOTIONS:
                steps = self.history * [[ACTION, size], *seen]
                others = [name.startswith("neighbour_") for name, _ in self.columns].count(False)
                columns = [*self.columns[:others], *steps, *self.columns[others:]]
                self.symmetry = both_ways(columns, self.parts[0].symmetry)
        self._memory = self.history * (size + len(self._recall))
        self.shape = self.shape._replace(columns=self.shape.columns + self._memory)

    def encode(self, observation: Any, before: Any = None, start: np.ndarray | None = None) -> Inputs:
        """Return the inputs for an observation (as a batch of one) or a batch of observations.

        Args:
            observation: dictionary of ``parts`` and ``mask``.
            before: inputs of the last step, whose ``command`` holds the actions since; None: none. Only for 'history'.
            start: (worlds,) bool, whether an episode has begun since: previous actions are then 0.

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
        inputs, recalled = Inputs(rows, mask[:, :n], where=where), rows[..., self._recall]
        if self._turns is not None:
            quarters = self._turns.ahead(rows)
            inputs = inputs._replace(rows=self._turns.turn_rows(quarters, rows), quarters=quarters)
        return self._with_command(inputs, recalled, before, start) if self.history else inputs

    def _with_command(self, inputs: Inputs, recalled: np.ndarray, before: Any, start: np.ndarray | None) -> Inputs:
        """Return ``inputs`` with previous steps in its rows, and in ``command`` zeros for the next actions, then this memory.

        Args:
            inputs, before, start: see :meth:`encode`.
            recalled: (worlds, parts, values) columns of the present observation that later rows contain.
        """
        command = np.zeros((*inputs.mask.shape, self._memory), dtype=np.float32)
        if before is not None:
            if not isinstance(before, Inputs) or before.command.shape != command.shape:
                got = f"of shape {before.command.shape}" if isinstance(before, Inputs) else type(before).__name__
                raise checks.refuse("state", got, f"None, or what predict() returned last, of shape {command.shape}")
            # Absent parts have no previous actions: where parts come and go, a slot is empty before each arrival.
            command[...] = before.command * (before.mask[..., None] > 0.5)
            if start is not None:
                command[np.asarray(start, dtype=bool)] = 0.0
        steps = command.reshape(*inputs.mask.shape, self.history, -1)
        turned = steps if self._turns is None else self._turns.turn_steps(inputs.quarters, steps)
        own, others = inputs.rows[..., : self._own], inputs.rows[..., self._own :]
        rows = np.concatenate([own, turned.reshape(command.shape), others], axis=-1)
        latest = np.concatenate([np.zeros((*inputs.mask.shape, self.shape.action), np.float32), recalled], axis=-1)
        kept = command[..., : self._memory - latest.shape[-1]]
        return inputs._replace(rows=rows, command=np.concatenate([latest, kept], axis=-1))

    def touching(self, inputs: Inputs) -> np.ndarray:
        """Return (worlds, parts) 1.0 where a part touches another or nearly, 0.0 elsewhere or if rows have no gaps."""
        if self._nearest is None:
            return np.zeros(inputs.mask.shape, dtype=np.float32)
        there, gap = (inputs.rows[..., column] for column in self._nearest)
        return ((there > 0.5) & (gap < TOUCHING)).astype(np.float32)

    def to_rows(self, inputs: Inputs, of_parts: np.ndarray) -> np.ndarray:
        """Return actions (worlds, parts, values) of parts on the table in the coordinates of the turned rows."""
        return of_parts if self._turns is None else self._turns.turn_actions(inputs.quarters, of_parts)

    def single(self, observation: Any) -> bool:
        """Return whether it is one observation, not a batch."""
        return np.ndim(observation["mask"]) == 1

    def decode(self, inputs: Inputs, of_parts: np.ndarray) -> np.ndarray:
        """Return the environment's actions (worlds, n) float32 for network outputs (worlds, parts, values).

        With 'history' the actions are stored in ``inputs.command``.
        """
        if self._turns is not None:
            of_parts = self._turns.turn_actions(-inputs.quarters, of_parts)
        if self.history:
            inputs.command[..., : self.shape.action] = of_parts
        if self._code is None:
            return of_parts.reshape(len(of_parts), -1)
        side, surface = self.shape.side, self.surface
        # In elements. The position in the element is finer than the position on the table.
        place, element = inputs.where[..., :2].astype(np.float64), inputs.where[..., 2:].astype(np.float64)
        within = 0.5 * (element + 1.0)
        size = np.array([surface.columns, surface.rows])
        whole = np.rint(0.5 * (place + 1.0) * size - within)
        first = (whole + np.floor(within + (0.5 - 0.5 * side))).astype(np.int64)
        return self._code(self._on_table(first, whole + within, inputs.mask > 0.5, of_parts))

    def _on_table(self, first: np.ndarray, centre: np.ndarray, present: np.ndarray, of_parts: np.ndarray) -> np.ndarray:
        """Return the phasors (worlds, rows, columns, 2) of all elements; in overlapping patches the nearest part's.

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


class ImageCoding(Coding):
    """Conversion of images of one part and its goal to planes: the part in the last images, newest first, and the goal.

    The planes of the last step are the memory.

    Args:
        surface, parts: the scene.
        layout: not used; an image has no columns.
        action: the environment's ``action=``.
        columns: ``[["part", frames], ["goal", 1]]``; None: :data:`FRAMES` frames.
        memory: ``turned``, ``history`` and ``history_columns``, False and empty.

    Raises:
        ValueError: several parts, an action that is not by part, or other columns.
    """

    observation, dtype = "image", np.uint8

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        layout: Sequence[Any],
        action: str,
        columns: Sequence[Sequence[Any]] | None = None,
        **memory: Any,
    ) -> None:
        self.surface, self.parts, self.action, self.slots = surface, tuple(parts), action, 1
        refuse_memory("pixels", memory)
        if len(parts) != 1:
            raise checks.conflict(f"network 'pixels' requires one part, got {len(parts)}")
        checks.choice("action", action, actions_by_part())
        size: int = ACTIONS[action](surface, self.parts).size
        self.columns = [["part", FRAMES], ["goal", 1]] if columns is None else [list(column) for column in columns]
        if [column[0] for column in self.columns] != ["part", "goal"] or self.columns[1][1] != 1:
            raise checks.refuse("columns", columns, "[['part', frames], ['goal', 1]]")
        frames = checks.count("columns: frames", self.columns[0][1], most=16)
        height, width = surface.rows * PIXELS, surface.columns * PIXELS
        self.shape = ImageShape(frames + 1, height, width, surface.element_size / PIXELS, size)

    def encode(self, observation: Any, before: Any = None, start: np.ndarray | None = None) -> Inputs:
        """Return the planes for an image (as a batch of one) or a batch of images.

        Args:
            observation: (..., height, width, 3) uint8.
            before: inputs of the last step; None: none.
            start: (worlds,) bool, whether an episode has just begun: the part was at rest before.

        Raises:
            ValueError: no such images, or a memory of other worlds.
        """
        shape = self.shape
        size = (shape.height, shape.width)
        image = np.asarray(observation) if not isinstance(observation, dict) else np.asarray(None)
        image = image[None] if image.ndim == 3 else image
        if image.dtype != np.uint8 or image.ndim != 4 or image.shape[1:] != (*size, 3):
            got = f"{type(observation).__name__} of shape {image.shape} and type {image.dtype}"
            raise checks.refuse("observation", got, f"uint8 images (..., {shape.height}, {shape.width}, 3)")
        planes = np.empty((len(image), shape.planes, *size), dtype=np.uint8)
        planes[:, 0], planes[:, -1] = image[..., 0], image[..., 1]
        new = np.ones(len(image), dtype=bool)
        if before is not None:
            rows = before.rows if isinstance(before, Inputs) else None
            if rows is None or rows.shape != (len(image), 1, shape.columns) or rows.dtype != self.dtype:
                allowed = f"None, or what predict() returned last for {len(image)} worlds"
                raise checks.refuse("state", before if rows is None else f"rows of shape {rows.shape}", allowed)
            planes[:, 1:-1] = rows.reshape(planes.shape)[:, :-2]
            new[:] = False if start is None else start
        planes[new, 1:-1] = planes[new, :1]
        return Inputs(planes.reshape(len(image), 1, -1), np.ones((len(image), 1), dtype=np.float32))

    def single(self, observation: Any) -> bool:
        """Return whether it is one image, not a batch."""
        return np.ndim(observation) == 3


def steps_of(history: Any) -> int:
    """Return the number of steps that rows contain.

    Raises:
        ValueError: neither a bool nor a whole number in [0, :data:`MAX_REMEMBERED`].
    """
    whole = int(history) if isinstance(history, bool) else history
    return checks.count("history", whole, least=0, most=MAX_REMEMBERED)


def refuse_memory(network: str, memory: Mapping[str, Any]) -> None:
    """Raise ValueError if ``turned``, ``history`` or ``history_columns`` are set, which a network does not support."""
    steps_of(memory.get("history", 0))
    for name, value in memory.items():
        if value:
            raise checks.conflict(f"{name} is not supported by network {network!r}")


def recalled_of(history_columns: Any, layout: Sequence[Any], steps: int) -> list[Any]:
    """Return the columns that rows contain of earlier steps, in the order of a row.

    Args:
        history_columns: their names.
        layout: the part's own columns.
        steps: number of earlier steps.

    Raises:
        ValueError: not a list of names of these columns, or no earlier steps.
    """
    names = tuple(row.name for row in layout)
    if isinstance(history_columns, str) or not isinstance(history_columns, Sequence):
        raise checks.refuse("history_columns", history_columns, "a list of columns")
    for name in history_columns:
        checks.choice("history_columns", name, names)
    if history_columns and not steps:
        raise checks.conflict("history_columns requires history, the number of steps")
    return [row for row in layout if row.name in history_columns]


def picked(layout: Sequence[Any], columns: Sequence[Sequence[Any]] | None) -> tuple[np.ndarray | None, list[Any]]:
    """Return the indices of the values that a network reads from a row (None: all), and their layout.

    Raises:
        ValueError: the row does not have the columns in this order.
    """
    if columns is None or list(map(list, columns)) == [[row.name, row.width] for row in layout]:
        return None, list(layout)
    if not len(columns):
        raise checks.refuse("columns", [], f"at least one of {[(row.name, row.width) for row in layout]}")
    wanted = [tuple(column) for column in columns]
    kept = [row for row in layout if (row.name, row.width) in wanted]
    if [(row.name, row.width) for row in kept] != wanted:
        missing = [column for column in wanted if column not in [(row.name, row.width) for row in kept]]
        raise checks.refuse("columns", missing or wanted, f"{[(row.name, row.width) for row in layout]}, in this order")
    starts = np.cumsum([0, *(row.width for row in kept)])
    numbers = np.concatenate([np.arange(row.start, row.start + row.width) for row in kept])
    return numbers, [row._replace(start=int(start)) for row, start in zip(kept, starts[:-1], strict=True)]


def phasor_code(table: np.ndarray) -> np.ndarray:
    """Return ``"phasor"`` actions for phasors (worlds, rows, columns, 2)."""
    return table.reshape(len(table), -1)


CODES = {"phasor": phasor_code, "element": element_code}
"""Actions with values for every element, computed from the phasors of all elements."""
