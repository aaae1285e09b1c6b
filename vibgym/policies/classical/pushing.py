"""Pushing: two driven parts, the pushers, go to places at the outline of a third part and push it to its goal.

Friction brakes the pushed part at a rate ``c``, so its velocity and spin are proportional to the forces (quasi-static pushing,
Mason, IJRR 1986). A push at a point of its outline moves it along the normal there and turns it by the lever. Of all pairs of
points the one is chosen whose pushes, of optimal strengths, come nearest to the remaining displacement and turn, less the cost
of the pushers' paths to these points. On the way there pushers go round the part along its outline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibgym import Part
from vibgym.policies.classical.law import lead_of
from vibgym.policies.classical.measured import Measured, wrap
from vibgym.policies.classical.steering import Memory, Settings, Steering
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.sliding import drag_of

SPACING = 0.004  # m between candidate points of the outline
ANGLES = 72  # directions about the part in which the distance of the path round it is tabulated
BARRED = 10.0  # m, added to the length of a path that a border or the other pusher obstructs
SECTOR, AHEAD = (
    0.30,
    0.35,
)  # rad, direction from the part below which a pusher goes straight; its next point on the way round
ROOM = 0.004  # m between pushers


@dataclass(frozen=True)
class Manner(Settings):
    """How parts are pushed."""

    speed: float = 0.14  # m/s, top speed of the pushed part, its spin times the radius of gyration included
    gain: float = 0.8  # rate at which its remaining displacement shrinks, over the rate at which friction brakes it
    travel: float = 1.2  # 1/m, cost of a metre of the pushers' paths, over the value of the best direction
    ready: float = 0.006  # m, distance of a pusher from its place, within which it pushes
    press: float = 0.004  # m into the part, target of a pusher
    clear: float = 0.006  # m, distance to the part on the way round it
    along: float = 0.12  # s, time constant of pushers on their way to a place nearby
    still: float = 0.5  # share of the tolerances within which no pusher pushes


class Outline:
    """Effects of a disc that pushes a part at points of its outline, in the part's frame.

    Args:
        part: the pushed part.
        reach: m, radius of the disc.

    Attributes:
        place: (n, 2) m, centres of the disc at the points.
        direction: (n,) rad, of the places.
        effect: (n, 3) velocity of the part as a unit vector, and spin times the radius of gyration.
        gyration: m, radius of gyration.
        round: (ANGLES,) m, distance from the part's centre at which a disc touches it, by direction.
    """

    def __init__(self, part: Part, reach: float) -> None:
        start, end = part.outline, np.roll(part.outline, -1, axis=0)
        points, normals = [], []
        for a, b in zip(start, end, strict=True):
            length = math.hypot(*(b - a))
            count = max(int(length / SPACING), 1)
            share = (np.arange(count) + 0.5) / count
            points.append(a + share[:, None] * (b - a))
            normals.append(np.tile([(b - a)[1] / length, -(b - a)[0] / length], (count, 1)))
        point, normal = np.concatenate(points), np.concatenate(normals)
        place = point + reach * normal
        free = np.sqrt(((place[:, None] - point) ** 2).sum(axis=-1)).min(axis=1) > reach - 0.25 * SPACING
        self.place, inward, point = place[free], -normal[free], point[free]
        self.direction = np.arctan2(self.place[:, 1], self.place[:, 0])
        lever = point[:, 0] * inward[:, 1] - point[:, 1] * inward[:, 0]
        self.gyration = math.sqrt(part.gyration)
        self.effect = np.column_stack([inward, lever / self.gyration])
        angle = 2.0 * math.pi * np.arange(ANGLES) / ANGLES
        ahead = np.column_stack([np.cos(angle), np.sin(angle)])
        along, across = point @ ahead.T, point @ np.column_stack([-ahead[:, 1], ahead[:, 0]]).T
        near = np.abs(across) < reach
        self.round = np.where(near, along + np.sqrt(np.maximum(reach**2 - across**2, 0.0)), 0.0).max(axis=0)


class PushingPolicy(Steering):
    """Policy that pushes one part to its goal with two others.

    Args:
        info: task, scene and step time.
        **settings: of :class:`Manner` and :class:`.steering.Steering`, whose ``law`` is ``"pose"`` here, and its law's own.

    Raises:
        ValueError: a task without one part that is pushed and two that push, or a bad argument.
    """

    def __init__(self, info: TaskInfo, **settings: Any) -> None:
        self.manner = Manner.taken(settings)
        super().__init__(info, **{"law": "pose", **settings})
        driven, asked = np.array(info.driven), np.array(info.asked)
        if not info.has_goal or info.goal_moves or (asked & ~driven).sum() != 1 or (driven & ~asked).sum() != 2:
            required = "a task with a goal for one part that elements do not drive, and two driven parts without goals"
            raise info.unsupported("push", required)
        self.driven = driven
        self.pushed, self.pushers = int(np.flatnonzero(~driven)[0]), np.flatnonzero(driven)
        part = info.parts[self.pushed]
        self.reach = max(info.parts[k].radius for k in self.pushers)
        self.outline = Outline(part, self.reach)
        self.drag = float(drag_of(info.surface, [part])[0])
        self.top = info.plant.top_speed
        self.lead = lead_of(self.law, info, 0.5 * self.top)
        effect, place = self.outline.effect, self.outline.place
        self._gram = effect @ effect.T
        self._fits = np.sqrt(((place[:, None] - place) ** 2).sum(axis=-1)) > 2.0 * self.reach + 0.5 * ROOM

    def act(self, measured: Measured, memory: Memory, new: np.ndarray) -> tuple[np.ndarray, Memory]:
        """See :meth:`.steering.Steering.act`."""
        velocity = np.zeros_like(measured.centre)
        velocity[:, self.pushers] = self.velocities(measured)
        acting = replace(measured, present=measured.present & self.driven)
        return self.steer(acting, self.lead * velocity, memory)

    def velocities(self, measured: Measured) -> np.ndarray:
        """Return the set velocities (batch, 2, 2) of the pushers, m/s."""
        manner, outline, gyration = self.manner, self.outline, self.outline.gyration
        centre, heading = measured.centre[:, self.pushed], measured.heading[:, self.pushed]
        way, turn = measured.way[:, self.pushed], measured.turn[:, self.pushed]
        to_world = rotation(heading)
        left = np.concatenate([np.einsum("bji,bj->bi", to_world, way), (gyration * turn)[:, None]], axis=-1)
        length = np.sqrt((left**2).sum(axis=-1))
        # Places of the pushers in the part's frame.
        at = np.einsum("bji,bkj->bki", to_world, measured.centre[:, self.pushers] - centre[:, None])
        chosen, push, sweep = self.choose(left / np.maximum(length, 1e-9)[:, None], at, centre, to_world)
        place = outline.place[chosen]  # (batch, 2, 2)
        done = (np.hypot(way[:, 0], way[:, 1]) < manner.still * self.info.position_tolerance) & (
            np.abs(turn) < manner.still * self.info.heading_tolerance
        )
        off = place - at
        ready = np.hypot(off[..., 0], off[..., 1]) < manner.ready
        all_ready = (ready | (push <= 0.0)).all(axis=1) & ~done
        inward = outline.effect[chosen][..., :2]
        # Velocity and spin of the part by both pushes, no faster than it can stop.
        twist = np.einsum("bk,bkj->bj", push, outline.effect[chosen])
        speed = np.minimum(manner.gain * self.drag * length, manner.speed)
        twist *= (speed / np.maximum(np.sqrt((twist**2).sum(axis=-1)), 1e-9))[:, None]
        spin = twist[:, 2] / gyration
        carried = twist[:, None, :2] + spin[:, None, None] * np.stack([-place[..., 1], place[..., 0]], axis=-1)
        pressing = np.where(push > 0.0, manner.press, -manner.clear)[..., None] * inward
        pushing = carried + (off + pressing) / manner.along
        waiting = (off - 0.5 * manner.clear * inward) / manner.along
        own = np.where((ready & all_ready[:, None])[..., None], pushing, waiting)
        angle = np.abs(wrap(np.arctan2(at[..., 1], at[..., 0]) - np.arctan2(place[..., 1], place[..., 0])))
        near = (angle < SECTOR) | (np.hypot(off[..., 0], off[..., 1]) < 2.0 * manner.ready)
        own = np.where(near[..., None], own, self.go_round(at, sweep))
        own = np.where(done[:, None, None], -(manner.clear * inward) / manner.along * ready[..., None], own)
        own = self.apart(at, own)
        fast = np.sqrt((own**2).sum(axis=-1, keepdims=True))
        own *= np.minimum(1.0, self.top / np.maximum(fast, 1e-9))
        return np.einsum("bij,bkj->bki", to_world, own)

    def choose(
        self, direction: np.ndarray, at: np.ndarray, centre: np.ndarray, to_world: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Choose the points of the outline at which the pushers push.

        Args:
            direction: (batch, 3) unit vector of remaining displacement and turn, in the part's frame.
            at: (batch, 2, 2) m, places of the pushers in the part's frame.
            centre: (batch, 2) m, of the part.
            to_world: (batch, 2, 2), see :func:`rotation`.

        Returns:
            (batch, 2) indices of points, strengths of the pushes, and angles (rad) by which the pushers go round the part.
        """
        effect, place, gram = self.outline.effect, self.outline.place, self._gram
        along = direction @ effect.T  # (batch, n)
        one, other = along[:, :, None], along[:, None, :]
        own = np.diag(gram)
        determinant = own[:, None] * own - gram**2
        safe = np.where(determinant > 1e-9, determinant, 1.0)
        first = (own[None, None, :] * one - gram * other) / safe
        second = (own[None, :, None] * other - gram * one) / safe
        both = (first > 0.0) & (second > 0.0) & (determinant > 1e-9)
        alone = np.maximum(along, 0.0) / np.sqrt(own)
        worth = np.where(both, np.sqrt(np.maximum(first * one + second * other, 0.0)), 0.0)
        single = np.maximum(alone[:, :, None], alone[:, None, :])
        worth = np.maximum(worth, np.where(both, 0.0, single))
        inside = self.on_table(place, centre, to_world)
        price, sweeps, pair = self.travel(at, centre, to_world)
        fits = self._fits & inside[:, :, None] & inside[:, None, :]
        worth = np.where(fits, worth - self.manner.travel * price, -np.inf)
        best = worth.reshape(len(worth), -1).argmax(axis=1)
        i, j = best // len(place), best % len(place)
        rows = np.arange(len(worth))
        strong = np.stack([first[rows, i, j], second[rows, i, j]], axis=-1)
        lone = np.stack([along[rows, i] >= along[rows, j], along[rows, j] > along[rows, i]], axis=-1).astype(float)
        first_way, second_way = np.divmod(pair[rows, i, j], 2)
        sweep = np.stack([sweeps[rows, 0, first_way, i], sweeps[rows, 1, second_way, j]], axis=-1)
        return np.stack([i, j], axis=-1), np.where(both[rows, i, j][:, None], strong, lone), sweep

    def travel(self, at: np.ndarray, centre: np.ndarray, to_world: np.ndarray) -> tuple[np.ndarray, ...]:
        """Compute the lengths of the pushers' paths to all pairs of places, not past one another and not over the border.

        Args:
            at, centre, to_world: see :meth:`choose`.

        Returns:
            (batch, n, n) m, of both together; (batch, 2, 2, n) rad, by which each pusher goes round on the shorter and on the
            longer path; (batch, n, n) index of the best pair of paths: twice the first pusher's plus the second one's.
        """
        outline = self.outline
        here = np.arctan2(at[..., 1], at[..., 0])
        short = wrap(outline.direction - here[..., None])
        sweeps = np.stack([short, short - np.copysign(2.0 * math.pi, short)], axis=2)
        off = np.hypot(at[..., 0], at[..., 1])[..., None, None] - np.hypot(outline.place[:, 0], outline.place[:, 1])
        cost = np.abs(off) + np.abs(sweeps) * float(outline.round.mean())
        cost = cost + BARRED * self.barred(here, sweeps, centre, to_world)
        ahead = np.mod(here[:, 1] - here[:, 0], 2.0 * math.pi)[:, None, None, None, None]
        # (batch, path of the first, path of the second, n, n)
        then = ahead + sweeps[:, 1][:, None, :, None, :] - sweeps[:, 0][:, :, None, :, None]
        passing = (then <= 0.0) | (then >= 2.0 * math.pi)
        both = cost[:, 0][:, :, None, :, None] + cost[:, 1][:, None, :, None, :] + BARRED * passing
        both = both.reshape(len(at), 4, *both.shape[3:])
        return both.min(axis=1), sweeps, both.argmin(axis=1)

    def barred(self, here: np.ndarray, sweeps: np.ndarray, centre: np.ndarray, to_world: np.ndarray) -> np.ndarray:
        """Return whether the border obstructs paths round the part, (batch, 2, 2, n) bool.

        Args:
            here: (batch, 2) rad, directions from which they start.
            sweeps: (batch, 2, 2, n) rad.
            centre, to_world: see :meth:`choose`.
        """
        angle = 2.0 * math.pi * np.arange(ANGLES) / ANGLES
        ring = self.outline.round[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        count = np.cumsum(np.tile(~self.on_table(ring, centre, to_world), 3), axis=1)
        begin = ANGLES + np.round(here * (ANGLES / (2.0 * math.pi))).astype(np.int64) % ANGLES
        begin = np.broadcast_to(begin[..., None, None], sweeps.shape)
        end = begin + np.trunc(sweeps * (ANGLES / (2.0 * math.pi))).astype(np.int64)
        rows = np.arange(len(count))[:, None, None, None]
        return count[rows, begin] != count[rows, end]

    def on_table(self, place: np.ndarray, centre: np.ndarray, to_world: np.ndarray) -> np.ndarray:
        """Return whether a pusher at places (n, 2) of the part's frame is on the table, (batch, n) bool."""
        there = centre[:, None] + np.einsum("bij,nj->bni", to_world, place)
        size = np.array([self.info.surface.width, self.info.surface.depth])
        return ((there > self.reach) & (there < size - self.reach)).all(axis=-1)

    def go_round(self, at: np.ndarray, sweep: np.ndarray) -> np.ndarray:
        """Return velocities (batch, 2, 2), m/s, along the outline from places (batch, 2, 2) by angles (batch, 2)."""
        here = np.arctan2(at[..., 1], at[..., 0])
        ahead = here + np.clip(sweep, -AHEAD, AHEAD)
        radius = np.maximum(self.round_at(here), self.round_at(ahead)) + self.manner.clear
        target = radius[..., None] * np.stack([np.cos(ahead), np.sin(ahead)], axis=-1)
        # Outwards, where a pusher is too near to go round.
        away, way = np.hypot(at[..., 0], at[..., 1]), target - at
        lack = np.maximum(self.round_at(here) + 0.5 * self.manner.clear - away, 0.0)
        outward = at / np.maximum(away, 1e-9)[..., None]
        along = self.top * way / np.maximum(np.hypot(way[..., 0], way[..., 1]), 1e-9)[..., None]
        return along + (lack / self.manner.along)[..., None] * 4.0 * outward

    def round_at(self, angle: np.ndarray) -> np.ndarray:
        """Return the distance from the part's centre, m, at which a disc touches it in directions (rad) of its frame."""
        return self.outline.round[np.round(angle * (ANGLES / (2.0 * math.pi))).astype(np.int64) % ANGLES]

    def apart(self, at: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return the velocities (batch, 2, 2), m/s, without components that would bring the pushers together."""
        between = at[:, 1] - at[:, 0]
        distance = np.hypot(between[:, 0], between[:, 1])
        along = between / np.maximum(distance, 1e-9)[:, None]
        room = np.maximum(distance - 2.0 * self.reach - ROOM, 0.0) / (2.0 * self.manner.along)
        result = velocity.copy()
        for k, sign in ((0, 1.0), (1, -1.0)):
            towards = sign * (velocity[:, k] * along).sum(axis=-1)
            result[:, k] -= (sign * np.maximum(towards - room, 0.0))[:, None] * along
        return result


def rotation(heading: np.ndarray) -> np.ndarray:
    """Return matrices (batch, 2, 2) that rotate vectors of a part's frame into the world's; ``heading`` (batch,) rad."""
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.stack([np.stack([cosine, -sine], axis=-1), np.stack([sine, cosine], axis=-1)], axis=-2)
