"""Episodes of all worlds: errors to the goals, distances between parts, success and reward, in one compiled pass.

Every part has a goal: a rectangle for its centre (a point for a pose, or the whole plane) and a heading where it counts. A part
is done if it is within the tolerances, slow enough and far enough from the others. A task sets these limits and the weights of
the reward terms (:class:`Rules`); the kernels do not depend on the task.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout
from vibgym.physics.contacts.hulls import Hulls, load_hulls, part_gap, place_hulls
from vibgym.physics.core.records import state_at

DISTANCE_SCALE = 0.1  # m of progress that earn the term's full reward
APPROACH_SCALE = 0.010  # m
TURN_SCALE = 1.0  # rad
ALIGNMENT_SCALE = 0.15  # rad
TOUCHING = 1e-4
"""m, distance below which a pair of parts counts as touching."""

QUANTITIES = {
    "distance": "decrease of the distance to the goal or zone, per 100 mm",
    "approach": "decrease of tanh(distance / 10 mm)",
    "turn": "decrease of the heading error, per rad",
    "alignment": "decrease of tanh(heading error / 0.15 rad)",
    "inside": "1 when the centre gets to the goal or into the zone, -1 when it leaves it",
    "within": "1 in every period that ends within all limits",
    "clearance": "increase of min(distance to the nearest part / required distance, 1)",
    "time": "-1 in every period",
    "success": "1 for all parts of a world that succeeds",
    "fallen": "-1 if the part has fallen off the surface",
    "good": "1 if the part leaves as it should",
    "faulty": "-1 if the part leaves otherwise",
    "reach": "decrease of the distance from a part without a goal to the nearest centre of one with a goal, per 100 mm",
}
"""Quantities of reward terms of one part in one step, and their meanings; each at most 1 in magnitude (per period). How they
become the reward of a world is defined in ``docs/extending.md``, section Reward."""
(DISTANCE, APPROACH, TURN, ALIGNMENT, INSIDE, WITHIN, CLEARANCE, TIME, SUCCESS, FALLEN, GOOD, FAULTY, REACH) = range(
    len(QUANTITIES)
)


class Rules(NamedTuple):
    """Limits and reward weights of a task."""

    zone: np.ndarray  # (parts, 4) m: x_low, y_low, x_high, y_high of each part's rectangle, about its goal
    tolerance: np.ndarray  # (parts, 2) m from the rectangle, and rad, which is infinite where headings do not count
    has_goal: np.ndarray  # (parts,) bool, parts with a goal; others are done unless they fall, and have no errors
    # (worlds, parts), or one row for all worlds, rad; headings that differ by it are the same; 0: headings are not wrapped
    heading_period: np.ndarray
    slow: float  # m/s, speed below which a part is done
    apart: float  # m, distance to the nearest other part above which a part is done; -inf where it does not count
    far: float  # m, distance reported where there is no other part
    hold: int  # consecutive periods with all parts done for success
    periods: int  # of a step
    term: np.ndarray  # (terms,) int64 index among QUANTITIES of each reward term
    weight: np.ndarray  # (terms,)
    worst: np.ndarray  # (terms,) bool, terms of which a world counts its worst part


AWAY, TURNED = range(2)  # of Rules.tolerance


PREVIEW = 4
"""Number of periods ahead for which the state observation includes the pose of a moving goal."""

MOTION = 3 * (1 + PREVIEW)
"""Length of :attr:`Episode.motion` of one part."""

EVENTS = ("stays", "good", "tilted", "close", "wrong", "lost")
"""Events of a part where parts arrive and leave: it stays; it leaves good, tilted, too close to another, or through the wrong
gate; or it has fallen (lost)."""
STAYS, LEFT_GOOD, TILTED, TOO_CLOSE, WRONG, LOST = range(len(EVENTS))

NO_PATHS = np.zeros((0, 0, 0, 0))
NO_KEY = np.zeros((0, 2), dtype=np.int64)


class Start(NamedTuple):
    """Where the episodes of n worlds begin."""

    pose: np.ndarray  # (n, parts, 3) m, m, rad; of absent parts beside the surface
    present: np.ndarray  # (n, parts) bool
    goal: np.ndarray  # (n, parts, 3) goal poses; zeros for tasks without
    paths: np.ndarray = NO_PATHS  # (n, parts, rows, 6) along which goals move, see vibgym.tasks.paths; else empty
    key: np.ndarray = NO_KEY  # (n, 2) int64, key of the random numbers of arrivals, see vibgym.tasks.flow; else empty


class Relations(NamedTuple):
    """Errors to the goals and distances between parts, from true or measured poses."""

    # (worlds, parts, 3) goal, or nearest point of its rectangle, minus pose: m, m, rad; 0 for absent parts
    error: np.ndarray
    gap: np.ndarray  # (worlds, parts) m, to the nearest other part; negative: overlap
    neighbour: np.ndarray  # (worlds, parts) int64, index of the nearest other part; -1: none
    # (worlds, parts) m, from the centre of a part without a goal to the nearest centre of a part with one; 0 of others
    reach: np.ndarray


class Episode(NamedTuple):
    """Progress of every world's episode, changed in place. Scalars per world share an array; the properties name them."""

    goal: np.ndarray  # (worlds, parts, 3) m, m, rad; zeros where the task has zones or none
    # (worlds, parts, MOTION): velocity of the goal (m/s, m/s, rad/s), and its pose 1, 2, ... PREVIEW periods ahead minus the
    # present one (m, m, rad); (worlds, parts, 0) for tasks whose goals stay
    motion: np.ndarray
    present: np.ndarray  # (worlds, parts) bool; constant unless parts arrive and leave
    arrived: np.ndarray  # (worlds, parts) bool, parts that have arrived in this step
    event: np.ndarray  # (worlds, parts) int64 index of EVENTS, of parts that have left in this step
    done: np.ndarray  # (worlds, parts) bool
    number: np.ndarray  # (worlds, NUMBERS)
    count: np.ndarray  # (worlds, COUNTS) int64
    flag: np.ndarray  # (worlds, FLAGS) bool
    terms: np.ndarray  # (worlds, terms) reward terms
    part_fallen: np.ndarray  # (worlds, parts) bool, of present parts
    part_number: np.ndarray  # (worlds, parts, PART_NUMBERS)
    part_terms: np.ndarray  # (worlds, parts, terms) weighted reward terms of each part; 0 of absent ones
    part_reward: np.ndarray  # (worlds, parts) their sum

    reward = property(lambda self: self.number[:, REWARD], doc="(worlds,) sum of the terms")
    position_error = property(
        lambda self: self.number[:, POSITION_ERROR],
        doc="(worlds,) m, largest distance of a part to its goal, or shortfall of the smallest gap if that is larger",
    )
    heading_error = property(
        lambda self: self.number[:, HEADING_ERROR],
        doc="(worlds,) rad, largest magnitude of a heading error; 0 where headings do not count",
    )
    clearance = property(
        lambda self: self.number[:, SMALLEST_GAP], doc="(worlds,) m, smallest distance between parts; negative: overlap"
    )
    parts_done = property(lambda self: self.count[:, PARTS_DONE], doc="(worlds,) int64, number of parts done")
    touching = property(lambda self: self.count[:, IN_TOUCH], doc="(worlds,) int64, pairs of touching parts")
    fallen = property(lambda self: self.flag[:, DOWN], doc="(worlds,) bool, whether a present part has fallen")
    success = property(lambda self: self.flag[:, SUCCEEDED], doc="(worlds,) bool")
    ended = property(lambda self: self.flag[:, ENDED], doc="(worlds,) bool: success, fallen or diverged")


