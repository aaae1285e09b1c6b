"""Lanes along the table: through gates (:class:`FeedingPolicy`), and both ways past one another (:class:`CrossingPolicy`).

Through gates: parts have velocities instead of targets. Parts farther along have right of way. Those behind press on them near
the inlet, and then keep a distance that grows on the way to the gate. Across the table parts change to the lane of their kind
where there is room.

Both ways: parts that meet others keep to the right, turn straight, and choose velocities in order of right of way
(:func:`choose_velocities`). A part on the wrong side changes to its own as soon as there is room; oncoming parts wait or move
to the border. Where no parts meet and one has waited off its goal, :mod:`.two_phases` brings the parts to their goals.

A velocity is as good as it is near the wanted one, and as long as the time to collision with the border or with another part
that keeps the velocity that it has chosen, or had (velocity obstacles, see van den Berg, Lin & Manocha, ICRA 2008; by sampling,
with an order instead of reciprocity). Two parts cannot meet before the rectangles about them do, nor before the gap along the
direction that separates their outlines is used up: the later of both counts.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.physics.contacts.hulls import hull_gap, place_hulls
from vibgym.policies.classical.measured import Measured, wrap
from vibgym.policies.classical.planner import TargetPlan
from vibgym.policies.classical.steering import LawChoice, Steering, SteeringMemory
from vibgym.policies.classical.two_phases import TwoPhasesPolicy
from vibgym.policies.task_info import TaskInfo
from vibgym.settings import Length
from vibgym.simulation import threads as workers


def extents(half: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Return half of the extents (batch, parts, 2) m at ``heading`` (batch, parts) rad; ``half`` (parts, 2) is that at 0."""
    cosine, sine = np.abs(np.cos(heading)), np.abs(np.sin(heading))
    return np.stack([half[:, 0] * cosine + half[:, 1] * sine, half[:, 0] * sine + half[:, 1] * cosine], axis=-1)


# -- through gates -----------------------------------------------------------------------------------------------------

PRESS, BESIDE = 0.030, 0.006
"""m: by which parts press on those ahead near the inlet, so that it empties at full speed; distance to parts beside."""
SPREAD = 0.22, 0.75
"""Shares of the way from inlet to gate between which the distance to the parts ahead grows."""
ALONG, ACROSS = 0.12, 0.20  # s, time constants: distances along the table; displacements to the middle of lanes


class FeedingPolicy(Steering):
    """Lanes along the table in which parts keep apart: to the gates of a task whose parts come and go.

    Raises:
        ValueError: a task whose parts stay, or a bad setting of the law.
    """

    class Settings(Steering.Settings):
        """Settings of the policy and its law."""

        law: LawChoice = "pose"

        spare: Length = Field(default=0.001, ge=0.0)
        """Distance in addition to the one that the gate requires."""

        slip: float = Field(default=0.3, gt=0.0, le=1.0)
        """Maximum velocity across the table over the top speed."""

    settings: Settings

    def __init__(self, info: TaskInfo, settings: Settings | None = None) -> None:
        super().__init__(info, settings)
        if not info.continuous_feed or info.zones is None:
            raise info.unsupported("lanes", "a task whose parts leave through gates, such as Feed")
        zones = info.zones[list(info.kind)]
        self.lane = 0.5 * (zones[:, 1] + zones[:, 3])
        self.gate = zones[:, 0]
        self.inlet = float(2.0 * max(part.radius for part in info.parts))
        self.half = np.array([np.abs(part.outline).max(axis=0) for part in info.parts])
        self.spacing = float(np.sqrt(2.0) * info.surface.element_size)

    def act(self, measured: Measured, memory: SteeringMemory, new: np.ndarray) -> tuple[np.ndarray, SteeringMemory]:
        """See :meth:`.steering.Steering.act`."""
        return self.steer(measured, self.lead * self.velocity(measured), memory)

    def velocity(self, measured: Measured) -> np.ndarray:
        """Return set velocities (batch, parts, 2), m/s."""
        centre, top, slip = measured.centre, self.top, self.settings.slip * self.top
        reach = extents(self.half, measured.heading)
        between = centre[:, None] - centre[:, :, None]  # of part i (first axis) to part j
        gap = np.abs(between) - reach[:, :, None] - reach[:, None]
        there = measured.present[:, :, None] & measured.present[:, None] & ~np.eye(centre.shape[1], dtype=bool)
        # The part that is farther along has priority.
        first = (between[..., 0] == 0.0) & np.triu(np.ones(gap.shape[1:3], bool), 1)
        ahead = there & ((between[..., 0] > 0.0) | first)
        progress = (centre[..., 0] - self.inlet) / (self.gate - self.inlet)
        spread = np.clip((progress - SPREAD[0]) / (SPREAD[1] - SPREAD[0]), 0.0, 1.0)
        wanted = spread * (self.spacing + self.settings.spare + PRESS) - PRESS
        along, across = gap[..., 0], gap[..., 1]
        in_way = ahead & (across < BESIDE)
        follow = measured.velocity[:, None, :, 0] + (along - wanted[:, :, None]) / ALONG
        vx = np.minimum(top, np.where(in_way, follow, np.inf).min(axis=2))
        vy = np.clip((self.lane - centre[..., 1]) / ACROSS, -slip, slip)
        # No part approaches one beside it: the one behind gives way.
        beside = ahead & (along < -PRESS)
        room = np.maximum(across - BESIDE, 0.0) / ALONG
        up, down = beside & (between[..., 1] > 0.0), beside & (between[..., 1] <= 0.0)
        vy = np.minimum(vy, np.where(up, room, np.inf).min(axis=2))
        vy = np.maximum(vy, -np.where(down, room, np.inf).min(axis=2))
        vx = np.clip(vx, 0.0, np.sqrt(np.maximum(top**2 - vy**2, 0.0)))
        return np.stack([vx, vy], axis=-1)


