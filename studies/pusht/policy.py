"""Model-predictive policy for PushT: sampled pushes, simulated to their end in a batch of worlds, the best one executed.

A candidate leads the pusher around the T to a point beside its outline, pushes along an arc, and stops. Perturbations of the
best candidates and the rest of the present plan compete with them. Every few periods the policy plans again.

The best plan has the highest rate of decrease of the logarithm of the T's error. With a price of time instead of a rate, plans
that do nothing win, since they are short.
"""

from __future__ import annotations

import numpy as np

from studies.pusht.scene import GYRATION, SIZE, SUCCESS, PushT, centre_of
from studies.pusht.ways import CLEARANCE, is_clear, rotation, ways

SPEEDS, PUSH_SPEEDS = (14.0, 20.0, 28.0), (4.0, 16.0)
"""Motion of the target in a period on the way, and bounds of that while pushing, px."""

SPREAD, BEND = np.radians(55.0), np.radians(7.0)
"""Largest angle between push and inward normal, and of the push between periods."""

LENGTHS = 1.0, 220.0
"""Bounds of the way of a push from the outline on, px, drawn log-uniformly."""

SETTLING, HORIZON = 4, 50
"""Periods after a push until the pusher rests, and most periods of a plan."""

KEPT, SHIFT = 12, 8.0
"""Plans that are perturbed, and standard deviation of the largest perturbations, px."""

BLOCKED = 500.0
"""Price of a way that starts through the T, px."""

CLOSE = 8.0
"""Error (px) below which coverage is computed."""