class Context(NamedTuple):
    """Arguments of the scoring kernels, pinned in memory."""

    relations: Relations
    episode: Episode
    rules: Rules
    hulls: Hulls
    placed: np.ndarray  # scratch: corners of the placed hulls, as hulls.corner
    share: np.ndarray  # scratch: (2,) present parts over those with a goal, and over those without
    quantity: np.ndarray  # scratch: (QUANTITIES,)
    fits: np.ndarray  # scratch: (parts,) bool, parts within their limits, whether or not they have fallen


CONTEXT: Layout[Context] = Layout("CONTEXT", __name__)
context_at = CONTEXT.at

# Columns of Episode.number.
POSITION_ERROR, HEADING_ERROR, SMALLEST_GAP, REWARD = range(4)
# Columns of Episode.part_number, with which a part's next step is compared: distance (m; of a part without a goal its
# reach), tanh of it over its scale, heading error (rad), tanh likewise, 1 at the goal, share of the required clearance.
PART_AWAY, PART_NEAR, PART_TURN, PART_ALIGNED, PART_INSIDE, PART_CLEAR = range(6)
PARTS_DONE, IN_TOUCH, HELD = range(3)  # of Episode.count; HELD: consecutive periods with all parts done
# Columns of Episode.flag. BARRED: success is not possible yet, or no longer, see vibgym.tasks.follow.
DOWN, SUCCEEDED, ENDED, BARRED = range(4)


