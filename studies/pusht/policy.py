"""Model-predictive policy for PushT: sampled pushes, simulated to their end in a batch of worlds, the best one executed.

A candidate leads the pusher around the T to a point beside its outline, pushes along an arc, and stops. Perturbations of the best
candidates and of the present plan are simulated as well. Every few periods the policy plans again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from studies.pusht.scene import BAR, CENTRE, GYRATION, RADIUS, SIZE, STEM, SUCCESS, PushT, centre_of

CLEARANCE = 12.0
"""Distance of pusher and T on the way to a push, px."""

SPACING = 9.0
"""Distance of neighbouring points around the T, px."""

SPEEDS, PUSH_SPEEDS = (14.0, 20.0, 28.0), (4.0, 16.0)
"""Motion of the target in a period on the way, and bounds of that while pushing, px."""

SPREAD, BEND = np.radians(55.0), np.radians(7.0)
"""Largest angle between push and inward normal, and of the push between periods."""

LENGTHS = 1.0, 220.0
"""Bounds of the way of a push from the outline on, px, drawn log-uniformly."""

SETTLING = 4
"""Periods after a push until the pusher rests."""

HORIZON = 50
"""Most periods of a plan."""


class Ways(NamedTuple):
    """Points around the T, in its frame, and shortest ways between them."""

    point: np.ndarray  # (n, 2) px
    inward: np.ndarray  # (n, 2) unit vectors to the outline
    length: np.ndarray  # (n, n) px
    following: np.ndarray  # (n, n) index of the next point on the way


def distance(point: np.ndarray) -> np.ndarray:
    """Return the distances (...) of points (..., 2) in the frame of the T's centre of mass from its outline, px."""
    found = []
    for size, middle in ((BAR, 0.5 * BAR[1]), (STEM, BAR[1] + 0.5 * STEM[1])):
        beyond = np.abs(point - (0.0, middle - CENTRE[1])) - 0.5 * size
        found.append(np.hypot(*np.moveaxis(np.maximum(beyond, 0.0), -1, 0)) + np.minimum(beyond.max(axis=-1), 0.0))
    return np.minimum(*found)


def clear(start: np.ndarray, stop: np.ndarray, most: float) -> np.ndarray:
    """Return whether segments stay at least ``most`` px away from the T, or as far as they start."""
    shares = np.linspace(0.0, 1.0, 24)[:, None]
    found = distance(start[..., None, :] + shares * (stop - start)[..., None, :])
    return (found >= np.minimum(most, found[..., :1] - 0.5)).all(axis=-1)


