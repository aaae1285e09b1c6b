"""The thesis's state space controller as a law for parts: by measured positions only, through an observer of its own."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vibgym.policies.classical.law import Law
from vibgym.policies.classical.measured import Measured, wrap
from vibgym.policies.classical.observer import Estimate, Observer
from vibgym.policies.classical.state_space import StateFeedback
from vibgym.policies.task_info import TaskInfo


class StateSpaceMemory(NamedTuple):
    """What the law remembers of an episode."""

    estimate: Estimate  # (batch, parts, 3) each: x, y, heading (not wrapped)
    known: np.ndarray  # (batch, parts) bool, whether there has been a measurement


class StateSpaceLaw(Law):
    """State feedback for x, y and heading of every part, see :mod:`vibgym.policies.classical.state_space`.

    Args:
        info: task, scene and step time.
        poles, state_weights, control_weight: of :class:`vibgym.policies.classical.state_space.StateFeedback`.
        observer_gains, observer_poles: of :class:`vibgym.policies.classical.observer.Observer`.

    Raises:
        ValueError: a bad argument.
    """

    def __init__(
        self,
        info: TaskInfo,
        *,
        poles: Any = None,
        state_weights: Any = None,
        control_weight: float = 1.0,
        observer_gains: Any = None,
        observer_poles: Any = None,
    ) -> None:
        self.feedback = StateFeedback(poles=poles, state_weights=state_weights, control_weight=control_weight)
        self.observer = Observer(info.step_time, gains=observer_gains, poles=observer_poles)
        self.lead = float(self.feedback.gains[1] / self.feedback.gains[0])
        self.symmetry = np.array([part.symmetry for part in info.parts])

    def initial(self, batch: int) -> StateSpaceMemory:
        """Before the first measurement."""
        shape = (batch, len(self.symmetry))
        return StateSpaceMemory(Estimate(*np.zeros((2, *shape, 3))), np.zeros(shape, dtype=bool))

    def wanted(
        self, measured: Measured, way: np.ndarray, turn: np.ndarray, memory: StateSpaceMemory
    ) -> tuple[np.ndarray, StateSpaceMemory]:
        """See :meth:`vibgym.policies.classical.law.Law.wanted`."""
        position = self._position(measured, memory)
        known = memory.known[..., None]
        estimate = Estimate(
            np.where(known, memory.estimate.position, position), np.where(known, memory.estimate.velocity, 0.0)
        )
        target = position + np.concatenate([way, turn[..., None]], axis=-1)
        return self.feedback.output(target, estimate), StateSpaceMemory(estimate, np.ones_like(memory.known))

    def applied(self, measured: Measured, acceleration: np.ndarray, memory: StateSpaceMemory) -> StateSpaceMemory:
        """See :meth:`vibgym.policies.classical.law.Law.applied`."""
        position = self._position(measured, memory)
        return memory._replace(estimate=self.observer.update(memory.estimate, position, acceleration))

    def _position(self, measured: Measured, memory: StateSpaceMemory) -> np.ndarray:
        """What is measured, (batch, parts, 3), headings in the turn that is nearest to the estimate."""
        guess = np.where(memory.known, memory.estimate.position[..., 2], measured.heading)
        heading = guess + wrap(measured.heading - guess, self.symmetry)
        return np.concatenate([measured.centre, heading[..., None]], axis=-1)
