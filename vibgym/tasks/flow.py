"""Episodes in which parts arrive and leave: events of parts and rates per minute, which parts arrive, and where.

Each index of a part is a slot. A part leaves at the end of the step in which its centre enters a gate or in which it falls, and
gets the reward of this step. In a later step an equal part arrives in its slot.

All draws follow from the key of the episode and counters: the poses from the number of attempts, and with given probabilities
the part that is next from the number of arrivals, so that it stays next until it has a slot and room.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym import checks
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout
from vibgym.physics.contacts.hulls import place_hulls
from vibgym.physics.core.noise import uniforms
from vibgym.physics.core.records import state_at
from vibgym.scene.parts import Part, kinds_of
from vibgym.scene.surface import Surface
from vibgym.tasks.episode import (
    ENDED,
    EVENTS,
    IN_TOUCH,
    LEFT_GOOD,
    LOST,
    PARTS_DONE,
    REWARD,
    SMALLEST_GAP,
    STAYS,
    TILTED,
    TOO_CLOSE,
    TURNED,
    WRONG,
    Context,
    average_terms,
    relate_world,
    reward_part,
    reward_parts,
    smallest_gap,
)
from vibgym.tasks.starts import CLEAR, TRIES, Room, heap, is_clear, lattice

INLET = (0.020, 0.055)
"""m, least and largest x of the centres of parts that arrive one at a time."""

HEAP_LENGTH = 0.200
"""m along x in which heaps arrive."""

ROUNDED = 1e-3
"""Largest deviation of the sum of probabilities from 1, of numbers that have been rounded."""

WHICH, WHERE, HEAPED, DRAWN = 17, 18, 19, 20
"""Third word of a counter, by the purpose of a random number."""


class Inlet(NamedTuple):
    """Region in which parts arrive, and scratch memory."""

    low: float  # m, least and largest x of the centres of parts that arrive one at a time
    high: float
    heap: int  # parts that arrive at once, in touch; 1: they arrive one at a time
    most: int  # parts on the table at once
    group: np.ndarray  # (parts,) int64, which different part a slot is for
    cumulative: np.ndarray  # (groups,) probabilities of arrivals, summed up; empty: any slot that is empty may be next
    room: Room  # of a heap, from the left border on
    numbers: np.ndarray  # scratch: (parts, TRIES, 2)
    order: np.ndarray  # scratch: (parts,) int64
    chance: np.ndarray  # scratch: (parts,)
    pose: np.ndarray  # scratch: (parts, 3)


@jit
def shuffle_waiting(inlet, key, tried, waiting):
    """Write the waiting parts into ``order``, shuffled; returns their number."""
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


@jit
def choose_drawn(inlet, key, arrivals, count):
    """Draw the parts that arrive next by their probabilities, and move an empty slot for each to the front of ``order``.

    The draw depends on the number of arrivals alone: a part without a slot or room is next until it arrives.

    Args:
        arrivals: number of parts that have arrived in this episode.  count: of empty slots, in ``order``.

    Returns:
        Whether each of the next ``heap`` parts has an empty slot.
    """
    order, cumulative = inlet.order, inlet.cumulative
    for k in range(inlet.heap):
        value, _, _, _ = uniforms(key, arrivals + k, 0, DRAWN, 0)
        group, at = 0, k
        while group + 1 < cumulative.shape[0] and value >= cumulative[group]:
            group += 1
        while at < count and inlet.group[order[at]] != group:
            at += 1
        if at == count:
            return False
        order[k], order[at] = order[at], order[k]
    return True


@jit
def find_free_pose(inlet, hulls, placed, key, tried, present, pose):
    """Draw a free pose for the part ``order[0]``, into ``inlet.pose``; returns whether one has been found.

    Args:
        hulls, placed: of all parts; those that are present have been placed.
        present: (parts,) bool.  pose: (parts, 3).
    """
    order, own, part, room = inlet.order, inlet.pose, inlet.order[0], inlet.room
    count = 0
    for other in range(present.shape[0]):
        if present[other]:
            order[count] = other
            count += 1
            own[other, 0], own[other, 1] = pose[other, 0], pose[other, 1]
    order[count] = part
    for t in range(TRIES):
        u, v, turn, _ = uniforms(key, tried, t, WHERE, 0)
        own[part, 0] = inlet.low + (inlet.high - inlet.low) * u
        own[part, 1] = hulls.radius[part] + (room.depth - 2.0 * hulls.radius[part]) * v
        own[part, 2] = math.pi * (2.0 * turn - 1.0)
        place_hulls(hulls, part, own[part, 0], own[part, 1], own[part, 2], placed)
        if is_clear(hulls, placed, own, order, count, room.clear):
            order[0] = part
            return True
    return False


@jit
def draw_heap(inlet, hulls, placed, key, tried, present, pose):
    """Draw the poses of a heap of the parts ``order[:inlet.heap]``, into ``inlet.pose``; returns False if its room is occupied.

    Args: as for :func:`find_free_pose`.
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


