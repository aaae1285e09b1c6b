"""What steering says to the elements: the pushes that parts shall get, as one of the environment's actions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from vibgym import checks
from vibgym.allocation import Allocator
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.envs.actions import Wrench
from vibgym.policies.classical.gains import GainLearner, turn_pushes
from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo


class Output(Protocol):
    """One of :data:`OUTPUTS`, made as ``cls(info, process, learn, apron)``."""

    action: str
    """Value of the environment's ``action=``."""

    learner: GainLearner | None
    """What learns from steps that went by what elements make of their phasors."""

    def begin(self, batch: int) -> Any:
        """Memory at the start of an episode: a NamedTuple of arrays (batch, ...), or ``()``."""
        ...

    def give(self, order: Order, memory: Any) -> tuple[np.ndarray, np.ndarray, Any]:
        """The action (batch, n) float32, the push (batch, parts, 3) that parts get of it near rest, and the new memory."""
        ...


class Order(NamedTuple):
    """What parts shall get, and where they are."""

    measured: Measured  # when this step's command begins to act
    seen: np.ndarray  # (batch, parts, 3) mean velocity over the last period, as it was measured, m/s and rad/s
    velocity: np.ndarray  # (batch, parts, 3) when the command begins to act, likewise
    push: np.ndarray  # (batch, parts, 3) as FrictionalInverse says it; 0: elements rest


class PhasorOutput:
    """Phasors of all elements, which it allocates itself: with what has been learnt of them.

    Args:
        info: task, scene and step time.
        process: the frictional process, with the limit of the hardware.
        learn: whether to learn what elements make of their phasors (:mod:`.gains`), where they have a hard dead
            zone and parts have goals to be held at.
        apron: m, of :class:`vibgym.allocation.Allocator`.
    """

    action = "phasor"

    def __init__(self, info: TaskInfo, process: FrictionalInverse, learn: bool, apron: float) -> None:
        self.learner = GainLearner(info) if learn and info.hard_dead_zone and info.has_goal else None
        self.allocator = Allocator(info.surface, info.parts, info.hardware, apron=apron)
        self.half = 0.5 * info.surface.period  # s

    def begin(self, batch: int) -> Any:
        """What is known of the elements, or nothing."""
        return () if self.learner is None else self.learner.begin(batch)

    def give(self, order: Order, memory: Any) -> tuple[np.ndarray, np.ndarray, Any]:
        """See :class:`Output`."""
        present, push = order.measured.present, order.push
        # In the middle of the step, during which a part at 0.15 m/s moves by a quarter of an element.
        pose = order.measured.pose + self.half * order.velocity
        if self.learner is None:
            pushes = self.allocator.pushes(pose, present, push)
            # Of the push that the elements under a part can do together, which is less than each part's limit says.
            given = self.allocator.effect(pose, present, pushes)
        else:
            gain, phase, spread = self.learner.known(memory)
            pushes = self.allocator.pushes(pose, present, push, gain, spread)
            turn_pushes(-phase, pushes.reshape(*phase.shape, 2))
            given = self.learner.predict(pushes, memory, push)
        return self.allocator.commands(pushes), given, memory


class Accelerations(NamedTuple):
    """What :class:`WrenchOutput` hands on from step to step: (batch, parts, 3) each."""

    given: np.ndarray  # m/s^2 and rad/s^2, that the environment's action counts on in the last step
    velocity: np.ndarray  # m/s and rad/s, at which it did that


class WrenchOutput:
    """Wanted accelerations of the parts, for which the environment finds pushes and phasors.

    The environment asks what push gives a part what is wanted, at a velocity that it works out from the same measurement. Here
    that question is turned round, so that it comes by the push that is meant: rest as well, for which the acceleration is the
    one that friction alone gives. What is more than 1 in the action is cut off: a part that brakes from its top speed, where
    friction helps, can do half as much again. Its elements' gains are not learnt, since the environment allocates.

    Args:
        info, process: see :class:`PhasorOutput`.
        learn: without effect.
        apron: likewise 0, since the environment allocates.

    Raises:
        ValueError: an apron.
    """

    action = "wrench"
    learner = None

    def __init__(self, info: TaskInfo, process: FrictionalInverse, learn: bool, apron: float) -> None:
        if apron != 0.0:
            raise checks.refuse("apron", apron, "0 with action='wrench': the environment allocates")
        self.process = process
        self.scale = Wrench(info.surface, info.parts).scale
        self.allocator = Allocator(info.surface, info.parts, info.hardware)
        self.half, self.parts = 0.5 * info.surface.period, len(info.parts)
        self.ahead = 0.5 * (info.step_time - info.surface.period)  # s

    def begin(self, batch: int) -> Accelerations:
        """Nothing has been given yet."""
        return Accelerations(*np.zeros((2, batch, self.parts, 3)))

    def give(self, order: Order, memory: Accelerations) -> tuple[np.ndarray, np.ndarray, Accelerations]:
        """See :class:`Output`."""
        present = order.measured.present
        velocity = order.seen + self.half * memory.given
        wanted, _ = self.process.acceleration(velocity, order.push)
        action = np.where(present[..., None], np.clip(wanted / self.scale, -1.0, 1.0), 0.0).astype(np.float32)
        push, counted, holds = self.process.push(velocity, action * self.scale)
        served = present & holds
        push = np.where(served[..., None] & order.push.any(axis=-1, keepdims=True), push, 0.0)
        # As the environment does it, which allocates for where a part was measured.
        pose = order.measured.pose - self.ahead * order.velocity
        given = self.allocator.effect(pose, served, self.allocator.pushes(pose, served, push))
        memory = Accelerations(np.where(served[..., None], counted, 0.0), velocity)
        return action.reshape(len(present), -1), given, memory

    def counted(self, action: np.ndarray, memory: Accelerations) -> np.ndarray:
        """What the environment counts on (batch, parts, 3) if the last step's action was another one."""
        action = np.clip(action, -1.0, 1.0).reshape(memory.given.shape)
        _, counted, holds = self.process.push(memory.velocity, action * self.scale)
        return np.where(holds[..., None], counted, 0.0)


OUTPUTS: Mapping[str, Any] = {"phasor": PhasorOutput, "wrench": WrenchOutput}
"""By the environment's ``action=``."""
