"""Episodes in which parts arrive and leave: events of parts, and rates per minute.

Each index of a part is a slot. A part leaves at the end of the step in which its centre enters a gate or in which it falls, and
gets the reward of this step. In a later step an equal part arrives in its slot.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout
from vibgym.physics.contacts.hulls import place_hulls
from vibgym.physics.core.records import state_at
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
    relate_gaps,
    relate_to_goals,
    reward_part,
    smallest_gap,
)
from vibgym.tasks.inlet import Inlet, draw_arrivals

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
    rate: (
        np.ndarray
    )  # (worlds, ...) since the warm-up: parts a minute by event, mean transit (s), mean parts on the table
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
def is_straight_and_apart(flow, world, part):
    """Return whether a part is straight and far enough from the others to leave; relations must be up to date."""
    relations, rules = flow.context.relations, flow.context.rules
    return abs(relations.error[world, part, 2]) <= rules.tolerance[part, TURNED] and (
        relations.gap[world, part] >= flow.spacing
    )


@jit
def event_of(flow, state, world, part):
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
    context = flow.context
    if abs(context.relations.error[world, part, 2]) > context.rules.tolerance[part, TURNED]:
        return TILTED
    if context.relations.gap[world, part] < flow.spacing or since < flow.headway:
        return TOO_CLOSE
    return LEFT_GOOD


@jit
def evaluate_parts(flow, state, world):
    """Compute event and reward of every part of a world."""
    episode, done, slots = flow.context.episode, 0, 0
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
        episode.part_reward[world, part], episode.part_terms[world, part] = 0.0, 0.0
        if here:
            reward_part(flow.context, world, part)
    slots = min(slots, flow.inlet.most)
    episode.number[world, REWARD] = average_terms(
        episode.part_terms[world], flow.there[world], slots, flow.context.rules.worst, episode.terms[world]
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
    episode.count[world, IN_TOUCH] = relate_gaps(context, state.pose, state.fallen, world)
    episode.number[world, SMALLEST_GAP] = smallest_gap(context.relations, world)
    relate_to_goals(context, state.pose, world)


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
def begin_flow(state, flow, worlds, pools):
    """Start the episodes of ``worlds`` (n,), whose keys are set, with the parts of ``pools`` (n, parts).

    Parts whose centres are on the table are present. If there are none, parts arrive.

    Args:
        state: address of the pinned true state, with the velocities of parts that slide in place.
        flow: address of a pinned :class:`Flow`.
    """
    true, all_of = state_at(state), flow_at(flow)
    episode, parts = all_of.context.episode, pools.shape[1]
    for k in range(worlds.shape[0]):
        world, begun = worlds[k], 0
        all_of.clock[world], all_of.tried[world], all_of.arrivals[world], all_of.age[world] = 0, 0, 0, 0
        all_of.there[world], all_of.changed[world], all_of.last[world] = False, False, -all_of.headway
        all_of.tally[world], all_of.rate[world] = 0, 0.0
        episode.arrived[world], episode.event[world], episode.part_fallen[world] = False, STAYS, False
        episode.part_reward[world], episode.part_terms[world], episode.terms[world] = 0.0, 0.0, 0.0
        episode.number[world], episode.count[world], episode.flag[world] = 0.0, 0, False
        for part in range(parts):
            all_of.pool[world, part] = pools[k, part]
            for axis in range(3):
                all_of.idle[world, part, axis] = true.velocity[world, part, axis]
            x, y = true.pose[world, part, 0], true.pose[world, part, 1]
            if pools[k, part] and x >= 0.0 and y >= 0.0:
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