@jit
def _limited(value):
    return min(max(value, -1.0), 1.0)


@jit
def wrapped(difference, period):
    """Return an angle's equivalent in [-period / 2, period / 2]; the angle itself for a period of 0."""
    if period > 0.0:
        return difference - period * math.floor(difference / period + 0.5)
    return difference


@jit
def relate_gaps(context, pose, gone, world):
    """Compute gaps and nearest neighbours in one world, without parts that are ``gone``; return how many pairs touch."""
    parts, hulls, placed, far = pose.shape[1], context.hulls, context.placed, context.rules.far
    here, relations = context.episode.present[world], context.relations
    gap, neighbour = relations.gap[world], relations.neighbour[world]
    load_hulls(hulls, world)
    for i in range(parts):
        gap[i], neighbour[i] = far, -1
        if here[i] and not gone[world, i]:
            place_hulls(hulls, i, pose[world, i, 0], pose[world, i, 1], pose[world, i, 2], placed)
    touching = 0
    for i in range(parts):
        if not here[i] or gone[world, i]:
            continue
        for j in range(i):
            if not here[j] or gone[world, j]:
                continue
            dx, dy = pose[world, i, 0] - pose[world, j, 0], pose[world, i, 1] - pose[world, j, 1]
            least = math.sqrt(dx * dx + dy * dy) - hulls.radius[i] - hulls.radius[j]
            if least >= gap[i] and least >= gap[j] and least >= TOUCHING:
                continue
            between = part_gap(hulls, placed, i, j)
            if between < gap[i]:
                gap[i], neighbour[i] = between, j
            if between < gap[j]:
                gap[j], neighbour[j] = between, i
            touching += between < TOUCHING
    return touching


@jit
def smallest_gap(relations, world):
    """Return the smallest gap between parts of a world, m."""
    smallest = math.inf
    for i in range(relations.gap.shape[1]):
        smallest = min(smallest, relations.gap[world, i])
    return smallest


@jit
def relate_to_goals(context, pose, world):
    """Compute errors to the goals, and what parts without a goal are to reach, in one world."""
    rules, goal, present, error = context.rules, context.episode.goal, context.episode.present, context.relations.error
    heading_period = rules.heading_period[min(world, rules.heading_period.shape[0] - 1)]
    for i in range(pose.shape[1]):
        ex, ey, heading_error = 0.0, 0.0, 0.0
        if present[world, i]:
            x, y, gx, gy = pose[world, i, 0], pose[world, i, 1], goal[world, i, 0], goal[world, i, 1]
            ex = min(max(x, gx + rules.zone[i, 0]), gx + rules.zone[i, 2]) - x
            ey = min(max(y, gy + rules.zone[i, 1]), gy + rules.zone[i, 3]) - y
            if rules.tolerance[i, TURNED] < math.inf:
                heading_error = wrapped(goal[world, i, 2] - pose[world, i, 2], heading_period[i])
        error[world, i, 0], error[world, i, 1], error[world, i, 2] = ex, ey, heading_error
        if not rules.has_goal[i]:
            context.relations.reach[world, i] = reach_of(context, pose, world, i)


