"""What a control law is: from where parts are, and where they shall be, to the accelerations that they want.

    observation -> measured -> targets -> law -> wanted accelerations -> inverse of the frictional process, within what the
    elements can do -> pushes -> allocation -> phasors of the elements

A law sees parts as free bodies, the reduced plant of the thesis (figs. 5.14 to 5.18): what friction and elements make of a push
is not its business. All the rest of the chain is :mod:`.steering`, the same for all laws. Where goals move a law
sees the parts from their goals, which stand still there, and what it wants comes on top of the goals' own acceleration
(:mod:`vibgym.policies.classical.goal_motion`).
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from vibgym.policies.classical.measured import Measured


class Law(Protocol):
    """A control law, made as ``SomeLaw(info, **settings)``; batched, for one part and several."""

    lead: float
    """s: a place ``lead * v`` ahead of a part asks for the velocity ``v``. For planners, which set velocities."""

    slack: float
    """m, by how much corners of parts that have arrived may be off."""

    def initial(self, batch: int) -> Any:
        """Memory at the start of an episode: a NamedTuple of arrays (batch, ...), or ``()``."""
        ...

    def wanted(self, measured: Measured, way: np.ndarray, turn: np.ndarray, memory: Any) -> tuple[np.ndarray, Any]:
        """Mean accelerations that the parts want (batch, parts, 3), m/s^2 and rad/s^2, and the new memory.

        A part whose row is not a number wants nothing: elements under it rest.

        Args:
            measured: where the parts are when this step's command begins to act.
            way: (batch, parts, 2) m, what is left to the target.
            turn: (batch, parts) rad, likewise.
            memory: of :meth:`initial`, or what the last call made of it.
        """
        ...

    def applied(self, measured: Measured, acceleration: np.ndarray, memory: Any) -> Any:
        """The memory, after it is known what accelerations (batch, parts, 3) the elements can give the parts.

        Like those that are wanted, they count from the goals' own where these move.
        """
        ...