def ways() -> Ways:
    """Return the points at ``CLEARANCE`` from the pusher's contact with the T, and the ways between them (Floyd, Warshall)."""
    away = RADIUS + CLEARANCE
    angles = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    low, high = np.zeros(len(rays)), np.full(len(rays), 200.0)
    inner = np.array([0.0, BAR[1] - CENTRE[1]])  # from where every ray leaves the enlarged T once
    for _ in range(40):
        middle = 0.5 * (low + high)
        outside = distance(inner + middle[:, None] * rays) > away
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    dense = inner + high[:, None] * rays
    steps = np.hypot(*(np.roll(dense, -1, axis=0) - dense).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    count = int(along[-1] / SPACING)
    point = dense[np.searchsorted(along[:-1], np.arange(count) * along[-1] / count)]
    slope = [(distance(point + d) - distance(point - d)) / 2e-3 for d in ((1e-3, 0.0), (0.0, 1e-3))]
    inward = -np.column_stack(slope)
    inward /= np.hypot(*inward.T)[:, None]
    one, other = point[:, None] + np.zeros_like(point), point[None] + np.zeros_like(point)[:, None]
    length = np.where(clear(one, other, away - 2.0), np.hypot(*np.moveaxis(other - one, -1, 0)), np.inf)
    following = np.tile(np.arange(count), (count, 1))
    for k in range(count):
        through = length[:, k, None] + length[None, k]
        following = np.where(through < length - 1e-9, following[:, k, None], following)
        length = np.minimum(length, through)
    return Ways(point, inward, length, following)


class Planner:
    """Policy for one world; its model is :class:`studies.pusht.scene.PushT`.

    Args:
        contacts: law of contact of the model.
        fresh, refined: candidates of a plan, and perturbed ones.
        every: periods between plans.
        overhead: periods added to the duration of a plan in its rate.
        seed: of the candidates.
    """

    def __init__(
        self,
        contacts: str = "delayed",
        fresh: int = 320,
        refined: int = 192,
        every: int = 5,
        overhead: float = 10.0,
        seed: int = 0,
    ) -> None:
        self._model, self._twin = PushT(fresh, contacts), PushT(1, contacts)
        self._finer = PushT(refined, contacts)
        self._every, self._overhead, self._seed, self._ways = every, overhead, seed, ways()
        self.reset()

    def reset(self) -> None:
        """Start an episode, with the pusher at rest."""
        self._random = np.random.default_rng(self._seed)
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
        fresh, lengths = self._candidates(self._model.worlds)
        if len(self._plan):
            kept = self._plan[:HORIZON]
            fresh[0], lengths[0] = kept[-1], len(kept)
            fresh[0, : len(kept)] = kept
        costs, lengths = self._costs(self._model, fresh, lengths)
        for scale in (1.0, 0.3):
            best = np.argsort(costs, kind="stable")[:12]
            chosen = np.resize(best, self._finer.worlds)
            finer, periods = fresh[chosen].copy(), lengths[chosen]
            share = np.minimum(np.arange(1, HORIZON + 1)[None, :, None] / np.maximum(periods, 1)[:, None, None], 1.0)
            shift = (
                self._random.normal(size=(2, len(chosen), 1, 2))
                * scale
                * 8.0
                * self._random.random((2, len(chosen), 1, 1)) ** 2
            )
            shift[:, : len(best)] = 0.0
            finer = np.clip(finer + shift[0] + share * shift[1], 0.0, SIZE)
            costs, lengths = self._costs(self._finer, finer, periods)
            fresh = finer
        best = int(np.argmin(costs))
        return fresh[best, : lengths[best]]

    def _costs(self, model: PushT, actions: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return costs of plans, and their lengths up to success."""
        twin, rows = self._twin, np.arange(len(actions))
        model.set_state(twin.pusher, twin.block, twin.drift)
        block = model.rollout(actions)[..., 2:]
        away = self._away(block)
        found = np.zeros(away.shape)
        close = (away < 8.0) & (np.arange(HORIZON) < lengths[:, None])
        found[close] = model.coverage(np.ascontiguousarray(block[close]))
        done = found > SUCCESS
        solved, first = done.any(axis=1), done.argmax(axis=1)
        lengths, left = np.where(solved, first + 1, lengths), np.log(1.0 + away[rows, lengths - 1])
        now = np.log(1.0 + self._away(twin.block))
        return (np.where(solved, -1.0, left) - now) / (lengths + self._overhead), lengths

    def _away(self, block: np.ndarray) -> np.ndarray:
        """Return root mean square distances (...) of the T's mass from the goal at poses (..., 3), px."""
        shift, turn = block[..., :2] - self._twin.goal[:2], block[..., 2] - self._twin.goal[2]
        return np.sqrt((shift**2).sum(axis=-1) + 2.0 * GYRATION * (1.0 - np.cos(turn)))

    def _candidates(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return plans (count, HORIZON, 2) and their lengths (count,)."""
        random, ways, pose = self._random, self._ways, self._twin.block[0]
        turn = np.array(
            [[np.cos(pose[2]), np.sin(pose[2])], [-np.sin(pose[2]), np.cos(pose[2])]]
        )  # row vectors to the world
        here = (self._twin.pusher[0, :2] - pose[:2]) @ turn.T
        entry = np.hypot(*(ways.point - here).T)
        entry = np.where(
            clear(here + np.zeros_like(ways.point), ways.point, RADIUS + CLEARANCE - 2.0), entry, entry + 500.0
        )
        through = entry[:, None] + ways.length
        world = ways.point @ turn + pose[:2]
        usable = np.flatnonzero(((world >= 0.0) & (world <= SIZE)).all(axis=1))
        plans, lengths = np.empty((count, HORIZON, 2)), np.empty(count, dtype=np.int64)
        for k in range(count):
            stop = int(random.choice(usable)) if len(usable) else int(random.integers(len(world)))
            at, corners = int(through[:, stop].argmin()), [self._twin.pusher[0, :2]]
            while True:
                corners.append(world[at])
                if at == stop:
                    break
                at = int(ways.following[at, stop])
            path = np.array(corners)
            along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
            places = np.arange(1, int(np.ceil(along[-1] / (speed := random.choice(SPEEDS)))) + 1) * speed
            way = np.column_stack([np.interp(places, along, path[:, axis]) for axis in range(2)])
            inward = ways.inward[stop] @ turn
            pace = random.uniform(*PUSH_SPEEDS)
            length = CLEARANCE + np.exp(random.uniform(*np.log(LENGTHS)))
            pushes = max(int(np.ceil(length / pace)), 1)
            angle = (
                np.arctan2(inward[1], inward[0])
                + random.uniform(-SPREAD, SPREAD)
                + random.uniform(-BEND, BEND) * np.arange(pushes)
            )
            push = world[stop] + np.cumsum(length / pushes * np.column_stack([np.cos(angle), np.sin(angle)]), axis=0)
            plan = np.clip(np.concatenate([way, push]), 0.0, SIZE)[: HORIZON - SETTLING]
            lengths[k] = len(plan) + SETTLING
            plans[k, : len(plan)], plans[k, len(plan) :] = plan, plan[-1]
        return plans, lengths