# -- both ways ---------------------------------------------------------------------------------------------------------

SIDE = 0.8  # maximum velocity towards the own side of the table over the top speed
HOLD, HOLD_ACROSS = 0.13, 0.052  # m between centres, along and across, below which parts wait for one on the wrong side
PATIENCE = 0.15  # s that a part waits off its goal, without oncoming parts, until the planner takes over
CROSSES = 0.15  # m along the table to the goal, above which other parts may be oncoming
TURN_AT = 0.060  # m from the goal, where parts turn to its heading


class CrossingPolicy(TwoPhasesPolicy):
    """Lanes along the table in which parts keep apart: both ways past one another.

    Raises:
        ValueError: a task whose parts have no goal poses, or a bad setting of the law.
    """

    def __init__(self, info: TaskInfo, settings: TwoPhasesPolicy.Settings | None = None) -> None:
        if not info.has_goal or info.goal_moves:
            required = "a task whose parts have fixed goal poses, such as Swap, or leave through gates, such as Feed"
            raise info.unsupported("lanes", required)
        super().__init__(info, settings)
        self.half = 0.5 * self.targets.size
        self.rules = Rules(info.surface.width, info.surface.depth, self.top, 1.0 / self.lead)

    def choose(self, measured: Measured, plan: TargetPlan) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`.planner.PlannerPolicy.choose`; velocities that pass others in worlds where parts meet."""
        velocity, waited = super().choose(measured, plan)
        wanted, first, meets = self.wanted(measured)
        crossing = meets.any(axis=1)
        patient = np.where(measured.present, waited, 0.0).max(axis=1) < PATIENCE
        # Once lost without any parts meeting, patience is not regained.
        waited = np.where((crossing | patient)[:, None], waited, np.maximum(waited, PATIENCE))
        some = np.flatnonzero(crossing | patient)
        if len(some):
            velocity[some] = self.pass_by(measured, wanted, first, some)
        return velocity, waited

    def pass_by(self, measured: Measured, wanted: np.ndarray, first: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Return velocities (n, parts, 2), m/s, with which the parts of some worlds pass one another; see :meth:`wanted`."""
        crowd = Crowd(
            present=measured.present[worlds],
            centre=np.ascontiguousarray(measured.centre[worlds]),
            reach=extents(self.half, measured.heading[worlds]),
            wanted=np.ascontiguousarray(wanted[worlds]),
            order=np.argsort(first[worlds], axis=1, kind="stable"),
            pose=measured.pose[worlds],
        )
        chosen = measured.velocity[worlds]

        def choose(start: int, stop: int) -> None:
            choose_velocities(start, stop, self.rules, self.hulls, crowd, chosen)

        workers.share(choose, len(worlds), self.threads)
        return chosen

    def _heading_error(self, measured: Measured) -> np.ndarray:
        far = np.hypot(*np.moveaxis(measured.displacement, -1, 0)) > TURN_AT
        return np.where(far, -wrap(measured.heading, self.symmetry), super()._heading_error(measured))

    def wanted(self, measured: Measured) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compute the velocities that parts would choose without others.

        Returns:
            Velocities (batch, parts, 2), m/s; sort keys (batch, parts), the smallest goes first; (batch, parts) bool, whether
            a part has oncoming parts.
        """
        x, y, displacement = measured.centre[..., 0], measured.centre[..., 1], measured.displacement
        away = np.hypot(displacement[..., 0], displacement[..., 1])
        speed = np.minimum(away / self.lead, self.top)
        straight = (speed / np.maximum(away, 1e-12))[..., None] * displacement
        # Direction of motion along the table, 0 near the goal.
        side = np.where((np.abs(displacement[..., 0]) > CROSSES) & measured.present, np.sign(displacement[..., 0]), 0.0)
        between = x[:, None] - x[:, :, None]
        oncoming = (between * side[:, :, None] > 0.0) & (side[:, None] * side[:, :, None] < 0.0)
        meets: np.ndarray = np.asarray(oncoming.any(axis=2))
        width, quarter, most = self.half[:, 1], 0.25 * self.info.surface.depth, SIDE * self.top
        room = np.maximum(quarter - width, 0.0)  # off the middle of a half
        middle = 2.0 * quarter - side * quarter
        across = np.clip(y, middle - room, middle + room) - y
        vy = np.clip(across / self.lead, -most, most)
        # Parts on the wrong side leave it; oncoming parts wait for that, or make room at the border.
        wrong = (np.abs(across) > width) & (side != 0.0)
        before, apart = oncoming & (wrong[:, None] | wrong[:, :, None]), np.abs(between)
        beside = np.abs(y[:, None] - y[:, :, None]) < HOLD_ACROSS
        free = np.maximum(apart - HOLD, 0.0) / (2.0 * self.lead)
        free = np.where(before & beside, free, np.inf).min(axis=2)
        aside = (before & (apart < 2.0 * HOLD)).any(axis=2)
        vy = np.where(aside, np.clip((middle - side * room - y) / self.lead, -most, most), vy)
        vy = np.where(wrong, np.sign(across) * most, vy)
        vx = side * np.minimum(np.sqrt(np.maximum(self.top**2 - vy**2, 0.0)), free)
        length = self.info.surface.width + self.info.surface.depth
        progress = np.where(side > 0.0, self.info.surface.width - x, x)
        first = np.where(meets, np.where(wrong, length, 0.0) + progress, 3.0 * length - away)
        return np.where(meets[..., None], np.stack([vx, vy], axis=-1), straight), first, meets


class LanesPolicy:
    """Lanes through gates where parts come and go (:class:`FeedingPolicy`), else :class:`CrossingPolicy`."""

    class Settings(CrossingPolicy.Settings, FeedingPolicy.Settings):
        """Settings of either."""

    supports = Steering.supports

    def __new__(cls, info: TaskInfo, settings: Settings) -> FeedingPolicy | CrossingPolicy:
        """Make the policy for the task.

        Raises:
            ValueError: settings of the other one, or another task.
        """
        policy: Any = FeedingPolicy if info.continuous_feed else CrossingPolicy
        known, given = policy.Settings.model_fields, settings.model_fields_set
        for name in given - known.keys():
            where = "through gates" if info.continuous_feed else "both ways"
            raise checks.unknown("setting", name, known, of=f"policy 'lanes' {where}")
        return policy(info, policy.Settings(**{name: getattr(settings, name) for name in given}))


# -- velocities that avoid collisions ----------------------------------------------------------------------------------

# Candidate velocities in addition to the wanted one, half of it, and rest: directions, and speeds over the top speed.
DIRECTIONS, SPEEDS = 20, (1.0, 0.6, 0.25)
CLOSE = 0.040  # m between the circumscribed circles of parts, below which gaps between outlines are computed
AT_ONCE = 0.08  # s, minimum time to collision of every part, with or without right of way, ...
PUSHING = 4.0  # ... and the price of less, relative to contact now
COSINES = np.cos(2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)
SINES = np.sin(2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)


class Rules(NamedTuple):
    """Constants of a scene and of the choice of velocities, for the kernels."""

    width: float  # m, of the surface
    depth: float  # m
    top: float  # m/s
    brake: float  # 1/s, maximum speed towards the border over the distance from it
    edge: float = 0.004  # m, by which rectangles may extend over the border
    near: float = 0.003  # m, distance that parts keep
    ahead: float = 0.35  # s, horizon
    meeting: float = 4.0  # price of a collision now, over that of rest for a part whose wanted speed is the top speed
    yielding: float = 0.3  # share of this price for a part that has right of way over the other
    faithful: float = 0.1  # price of a velocity that differs from the present one by the top speed


class Crowd(NamedTuple):
    """The parts of all worlds at this instant, input of :func:`choose_velocities`."""

    present: np.ndarray  # (worlds, parts) bool
    centre: np.ndarray  # (worlds, parts, 2) m
    reach: np.ndarray  # (worlds, parts, 2) m, half of their extent along x and y
    wanted: np.ndarray  # (worlds, parts, 2) m/s, wanted velocities
    order: np.ndarray  # (worlds, parts) int64: the first has right of way over all others
    pose: np.ndarray  # (worlds, parts, 3) m, m, rad


class Gaps(NamedTuple):
    """Gaps between the parts of one world: (parts, parts), of parts whose circumscribed circles are near."""

    size: np.ndarray  # m, between outlines; infinite of others
    x: np.ndarray  # of the unit vector from the first part to the second along which it is
    y: np.ndarray


@jit
def time_to_meet(dx, dy, ex, ey, vx, vy):
    """Return the time to collision of two rectangles, s: infinite without collision, 0 where they overlap.

    Args:
        dx, dy: centre of the other one minus own, m.
        ex, ey: sum of both half extents and the distance to keep, m.
        vx, vy: own velocity minus the other one's, m/s.
    """
    enter, leave = 0.0, math.inf
    for axis in range(2):
        d, e, v = (dx, ex, vx) if axis == 0 else (dy, ey, vy)
        if v == 0.0:
            if abs(d) >= e:
                return math.inf
            continue
        first, last = (d - e) / v, (d + e) / v
        enter, leave = max(enter, min(first, last)), min(leave, max(first, last))
    return enter if enter < leave else math.inf


@jit
def measure_gaps(hulls, placed, crowd, rank, w, gaps):
    """Compute the gaps between the present parts of a world whose circles are nearer than :data:`CLOSE`."""
    parts = rank.shape[0]
    for p in range(parts):
        if rank[p] >= 0:
            place_hulls(hulls, p, crowd.pose[w, p, 0], crowd.pose[w, p, 1], crowd.pose[w, p, 2], placed)
    for p in range(parts):
        for q in range(p):
            gaps.size[p, q] = gaps.size[q, p] = math.inf
            if rank[p] < 0 or rank[q] < 0:
                continue
            dx, dy = crowd.centre[w, q, 0] - crowd.centre[w, p, 0], crowd.centre[w, q, 1] - crowd.centre[w, p, 1]
            far = hulls.radius[p] + hulls.radius[q] + CLOSE
            if dx * dx + dy * dy >= far * far:
                continue
            for a in range(hulls.owner[p], hulls.owner[p + 1]):
                for b in range(hulls.owner[q], hulls.owner[q + 1]):
                    gap, nx, ny = hull_gap(hulls, placed, a, b)
                    if gap < gaps.size[p, q]:
                        gaps.size[p, q] = gaps.size[q, p] = gap
                        gaps.x[p, q], gaps.y[p, q], gaps.x[q, p], gaps.y[q, p] = nx, ny, -nx, -ny


@jit
def meeting_time(rules, gaps, p, q, dx, dy, ex, ey, ux, uy):
    """Return a lower bound of the time to collision of two parts, s: of their rectangles and of their outlines."""
    time, gap = time_to_meet(dx, dy, ex, ey, ux, uy), gaps.size[p, q]
    if gap < math.inf:
        closing = ux * gaps.x[p, q] + uy * gaps.y[p, q]
        time = max(time, max(gap - rules.near, 0.0) / closing if closing > 0.0 else math.inf)
    return time


@jit
def price_of(rules, crowd, gaps, chosen, rank, w, p, last_x, last_y, vx, vy, limit):
    """Return the price of a velocity (m/s) of part ``p``; infinite if it leads over the border.

    The price may be incomplete where it exceeds ``limit``.
    """
    wx, wy = crowd.wanted[w, p, 0] - vx, crowd.wanted[w, p, 1] - vy
    lx, ly = last_x - vx, last_y - vy
    price = (math.sqrt(wx * wx + wy * wy) + rules.faithful * math.sqrt(lx * lx + ly * ly)) / rules.top
    x, y = crowd.centre[w, p, 0], crowd.centre[w, p, 1]
    for axis in range(2):
        at, v, size = (x, vx, rules.width) if axis == 0 else (y, vy, rules.depth)
        reach = crowd.reach[w, p, axis] - rules.edge
        room = size - reach - at if v > 0.0 else at - reach
        if abs(v) > rules.brake * max(room, 0.0):
            return math.inf
    for q in range(rank.shape[0]):
        if price > limit:
            return price
        if q == p or rank[q] < 0:
            continue
        dx, dy = crowd.centre[w, q, 0] - x, crowd.centre[w, q, 1] - y
        ex = crowd.reach[w, p, 0] + crowd.reach[w, q, 0] + rules.near
        ey = crowd.reach[w, p, 1] + crowd.reach[w, q, 1] + rules.near
        far = 2.0 * rules.top * rules.ahead
        if abs(dx) > ex + far or abs(dy) > ey + far:
            continue
        ux, uy = vx - chosen[w, q, 0], vy - chosen[w, q, 1]
        time = meeting_time(rules, gaps, p, q, dx, dy, ex, ey, ux, uy)
        if time < AT_ONCE:
            price += PUSHING * rules.meeting * (1.0 - time / AT_ONCE)
        share = 1.0 if rank[q] < rank[p] else rules.yielding
        if rank[q] < rank[p]:  # the part with right of way may have had to stop
            ux, uy = vx - crowd.wanted[w, q, 0], vy - crowd.wanted[w, q, 1]
            time = min(time, meeting_time(rules, gaps, p, q, dx, dy, ex, ey, ux, uy))
        if time < rules.ahead:
            left = 1.0 - time / rules.ahead
            price += share * rules.meeting * left * left
    return price


@jit(allocates=True)
def choose_velocities(start, stop, rules, hulls, crowd, chosen):
    """Choose the velocities of the parts of each world, in order of right of way.

    Args:
        start, stop: first world, and the one after the last.
        chosen: (worlds, parts, 2) m/s, velocities of the last step; overwritten.
    """
    parts = crowd.present.shape[1]
    rank, placed = np.empty(parts, np.int64), np.empty_like(hulls.corner)
    gaps = Gaps(np.empty((parts, parts)), np.empty((parts, parts)), np.empty((parts, parts)))
    for w in range(start, stop):
        for k in range(parts):
            p = crowd.order[w, k]
            rank[p] = k if crowd.present[w, p] else -1
        measure_gaps(hulls, placed, crowd, rank, w, gaps)
        for k in range(parts):
            p = crowd.order[w, k]
            last_x, last_y = chosen[w, p, 0], chosen[w, p, 1]
            chosen[w, p, 0] = chosen[w, p, 1] = 0.0
            if rank[p] < 0:
                continue
            wx, wy = crowd.wanted[w, p, 0], crowd.wanted[w, p, 1]
            best_x, best_y = wx, wy
            least = price_of(rules, crowd, gaps, chosen, rank, w, p, last_x, last_y, wx, wy, math.inf)
            for k in range(2 + DIRECTIONS * len(SPEEDS)):
                if k < 2:
                    vx, vy = 0.5 * k * wx, 0.5 * k * wy
                else:
                    speed = rules.top * SPEEDS[(k - 2) // DIRECTIONS]
                    vx, vy = speed * COSINES[(k - 2) % DIRECTIONS], speed * SINES[(k - 2) % DIRECTIONS]
                price = price_of(rules, crowd, gaps, chosen, rank, w, p, last_x, last_y, vx, vy, least)
                if price < least:
                    least, best_x, best_y = price, vx, vy
            chosen[w, p, 0], chosen[w, p, 1] = best_x, best_y
