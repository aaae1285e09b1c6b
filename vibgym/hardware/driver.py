"""Drivers: the interface between the control loop and a machine, simulated or real."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from vibgym import checks


class PoseMeasurement(NamedTuple):
    """The latest measurement of a machine: poses or an image.

    Attributes:
        pose: (parts, 3) x, y (m) and heading (rad); nan where a part was not measured. None: see ``image``.
        taken: s on the machine's clock, instant of the sample. A measurement with the ``taken`` of an earlier one is a repeat.
        image: uint8 array, for the control loop's ``locate``.
    """

    pose: np.ndarray | None
    taken: float
    image: np.ndarray | None = None


class MachineError(Exception):
    """A machine that does not work as it should; the message is made one line of printable characters."""

    def __init__(self, message: str) -> None:
        super().__init__(checks.plain_text(" ".join(message.split())))


class Driver(Protocol):
    """A machine with a segmented vibrating surface, its camera and its clock.

    The machine works in cycles. In each cycle the control loop calls :meth:`receive` once and :meth:`send` once. A machine
    without a new command holds the last one for a few cycles and then stops its elements; it must not depend on the control
    loop for that. Any exception of these methods stops the control loop, which calls :meth:`stop` first.
    """

    def send(self, amplitude: np.ndarray, phase: np.ndarray) -> None:
        """Command the motion of all elements from now on.

        Args:
            amplitude: (rows, columns) m, in [0, max_amplitude].
            phase: (rows, columns) rad, relative to the table's horizontal motion, see docs/physics.md.
        """

    def receive(self) -> PoseMeasurement:
        """Wait for the next cycle and return its measurement: the latest one, or the last one again if none is new.

        The first call after a start returns the measurement of the present cycle. If cycles have passed since the last call,
        they are skipped.

        Raises:
            MachineError: the machine does not answer within the driver's own limit, or reports an error.
        """
        ...

    def now(self) -> float:
        """Return the time of the present cycle on the machine's clock, s."""
        ...

    def stop(self) -> None:
        """Stop all elements; may be called at any time and several times."""

    def close(self) -> None:
        """Release the connection; elements stop."""
