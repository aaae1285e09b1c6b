"""The law of local fields: what every part wants of the elements under it, so as to move at a set velocity.

Near rest a push of strength 1 accelerates a part by about ``mu a_v w^2 / 2`` and friction brakes it at the rate
``mu g / (2 a_h w)`` (first-order average, thesis eqs. 5.60 and 5.61). The law asks for the velocity from which the part can
still stop at its target, ``sqrt(2 a d)`` far away and proportional to the distance near it, and pushes towards that velocity.
Headings are controlled in the same way. On elements with a hard dead zone, :mod:`agents.control.settling` takes over near the
target.

The numbers are tuned for one period a step. A longer step holds its push for longer, so the velocity follows its set value no
faster than in one step, in ``(1 - exp(-drag T)) / drag``; and the law goes by where the parts will be in the middle of the time
that is added, and approaches more slowly by that time, lest they overshoot.
:mod:`agents.control.allocation` turns what the parts want into the elements' motion, :mod:`agents.control.dead_zone` where
elements cannot do little.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from agents.control.dead_zone import allocator_for, strongest
from agents.control.measured import Measured, wrap
from agents.control.settling import Settling, keep_on
from agents.task_info import TaskInfo
from vibgym import checks
from vibgym.envs.layout import LEAST_SPEED

TOP_SLIP = 0.71
"""Speed of a part on elements at full amplitude, over the table's: 0.30 m/s on the prototype."""

DRAG_GROWTH = 0.8
"""Near the top speed friction brakes more and pushes less than near rest: ``1 + 0.8 s^2`` fits the first-order averages' ratio
within 4 %, ``s`` being the speed over the table's."""

TURN_ROOM = 0.010
"""m, distance to the nearest other part below which a part turns more slowly."""


def top_slip(strength: float) -> float:
    """Speed of a part over the table's on elements at a share of full amplitude: where friction takes what they give."""
    if strength == 1.0:
        return TOP_SLIP
    given = strength * TOP_SLIP * (1.0 + DRAG_GROWTH * TOP_SLIP**2)
    slip = given
    for _ in range(20):  # Newton's method; the left side is convex, so it converges from above
        slip -= (slip * (1.0 + DRAG_GROWTH * slip**2) - given) / (1.0 + 3.0 * DRAG_GROWTH * slip**2)
    return slip


class Steering:
    """Base of the policies with local fields: takes every part to a set velocity, by ``"phasor"`` actions.

    Args:
        info: task, scene and step time.
        rule: who rules an element under several parts, see :data:`agents.control.allocation.RULES`.
        response: s, time in which the velocity follows its set value; longer where steps are.
        braking: share of the available acceleration that the stopping law counts on.
        approach: 1/s, rate at which the remaining error shrinks near the target; less where steps are long.

    Attributes:
        ahead: s, half of what a step lasts longer than a period.
        strength: largest push, over that of the surface's largest amplitude.
        slack: m, by how much corners of parts that have arrived may be off.

    Raises:
        ValueError: a bad argument.
    """

    action, observation = "phasor", "state"

    def __init__(
        self,
        info: TaskInfo,
        *,
        rule: str = "solve",
        response: float = 0.06,
        braking: float = 0.6,
        approach: float = 7.0,
    ) -> None:
        surface, self.info = info.surface, info
        self.allocator = allocator_for(info, rule)
        self.braking = checks.number("braking", braking, above=0.0, most=1.0)
        friction = np.array([part.friction for part in info.parts])
        self.push = 0.5 * friction * surface.full_scale  # m/s^2 of a push of strength 1
        self.strength = strongest(info)
        self.table_speed = max(surface.table_speed, LEAST_SPEED)
        self.drag = 0.5 * friction * surface.gravity / self.table_speed  # 1/s
        self.ahead = 0.5 * (info.step_time - surface.period)  # s
        self.approach = checks.number("approach", approach, above=0.0)
        self.approach /= 1.0 + self.approach * self.ahead
        held = -np.expm1(-self.drag * info.step_time) / np.maximum(self.drag, 1e-9)  # s, see above
        self.response = np.maximum(checks.number("response", response, above=0.0), held)
        self.top_speed = top_slip(self.strength) * surface.table_speed
        self.turn_push = self.push / self.allocator.gyration  # rad/s^2
        self.symmetry = np.array([part.symmetry for part in info.parts])
        self.settle, self.slack = keep_on, 0.0
        if info.hardware.dead_zone > 0.0 and info.hardware.dead_zone_form == "hard":
            settling = Settling(info, self.drag, self.push, self.turn_push, self.approach, self.ahead)
            self.settle, self.slack = settling, settling.slack

    def expected(self, observation: Any) -> Measured:
        """What an observation says, with the parts moved on by :attr:`ahead`.

        Raises:
            ValueError: an observation of another shape.
        """
        measured = Measured.of(observation, self.info)
        if self.ahead == 0.0:
            return measured
        moved, turned = self.ahead * measured.velocity, self.ahead * measured.spin
        return replace(
            measured,
            centre=measured.centre + moved,
            heading=measured.heading + turned,
            way=measured.way - moved if self.info.has_goal else measured.way,
            turn=measured.turn - turned if self.info.has_heading else measured.turn,
        )

    def stopping_speed(self, distance: np.ndarray) -> np.ndarray:
        """Set speed (..., parts) at a distance (..., parts) from the target, m/s."""
        return np.minimum(self._rate(distance, self.strength * self.push), self.top_speed)

    def steer(self, measured: Measured, velocity: np.ndarray) -> np.ndarray:
        """The action that takes the parts to set velocities (batch, parts, 2), and their headings to where they shall be."""
        pose = np.concatenate([measured.centre, measured.heading[..., None]], axis=-1)
        action = self.allocator.actions(pose, measured.present, self.wanted(measured, velocity))
        return action[0] if measured.single else action

    def wanted(self, measured: Measured, velocity: np.ndarray) -> np.ndarray:
        """Wanted accelerations (batch, parts, 3) for set velocities (batch, parts, 2), see :meth:`Allocator.pushes`."""
        slip = (measured.velocity**2).sum(axis=-1, keepdims=True) / self.table_speed**2
        drag, push = self.drag[:, None] * (1.0 + DRAG_GROWTH * slip), self.push[:, None]
        force = ((velocity - measured.velocity) / self.response[:, None] + drag * measured.velocity) / push
        force /= np.maximum(np.sqrt((force**2).sum(axis=-1, keepdims=True)) / self.strength, 1.0)
        left = self._turn(measured)
        room, most = np.clip(measured.gap / TURN_ROOM, 0.0, 1.0), self.strength
        rate = np.sign(left) * self._rate(np.abs(left), most * self.turn_push) * room
        torque = ((rate - measured.spin) / self.response + self.drag * measured.spin) / self.turn_push
        wanted = np.concatenate([force, np.clip(torque, -most, most)[..., None]], axis=-1)
        return self.settle(measured, velocity, room * left, wanted)

    def _turn(self, measured: Measured) -> np.ndarray:
        """Turn that is left, (batch, parts) rad. Where headings do not count, several parts are turned straight (heading 0,
        modulo their symmetry), so that they take little of the table's width."""
        if self.info.has_heading:
            return measured.turn
        if len(self.info.parts) == 1:
            return np.zeros_like(measured.heading)
        return -wrap(measured.heading, self.symmetry)

    def _rate(self, distance: np.ndarray, push: np.ndarray) -> np.ndarray:
        """Set speed from which a part that can be slowed down by ``push`` still stops."""
        return np.minimum(np.sqrt(2.0 * self.braking * push * distance), self.approach * distance)
