"""What a control law is: from where parts are, and where they shall be, to the accelerations that they want.

    observation -> measured -> targets -> law -> wanted accelerations -> inverse of the frictional process, within what the
    elements can do -> pushes -> allocation -> phasors of the elements

A law sees parts as free bodies, the reduced plant of the thesis (figs. 5.14 to 5.18): what friction and elements make of a push
is not its business. All the rest of the chain is :mod:`.steering`, the same for all laws. Where goals move a law
sees the parts from their goals, which stand still there, and what it wants comes on top of the goals' own acceleration
(:mod:`vibgym.policies.classical.goal_motion`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo

LONGEST_LEAD = 10.0
"""s, most that :func:`lead_of` looks for."""


class Law(ABC):
    """A control law, made as ``SomeLaw(info, **settings)``; batched, for one part and several.

    One without memory is :meth:`wanted` alone.
    """

    lead: float | None = None
    """s: a place ``lead * v`` ahead of a part asks for the velocity ``v``. For planners, which set velocities; None: they find
    it out (:func:`lead_of`)."""

    slack: float = 0.0
    """m, by how much corners of parts that have arrived may be off."""

    def initial(self, batch: int) -> Any:
        """Memory at the start of an episode: a NamedTuple of arrays (batch, ...), or ``()``."""
        return ()

    @abstractmethod
    def wanted(self, measured: Measured, way: np.ndarray, turn: np.ndarray, memory: Any) -> tuple[np.ndarray, Any]:
        """Mean accelerations that the parts want (batch, parts, 3), m/s^2 and rad/s^2, and the new memory.

        A part whose row is not a number wants nothing: elements under it rest.

        Args:
            measured: where the parts are when this step's command begins to act.
            way: (batch, parts, 2) m, what is left to the target.
            turn: (batch, parts) rad, likewise.
            memory: of :meth:`initial`, or what the last call made of it.
        """

    def applied(self, measured: Measured, acceleration: np.ndarray, memory: Any) -> Any:
        """The memory, after it is known what accelerations (batch, parts, 3) the elements can give the parts.

        Like those that are wanted, they count from the goals' own where these move.
        """
        return memory


def lead_of(law: Law, info: TaskInfo, speed: float) -> float:
    """The ``lead`` of a law, s; where it says none, that of what it wants of parts at ``speed`` (m/s), by bisection.

    Raises:
        ValueError: it says none, and there is no place ahead at which it neither drives nor brakes such parts.
    """
    if law.lead is not None:
        return law.lead
    still, alone = np.zeros((1, len(info.parts), 2)), np.zeros((1, len(info.parts)))
    along = still + [1.0, 0.0]
    seen = Measured(
        present=alone == 0.0, centre=still, heading=alone, way=still, turn=alone, velocity=speed * along, spin=alone,
        gap=alone + np.inf, single=False,
    )  # fmt: skip

    def wanted(lead: float) -> np.ndarray:
        return law.wanted(seen, lead * speed * along, alone, law.initial(1))[0][..., 0]

    near, far = 0.0, LONGEST_LEAD
    if not ((wanted(near) < 0.0).all() and (wanted(far) > 0.0).all()):
        name = type(law).__name__
        allowed = f"s, a number: from {name}.wanted() of parts at {speed:.3g} m/s it cannot be determined"
        raise checks.refuse(f"{name}.lead", law.lead, allowed)
    for _ in range(40):
        middle = 0.5 * (near + far)
        near, far = (near, middle) if (wanted(middle) > 0.0).all() else (middle, far)
    return far