@jit
def reach_of(context, pose, world, part):
    """Return the distance, m, from a part's centre to the nearest centre of a part with a goal; 0 if either is absent."""
    present, nearest = context.episode.present[world], math.inf
    for other in range(pose.shape[1]):
        if context.rules.has_goal[other] and present[other]:
            x, y = pose[world, other, 0] - pose[world, part, 0], pose[world, other, 1] - pose[world, part, 1]
            nearest = min(nearest, math.sqrt(x * x + y * y))
    return nearest if present[part] and nearest < math.inf else 0.0


@jit
def evaluate_world(context, mean_velocity, fallen, world):
    """Compute the errors of one world and which parts are done; its relations must be up to date.

    Returns:
        Whether all parts are done.
    """
    relations, episode, rules = context.relations, context.episode, context.rules
    number, apart = episode.number[world], rules.apart
    clearance = smallest_gap(relations, world)
    error, down, count, with_goal, done, most_turned = max(apart - clearance, 0.0), False, 0, 0, 0, 0.0
    for i in range(mean_velocity.shape[1]):
        episode.done[world, i] = False
        if not episode.present[world, i]:
            continue
        ex, ey = relations.error[world, i, 0], relations.error[world, i, 1]
        away, turned, gap = math.sqrt(ex * ex + ey * ey), abs(relations.error[world, i, 2]), relations.gap[world, i]
        vx, vy = mean_velocity[world, i, 0], mean_velocity[world, i, 1]
        error, most_turned = max(error, away), max(most_turned, turned)
        count, with_goal = count + 1, with_goal + rules.has_goal[i]
        slow = vx * vx + vy * vy < rules.slow * rules.slow
        fitting = away <= rules.tolerance[i, AWAY] and turned <= rules.tolerance[i, TURNED] and slow and gap > apart
        context.fits[i] = fitting or not rules.has_goal[i]
        if fallen[world, i]:
            down = True
        elif context.fits[i]:
            episode.done[world, i] = True
            done += 1
    context.share[0], context.share[1] = count / max(with_goal, 1), count / max(count - with_goal, 1)
    number[POSITION_ERROR], number[HEADING_ERROR], number[SMALLEST_GAP] = error, most_turned, clearance
    episode.count[world, PARTS_DONE] = done
    episode.flag[world, DOWN] = down
    return done == count


@jit
def average_terms(part_terms, counted, share, worst, terms):
    """Compute the reward terms of one world from those of its parts; return its reward, their sum.

    Args:
        part_terms: (parts, terms).
        counted: (parts,) bool, parts that count.
        share: number of parts that a mean is over.
        worst: (terms,) bool, terms of which the worst part counts.
        terms: (terms,), overwritten.
    """
    total = 0.0
    for k in range(terms.shape[0]):
        value = 0.0
        for i in range(part_terms.shape[0]):
            if counted[i] and not worst[k]:
                value += part_terms[i, k]
            elif counted[i] and abs(part_terms[i, k]) > abs(value):
                value = part_terms[i, k]
        terms[k] = value if worst[k] else value / max(share, 1)
        total += terms[k]
    return total


