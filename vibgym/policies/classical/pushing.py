"""Pushing: two driven parts, the pushers, go to places at the outline of a third part and push it to its goal.

Friction brakes the pushed part at a rate ``c``, so its velocity and spin are proportional to the forces (quasi-static pushing,
Mason, IJRR 1986). A push at a point of its outline moves it along the normal there and turns it by the lever. Of all pairs of
points the one is chosen whose pushes, of optimal strengths, come nearest to the remaining displacement and turn, less the cost
of the pushers' paths to these points. On the way there pushers go round the part along its outline.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from pydantic import Field

from vibgym import Part
from vibgym.kernels.jit import exact
from vibgym.policies.classical.measured import Measured, wrap
from vibgym.policies.classical.steering import LawChoice, Steering, SteeringMemory
from vibgym.policies.task_info import TaskInfo
from vibgym.settings import Length, Speed

SPACING = 0.004  # m between candidate points of the outline
ANGLES = 72  # directions about the part in which the distance of the path round it is tabulated
BARRED = 10.0  # m, added to the length of a path that a border or the other pusher obstructs
SECTOR, AHEAD = (
    0.30,
    0.35,
)  # rad: direction from the part below which a pusher goes straight; next point on the way round
ROOM = 0.004  # m between pushers
NEARBY, NEAREST = 0.05, 0.01  # m, units of the ways to planned places, before tanh
ROOMY = 0.12  # m, distance from borders that are not seen
FURTHEST, CLOSEST = 1.0, 0.002  # m, distances whose logarithms are +1 and -1


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
        start, end = part.rim, np.roll(part.rim, -1, axis=0)
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

    Raises:
        ValueError: a task without one part that is pushed and two that push, or a bad setting of the law.
    """

    class Settings(Steering.Settings):
        """How parts are pushed, and the law's settings."""

        law: LawChoice = "pose"

        speed: Speed = Field(default=0.14, gt=0.0)
        """Top speed of the pushed part, its spin times the radius of gyration included."""

        gain: float = Field(default=0.8, gt=0.0)
        """Rate at which its remaining displacement shrinks, over the rate at which friction brakes it."""

        travel: float = Field(default=0.65, gt=0.0)
        """Cost of a metre of the longer path of both pushers, over the best direction's value, 1/m."""

        shorter: float = Field(default=0.2, gt=0.0)
        """Share of this cost for a metre of the shorter path."""

        early: float = Field(default=0.6, gt=0.0)
        """Share of their difference that is deducted if the first to arrive can push alone, see ``useful``."""

        ready: Length = Field(default=0.009, gt=0.0)
        """Distance of a pusher from its place, within which it pushes."""

        useful: float = Field(default=0.8, gt=0.0)
        """Cosine of the angle to the wanted motion, above which one pushes before the other is ready."""

        press: Length = Field(default=0.004, gt=0.0)
        """Into the part, target of a pusher."""

        clear: Length = Field(default=0.006, gt=0.0)
        """Distance to the part on the way round it."""

        along: float = Field(default=0.12, gt=0.0)
        """Time constant of pushers on their way to a place nearby, s."""

        still: float = Field(default=0.5, gt=0.0)
        """Share of the tolerances within which no pusher pushes."""

    PLAN = (
        ("plan_velocity", 2), ("plan_room", 2),
        ("plan_way", 2), ("plan_way_fine", 2), ("plan_normal", 2), ("plan_push", 4),
        ("plan_left", 2), ("plan_turn", 1), ("plan_distance", 1),
    )  # fmt: skip
    """Names and widths of what a correction sees of the plan (:class:`vibgym.policies.trained.residual.Base`).

    Of all parts velocities at the start of the step, over the top speed, and a vector away from borders that are nearer than
    0.12 m. Of each pusher tanh of the way to its place in 50 and in 10 mm, the part's inward normal there, tanh of the strength
    of its push and of the turn by it, turns by which it still goes round the part, and 1 if it is there. Of the pushed part the
    unit vector of what is left, displacement and turn times the radius of gyration, and the logarithm of its length.
    """

    settings: Settings

    def __init__(self, info: TaskInfo, settings: Settings | None = None) -> None:
        super().__init__(info, settings)
        driven, scored = np.array(info.driven), np.array(info.scored)
        if not info.has_goal or info.goal_moves or (scored & ~driven).sum() != 1 or (driven & ~scored).sum() != 2:
            required = "a task with a goal for one part that elements do not drive, and two driven parts without goals"
            raise info.unsupported("push", required)
        self.driven = driven
        self.pushed, self.pushers = int(np.flatnonzero(~driven)[0]), np.flatnonzero(driven)
        part = info.parts[self.pushed]
        self.reach = max(info.parts[k].radius for k in self.pushers)
        self.outline = Outline(part, self.reach)
        self.drag = float(info.plant.drag[self.pushed])
        effect, place = self.outline.effect, self.outline.place
        self._gram = effect @ effect.T
        self._fits = np.sqrt(((place[:, None] - place) ** 2).sum(axis=-1)) > 2.0 * self.reach + 0.5 * ROOM

    def initial(self, batch: int) -> SteeringMemory:
        """See :meth:`.steering.Steering.initial`; its own memory is the plan, (batch, parts, columns), see :attr:`PLAN`."""
        width = sum(width for _, width in self.PLAN)
        return super().initial(batch)._replace(own=np.zeros((batch, len(self.info.parts), width), dtype=np.float32))

    def act(self, measured: Measured, memory: SteeringMemory, new: np.ndarray) -> tuple[np.ndarray, SteeringMemory]:
        """See :meth:`.steering.Steering.act`."""
        velocity = np.zeros_like(measured.centre)
        velocity[:, self.pushers], plan, left = self.velocities(measured)
        size = np.array([self.info.surface.width, self.info.surface.depth])
        near = [np.clip(1.0 - distance / ROOMY, 0.0, 1.0) for distance in (measured.centre, size - measured.centre)]
        own = memory.own
        own[..., :2], own[..., 2:4] = np.clip(measured.velocity / self.top, -1.0, 1.0), near[0] - near[1]
        own[:, self.pushers, 4:14], own[:, self.pushed, 14:] = plan, left
        acting = replace(measured, present=measured.present & self.driven)
        return self.steer(acting, self.lead * velocity, memory)

    def velocities(self, measured: Measured) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the set velocities (batch, 2, 2) of the pushers, m/s, their plans (batch, 2, 10), and that of the pushed part
        (batch, 4), see :attr:`PLAN`."""
        manner, outline, gyration = self.settings, self.outline, self.outline.gyration
        centre, heading = measured.centre[:, self.pushed], measured.heading[:, self.pushed]
        displacement, heading_error = measured.displacement[:, self.pushed], measured.heading_error[:, self.pushed]
        to_world = rotation(heading)
        left = np.concatenate(
            [np.einsum("bji,bj->bi", to_world, displacement), (gyration * heading_error)[:, None]], axis=-1
        )
        length = np.sqrt((left**2).sum(axis=-1))
        # Places of the pushers in the part's frame.
        at = np.einsum("bji,bkj->bki", to_world, measured.centre[:, self.pushers] - centre[:, None])
        direction = left / np.maximum(length, 1e-9)[:, None]
        chosen, push, sweep = self.choose(direction, at, centre, to_world)
        place = outline.place[chosen]  # (batch, 2, 2)
        done = (np.hypot(displacement[:, 0], displacement[:, 1]) < manner.still * self.info.position_tolerance) & (
            np.abs(heading_error) < manner.still * self.info.heading_tolerance
        )
        off = place - at
        ready = np.hypot(off[..., 0], off[..., 1]) < manner.ready
        effect = outline.effect[chosen]
        inward = effect[..., :2]
        all_ready = (ready | (push <= 0.0)).all(axis=1)
        # Who is ready does not wait for the other one if this push alone is nearly in the right direction.
        now = np.einsum("bk,bkj->bj", np.where(ready, push, 0.0), effect)
        useful = (now * left).sum(axis=-1) > manner.useful * np.sqrt((now**2).sum(axis=-1)) * length
        goes = (all_ready | useful) & ~done
        # Velocity and spin of the part by these pushes, no faster than it can stop.
        twist = np.where(all_ready[:, None], np.einsum("bk,bkj->bj", push, effect), now)
        speed = np.minimum(manner.gain * self.drag * length, manner.speed)
        twist *= (speed / np.maximum(np.sqrt((twist**2).sum(axis=-1)), 1e-9))[:, None]
        spin = twist[:, 2] / gyration
        carried = twist[:, None, :2] + spin[:, None, None] * np.stack([-place[..., 1], place[..., 0]], axis=-1)
        pressing = np.where(push > 0.0, manner.press, -manner.clear)[..., None] * inward
        pushing = carried + (off + pressing) / manner.along
        waiting = (off - 0.5 * manner.clear * inward) / manner.along
        own = np.where((ready & goes[:, None])[..., None], pushing, waiting)
        angle = np.abs(wrap(np.arctan2(at[..., 1], at[..., 0]) - np.arctan2(place[..., 1], place[..., 0])))
        near = (angle < SECTOR) | (np.hypot(off[..., 0], off[..., 1]) < 2.0 * manner.ready)
        own = np.where(near[..., None], own, self.go_round(at, sweep))
        own = np.where(done[:, None, None], -(manner.clear * inward) / manner.along * ready[..., None], own)
        own = self.apart(at, own)
        fast = np.sqrt((own**2).sum(axis=-1, keepdims=True))
        own *= np.minimum(1.0, self.top / np.maximum(fast, 1e-9))
        way, normal = (np.einsum("bij,bkj->bki", to_world, vector) for vector in (off, inward))
        pushes = np.stack([np.tanh(push), np.tanh(effect[..., 2]), sweep / (2.0 * math.pi), ready], axis=-1)
        plan = np.concatenate([np.tanh(way / NEARBY), np.tanh(way / NEAREST), normal, pushes], axis=-1)
        far = np.log(np.clip(length, CLOSEST, FURTHEST) ** 2 / (CLOSEST * FURTHEST)) / math.log(FURTHEST / CLOSEST)
        rest = np.column_stack([np.einsum("bij,bj->bi", to_world, direction[:, :2]), direction[:, 2], far])
        return np.einsum("bij,bkj->bki", to_world, own), plan, rest

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
        effect, place = self.outline.effect, self.outline.place
        along = direction @ effect.T  # (batch, n)
        here = np.arctan2(at[..., 1], at[..., 0])
        short = wrap(self.outline.direction - here[..., None])
        sweeps = np.stack([short, short - np.copysign(2.0 * math.pi, short)], axis=2)
        cost = self.travel(at, here, sweeps, centre, to_world)
        ahead = np.mod(here[:, 1] - here[:, 0], 2.0 * math.pi)
        inside = self.on_table(place, centre, to_world)
        chosen, sweep = np.zeros((len(at), 2), dtype=np.int64), np.zeros((len(at), 2))
        push = np.zeros((len(at), 2))
        alone = np.maximum(along, 0.0) / np.sqrt(np.diag(self._gram))
        manner = self.settings
        prices = manner.travel, manner.shorter, manner.early, manner.useful
        choose_pairs(along, alone, self._gram, self._fits, inside, cost, sweeps, ahead, *prices, chosen, push, sweep)
        return chosen, push, sweep

    def travel(
        self, at: np.ndarray, here: np.ndarray, sweeps: np.ndarray, centre: np.ndarray, to_world: np.ndarray
    ) -> np.ndarray:
        """Return the lengths of each pusher's paths to all places, (batch, 2, 2, n) m, more where a border obstructs them.

        Args:
            at, centre, to_world: see :meth:`choose`.
            here: (batch, 2) rad, directions of the pushers from the part.
            sweeps: (batch, 2, 2, n) rad, by which each pusher goes round on the shorter and on the longer path.
        """
        outline, sweep = self.outline, np.abs(sweeps)
        away, radius = np.hypot(at[..., 0], at[..., 1])[..., None, None], float(outline.round.mean())
        there = np.hypot(outline.place[:, 0], outline.place[:, 1])
        # Straight to the place if the part is not between; else along a tangent and round the part.
        seen = np.arccos(np.minimum(radius / np.maximum(away, 1e-9), 1.0))
        straight = np.sqrt(np.maximum(away**2 + there**2 - 2.0 * away * there * np.cos(sweep), 0.0))
        bent = np.sqrt(np.maximum(away**2 - radius**2, 0.0)) + radius * (sweep - seen)
        cost = np.where(sweep < seen, straight, bent + np.abs(there - np.minimum(away, radius)))
        return cost + BARRED * self.barred(here, sweeps, centre, to_world)

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
        inside = np.ones((len(centre), len(place)), dtype=bool)
        for axis, size in enumerate((self.info.surface.width, self.info.surface.depth)):
            x, y = to_world[:, axis, 0, None], to_world[:, axis, 1, None]
            there = centre[:, axis, None] + (x * place[:, 0] + y * place[:, 1])
            inside &= (there > self.reach) & (there < size - self.reach)
        return inside

    def go_round(self, at: np.ndarray, sweep: np.ndarray) -> np.ndarray:
        """Return velocities (batch, 2, 2), m/s, along the outline from places (batch, 2, 2) by angles (batch, 2)."""
        here, away = np.arctan2(at[..., 1], at[..., 0]), np.hypot(at[..., 0], at[..., 1])
        # From far away to where the way touches the circle about the part and a disc.
        circle = float(self.outline.round.max()) + self.settings.clear
        most = np.maximum(np.arccos(np.minimum(circle / np.maximum(away, 1e-9), 1.0)), AHEAD)
        ahead = here + np.clip(sweep, -most, most)
        radius = np.maximum(self.round_at(here), self.round_at(ahead)) + self.settings.clear
        target = radius[..., None] * np.stack([np.cos(ahead), np.sin(ahead)], axis=-1)
        # Outwards, where a pusher is too near to go round.
        displacement = target - at
        lack = np.maximum(self.round_at(here) + 0.5 * self.settings.clear - away, 0.0)
        outward = at / np.maximum(away, 1e-9)[..., None]
        along = (
            self.top * displacement / np.maximum(np.hypot(displacement[..., 0], displacement[..., 1]), 1e-9)[..., None]
        )
        return along + (lack / self.settings.along)[..., None] * 4.0 * outward

    def round_at(self, angle: np.ndarray) -> np.ndarray:
        """Return the distance from the part's centre, m, at which a disc touches it in directions (rad) of its frame."""
        return self.outline.round[np.round(angle * (ANGLES / (2.0 * math.pi))).astype(np.int64) % ANGLES]

    def apart(self, at: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return the velocities (batch, 2, 2), m/s, without components that would bring the pushers together."""
        between = at[:, 1] - at[:, 0]
        distance = np.hypot(between[:, 0], between[:, 1])
        along = between / np.maximum(distance, 1e-9)[:, None]
        room = np.maximum(distance - 2.0 * self.reach - ROOM, 0.0) / (2.0 * self.settings.along)
        result = velocity.copy()
        for k, sign in ((0, 1.0), (1, -1.0)):
            towards = sign * (velocity[:, k] * along).sum(axis=-1)
            result[:, k] -= (sign * np.maximum(towards - room, 0.0))[:, None] * along
        return result


def rotation(heading: np.ndarray) -> np.ndarray:
    """Return matrices (batch, 2, 2) that rotate vectors of a part's frame into the world's; ``heading`` (batch,) rad."""
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.stack([np.stack([cosine, -sine], axis=-1), np.stack([sine, cosine], axis=-1)], axis=-2)


@exact
def choose_pairs(
    along, alone, gram, fits, inside, cost, sweeps, ahead, price, shorter, early, useful, chosen, push, sweep
):
    """Choose the best pair of points for each world, see :meth:`PushingPolicy.choose`.

    The value of a pair is the length of the projection of the wanted motion onto the cone of both pushes, or onto the better
    of the two, less the price of the paths.

    Args:
        along: (worlds, n) component of the wanted motion along the effect of each point.
        alone: (worlds, n) value of a push at one point: 0, or ``along`` over the length of the effect.
        gram: (n, n) scalar products of the effects.  fits: (n, n) bool, whether two pushers have room at both points.
        inside: (worlds, n) bool, whether a pusher is on the table there.
        cost, sweeps: (worlds, 2, 2, n) m and rad, length and angle of both paths of each pusher.
        ahead: (worlds,) rad in [0, 2 pi), by which the second pusher is ahead of the first.
        price: 1/m, cost of a metre of the longer path.  shorter: share of it for a metre of the shorter one.
        early: share of their difference that is deducted if the first to arrive alone is worth more than ``useful``.
        chosen, push, sweep: (worlds, 2) points, strengths and angles, overwritten.
    """
    for w in range(along.shape[0]):
        best, first_path, second_path = -math.inf, 0, 0
        for i in range(along.shape[1]):
            if not inside[w, i]:
                continue
            for j in range(along.shape[1]):
                if not (inside[w, j] and fits[i, j]):
                    continue
                one, other, shared = along[w, i], along[w, j], gram[i, j]
                determinant = gram[i, i] * gram[j, j] - shared * shared
                first, second = gram[j, j] * one - shared * other, gram[i, i] * other - shared * one
                if determinant > 1e-9 and first > 0.0 and second > 0.0:
                    first, second = first / determinant, second / determinant
                    worth = math.sqrt(max(first * one + second * other, 0.0))
                else:
                    worth = max(alone[w, i], alone[w, j])
                    first, second = (1.0, 0.0) if one >= other else (0.0, 1.0)
                if worth <= best:  # paths only cost
                    continue
                shortest, a_best, b_best = math.inf, 0, 0
                for a in range(2):
                    for b in range(2):
                        then = ahead[w] + sweeps[w, 1, b, j] - sweeps[w, 0, a, i]
                        one_path, other_path = cost[w, 0, a, i], cost[w, 1, b, j]
                        length = max(one_path, other_path) + shorter * min(one_path, other_path)
                        if alone[w, i if one_path < other_path else j] > useful:
                            length -= early * abs(one_path - other_path)
                        if then <= 0.0 or then >= 2.0 * math.pi:  # one would pass the other
                            length += BARRED
                        if length < shortest:
                            shortest, a_best, b_best = length, a, b
                if worth - price * shortest > best:
                    best = worth - price * shortest
                    chosen[w, 0], chosen[w, 1] = i, j
                    push[w, 0], push[w, 1] = first, second
                    first_path, second_path = a_best, b_best
        i, j = chosen[w, 0], chosen[w, 1]
        sweep[w, 0], sweep[w, 1] = sweeps[w, 0, first_path, i], sweeps[w, 1, second_path, j]