@jit
def draw_arrivals(inlet, hulls, placed, key, tried, arrivals, waiting, present, pose):
    """Draw which waiting parts arrive, and their poses; returns their number.

    They are the first ones of ``inlet.order``, at ``inlet.pose``.

    Args:
        key: (2,) of the episode.  tried: number of previous draws.  arrivals: number of parts that have arrived.
        waiting, present: (parts,) bool.  pose: (parts, 3) of present parts.
    """
    count = shuffle_waiting(inlet, key, tried, waiting)
    if count < inlet.heap or present.sum() + inlet.heap > inlet.most:
        return 0
    if inlet.cumulative.shape[0] > 0 and not choose_drawn(inlet, key, arrivals, count):
        return 0
    if inlet.heap > 1:
        return inlet.heap if draw_heap(inlet, hulls, placed, key, tried, present, pose) else 0
    return 1 if find_free_pose(inlet, hulls, placed, key, tried, present, pose) else 0


def new_inlet(
    surface: Surface, parts: Sequence[Part], together: int, probabilities: Sequence[float] | None, most: int | None
) -> Inlet:
    """Return an inlet at the left border for heaps of so many parts; other arguments are settings of Feed.

    Raises:
        ValueError: a heap of more parts than there are, than there is certainly room for, or than a part has slots if it is
            drawn; no probabilities of the different parts.
    """
    count, radius, length = len(parts), max(part.radius for part in parts), HEAP_LENGTH
    if together > count:
        raise checks.refuse("task_settings.heap", together, f"a whole number <= {count}, the number of parts")
    most = count if most is None else most
    if not together <= most <= count:
        allowed = f"a whole number >= {together} and <= {count}, the number of parts"
        raise checks.refuse("task_settings.most", most, allowed)
    cells = lattice(np.zeros(2), np.array([length, surface.depth]), radius, 0.0)
    if together > 1 and len(cells) < together:
        allowed = f"at most {len(cells)} parts of radius {radius:.4g} m on {length:g} x {surface.depth:g} m at the left border"
        raise checks.refuse("task_settings.heap", together, allowed)
    if 2.0 * radius > surface.depth:
        got = f"a part of radius {radius:.4g} m"
        raise checks.refuse("parts", got, f"at most {surface.depth / 2:g} m on this surface")
    kinds, group = kinds_of(parts, lambda one, other: one.name == other.name and one.same_as(other))
    inlet = Inlet(
        *INLET, together, most, group, _cumulative(probabilities, kinds), Room(length, surface.depth, cells, CLEAR),
        np.zeros((count, TRIES, 2)), np.zeros(count, dtype=np.int64), np.zeros(count), np.zeros((count, 3)),
    )  # fmt: skip
    check_slots("parts", inlet, np.ones((1, count), dtype=bool))
    return inlet


def _cumulative(probabilities: Sequence[float] | None, kinds: Sequence[Part]) -> np.ndarray:
    """Return the sums of the probabilities of different parts, (kinds,); empty for None."""
    if probabilities is None:
        return np.zeros(0)
    name, names = "task_settings.probabilities", ", ".join(part.name for part in kinds)
    if len(probabilities) != len(kinds):
        raise checks.refuse(name, probabilities, f"{len(kinds)} numbers, one for each different part: {names}")
    total = sum(probabilities)
    if abs(total - 1.0) > ROUNDED:
        raise checks.refuse(name, f"a sum of {total:.6g}", f"a sum of 1, within {ROUNDED:g}")
    return np.cumsum(probabilities) / total


def check_slots(name: str, inlet: Inlet, there: np.ndarray) -> None:
    """Check that every part that may be drawn has slots for a heap of it alone, without which it would never arrive.

    Args:
        name: of the argument, for errors.
        there: (n, parts) bool, slots that are in use.

    Raises:
        ValueError: too few slots.
    """
    for group in range(len(inlet.cumulative)):
        fewest = int(there[:, inlet.group == group].sum(axis=1).min(initial=inlet.heap))
        if fewest < inlet.heap:
            first = int((inlet.group == group).argmax())
            allowed = f"at least {inlet.heap}, which may be drawn for one heap" if inlet.heap > 1 else "at least 1"
            raise checks.refuse(name, f"{fewest} slots for parts equal to parts[{first}]", allowed)


