"""Local fields for several parts at once: each is steered to its own target as if it were alone.

The law is that of the one-part ``local_field``: a set velocity from which the part can still stop at its target, a push towards
it that makes up for friction, and the push's lead angle. What the parts want is turned into the elements' motion by
:mod:`agents.control.sharing`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.control.crowd_seen import CrowdSeen, see_crowd, wrap
from agents.control.sharing import Sharing
from agents.policy import Situation
from vibgym import checks
from vibgym.envs.observations import LEAST_SPEED

TOP_SLIP = 0.71
"""Speed of a part on elements at full amplitude, over the table's: 0.30 m/s on the prototype."""

DRAG_GROWTH = 0.8
"""Near the top speed friction brakes more and pushes less than near rest: ``1 + 0.8 s^2`` fits the first-order averages' ratio
within 4 %, ``s`` being the speed over the table's."""


TURN_RATE = 7.0
"""1/s, rate at which parts turn straight (heading 0, modulo their symmetry), so that they take little of the table's width."""

TURN_ROOM = 0.010
"""m, distance to the nearest other part below which a part turns more slowly."""


class LocalFieldsPolicy:
    """Every part steered straight to its target by local fields, whatever is in the way, as "phasor" actions.

    The target in Sort is the point of the own zone nearest to the part, a margin inside; in Singulate it lies straight away
    from the other parts that are too near. Parts are turned straight on the way.

    Args:
        situation: task, surface and parts.
        rule: who rules an element under several parts, see :data:`agents.control.sharing.RULES`.
        response: s, time in which the velocity follows its set value.
        braking: share of the available acceleration that the stopping law counts on.
        approach: 1/s, rate at which the remaining error shrinks near the target.
        margin: m, how far inside zones and borders targets lie.

    Raises:
        ValueError: a task for one part, or a bad argument.
    """

    name = "local_fields"
    action, observation = "phasor", "state"

    def __init__(
        self,
        situation: Situation,
        rule: str = "solve",
        response: float = 0.06,
        braking: float = 0.6,
        approach: float = 7.0,
        margin: float = 0.03,
    ) -> None:
        situation.check_served(self.name, many=True)
        surface, parts = situation.surface, situation.parts
        self.situation = situation
        self.sharing = Sharing(situation, rule)
        self.response = checks.number("response", response, above=0.0)
        self.braking = checks.number("braking", braking, above=0.0, most=1.0)
        self.approach = checks.number("approach", approach, above=0.0)
        self.margin = checks.number("margin", margin, least=0.0)
        friction = np.array([part.friction for part in parts])
        self.push = 0.5 * friction * surface.full_scale  # m/s^2 of a push of strength 1
        self.drag = 0.5 * friction * surface.gravity / max(surface.table_speed, LEAST_SPEED)  # 1/s
        self.top_speed = TOP_SLIP * surface.table_speed
        self.symmetry = np.array([part.symmetry for part in parts])

    def stopping_speed(self, distance: np.ndarray) -> np.ndarray:
        """Set speed (..., parts) at a distance (..., parts) from the target."""
        fast = np.sqrt(2.0 * self.braking * self.push * distance)
        return np.minimum(np.minimum(fast, self.approach * distance), self.top_speed)

    def wanted(self, seen: CrowdSeen, velocity: np.ndarray) -> np.ndarray:
        """Wanted accelerations (worlds, parts, 3) for set velocities (worlds, parts, 2), see :meth:`Sharing.pushes`."""
        slip = (seen.velocity**2).sum(axis=-1, keepdims=True) / max(
            self.situation.surface.table_speed, LEAST_SPEED
        ) ** 2
        drag, push = self.drag[:, None] * (1.0 + DRAG_GROWTH * slip), self.push[:, None]
        force = ((velocity - seen.velocity) / self.response + drag * seen.velocity) / push
        force /= np.maximum(np.sqrt((force**2).sum(axis=-1, keepdims=True)), 1.0)
        free = np.clip(seen.gap / TURN_ROOM, 0.0, 1.0)
        rate = np.where(self.symmetry > 0, -TURN_RATE * free * wrap(seen.heading, self.symmetry), 0.0)
        turn = ((rate - seen.spin) / self.response + self.drag * seen.spin) * self.sharing.gyration / self.push
        return np.concatenate([force, np.clip(turn, -1.0, 1.0)[..., None]], axis=-1)

    def steer(self, seen: CrowdSeen, velocity: np.ndarray) -> np.ndarray:
        """The action that takes the parts to the set velocities."""
        pose = np.concatenate([seen.centre, seen.heading[..., None]], axis=-1)
        action = self.sharing.actions(pose, seen.present, self.wanted(seen, velocity))
        return action[0] if seen.single else action

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Phasors from the measured poses and mean velocities; the policy has no memory."""
        seen = see_crowd(observation, self.situation)
        way = self.targets(seen) - seen.centre
        distance = np.sqrt((way**2).sum(axis=-1))
        speed = self.stopping_speed(distance) / np.maximum(distance, 1e-12)
        return self.steer(seen, speed[..., None] * way), state

    def targets(self, seen: CrowdSeen) -> np.ndarray:
        """Where the parts are heading, (worlds, parts, 2) m."""
        situation, surface = self.situation, self.situation.surface
        if situation.zones is not None:
            zone = situation.zones[list(situation.kind)]
            inset = np.minimum(self.margin, 0.5 * (zone[:, 2:] - zone[:, :2]))
            return np.clip(seen.centre, zone[:, :2] + inset, zone[:, 2:] - inset)
        apart = seen.centre[:, :, None] - seen.centre[:, None]
        distance = np.sqrt((apart**2).sum(axis=-1))
        radius = np.array([part.radius for part in situation.parts])
        enough = radius[:, None] + radius + np.sqrt(2.0) * surface.element_size
        lack = np.maximum(enough - distance, 0.0) * seen.present[:, None] * ~np.eye(len(radius), dtype=bool)
        away = (lack / np.maximum(distance, 1e-9))[..., None] * apart
        edge = np.minimum(self.margin, 0.5 * min(surface.width, surface.height))
        return np.clip(seen.centre + away.sum(axis=2), edge, np.array([surface.width, surface.height]) - edge)