class Planner:
    """Policy for one world.

    Args:
        contacts: law of contact of the model, see :class:`studies.pusht.scene.PushT`.
        fresh, perturbed: number of candidates of either kind.
        every: periods between plans.
        overhead: periods added to the duration of a plan in its rate.
    """

    def __init__(
        self,
        contacts: str = "delayed",
        *,
        fresh: int = 320,
        perturbed: int = 192,
        every: int = 5,
        overhead: float = 10.0,
    ) -> None:
        self._twin = PushT(1, contacts)
        self._fresh, self._perturbed = PushT(fresh, contacts), PushT(perturbed, contacts)
        self._every, self._overhead, self._ways = every, overhead, ways()
        self.reset()

    def reset(self) -> None:
        """Start an episode, with the pusher at rest."""
        self._random = np.random.default_rng(0)
        self._plan, self._age = np.empty((0, 2)), 0
        self._twin.set_state([0.0, 0.0], [0.0, 0.0, 0.0])

    def predict(self, observation: np.ndarray) -> np.ndarray:
        """Return the action (2,) for an observation (5,)."""
        twin = self._twin  # predicts the velocities, which are not observed
        pusher = np.concatenate([observation[:2], twin.pusher[0, 2:]])
        twin.set_state(pusher, centre_of(observation[2:]), twin.drift.copy())
        if self._age >= self._every or not len(self._plan):
            self._plan, self._age = self._search(), 0
        action, self._plan, self._age = self._plan[0], self._plan[1:], self._age + 1
        twin.rollout(action[None, None])
        return action

    def _search(self) -> np.ndarray:
        """Return the best plan found, (periods, 2)."""
        plans, lengths = self._candidates(self._fresh.worlds)
        if len(self._plan):
            plans[0], lengths[0] = self._plan[-1], len(self._plan)
            plans[0, : len(self._plan)] = self._plan
        rates, lengths = self._rates(self._fresh, plans, lengths)
        for scale in (1.0, 0.3):
            best = np.resize(np.argsort(-rates, kind="stable")[:KEPT], self._perturbed.worlds)
            plans, lengths = self._shifted(plans[best], lengths[best], scale)
            rates, lengths = self._rates(self._perturbed, plans, lengths)
        best = int(np.argmax(rates))
        return plans[best, : lengths[best]]

    def _shifted(self, plans: np.ndarray, lengths: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray]:
        """Shift all plans (n, HORIZON, 2) but the first ones, by a constant and by a ramp to their ends."""
        size = SHIFT * scale * self._random.random((2, len(plans), 1, 1)) ** 2
        shift = size * self._random.normal(size=(2, len(plans), 1, 2))
        shift[:, :KEPT] = 0.0
        ramp = np.minimum(np.arange(1, HORIZON + 1) / lengths[:, None], 1.0)[..., None]
        return np.clip(plans + shift[0] + ramp * shift[1], 0.0, SIZE), lengths

    def _rates(self, model: PushT, plans: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rates of plans (n,), 1/period, and their lengths (n,), up to success."""
        twin = self._twin
        model.set_state(twin.pusher, twin.block, twin.drift)
        block = model.rollout(plans)[..., 2:]
        error, coverage = self._error(block), np.zeros(block.shape[:2])
        close = (error < CLOSE) & (np.arange(HORIZON) < lengths[:, None])
        coverage[close] = model.coverage(block[close])
        success = coverage > SUCCESS
        solved = success.any(axis=1)
        lengths = np.where(solved, success.argmax(axis=1) + 1, lengths)
        left = np.where(solved, -1.0, np.log(1.0 + error[np.arange(len(plans)), lengths - 1]))
        return (np.log(1.0 + self._error(twin.block)) - left) / (lengths + self._overhead), lengths

    def _error(self, block: np.ndarray) -> np.ndarray:
        """Return root mean square distances (...) of the T's points from those at the goal, at poses (..., 3), px."""
        shift, turn = block[..., :2] - self._twin.goal[:2], block[..., 2] - self._twin.goal[2]
        return np.sqrt((shift**2).sum(axis=-1) + 2.0 * GYRATION * (1.0 - np.cos(turn)))

    def _candidates(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return plans (count, HORIZON, 2) and their lengths (count,)."""
        random, ways, pose = self._random, self._ways, self._twin.block[0]
        turn, start = rotation(pose[2]), self._twin.pusher[0, :2]
        here = np.broadcast_to((start - pose[:2]) @ turn.T, ways.point.shape)
        entry = np.hypot(*(ways.point - here).T) + np.where(is_clear(here, ways.point), 0.0, BLOCKED)
        first = (entry[:, None] + ways.length).argmin(axis=0)  # (points,) point at which the way to each starts
        world = ways.point @ turn + pose[:2]
        usable = np.flatnonzero(((world >= 0.0) & (world <= SIZE)).all(axis=1))
        if not len(usable):  # the T has left the world
            return np.full((count, HORIZON, 2), 0.5 * SIZE), np.full(count, HORIZON)
        plans, lengths = np.empty((count, HORIZON, 2)), np.empty(count, dtype=np.int64)
        for k in range(count):
            stop = random.choice(usable)
            way = [stop]
            while way[-1] != first[stop]:
                way.append(ways.before[first[stop], way[-1]])
            approach = resampled(np.array([start, *world[way[::-1]]]), random.choice(SPEEDS))
            length = CLEARANCE + np.exp(random.uniform(*np.log(LENGTHS)))
            steps = int(np.ceil(length / random.uniform(*PUSH_SPEEDS)))
            inward = ways.inward[stop] @ turn
            angle = np.arctan2(inward[1], inward[0]) + random.uniform(-SPREAD, SPREAD)
            angles = angle + random.uniform(-BEND, BEND) * np.arange(steps)
            push = world[stop] + np.cumsum(length / steps * np.column_stack([np.cos(angles), np.sin(angles)]), axis=0)
            plan = np.clip(np.concatenate([approach, push]), 0.0, SIZE)[: HORIZON - SETTLING]
            lengths[k] = len(plan) + SETTLING
            plans[k, : len(plan)], plans[k, len(plan) :] = plan, plan[-1]
        return plans, lengths


def resampled(corners: np.ndarray, step: float) -> np.ndarray:
    """Return points (n, 2) on a path through corners, at every ``step`` px and at its end."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    places = np.arange(1, int(np.ceil(along[-1] / step)) + 1) * step
    return np.column_stack([np.interp(places, along, corners[:, axis]) for axis in range(2)])
