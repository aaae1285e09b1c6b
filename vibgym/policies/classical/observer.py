"""Disturbance observer: the constant acceleration of each part that elements and nominal friction do not explain.

Causes are a table that is not level, and rigid parts on elements of different friction. The model of an axis is

    v_{k+1} = v_k + T' (a_k + d)        d_{k+1} = d_k

where ``v_k`` is the velocity at the start of step k, ``a_k`` the mean acceleration by the elements' limited pushes and by
friction, and ``T' a`` the velocity gained in a step. The mean velocity over the last period, which is measured, lacks
``T'' (a_k + d)`` of ``v_{k+1}``. A measurement differs from its prediction by ``T' (d - d_k)``, so with the gain g the estimate
has the pole 1 - g:

    d_{k+1} = d_k + g (measured - predicted) / T'        d - d_k = (1 - g)^k (d - d_0)

Like ``a``, ``d`` is a mean over the step, friction included: a constant acceleration f of a part at rest is estimated as
``f / (1 + c T / 2)``, with the rate c of friction and the period T. Velocities are taken from the measurement (pole 0), as
without an observer. Pushes enter within the limits of the elements, so the estimate does not wind up.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo

# 1 - pole. `lqr` on rigid parts on patches, 100 episodes: 1.81, 1.73, 1.63 s with 0.1, 0.2, 0.4; `pose` gets worse with it.
GAIN = 0.2
MOST = 0.5  # limit of the estimate over the largest push near rest: the other half moves the part


class Disturbance(NamedTuple):
    """Memory of :class:`DisturbanceObserver`."""

    acceleration: np.ndarray  # (batch, parts, 3) m/s^2 and rad/s^2, the estimate
    start: np.ndarray  # (batch, parts, 3) m/s and rad/s, velocity at the start of the last step
    valid: np.ndarray  # (batch, parts) bool, whether there is one, at which the averaged model held


class NoObserver:
    """Placeholder for controllers without an observer: a disturbance of zero.

    Args:
        info: task and scene.
        gaining, gained: (parts,) s, T'' and T' of the module.
    """

    def __init__(self, info: TaskInfo, gaining: np.ndarray, gained: np.ndarray) -> None:
        self.parts, self.plant, self.gained = len(info.parts), info.plant, gained[:, None]
        self.seen = self.gained - gaining[:, None]

    def begin(self, batch: int) -> Any:
        """Return the memory at the start of an episode: a NamedTuple of arrays (batch, parts, ...), or ``()``."""
        return ()

    def update(
        self, measured: Measured, valid: np.ndarray, acceleration: np.ndarray, memory: Any
    ) -> np.ndarray | float:
        """Update the estimate, in place, by a measurement; return it, (batch, parts, 3) m/s^2 and rad/s^2.

        Args:
            measured: decoded observation.
            valid: (batch, parts) bool, parts whose velocity is measured.
            acceleration: (batch, parts, 3) by pushes and friction in the last step.
            memory: of :meth:`begin` or :meth:`started`; overwritten.
        """
        return 0.0

    def estimate(self, memory: Any) -> np.ndarray | float:
        """Return the last estimate."""
        return 0.0

    def started(self, velocity: np.ndarray, valid: np.ndarray, memory: Any) -> Any:
        """Return the memory with the velocities (batch, parts, 3) at the start of a step, and where the model holds."""
        return memory


class DisturbanceObserver(NoObserver):
    """Observer of first order; see the module."""

    def __init__(self, info: TaskInfo, gaining: np.ndarray, gained: np.ndarray) -> None:
        super().__init__(info, gaining, gained)
        self.most = MOST * np.stack([self.plant.push, self.plant.push, self.plant.turn_push], axis=-1)

    def begin(self, batch: int) -> Disturbance:
        shape = batch, self.parts
        return Disturbance(np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape, dtype=bool))

    def update(
        self, measured: Measured, valid: np.ndarray, acceleration: np.ndarray, memory: Disturbance
    ) -> np.ndarray:
        now = memory.acceleration
        off = measured.rate - memory.start - self.seen * (acceleration + now)
        changed = np.clip(now + GAIN / self.gained * off, -self.most, self.most)
        now[...] = np.where((memory.valid & valid & measured.present)[..., None], changed, now)
        return now

    def estimate(self, memory: Disturbance) -> np.ndarray:
        return memory.acceleration

    def started(self, velocity: np.ndarray, valid: np.ndarray, memory: Disturbance) -> Disturbance:
        return memory._replace(start=velocity, valid=valid)


OBSERVERS: Mapping[str, type[NoObserver]] = {"none": NoObserver, "disturbance": DisturbanceObserver}
"""Observers by name."""
