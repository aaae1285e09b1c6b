"""From what parts want to what the elements do: the part of every controller that comes after its law."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from agents.control.gains import GainLearner, turn_pushes
from agents.control.laws import LAWS
from agents.control.measured import Measured, wrap
from agents.control.plant import plant_of
from agents.task_info import TaskInfo
from vibgym import checks
from vibgym.allocation import Allocator
from vibgym.allocation.frictional import FrictionalInverse

TURN_ROOM = 0.010
"""m, distance to the nearest other part below which a part turns more slowly."""


class Memory(NamedTuple):
    """What steering hands on from step to step."""

    acceleration: np.ndarray  # (batch, parts, 3) m/s^2 and rad/s^2, that the parts were given in the last step
    law: Any  # the law's own
    gains: Any  # agents.control.gains.Gains, or () where nothing is learnt


class Steering:
    """Base of the policies that steer parts by a law, by ``"phasor"`` actions.

    Args:
        info: task, scene and step time.
        law: among :data:`agents.control.laws.LAWS`.
        learn: whether to learn what elements make of their phasors (:mod:`agents.control.gains`), where they have a hard dead
            zone and parts have goals to be held at.
        **settings: the law's own.

    Attributes:
        ahead: s, half of what a step lasts longer than a period.
        slack: m, by how much corners of parts that have arrived may be off.

    Raises:
        ValueError: a bad argument, or parts that can stick to the surface, where averages over a period do not hold.
    """

    action, observation = "phasor", "state"

    def __init__(self, info: TaskInfo, *, law: str = "local", learn: bool = True, **settings: Any) -> None:
        self.info = info
        self.law = checks.made(f"law {law!r}", LAWS.choose("law", law), (info,), settings)
        self.slack = self.law.slack
        self.process = FrictionalInverse(
            info.surface, info.parts, limit=info.hardware.limit, ahead=0.5 * info.surface.period
        )
        self.ahead = 0.5 * (info.step_time - info.surface.period)  # s
        # s, of a step's first acceleration, which fades as the velocity comes near what the push can hold.
        self.gaining = 0.5 * info.surface.period * np.exp(-2.0 * self.ahead * plant_of(info).drag)
        hard = info.hardware.dead_zone > 0.0 and info.hardware.dead_zone_form == "hard"
        self.learner = GainLearner(info) if learn and hard and info.has_goal else None
        self.allocator = Allocator(info.surface, info.parts, info.hardware)
        self.symmetry = np.array([part.symmetry for part in info.parts])

    def begin(self, batch: int) -> Memory:
        """Memory at the start of an episode."""
        gains = () if self.learner is None else self.learner.begin(batch)
        return Memory(np.zeros((batch, len(self.info.parts), 3)), self.law.initial(batch), gains)

    def expected(self, measured: Measured, memory: Memory) -> Measured:
        """Where the parts are in the middle of what a step lasts longer than a period, and how fast at its start.

        A mean velocity over a period is half a period old: a part that brakes is slower by now. What it was given is known.

        Args:
            measured: what an observation says.
            memory: of :meth:`begin`, or what :meth:`steer` made of it.
        """
        gained = self.gaining[:, None] * memory.acceleration
        measured = replace(measured, velocity=measured.velocity + gained[..., :2], spin=measured.spin + gained[..., 2])
        if self.ahead == 0.0 and self.learner is None:
            return measured
        moved, turn = self.ahead * measured.velocity, self.ahead * measured.spin
        if self.learner is not None:  # readings will tell later that elements do not do what they are told
            unseen, doubt = self.learner.learn(measured, memory.gains)
            measured = replace(measured, doubt=doubt)
            moved, turn = moved + unseen[..., :2], turn + unseen[..., 2]
        return replace(
            measured,
            centre=measured.centre + moved,
            heading=measured.heading + turn,
            way=measured.way - moved if self.info.has_goal else measured.way,
            turn=measured.turn - turn if self.info.has_heading else measured.turn,
        )

    def steer(self, measured: Measured, way: np.ndarray, memory: Memory) -> tuple[np.ndarray, Memory]:
        """The action that takes the parts the ways (batch, parts, 2) that are left, and turns them to where they shall be."""
        room = np.clip(measured.gap / TURN_ROOM, 0.0, 1.0)
        wanted, law = self.law.wanted(measured, way, room * self._turn(measured), memory.law)
        moves = ~np.isnan(wanted[..., :1])
        velocity = np.concatenate([measured.velocity, measured.spin[..., None]], axis=-1)
        push, acceleration, _ = self.process.push(velocity, np.where(moves, wanted, 0.0))
        if not moves.all():
            push = np.where(moves, push, 0.0)
            coasting, _ = self.process.acceleration(velocity, push)
            acceleration = np.where(moves, acceleration, coasting)
        pose = np.concatenate([measured.centre, measured.heading[..., None]], axis=-1)
        if self.learner is None:
            action = self.allocator.actions(pose, measured.present, push)
        else:
            gain, phase, spread = self.learner.known(memory.gains)
            pushes = self.allocator.pushes(pose, measured.present, push, gain, spread)
            turn_pushes(-phase, pushes.reshape(*phase.shape, 2))
            given = self.learner.note(pushes, memory.gains, push)
            acceleration, _ = self.process.acceleration(velocity, given)
            action = self.allocator.commands(pushes)
        memory = Memory(acceleration, self.law.applied(measured, acceleration, law), memory.gains)
        return (action[0] if measured.single else action), memory

    def _turn(self, measured: Measured) -> np.ndarray:
        """Turn that is left, (batch, parts) rad. Where headings do not count, several parts are turned straight (heading 0,
        modulo their symmetry), so that they take little of the table's width."""
        if self.info.has_heading:
            return measured.turn
        if len(self.info.parts) == 1:
            return np.zeros_like(measured.heading)
        return -wrap(measured.heading, self.symmetry)
