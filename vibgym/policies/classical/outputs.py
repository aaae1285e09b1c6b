"""What comes after a law: outputs turn pushes into the environment's action, and an observer estimates disturbances.

The disturbance observer estimates the constant acceleration of each part that elements and nominal friction do not explain.
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
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from vibgym.allocation import Allocator
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.envs.motions import MOTIONS, Wrench
from vibgym.policies.classical.gains import GainLearner, turn_pushes
from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo


class PhasorOutput:
    """Output that turns pushes into phasors of all elements, with the estimated gains of the elements.

    Args:
        info: task, scene and step time.
        process: the frictional process, with the limit of the hardware.
        learn: whether to estimate gains and phases of elements, see :class:`Steering`.

    Attributes:
        learner: estimator of the elements' gains, None: not used.
    """

    def __init__(self, info: TaskInfo, process: FrictionalInverse, learn: bool) -> None:
        self.learner = GainLearner(info) if learn and info.hard_dead_zone and info.has_goal else None
        self.allocator = Allocator(info.surface, info.parts, info.hardware)
        self.half = 0.5 * info.surface.period  # s

    def begin(self, batch: int) -> Any:
        """Return the memory at the start of an episode: a NamedTuple of arrays (batch, ...), or ``()``."""
        return () if self.learner is None else self.learner.begin(batch)

    def give(
        self, measured: Measured, seen: np.ndarray, push: np.ndarray, memory: Any
    ) -> tuple[np.ndarray, np.ndarray, Any]:
        """Return the action (batch, n) float32, the pushes (batch, parts, 3) that parts get near rest, and the new memory.

        Args:
            measured: parts at the instant when this step's command begins to act.
            seen: (batch, parts, 3) measured mean velocity over the last period, m/s and rad/s.
            push: (batch, parts, 3) wanted pushes, see :class:`vibgym.allocation.frictional.FrictionalInverse`; 0: at rest.
            memory: of :meth:`begin`, or what the last call returned.
        """
        present = measured.present
        # In the middle of the step, during which a part at 0.15 m/s moves by a quarter of an element.
        pose = measured.pose + self.half * measured.rate
        if self.learner is None:
            pushes = self.allocator.pushes(pose, present, push)
            # The elements under a part together can give less than each part's limit.
            effect = self.allocator.effect(pose, present, pushes)
        else:
            gain, phase, spread = self.learner.known(memory)
            pushes = self.allocator.pushes(pose, present, push, gain, spread)
            turn_pushes(-phase, pushes.reshape(*phase.shape, 2))
            effect = self.learner.predict(pushes, memory, push)
        return self.allocator.commands(pushes), effect, memory


class Accelerations(NamedTuple):
    """Memory of :class:`MotionOutput`: (batch, parts, 3) each."""

    given: np.ndarray  # m/s^2 and rad/s^2, which the environment's action assumed in the last step
    velocity: np.ndarray  # m/s and rad/s, at which it did
    pose: np.ndarray  # m, m, rad, at which it did


class MotionOutput:
    """Output that turns pushes into motions of the parts (:mod:`vibgym.envs.motions`), for which the environment finds phasors.

    The environment inverts the frictional process at a velocity that it computes from the same measurement. This class applies
    the forward process at that velocity, so that the environment finds the intended push; at rest this is the acceleration
    that friction alone gives. Values beyond 1 are clipped: with ``"wrench"``, a part that brakes from its top speed, where
    friction helps, can do half as much again. Gains of elements are not estimated, since the environment allocates.

    Args:
        action: class of the environment's action.
        info, process: see :class:`PhasorOutput`.
        learn: no effect.
    """

    learner = None

    def __init__(self, action: type[Wrench], info: TaskInfo, process: FrictionalInverse, learn: bool) -> None:
        self.process = process
        self.mapping = action(info.surface, info.parts)
        self.mapping.step_time = info.step_time
        self.mapping.resolve_limits(info.hardware, 1)
        self.allocator = self.mapping.allocator
        self.half, self.parts = 0.5 * info.surface.period, len(info.parts)
        self.ahead = 0.5 * (info.step_time - info.surface.period)  # s

    def begin(self, batch: int) -> Accelerations:
        """See :meth:`PhasorOutput.begin`."""
        return Accelerations(*np.zeros((3, batch, self.parts, 3)))

    def give(
        self, measured: Measured, seen: np.ndarray, push: np.ndarray, memory: Accelerations
    ) -> tuple[np.ndarray, np.ndarray, Accelerations]:
        """See :meth:`PhasorOutput.give`."""
        present = measured.present
        velocity = seen + self.half * memory.given
        wanted, _ = self.process.acceleration(velocity, push)
        action = np.clip(self.mapping.values(wanted, velocity), -1.0, 1.0)
        action = np.where(present[..., None], action, 0.0).astype(np.float32)
        pose = measured.pose - self.ahead * measured.rate  # measured by the environment, which allocates there
        possible, counted, holds = self.process.push(velocity, self.mapping.acceleration(action, velocity, pose))
        served = present & holds
        possible = np.where(served[..., None] & push.any(axis=-1, keepdims=True), possible, 0.0)
        effect = self.allocator.effect(pose, served, self.allocator.pushes(pose, served, possible))
        memory = Accelerations(np.where(served[..., None], counted, 0.0), velocity, pose)
        return action.reshape(len(present), -1), effect, memory

    def counted(self, action: np.ndarray, memory: Accelerations) -> np.ndarray:
        """Return the accelerations (batch, parts, 3) that the environment assumes if the last step's action was another one."""
        action = np.clip(action, -1.0, 1.0).reshape(memory.given.shape)
        _, counted, holds = self.process.push(
            memory.velocity, self.mapping.acceleration(action, memory.velocity, memory.pose)
        )
        return np.where(holds[..., None], counted, 0.0)