LEFT, TRANSIT, ON_TABLE, STEPS = len(EVENTS), len(EVENTS) + 1, len(EVENTS) + 2, len(EVENTS) + 3
"""Columns of :attr:`Flow.tally` after those of the events."""

MEAN_TRANSIT, MEAN_LOAD = len(EVENTS), len(EVENTS) + 1
"""Columns of :attr:`Flow.rate` after those of the events."""


class Flow(NamedTuple):
    """Arrivals and departures in all worlds, pinned in memory and changed in place."""

    clock: np.ndarray  # (worlds,) int64, periods since the episode's start
    key: np.ndarray  # (worlds, 2) int64 of its random numbers
    tried: np.ndarray  # (worlds,) int64, draws of arrivals
    arrivals: np.ndarray  # (worlds,) int64, parts that have arrived
    pool: np.ndarray  # (worlds, parts) bool, parts of this episode, on the table or not
    there: np.ndarray  # (worlds, parts) bool, parts that were on the table in this step
    changed: np.ndarray  # (worlds, parts) bool, parts that have arrived or left in this step
    age: np.ndarray  # (worlds, parts) int64, periods since the part's arrival
    last: np.ndarray  # (worlds, kinds) int64, when a part has last left through each gate
    # (worlds, ...) int64 since the warm-up: parts by event, all that left, sum of their periods, sum over steps of the parts on
    # the table, steps
    tally: np.ndarray
    # (worlds, ...) since the warm-up: parts a minute by event, mean transit (s), mean parts on the table
    rate: np.ndarray
    idle: np.ndarray  # (worlds, parts, 3) velocity of a part that slides in place
    gate: np.ndarray  # (kinds, 4) m: x_low, y_low, x_high, y_high
    kind: np.ndarray  # (parts,) int64, index of each part's gate
    away: np.ndarray  # (3,) pose of parts that are not on the table
    spacing: float  # m, required distance of a part that leaves to the nearest other
    headway: int  # periods between parts that leave through the same gate
    warm_up: int  # periods that do not count
    period: float  # s
    inlet: Inlet
    context: Context


CHANGING = Flow._fields[: Flow._fields.index("gate")]
"""Fields that change during an episode."""

FLOW: Layout[Flow] = Layout("FLOW", __name__)
flow_at = FLOW.at


@jit
def gate_of(flow, x, y):
    """Return the gate that contains a point; -1: none."""
    gate = flow.gate
    for k in range(gate.shape[0]):
        if gate[k, 0] <= x and x <= gate[k, 2] and gate[k, 1] <= y and y <= gate[k, 3]:
            return k
    return -1


@jit
def event_of(flow, state, world, part, straight, apart):
    """Return the event of a present part in this step, see :data:`vibgym.tasks.episode.EVENTS`."""
    if state.fallen[world, part]:
        return LOST
    gate = gate_of(flow, state.pose[world, part, 0], state.pose[world, part, 1])
    if gate < 0:
        return STAYS
    since = flow.clock[world] - flow.last[world, gate]
    flow.last[world, gate] = flow.clock[world]
    if gate != flow.kind[part]:
        return WRONG
    if not straight:
        return TILTED
    return LEFT_GOOD if apart and since >= flow.headway else TOO_CLOSE


@jit
def evaluate_parts(flow, state, world):
    """Compute event and reward of every part of a world; relations must be up to date."""
    episode, done, slots = flow.context.episode, 0, 0
    relations, rules = flow.context.relations, flow.context.rules
    for part in range(state.fallen.shape[1]):
        here = episode.present[world, part]
        straight = abs(relations.error[world, part, 2]) <= rules.tolerance[part, TURNED]
        apart = relations.gap[world, part] >= flow.spacing
        flow.there[world, part], episode.arrived[world, part] = here, False
        episode.event[world, part] = event_of(flow, state, world, part, straight, apart) if here else STAYS
        flow.context.fits[part] = here and straight and apart
        at_own = gate_of(flow, flow.gate[flow.kind[part], 0], state.pose[world, part, 1]) == flow.kind[part]
        episode.done[world, part] = flow.context.fits[part] and at_own
        done += episode.done[world, part]
        slots += flow.pool[world, part]
    reward_parts(flow.context, state.fallen, False, world)
    slots = min(slots, flow.inlet.most)
    episode.number[world, REWARD] = average_terms(
        episode.part_terms[world], flow.there[world], slots, rules.worst, episode.terms[world]
    )
    episode.count[world, PARTS_DONE] = done


