"""Episodes in which parts arrive and leave: what becomes of each, and how many a minute leave as they should.

A part's place among the parts is a slot: a part leaves when its centre enters a gate, or when it has fallen, and some steps
later another one of its kind arrives in its slot. A part that leaves is gone at the end of that step, and one that arrives is
there at the end of its step, so no slot is ever handed on within a step. The reward of the step that it leaves in is its own.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vibgym.kernels.jit import borrowing
from vibgym.kernels.reference import Layout
from vibgym.physics.contacts.hulls import place_hulls
from vibgym.physics.core.noise import uniforms
from vibgym.physics.core.records import state_at
from vibgym.tasks.episode import (
    BARRED,
    DOWN,
    ENDED,
    EVENTS,
    HEADING_ERROR,
    HELD,
    IN_TOUCH,
    LEFT_GOOD,
    LOST,
    PARTS_DONE,
    POSITION_ERROR,
    REWARD,
    SMALLEST_GAP,
    STAYS,
    SUCCEEDED,
    TILTED,
    TOO_CLOSE,
    TURNED,
    WRONG,
    Context,
    relate_world,
    reward_part,
)
from vibgym.tasks.starts import TRIES, Room, heap, is_clear

if TYPE_CHECKING:
    pass


WHICH, WHERE, HEAPED = 17, 18, 19
"""Third word of a counter: what a random number is drawn for."""


class Inlet(NamedTuple):
    """Where parts come in, and in what company; with what it works on."""

    low: float  # m, least and largest x of the centres of parts that come one at a time
    high: float
    heap: int  # parts that come at once, in touch; 1: they come one at a time
    room: Room  # that a heap lies in, from the left border on
    numbers: np.ndarray  # scratch: (parts, TRIES, 2)
    order: np.ndarray  # scratch: (parts,) int64
    chance: np.ndarray  # scratch: (parts,)
    pose: np.ndarray  # scratch: (parts, 3)


@borrowing
def shuffle_waiting(inlet, key, tried, waiting):
    """Let ``order`` begin with the parts that wait, at random; returns their number."""
    order, chance, count = inlet.order, inlet.chance, 0
    for part in range(waiting.shape[0]):
        if waiting[part]:
            value, _, _, _ = uniforms(key, tried, part, WHICH, 0)
            at = count
            while at > 0 and chance[at - 1] > value:
                order[at], chance[at] = order[at - 1], chance[at - 1]
                at -= 1
            order[at], chance[at] = part, value
            count += 1
    return count


@borrowing
def find_free_pose(inlet, hulls, placed, key, tried, present, pose):
    """Look for room for the part ``order[0]``; its pose is left in ``inlet.pose``.

    Args:
        hulls, placed: of all parts; those that are present have been placed.
        present: (parts,) bool.  pose: (parts, 3), theirs.

    Returns:
        Whether there is any.
    """
    order, own, part, room = inlet.order, inlet.pose, inlet.order[0], inlet.room
    count = 0
    for other in range(present.shape[0]):
        for axis in range(3):
            own[other, axis] = pose[other, axis]
    for t in range(TRIES):
        u, v, turn, _ = uniforms(key, tried, t, WHERE, 0)
        own[part, 0] = inlet.low + (inlet.high - inlet.low) * u
        own[part, 1] = hulls.radius[part] + (room.depth - 2.0 * hulls.radius[part]) * v
        own[part, 2] = math.pi * (2.0 * turn - 1.0)
        place_hulls(hulls, part, own[part, 0], own[part, 1], own[part, 2], placed)
        count = 0
        for other in range(present.shape[0]):
            if present[other]:
                order[count] = other
                count += 1
        order[count] = part
        if is_clear(hulls, placed, own, order, count, room.clear):
            order[0] = part
            return True
    return False


@borrowing
def draw_heap(inlet, hulls, placed, key, tried, present, pose):
    """Pile the parts ``order[:inlet.heap]`` up, if their room is free; their poses are left in ``inlet.pose``.

    Args: as for :func:`find_free_pose`.

    Returns:
        Whether it is.
    """
    room, numbers = inlet.room, inlet.numbers
    for other in range(present.shape[0]):
        if present[other] and pose[other, 0] - hulls.radius[other] < room.width:
            return False
    for k in range(inlet.heap):
        for t in range(TRIES):
            part = inlet.order[k]
            numbers[part, t, 0], numbers[part, t, 1], _, _ = uniforms(key, tried, part * TRIES + t, HEAPED, 0)
    heap(hulls, room, inlet.order, inlet.heap, numbers, placed, inlet.pose)
    return True


@borrowing
def draw_arrivals(inlet, hulls, placed, key, tried, waiting, present, pose):
    """Let parts arrive that wait for it.

    Args:
        key: (2,) of the episode.  tried: how often it has been tried.
        waiting, present: (parts,) bool.  pose: (parts, 3) of those that are present.

    Returns:
        How many arrive: the first ones of ``inlet.order``, at ``inlet.pose``.
    """
    if shuffle_waiting(inlet, key, tried, waiting) < inlet.heap:
        return 0
    if inlet.heap > 1:
        return inlet.heap if draw_heap(inlet, hulls, placed, key, tried, present, pose) else 0
    return 1 if find_free_pose(inlet, hulls, placed, key, tried, present, pose) else 0


LEFT, TRANSIT, ON_TABLE, STEPS = len(EVENTS), len(EVENTS) + 1, len(EVENTS) + 2, len(EVENTS) + 3
"""Columns of :attr:`Flow.tally` behind those of the events."""

MEAN_TRANSIT, MEAN_LOAD = len(EVENTS), len(EVENTS) + 1
"""Columns of :attr:`Flow.rate` behind those of the events."""


class Flow(NamedTuple):
    """Parts that come and go in all worlds, pinned in memory and changed in place."""

    clock: np.ndarray  # (worlds,) int64, periods since the episode's start
    key: np.ndarray  # (worlds, 2) int64 of its random numbers
    tried: np.ndarray  # (worlds,) int64, arrivals that have been tried
    pool: np.ndarray  # (worlds, parts) bool, parts of this episode, on the table or not
    there: np.ndarray  # (worlds, parts) bool, parts that were on the table in this step
    changed: np.ndarray  # (worlds, parts) bool, parts that have arrived or left in this step
    age: np.ndarray  # (worlds, parts) int64, periods since the part's arrival
    last: np.ndarray  # (worlds, kinds) int64, when a part has last left through each gate
    # (worlds, ...) int64 since the warm-up: parts by what became of them, all that left, periods that they took, ends of steps
    # that parts were on the table at, all ends of steps
    tally: np.ndarray
    rate: np.ndarray  # (worlds, ...) of these: parts a minute by event, s of a transit, parts on the table
    idle: np.ndarray  # (worlds, parts, 3) velocity of a part that slides in place
    gate: np.ndarray  # (kinds, 4) m: x_low, y_low, x_high, y_high
    kind: np.ndarray  # (parts,) int64, whose gate is a part's own
    away: np.ndarray  # (3,) pose of parts that are not on the table
    spacing: float  # m that parts keep when they leave
    headway: int  # periods between parts that leave through the same gate
    warm_up: int  # periods that do not count
    period: float  # s
    inlet: Inlet
    context: Context


FLOW: Layout[Flow] = Layout("FLOW", __name__)
flow_at = FLOW.at


@borrowing
def gate_of(flow, x, y):
    """The gate in which a place lies; -1: in none."""
    gate = flow.gate
    for k in range(gate.shape[0]):
        if gate[k, 0] <= x and x <= gate[k, 2] and gate[k, 1] <= y and y <= gate[k, 3]:
            return k
    return -1


@borrowing
def is_straight_and_apart(flow, world, part):
    """Whether a part is straight and far enough from the others to leave, by relations that are up to date."""
    relations, rules = flow.context.relations, flow.context.rules
    return abs(relations.error[world, part, 2]) <= rules.tolerance[part, TURNED] and (
        relations.gap[world, part] >= flow.spacing
    )


@borrowing
def event_of(flow, state, world, part):
    """What becomes of a part on the table in this step, see :data:`vibgym.tasks.episode.EVENTS`."""
    if state.fallen[world, part]:
        return LOST
    gate = gate_of(flow, state.pose[world, part, 0], state.pose[world, part, 1])
    if gate < 0:
        return STAYS
    since = flow.clock[world] - flow.last[world, gate]
    flow.last[world, gate] = flow.clock[world]
    if gate != flow.kind[part]:
        return WRONG
    context = flow.context
    if abs(context.relations.error[world, part, 2]) > context.rules.tolerance[part, TURNED]:
        return TILTED
    if context.relations.gap[world, part] < flow.spacing or since < flow.headway:
        return TOO_CLOSE
    return LEFT_GOOD


@borrowing
def evaluate_parts(flow, state, world):
    """Say what becomes of every part of a world, and reward it."""
    episode, done = flow.context.episode, 0
    total = episode.terms[world]
    slots = 0
    for k in range(total.shape[0]):
        total[k] = 0.0
    for part in range(state.fallen.shape[1]):
        here = episode.present[world, part]
        flow.there[world, part], episode.arrived[world, part] = here, False
        episode.event[world, part] = event_of(flow, state, world, part) if here else STAYS
        episode.part_fallen[world, part] = episode.event[world, part] == LOST
        flow.context.fits[part] = here and is_straight_and_apart(flow, world, part)
        at_own = gate_of(flow, flow.gate[flow.kind[part], 0], state.pose[world, part, 1]) == flow.kind[part]
        episode.done[world, part] = flow.context.fits[part] and at_own
        done += episode.done[world, part]
        slots += flow.pool[world, part]
        episode.part_reward[world, part] = 0.0
        for k in range(total.shape[0]):
            episode.part_terms[world, part, k] = 0.0
        if here:
            reward_part(flow.context, world, part)
            for k in range(total.shape[0]):
                total[k] += episode.part_terms[world, part, k]
    reward = 0.0
    for k in range(total.shape[0]):
        total[k] /= max(slots, 1)
        reward += total[k]
    episode.number[world, REWARD] = reward
    episode.count[world, PARTS_DONE] = done


@borrowing
def remove_part(flow, state, world, part):
    """Take a part off the table."""
    for k in range(3):
        state.pose[world, part, k] = flow.away[k]
        state.velocity[world, part, k] = state.mean_velocity[world, part, k] = 0.0
    state.pushed[world, part, 0] = state.pushed[world, part, 1] = 0.0
    state.fallen[world, part], state.sticking[world, part] = True, False
    flow.context.episode.present[world, part] = flow.context.episode.done[world, part] = False


@borrowing
def place_part(flow, state, world, part, pose):
    """Put a part on the table at a pose (3,), where it slides in place."""
    for k in range(3):
        state.pose[world, part, k] = pose[k]
        state.velocity[world, part, k], state.mean_velocity[world, part, k] = flow.idle[world, part, k], 0.0
    state.fallen[world, part] = state.sticking[world, part] = state.doubtful[world, part] = False
    episode = flow.context.episode
    episode.present[world, part] = episode.arrived[world, part] = True
    flow.age[world, part] = 0


@borrowing
def remove_leaving(flow, state, world):
    """Take parts off the table that leave in this step, and count them; returns whether there are any."""
    event, counts, tally = flow.context.episode.event, flow.clock[world] > flow.warm_up, flow.tally[world]
    some = False
    for part in range(event.shape[1]):
        flow.changed[world, part] = event[world, part] != STAYS
        if event[world, part] != STAYS:
            some = True
            if counts:
                tally[event[world, part]] += 1
                if event[world, part] != LOST:
                    tally[LEFT] += 1
                    tally[TRANSIT] += flow.age[world, part]
            remove_part(flow, state, world, part)
    return some


@borrowing
def add_waiting(flow, state, world, most):
    """Let up to ``most`` parts, or heaps, arrive; returns how many parts have come."""
    inlet, context, pose, arrivals = flow.inlet, flow.context, state.pose[world], 0
    present, placed, hulls = context.episode.present[world], context.placed, context.hulls
    waiting = context.fits
    for _ in range(most):
        for part in range(present.shape[0]):  # who has left in this step comes later
            waiting[part] = flow.pool[world, part] and not present[part] and not flow.changed[world, part]
            if present[part]:
                place_hulls(hulls, part, pose[part, 0], pose[part, 1], pose[part, 2], placed)
        count = draw_arrivals(inlet, hulls, placed, flow.key[world], flow.tried[world], waiting, present, pose)
        flow.tried[world] += 1
        if count == 0:
            break
        for k in range(count):
            place_part(flow, state, world, inlet.order[k], inlet.pose[inlet.order[k]])
        arrivals += count
    for part in range(present.shape[0]):
        if context.episode.arrived[world, part]:
            flow.changed[world, part] = True
    return arrivals


@borrowing
def update_rates(flow, world):
    """Bring rates and means up to date."""
    tally, rate, present = flow.tally[world], flow.rate[world], flow.context.episode.present
    if flow.clock[world] <= flow.warm_up:
        return
    tally[STEPS] += 1
    for part in range(present.shape[1]):
        tally[ON_TABLE] += present[world, part]
    minutes = (flow.clock[world] - flow.warm_up) * flow.period / 60.0
    for k in range(1, LEFT):
        rate[k] = tally[k] / minutes
    rate[MEAN_TRANSIT] = flow.period * tally[TRANSIT] / max(tally[LEFT], 1)
    rate[MEAN_LOAD] = tally[ON_TABLE] / tally[STEPS]


@borrowing
def update_relations(flow, state, world):
    """Bring the relations of a world up to date, and what ``info`` says of them."""
    clearance, touching = relate_world(flow.context, state.pose, state.fallen, world)
    episode = flow.context.episode
    episode.number[world, SMALLEST_GAP], episode.count[world, IN_TOUCH] = clearance, touching


@borrowing
def begin_arrived(flow, state, world):
    """After arrivals: relations, and what the rewards of those who have come will be held against."""
    episode = flow.context.episode
    update_relations(flow, state, world)
    for part in range(state.fallen.shape[1]):
        if episode.arrived[world, part]:
            episode.event[world, part] = STAYS
            reward_part(flow.context, world, part)
            episode.part_reward[world, part] = 0.0
            for k in range(episode.part_terms.shape[2]):
                episode.part_terms[world, part, k] = 0.0


@borrowing
def begin_flow(state, flow, worlds, pools):
    """Start the episodes of ``worlds`` (n,), whose keys are set, with the parts of ``pools`` (n, parts).

    Parts whose centres are on the table are present at once. No other part arrives at the start if there are any.

    Args:
        state: address of the pinned true state, in which parts of the pool have the velocity of those that slide in place.
        flow: address of a pinned :class:`Flow`.
    """
    true, all_of = state_at(state), flow_at(flow)
    episode, parts = all_of.context.episode, pools.shape[1]
    for k in range(worlds.shape[0]):
        world, begun = worlds[k], 0
        all_of.clock[world] = all_of.tried[world] = 0
        for part in range(parts):
            all_of.pool[world, part] = pools[k, part]
            episode.arrived[world, part] = all_of.changed[world, part] = all_of.there[world, part] = False
            episode.event[world, part], all_of.age[world, part] = STAYS, 0
            episode.part_fallen[world, part], episode.part_reward[world, part] = False, 0.0
            for term in range(episode.terms.shape[1]):
                episode.part_terms[world, part, term] = 0.0
            for axis in range(3):
                all_of.idle[world, part, axis] = true.velocity[world, part, axis]
            x, y = true.pose[world, part, 0], true.pose[world, part, 1]
            if pools[k, part] and x >= 0.0 and y >= 0.0:
                episode.present[world, part] = episode.arrived[world, part] = True
                begun += 1
            else:
                remove_part(all_of, true, world, part)
        for gate in range(all_of.last.shape[1]):
            all_of.last[world, gate] = -all_of.headway
        for column in range(all_of.tally.shape[1]):
            all_of.tally[world, column] = 0
        for column in range(all_of.rate.shape[1]):
            all_of.rate[world, column] = 0.0
        for flag in (DOWN, SUCCEEDED, ENDED, BARRED):
            episode.flag[world, flag] = False
        for number in (REWARD, POSITION_ERROR, HEADING_ERROR):
            episode.number[world, number] = 0.0
        episode.count[world, HELD] = episode.count[world, PARTS_DONE] = 0
        for term in range(episode.terms.shape[1]):
            episode.terms[world, term] = 0.0
        if begun == 0:
            add_waiting(all_of, true, world, parts)
        begin_arrived(all_of, true, world)


@borrowing
def score_flow(state, flow, periods, worlds):
    """Score one step of some worlds, take parts away that leave, and let others in; see :func:`begin_flow`."""
    true, all_of = state_at(state), flow_at(flow)
    for k in range(worlds.shape[0]):
        world = worlds[k]
        all_of.clock[world] += periods
        for part in range(true.fallen.shape[1]):
            all_of.age[world, part] += periods
        update_relations(all_of, true, world)
        evaluate_parts(all_of, true, world)
        gone = remove_leaving(all_of, true, world)
        if add_waiting(all_of, true, world, periods) > 0:
            begin_arrived(all_of, true, world)
        elif gone:
            update_relations(all_of, true, world)
        update_rates(all_of, world)
        all_of.context.episode.flag[world, ENDED] = true.diverged[world]