OUTPUTS: Mapping[str, Any] = {
    "phasor": PhasorOutput,
    **{name: partial(MotionOutput, action) for name, action in MOTIONS.items()},
}
"""Outputs by the environment's ``action=``, made as ``cls(info, process, learn)``."""


# -- disturbances ------------------------------------------------------------------------------------------------------

# 1 - pole. `lqr` on rigid parts on patches, 100 episodes: 1.81, 1.73, 1.63 s with 0.1, 0.2, 0.4; `pose` gets worse with it.
GAIN = 0.2
MAX = 0.5  # limit of the estimate over the largest push near rest: the other half moves the part


class Disturbance(NamedTuple):
    """Memory of :class:`DisturbanceObserver`."""

    acceleration: np.ndarray  # (batch, parts, 3) m/s^2 and rad/s^2, the estimate
    start: np.ndarray  # (batch, parts, 3) m/s and rad/s, velocity at the start of the last step
    valid: np.ndarray  # (batch, parts) bool, whether there is one, at which the averaged model held


class DisturbanceObserver:
    """Observer of first order; see the module.

    Args:
        info: task and scene.
        gaining, gained: (parts,) s, T'' and T' of the module.
    """

    def __init__(self, info: TaskInfo, gaining: np.ndarray, gained: np.ndarray) -> None:
        plant = info.plant
        self.parts, self.gained = len(info.parts), gained[:, None]
        self.seen = self.gained - gaining[:, None]
        self.most = MAX * np.stack([plant.push, plant.push, plant.turn_push], axis=-1)

    def begin(self, batch: int) -> Disturbance:
        """Return the memory at the start of an episode."""
        shape = batch, self.parts
        return Disturbance(np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape, dtype=bool))

    def update(self, measured: Measured, valid: np.ndarray, acceleration: np.ndarray, memory: Disturbance) -> None:
        """Update the estimate, in place, by a measurement.

        Args:
            measured: decoded observation.
            valid: (batch, parts) bool, parts whose velocity is measured.
            acceleration: (batch, parts, 3) by pushes and friction in the last step, m/s^2 and rad/s^2.
            memory: overwritten; its ``start`` and ``valid`` are those of the last step.
        """
        now = memory.acceleration
        off = measured.rate - memory.start - self.seen * (acceleration + now)
        changed = np.clip(now + GAIN / self.gained * off, -self.most, self.most)
        now[...] = np.where((memory.valid & valid & measured.present)[..., None], changed, now)