@jit
def remove_part(flow, state, world, part):
    """Remove a part from the table."""
    for k in range(3):
        state.pose[world, part, k] = flow.away[k]
        state.velocity[world, part, k] = state.mean_velocity[world, part, k] = 0.0
    state.pushed[world, part, 0] = state.pushed[world, part, 1] = 0.0
    state.fallen[world, part], state.sticking[world, part] = True, False
    flow.context.episode.present[world, part] = flow.context.episode.done[world, part] = False


@jit
def place_part(flow, state, world, part, pose):
    """Place a part on the table at a pose (3,), where it slides in place."""
    for k in range(3):
        state.pose[world, part, k] = pose[k]
        state.velocity[world, part, k], state.mean_velocity[world, part, k] = flow.idle[world, part, k], 0.0
    state.fallen[world, part] = state.sticking[world, part] = state.doubtful[world, part] = False
    episode = flow.context.episode
    episode.present[world, part] = episode.arrived[world, part] = True
    flow.age[world, part] = 0


@jit
def remove_leaving(flow, state, world):
    """Remove and count the parts that leave in this step; returns whether there are any."""
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


@jit
def add_waiting(flow, state, world, most):
    """Let up to ``most`` parts or heaps arrive; returns the number of parts that have arrived."""
    inlet, context, pose, before = flow.inlet, flow.context, state.pose[world], flow.arrivals[world]
    present, placed, hulls = context.episode.present[world], context.placed, context.hulls
    waiting = context.fits
    for _ in range(most):
        for part in range(present.shape[0]):  # a slot is not refilled in the step in which its part left
            waiting[part] = flow.pool[world, part] and not present[part] and not flow.changed[world, part]
            if present[part]:
                place_hulls(hulls, part, pose[part, 0], pose[part, 1], pose[part, 2], placed)
        key, tried, arrivals = flow.key[world], flow.tried[world], flow.arrivals[world]
        count = draw_arrivals(inlet, hulls, placed, key, tried, arrivals, waiting, present, pose)
        flow.tried[world] += 1
        if count == 0:
            break
        for k in range(count):
            place_part(flow, state, world, inlet.order[k], inlet.pose[inlet.order[k]])
        flow.arrivals[world] += count
    for part in range(present.shape[0]):
        if context.episode.arrived[world, part]:
            flow.changed[world, part] = True
    return flow.arrivals[world] - before


@jit
def update_rates(flow, world):
    """Update rates and means."""
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


@jit
def update_relations(flow, state, world):
    """Update the relations of a world, and the fields of ``info`` that depend on them."""
    context, episode = flow.context, flow.context.episode
    episode.count[world, IN_TOUCH] = relate_world(context, state.pose, state.fallen, world)
    episode.number[world, SMALLEST_GAP] = smallest_gap(context.relations, world)


@jit
def begin_arrived(flow, state, world):
    """Update relations after arrivals, and the values with which the next step of the new parts is compared."""
    episode = flow.context.episode
    update_relations(flow, state, world)
    for part in range(state.fallen.shape[1]):
        if episode.arrived[world, part]:
            episode.event[world, part] = STAYS
            reward_part(flow.context, world, part)
            episode.part_reward[world, part], episode.part_terms[world, part] = 0.0, 0.0


@jit
def begin_flow(state, flow, worlds):
    """Start the episodes of ``worlds`` (n,), whose arrays have been reset.

    Parts of the pool whose centres are on the table are present. If there are none, parts arrive.

    Args:
        state: address of the pinned true state.
        flow: address of a pinned :class:`Flow`.
    """
    true, all_of = state_at(state), flow_at(flow)
    episode, parts = all_of.context.episode, all_of.pool.shape[1]
    for k in range(worlds.shape[0]):
        world, begun = worlds[k], 0
        for part in range(parts):
            x, y = true.pose[world, part, 0], true.pose[world, part, 1]
            if all_of.pool[world, part] and x >= 0.0 and y >= 0.0:
                episode.present[world, part] = episode.arrived[world, part] = True
                begun += 1
            else:
                remove_part(all_of, true, world, part)
        if begun == 0:
            add_waiting(all_of, true, world, parts)
        begin_arrived(all_of, true, world)


@jit
def score_flow(state, flow, periods, worlds):
    """Score one step of some worlds, remove the parts that leave and add those that arrive; see :func:`begin_flow`."""
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
