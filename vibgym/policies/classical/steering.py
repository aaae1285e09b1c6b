"""From what parts want to what the elements do: the part of every controller that comes after its law."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.envs.features import SPIN
from vibgym.policies.classical.goal_motion import Preview, as_they_stand, from_goals
from vibgym.policies.classical.laws import LAWS
from vibgym.policies.classical.measured import Measured, wrap
from vibgym.policies.classical.outputs import OUTPUTS, Order
from vibgym.policies.task_info import TaskInfo

TURN_ROOM = 0.010
"""m, distance to the nearest other part below which a part turns more slowly."""

SPIN_LIMIT = (1.0 - 1e-6) * SPIN
"""rad/s: observations end there. Of parts that are faster, what was expected of them is all that is known of their spin."""


class Memory(NamedTuple):
    """What steering hands on from step to step."""

    acceleration: np.ndarray  # (batch, parts, 3) m/s^2 and rad/s^2, that the parts were given in the last step
    law: Any  # the law's own
    spin: np.ndarray  # (batch, parts) rad/s, that the parts are expected to have at the end of that step
    output: Any  # of what says it to the elements: vibgym.policies.classical.gains.Gains, say, or () where nothing is learnt


class Steering:
    """Base of the policies that steer parts by a law.

    Args:
        info: task, scene and step time.
        law: among :data:`vibgym.policies.classical.laws.LAWS`.
        learn: whether to learn what elements make of their phasors (:mod:`.gains`), where they have a hard dead
            zone and parts have goals to be held at, and ``action`` is ``"phasor"``.
        action: the environment's ``action=`` that is spoken, of :data:`vibgym.policies.classical.outputs.OUTPUTS`.
        apron: m around parts within which elements move as those under them, for rigid parts
            (:mod:`vibgym.allocation.cut`); only with ``action="phasor"``.
        **settings: the law's own.

    Attributes:
        ahead: s, half of what a step lasts longer than a period.
        slack: m, by how much corners of parts that have arrived may be off.

    Raises:
        ValueError: a bad argument, or parts that can stick to the surface, where averages over a period do not hold.
    """

    observation = "state"

    def __init__(
        self,
        info: TaskInfo,
        *,
        law: str = "local",
        learn: bool = True,
        action: str = "phasor",
        apron: float = 0.0,
        **settings: Any,
    ) -> None:
        self.info = info
        self.law = checks.made(f"law {law!r}", LAWS.choose("law", law), (info,), settings)
        self.slack = self.law.slack
        self.process = FrictionalInverse(
            info.surface, info.parts, limit=info.hardware.limit, ahead=0.5 * info.surface.period
        )
        self.ahead = 0.5 * (info.step_time - info.surface.period)  # s
        # s, of a step's first acceleration, which fades as the velocity comes near what the push can hold.
        self.gaining = 0.5 * info.surface.period * np.exp(-2.0 * self.ahead * info.plant.drag)
        # s, of the same, by the end of the step.
        self.gained = info.surface.period + 2.0 * self.ahead * np.exp(-self.ahead * info.plant.drag)
        self.action = checks.choice("action", action, tuple(OUTPUTS))
        self.output = OUTPUTS[action](info, self.process, learn, apron)
        self.learner = self.output.learner
        self.symmetry = np.array([part.symmetry for part in info.parts])
        self.preview, self.seen = (Preview(info), from_goals) if info.goal_moves else (as_they_stand, as_they_stand)

    def begin(self, batch: int) -> Memory:
        """Memory at the start of an episode."""
        shape = batch, len(self.info.parts)
        return Memory(np.zeros((*shape, 3)), self.law.initial(batch), np.zeros(shape), self.output.begin(batch))

    def expected(self, measured: Measured, memory: Memory) -> Measured:
        """Where the parts are in the middle of what a step lasts longer than a period, and how fast at its start.

        A mean velocity over a period is half a period old: a part that brakes is slower by now. What it was given is known.

        Args:
            measured: what an observation says.
            memory: of :meth:`begin`, or what :meth:`steer` made of it.
        """
        measured = self.preview(measured)
        gained = self.gaining[:, None] * memory.acceleration
        spin = measured.spin + gained[..., 2]
        spin = np.where(np.abs(measured.spin) < SPIN_LIMIT, spin, memory.spin)
        measured = replace(measured, velocity=measured.velocity + gained[..., :2], spin=spin)
        if self.ahead == 0.0 and self.learner is None:
            return measured
        moved, turn = self.ahead * measured.velocity, self.ahead * measured.spin
        if self.learner is not None:  # later measurements will show the gain errors of elements
            unseen, doubt = self.learner.learn(measured, memory.output)
            measured = replace(measured, doubt=doubt)
            moved, turn = moved + unseen[..., :2], turn + unseen[..., 2]
        goal = self.ahead * measured.goal_velocity
        return replace(
            measured,
            centre=measured.centre + moved,
            heading=measured.heading + turn,
            way=measured.way + goal[..., :2] - moved if self.info.has_goal else measured.way,
            turn=measured.turn + goal[..., 2] - turn if self.info.has_heading else measured.turn,
        )

    def steer(
        self, measured: Measured, way: np.ndarray, memory: Memory, free: np.ndarray | None = None
    ) -> tuple[np.ndarray, Memory]:
        """The action that takes the parts the ways (batch, parts, 2) that are left, and turns them to where they shall be.

        Args:
            free: (batch, parts) bool, parts that turn as fast as they can however near others are; None: no part.
        """
        room = np.clip(measured.gap / TURN_ROOM, 0.0, 1.0)
        if free is not None:
            room = np.where(free, 1.0, room)
        seen = self.seen(measured)
        wanted, law = self.law.wanted(seen, way, room * self._turn(measured), memory.law)
        wanted = wanted + measured.goal_acceleration
        moves = ~np.isnan(wanted[..., :1])
        velocity = measured.rate
        push, allowed, holds = self.process.push(velocity, np.where(moves, wanted, 0.0))
        moves &= holds[..., None]  # where averages do not hold, the effect of a push is unknown
        push = np.where(moves, push, 0.0)
        seen_then = velocity - self.gaining[:, None] * memory.acceleration
        action, given, output = self.output.give(Order(measured, seen_then, velocity, push), memory.output)
        acceleration, _ = self.process.acceleration(velocity, given)
        spin = measured.spin + self.gained * acceleration[..., 2]
        # Pass the acceleration within limits, without the allocation's residual, which laws would take for saturation.
        limited = np.where(moves, allowed, acceleration) - measured.goal_acceleration
        memory = Memory(acceleration, self.law.applied(seen, limited, law), spin, output)
        return (action[0] if measured.single else action), memory

    def acted(self, memory: Any, proposed: np.ndarray, done: np.ndarray) -> Any:
        """Return the memory after a step whose ``"wrench"`` action was changed: given accelerations are those applied.

        The law's own state, such as the error integral of a PID, is unchanged.

        Args:
            memory: that :meth:`predict` returned.
            proposed: (batch, n) the action that it returned.
            done: (batch, n) the one that the environment got.

        Raises:
            ValueError: the policy speaks another action.
        """
        checks.choice("action", self.action, ("wrench",))
        shape = memory.acceleration.shape
        changed = (proposed.reshape(shape) != done.reshape(shape)).any(axis=-1, keepdims=True)
        if not changed.any():
            return memory
        given = np.where(changed, self.output.counted(done, memory.output), memory.output.given)
        acceleration = np.where(changed, given, memory.acceleration)
        spin = memory.spin + self.gained * (acceleration - memory.acceleration)[..., 2]
        return memory._replace(acceleration=acceleration, spin=spin, output=memory.output._replace(given=given))

    def _turn(self, measured: Measured) -> np.ndarray:
        """Turn that is left, (batch, parts) rad. Where headings do not count, several parts are turned straight (heading 0,
        modulo their symmetry), so that they take little of the table's width."""
        if self.info.has_heading:
            return measured.turn
        if len(self.info.parts) == 1:
            return np.zeros_like(measured.heading)
        return -wrap(measured.heading, self.symmetry)