@jit
def reward_part(context, world, part):
    """Compute the reward terms of one part and their sum from the change of ``part_number``, which is updated."""
    rules, episode, relations, quantity = context.rules, context.episode, context.relations, context.quantity
    before, apart = episode.part_number[world, part], rules.apart
    ex, ey, turned = relations.error[world, part, 0], relations.error[world, part, 1], relations.error[world, part, 2]
    away, turned = math.sqrt(ex * ex + ey * ey), abs(turned)  # both 0 of a part without a goal
    near, aligned = math.tanh(away / APPROACH_SCALE), math.tanh(turned / ALIGNMENT_SCALE)
    share, others = context.share[0], 0.0
    if not rules.has_goal[part]:
        away, share, others = relations.reach[world, part], 0.0, context.share[1]
    closer = _limited((before[PART_AWAY] - away) / DISTANCE_SCALE)
    inside = 1.0 if ex == 0.0 and ey == 0.0 else 0.0
    clear = min(max(relations.gap[world, part], 0.0), apart) / apart if apart > 0.0 else 0.0
    quantity[DISTANCE], quantity[REACH] = share * closer, others * closer
    quantity[APPROACH] = share * (before[PART_NEAR] - near)
    quantity[TURN] = share * _limited((before[PART_TURN] - turned) / TURN_SCALE)
    quantity[ALIGNMENT] = share * (before[PART_ALIGNED] - aligned)
    quantity[INSIDE] = share * (inside - before[PART_INSIDE])
    quantity[WITHIN] = share if context.fits[part] else 0.0
    quantity[CLEARANCE] = share * (clear - before[PART_CLEAR])
    quantity[TIME] = -1.0
    quantity[SUCCESS] = 1.0 if episode.flag[world, SUCCEEDED] else 0.0
    quantity[FALLEN] = -1.0 if episode.part_fallen[world, part] else 0.0
    event = episode.event[world, part]
    quantity[GOOD] = 1.0 if event == LEFT_GOOD else 0.0
    quantity[FAULTY] = -1.0 if event > LEFT_GOOD and event != LOST else 0.0
    before[PART_AWAY], before[PART_NEAR], before[PART_TURN] = away, near, turned
    before[PART_ALIGNED], before[PART_INSIDE], before[PART_CLEAR] = aligned, inside, clear
    total = 0.0
    for k in range(rules.term.shape[0]):
        episode.part_terms[world, part, k] = rules.weight[k] * quantity[rules.term[k]]
        total += episode.part_terms[world, part, k]
    episode.part_reward[world, part] = total


@jit
def reward_parts(context, fallen, starting, world):
    """Compute the reward terms of every part of one world: zero for absent parts, and for all where an episode starts."""
    episode = context.episode
    for i in range(fallen.shape[1]):
        here = episode.present[world, i]
        episode.part_fallen[world, i] = here and fallen[world, i]
        if here:
            reward_part(context, world, i)
        if starting or not here:
            episode.part_reward[world, i], episode.part_terms[world, i] = 0.0, 0.0


@jit
def relate_world(context, pose, gone, world):
    """Update the relations of one world, whose parts ``gone`` are ignored by others; return how many pairs touch."""
    relate_to_goals(context, pose, world)
    if pose.shape[1] == 1:  # its gap and neighbour never change
        return 0
    return relate_gaps(context, pose, gone, world)


@jit
def relate_worlds(address, worlds, pose, gone):
    """Update the relations of some worlds.

    Args:
        address: of a pinned :class:`Context`, whose relations are overwritten.
        worlds: (n,) index.
        pose: (worlds, parts, 3).  gone: (worlds, parts) bool, parts that others ignore.
    """
    context = context_at(address)
    for k in range(worlds.shape[0]):
        relate_world(context, pose, gone, worlds[k])


@jit
def score_worlds(state, address, starting, worlds):
    """Score one step of some worlds relative to the previous one, or start their episodes, whose goals and parts are set.

    Args:
        state: address of the pinned true state.
        address: of a pinned :class:`Context`, whose relations and episode are changed.
        starting: whether their episodes start.
        worlds: (n,) index.
    """
    true, context = state_at(state), context_at(address)
    episode, rules = context.episode, context.rules
    for k in range(worlds.shape[0]):
        world = worlds[k]
        number, count, flag = episode.number, episode.count, episode.flag
        count[world, IN_TOUCH] = relate_world(context, true.pose, true.fallen, world)
        complete = evaluate_world(context, true.mean_velocity, true.fallen, world)
        if starting:
            count[world, HELD], flag[world, SUCCEEDED], flag[world, ENDED] = 0, False, False
            number[world, REWARD], episode.terms[world] = 0.0, 0.0
            reward_parts(context, true.fallen, True, world)
            continue
        sound = not (flag[world, DOWN] or true.diverged[world])
        held = sound and complete and not flag[world, BARRED]
        count[world, HELD] = count[world, HELD] + rules.periods if held else 0
        flag[world, SUCCEEDED] = count[world, HELD] >= rules.hold
        flag[world, ENDED] = flag[world, SUCCEEDED] or not sound
        reward_parts(context, true.fallen, False, world)
        present = episode.present[world]
        number[world, REWARD] = average_terms(
            episode.part_terms[world], present, present.sum(), rules.worst, episode.terms[world]
        )
