"""Commands on their way: their check, stored ones, which take effect after a latency, and the inverse of a known response."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym import checks
from vibgym.physics.core.drive import CARTESIAN, ELEMENT, PHASOR, POLAR, Drive
from vibgym.scene.surface import Surface


def check_command(name: str, command: Any, surface: Surface, worlds: int) -> Drive:
    """Return the command of the action ``name``.

    Raises:
        ValueError: not a drive, or arrays of wrong shape or type.
    """
    what, elements = f"command of action {name!r}", (surface.rows, surface.columns)
    if not isinstance(command, Drive):
        raise checks.refuse(
            what, command, "a Drive, as made by phasor_drive(values, columns, full_scale) of vibgym.physics.core.drive"
        )
    motion = (worlds, *elements) if command.mode in (POLAR, CARTESIAN) else (0, 0, 0)
    numbers = {POLAR: (0, 0), CARTESIAN: (0, 0)}.get(command.mode, (worlds, command.values.shape[-1]))
    if command.mode in (ELEMENT, PHASOR):
        numbers = (worlds, 2 * elements[0] * elements[1])  # amplitude and phase, or a phasor, of every element
    for field, shape, kind in (
        ("values", numbers, np.float32), ("amplitude", motion, np.float64), ("phase", motion, np.float64),
    ):  # fmt: skip
        array = getattr(command, field)
        if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != kind:
            got = f"shape {array.shape} and type {array.dtype}" if isinstance(array, np.ndarray) else array
            meaning = " (worlds, rows * columns * 2)" if field == "values" else " (worlds, rows, columns)"
            raise checks.refuse(f"{what}, {field},", got, f"of shape {shape}{meaning} and type {np.dtype(kind)}")
    return command


class Commands:
    """Ring buffer of commands, one row per world and step.

    Args:
        template: a command of the form to store.
        worlds: number of worlds.
        room: stored steps, including the present one.
    """

    def __init__(self, template: Drive, worlds: int, room: int) -> None:
        self.worlds, self.room = worlds, room
        self._mode = template.mode
        arrays = template._asdict()
        self._rows = {
            name: np.zeros((room * worlds, *values.shape[1:]), dtype=values.dtype)
            for name, values in arrays.items()
            if isinstance(values, np.ndarray) and values.size
        }
        self._count = np.zeros(1, dtype=np.int64)  # steps in total
        self._age = np.zeros(worlds, dtype=np.int64)  # commands of each world's episode
        self._world = np.arange(worlds)

    def clear(self, worlds: Any) -> None:
        """Delete the commands of ``worlds``."""
        self._age[worlds] = 0

    def write(self, command: Drive, hardware: int) -> Drive:
        """Store the command of a step.

        Args:
            hardware: address of pinned hardware.

        Returns:
            A drive with all stored rows, executed by the hardware.
        """
        if command.mode != self._mode:
            raise checks.conflict("action: all commands of an environment must have the same form")
        slot = int(self._count[0] % self.room)
        for name, rows in self._rows.items():
            rows[slot * self.worlds : (slot + 1) * self.worlds] = getattr(command, name)
        self._count += 1
        self._age += 1
        return command._replace(**self._rows, hardware=hardware)

    def rows(self, steps: Any, source: np.ndarray) -> None:
        """Write the rows of the commands ``steps`` (a number or (worlds,)) steps ago to ``source``; -1: none."""
        slot = (self._count[0] - 1 - steps) % self.room
        source[...] = np.where(self._age > steps, slot * self.worlds + self._world, -1)

    def state(self) -> dict[str, np.ndarray]:
        """Return live arrays for a snapshot."""
        return {
            **{f"command_{name}": rows for name, rows in self._rows.items()},
            "count": self._count,
            "age": self._age,
        }


WEAKEST = 0.1
"""Gain below which an element counts as dead where commands are compensated: it rests."""


def inverse_of(response: Any, shape: tuple[int, int]) -> np.ndarray:
    """Return the factors of commands, (rows, columns), that compensate a response: complex, a number or one per element.

    Raises:
        ValueError: no element can be compensated.
    """
    response = np.broadcast_to(response, shape)
    works = np.abs(response) >= WEAKEST
    if not works.any():
        raise checks.conflict(f"actuators.compensate requires elements with a gain of at least {WEAKEST:g}")
    return np.where(works, 1.0 / np.where(works, response, 1.0), 0.0)
