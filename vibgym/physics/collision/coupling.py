"""Parts in touch: the contact solver of another library (pymunk), coupled to friction within the period.

Friction moves the parts for a short while as if they were alone; then the solver changes their velocities by the impulses of
the contacts, and their positions as far as they overlap. The solver only sees contacts once outlines overlap, so the while is
cut short whenever parts would run into one another by more than a small overlap: fast parts meet at the right time and
place and never pass through one another, and parts at rest against one another do not need short steps. In a while in which
nothing can touch, the solver is not called.

The solver starts each world's period afresh from poses and velocities: it keeps nothing from one period to the next, so a
state is restored by these alone, and results do not depend on which worlds it saw before.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.physics.collision.broad_phase import near_pairs, pair_capacity, pair_gap
from vibgym.physics.collision.hulls import A_FACE, B_FACE, BOTTOM, LEFT, RIGHT, farthest, hull_contact, place_hulls
from vibgym.physics.collision.solver import JOLT, forget_blows, leave, resolve
from vibgym.physics.contact_area.pressure_moments import LANES, MOMENT_ROWS, PIECE_FIELDS
from vibgym.physics.core.jit import borrowing, jit
from vibgym.physics.core.records import body_of
from vibgym.physics.friction.by_points import careful_span, contact_for, cuts_needed
from vibgym.physics.friction.planar import bundle_moments, cut_lane, kutta_lanes, limits, place_ahead

FAST, SLOWLY = 0.02, 10.0
"""m/s; where parts come together more slowly, so many times the overlap of a blow is allowed."""

SHORTEST = 1.0 / 2048.0
"""Length of the shortest step of the coupling, as a share of the longest."""

RESTING = 0.01
"""m/s; parts that come together more slowly at the start of a step rest against one another, and do not rebound from what
friction's acceleration adds in it: they would chatter without end. A rebound of this speed is over after 10 um."""

CONTACT_FROM = 2e-6
"""m of overlap from which the solver, whose shapes are a little smaller, sees a contact."""


class Workshop(NamedTuple):
    """Working arrays for one world; parts stand in lanes, eight a group."""

    pose: np.ndarray  # (groups, flat (3, lane))
    velocity: np.ndarray
    old_pose: np.ndarray
    old_velocity: np.ndarray
    own: np.ndarray  # (groups, flat (4, lane)), see kutta_lanes
    moments: np.ndarray  # (groups, flat (row, lane))
    spare: np.ndarray
    share: np.ndarray  # (groups, lane)
    held: np.ndarray  # (groups, lane)
    most_square: np.ndarray  # (parts,) see limits
    slow_rate: np.ndarray  # (parts,) m/s^2, slip below this times a substep is small
    pieces: np.ndarray  # (groups, flat (piece, field, lane))
    rows: np.ndarray
    columns: np.ndarray
    known: np.ndarray  # (parts, slots, slots)
    known_c: np.ndarray
    known_s: np.ndarray
    careful: np.ndarray  # (parts,) bool
    stale: np.ndarray  # (parts,) bool: to be cut again
    placed: np.ndarray  # (corners, 4)
    settled: np.ndarray  # (parts, 3) poses before overlaps are undone
    speed: np.ndarray  # (parts, 3) velocities, for the list of pairs
    reach: np.ndarray  # (parts,) see near_pairs
    order: np.ndarray  # (parts,)
    close: np.ndarray  # (pairs,) bool: may touch in this step


@jit
def new_workshop(table, bodies, hulls):
    """Working arrays for the worlds of a call."""
    parts = bodies.kind.shape[0]
    groups = (parts + LANES - 1) // LANES
    across = int(2.0 * bodies.radius.max() / table.element_size) + 3
    slots = 1
    while slots < across:
        slots *= 2
    most_square, slow_rate = np.empty(parts), np.empty(parts)
    for p in range(parts):
        most_square[p], least_square = limits(table, body_of(bodies, bodies.kind[p]), 1.0)
        slow_rate[p] = math.sqrt(least_square)
    return Workshop(
        np.zeros((groups, 3 * LANES)), np.zeros((groups, 3 * LANES)),
        np.zeros((groups, 3 * LANES)), np.zeros((groups, 3 * LANES)), np.zeros((groups, 4 * LANES)),
        np.zeros((groups, MOMENT_ROWS * LANES)), np.zeros(MOMENT_ROWS * LANES),
        np.zeros((groups, LANES)), np.zeros((groups, LANES), np.int64), most_square, slow_rate,
        np.zeros((groups, (across * across + 1) * PIECE_FIELDS * LANES)),
        np.zeros(across * across, np.int64), np.zeros(across * across, np.int64),
        np.zeros((parts, slots, slots), np.int64), np.zeros((parts, slots, slots)), np.zeros((parts, slots, slots)),
        np.zeros(parts, np.bool_), np.zeros(parts, np.bool_), np.zeros(hulls.corner.shape),
        np.zeros((parts, 3)), np.zeros((parts, 3)), np.zeros(parts), np.zeros(parts, np.int64),
        np.zeros(pair_capacity(parts), np.bool_),
    )  # fmt: skip


@borrowing
def safe_step(table, bodies, hulls, overlap, pairs, n, away, shop, h, shortest):
    """How long friction may go on alone, at most ``h`` s, and whether anything may touch by then: ``shop.close``.

    Args:
        overlap: m that velocities may add to the overlap of two parts. What friction's acceleration adds in a step, at most
            ``2 mu g h^2``, is for ``h`` to keep small.
        h, shortest: s, longest and shortest step.

    Returns:
        That time, s; whether any pair may touch; and whether such a pair comes together faster than ``RESTING``.
    """
    pose, velocity, placed = shop.pose, shop.velocity, shop.placed
    touching, blow = False, False
    shop.close[:n] = False
    width, height = table.columns * table.element_size, table.rows * table.element_size
    for pair in range(n):
        i, j = pairs[pair, 0], pairs[pair, 1]
        if away[i] or (j >= 0 and away[j]):
            continue
        gi, li = i // LANES, i % LANES
        xi, yi = pose[gi, li], pose[gi, LANES + li]
        ui, wi, si = velocity[gi, li], velocity[gi, LANES + li], velocity[gi, 2 * LANES + li]
        pull = 2.0 * bodies.friction[bodies.kind[i]] * table.gravity
        if j < 0:
            pull += si * si * hulls.radius[i]
            nx, ny, border = 0.0, 0.0, 0.0
            if j == -1 - LEFT:
                nx = -1.0
            elif j == -1 - RIGHT:
                nx, border = 1.0, width
            elif j == -1 - BOTTOM:
                ny = -1.0
            else:
                ny, border = 1.0, height
            if border - (nx * xi + ny * yi) > hulls.radius[i] + (nx * ui + ny * wi) * h + 0.5 * pull * h * h:
                continue
            for a in range(hulls.owner[i], hulls.owner[i + 1]):
                gap = border - farthest(hulls, placed, a, nx, ny, xi, yi, ui, wi, si, 0.0)
                later = border - farthest(hulls, placed, a, nx, ny, xi, yi, ui, wi, si, h)
                if later < 0.5 * pull * h * h:
                    touching = shop.close[pair] = True
                    blow = blow or gap - later > RESTING * h
                least = min(gap, 0.0) - (overlap if gap - later > FAST * h else SLOWLY * overlap)
                if later < least:
                    h = max(h * (gap - least) / (gap - later), shortest)
            continue
        gj, lj = j // LANES, j % LANES
        xj, yj = pose[gj, lj], pose[gj, LANES + lj]
        uj, wj, sj = velocity[gj, lj], velocity[gj, LANES + lj], velocity[gj, 2 * LANES + lj]
        pull += 2.0 * bodies.friction[bodies.kind[j]] * table.gravity
        # What straight lines leave out: friction's acceleration, and the circles on which points of spinning parts go.
        pull += si * si * hulls.radius[i] + sj * sj * hulls.radius[j]
        bow = 0.5 * pull * h * h
        dx, dy, du, dw = xj - xi, yj - yi, uj - ui, wj - wi
        clear = hulls.radius[i] + hulls.radius[j] + math.sqrt(du * du + dw * dw) * h + bow
        if dx * dx + dy * dy > clear * clear:
            continue
        for a in range(hulls.owner[i], hulls.owner[i + 1]):
            for b in range(hulls.owner[j], hulls.owner[j + 1]):
                gap, nx, ny, owner = hull_contact(hulls, placed, a, b)
                # An edge takes its normal along when its part turns: seen from there, only the other hull moves.
                if owner == A_FACE:
                    vx, vy = du - sj * (yi - yj), dw + sj * (xi - xj)
                    now = farthest(hulls, placed, b, -nx, -ny, xi, yi, vx, vy, sj - si, 0.0)
                    later = gap + now - farthest(hulls, placed, b, -nx, -ny, xi, yi, vx, vy, sj - si, h)
                elif owner == B_FACE:
                    vx, vy = -du - si * (yj - yi), -dw + si * (xj - xi)
                    now = farthest(hulls, placed, a, nx, ny, xj, yj, vx, vy, si - sj, 0.0)
                    later = gap + now - farthest(hulls, placed, a, nx, ny, xj, yj, vx, vy, si - sj, h)
                else:
                    later = -farthest(hulls, placed, b, -nx, -ny, xj, yj, uj, wj, sj, h)
                    later -= farthest(hulls, placed, a, nx, ny, xi, yi, ui, wi, si, h)
                if later < bow:
                    touching = shop.close[pair] = True
                    blow = blow or gap - later > RESTING * h
                least = min(gap, 0.0) - (overlap if gap - later > FAST * h else SLOWLY * overlap)
                if later < least:
                    # The gap along a fixed direction is concave in time: its chord is met too early, never too late.
                    h = max(h * (gap - least) / (gap - later), shortest)
    return h, touching, blow


@borrowing
def smallest_gap(table, hulls, pairs, n, shop):
    """Gap of the closest of the pairs that may touch, where the parts are placed now, m."""
    smallest = math.inf
    for pair in range(n):
        if shop.close[pair]:
            smallest = min(smallest, pair_gap(table, hulls, shop.placed, pairs[pair, 0], pairs[pair, 1]))
    return smallest


@borrowing
def place_parts(hulls, away, shop):
    """Place the hulls of all parts that are on the table."""
    for p in range(away.shape[0]):
        if not away[p]:
            at, lane = shop.pose[p // LANES], p % LANES
            place_hulls(hulls, p, at[lane], at[LANES + lane], at[2 * LANES + lane], shop.placed)


@jit
def cut_stale(table, bodies, drive, world, scheme, contact, state, away, shop, left):
    """Cut what lies under every stale part where it will be after half of ``left`` s, and bring its moments up to date."""
    parts = away.shape[0]
    stale, careful, held, share = shop.stale, shop.careful, shop.held, shop.share
    outline_x, outline_y, cells, box = contact.outline_x, contact.outline_y, contact.cells, contact.box
    rows, columns = shop.rows, shop.columns
    for g in range(shop.pose.shape[0]):
        pose, velocity, pieces = shop.pose[g], shop.velocity[g], shop.pieces[g]
        cut = False
        for lane in range(min(LANES, parts - g * LANES)):
            p = g * LANES + lane
            if not stale[p] or away[p]:
                continue
            stale[p] = False
            cut = True
            body = body_of(bodies, bodies.kind[p])
            corners = body.outline.shape[0]
            vx, vy, spin = velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane]
            x, y = pose[lane] + 0.5 * left * vx, pose[LANES + lane] + 0.5 * left * vy
            heading = pose[2 * LANES + lane] + 0.5 * left * spin
            fate = place_ahead(table, body, x, y, heading, outline_x[:corners], outline_y[:corners])
            if fate == 1:  # it may be stopped before it gets there: only where it is now counts
                x, y, heading = pose[lane], pose[LANES + lane], pose[2 * LANES + lane]
                fate = place_ahead(table, body, x, y, heading, outline_x[:corners], outline_y[:corners])
            held[g, lane], share[g, lane] = 0, 0.0
            if fate == 0:
                careful[p] = scheme.pieces > 0 or cuts_needed(table, left, vx, vy, spin) > 1
                held[g, lane], share[g, lane] = cut_lane(
                    table, body, drive, world, lane, x, y, outline_x[:corners], outline_y[:corners], cells, box,
                    pieces, rows, columns, shop.known[p], shop.known_c[p], shop.known_s[p],
                )  # fmt: skip
                if held[g, lane] == 0:
                    fate = 1
            if fate > 0:
                away[p] = True
                state.fallen[world, p] = fate == 1
                state.diverged[world] = state.diverged[world] or fate == 2
        if cut:
            moments = shop.moments[g]
            held_by = bundle_moments(table, pieces, held[g], share[g], moments, shop.spare, scheme.lanes)
            for k in range(MOMENT_ROWS * LANES):
                moments[k] = held_by[k]


@jit
def rub_carefully(table, bodies, drive, world, scheme, contact, state, away, shop, phase, h, substeps, p):
    """What :func:`rub` does in ``substeps`` of ``h`` s, for part ``p`` alone and by contact points."""
    body = body_of(bodies, bodies.kind[p])
    pose, velocity, lane = shop.pose[p // LANES], shop.velocity[p // LANES], p % LANES
    x, y, heading, vx, vy, spin, stuck, supported = careful_span(
        table, body, scheme.pieces, drive, world, phase, substeps * h, substeps, contact_for(contact, body),
        pose[lane], pose[LANES + lane], pose[2 * LANES + lane],
        velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane], state.sticking[world, p],
    )  # fmt: skip
    pose[lane], pose[LANES + lane], pose[2 * LANES + lane] = x, y, heading
    velocity[lane], velocity[LANES + lane], velocity[2 * LANES + lane] = vx, vy, spin
    state.sticking[world, p] = stuck
    if not supported:
        away[p] = True
        state.fallen[world, p] = True


@borrowing
def rub(table, bodies, drive, world, scheme, contact, state, away, shop, phase, h):
    """Let friction alone move all parts for ``h`` s from ``phase = w t`` on, in the scheme's Runge-Kutta steps or shorter."""
    parts = away.shape[0]
    substeps = int(math.ceil(h * scheme.steps * scheme.substeps / table.period - 1e-9))
    h /= substeps
    third = 2.0 * math.pi / table.period * h / 3.0
    for g in range(shop.pose.shape[0]):
        pose, velocity, own = shop.pose[g], shop.velocity[g], shop.own[g]
        old_pose, old_velocity = shop.old_pose[g], shop.old_velocity[g]
        for k in range(3 * LANES):
            old_pose[k], old_velocity[k] = pose[k], velocity[k]
        for lane in range(LANES):
            own[lane], own[LANES + lane] = 0.0, math.inf
        for k in range(substeps):
            at = phase + 3 * k * third
            c = math.cos(at), math.cos(at + third), math.cos(at + 2.0 * third), math.cos(at + 3.0 * third)
            s = math.sin(at), math.sin(at + third), math.sin(at + 2.0 * third), math.sin(at + 3.0 * third)
            kutta_lanes(shop.moments[g], table.gravity, table.speed, h, c, s, pose, velocity, own, scheme.lanes)
        for lane in range(LANES):
            p = g * LANES + lane
            gone = p >= parts or away[p]
            careful = False
            if not gone:
                slow = shop.slow_rate[p] * h
                total = 0.0
                for k in range(lane, 3 * LANES, LANES):
                    total += pose[k] + velocity[k]
                careful = (
                    shop.careful[p]
                    or state.sticking[world, p]
                    or not (
                        own[lane] <= shop.most_square[p] and own[LANES + lane] >= slow * slow and abs(total) < math.inf
                    )
                )
            if gone or careful:
                for k in range(lane, 3 * LANES, LANES):
                    pose[k], velocity[k] = old_pose[k], old_velocity[k]
            if careful:
                rub_carefully(table, bodies, drive, world, scheme, contact, state, away, shop, phase, h, substeps, p)


@jit
def pairs_now(table, bodies, hulls, walls, away, shop, pairs):
    """Write the pairs that may come to touch from now on into ``pairs``; returns their number."""
    parts = away.shape[0]
    for p in range(parts):
        g, lane = p // LANES, p % LANES
        for k in range(3):
            shop.settled[p, k] = shop.pose[g, k * LANES + lane]
            shop.speed[p, k] = shop.velocity[g, k * LANES + lane]
    return near_pairs(
        table, bodies, hulls, walls, shop.settled, shop.speed, away, JOLT * table.period, pairs, shop.reach, shop.order
    )


@jit
def collide_period(
    world, drive, table, bodies, hulls, scheme, couplings, overlap, solver, contact, walls, state, pairs, n, shop
):
    """Advance one world by a period with contacts, changing ``state`` in place.

    Args:
        scheme: cuts a period, and Runge-Kutta steps in each.
        couplings: fewest steps of the coupling from cut to cut.
        overlap: m, see :func:`safe_step`.
        contact: working arrays of the largest part.
        walls: set of walls, a bit each.
        pairs: (capacity, 2) of which ``n`` may come to touch, see :func:`vibgym.physics.collision.broad_phase.near_pairs`;
        overwritten.

    Returns:
        How often the solver was called.
    """
    parts = state.pose.shape[1]
    omega = 2.0 * math.pi / table.period
    step = table.period / scheme.steps
    longest = step / couplings
    away = state.fallen[world].copy()
    shop.known[:] = -1
    for g in range(shop.pose.shape[0]):
        for lane in range(LANES):
            p = g * LANES + lane
            for k in range(3):
                shop.pose[g, k * LANES + lane] = state.pose[world, p, k] if p < parts else 0.0
                shop.velocity[g, k * LANES + lane] = state.velocity[world, p, k] if p < parts else 0.0
            kind = bodies.kind[min(p, parts - 1)]
            shop.own[g, 2 * LANES + lane] = bodies.friction[kind]
            shop.own[g, 3 * LANES + lane] = 1.0 / bodies.gyration[kind]
    calls, entered, placed, pushed = 0, False, False, False
    for turn in range(scheme.steps):
        elapsed = 0.0
        shop.stale[:] = True
        stale = True
        while elapsed < step:
            if pushed and stale:
                # Parts now go where friction alone would not have taken them.
                n = pairs_now(table, bodies, hulls, walls, away, shop, pairs)
            if stale:
                cut_stale(table, bodies, drive, world, scheme, contact, state, away, shop, step - elapsed)
                stale = False
            left = step - elapsed
            h = left if left < (1.0 + 1e-9) * longest else longest
            if not placed:
                place_parts(hulls, away, shop)
            h, touching, blow = safe_step(table, bodies, hulls, overlap, pairs, n, away, shop, h, SHORTEST * longest)
            elapsed = step if h == left else elapsed + h
            rub(
                table, bodies, drive, world, scheme, contact, state, away, shop, omega * (turn * step + step - left), h
            )  # fmt: skip
            place_parts(hulls, away, shop)
            placed = True
            if touching:
                gap = smallest_gap(table, hulls, pairs, n, shop)
                if gap < -CONTACT_FROM:
                    undo = gap < -solver.slop
                    hit = resolve(solver, hulls, away, state.sticking[world], shop, h, entered, blow, undo)
                    calls += 1
                    entered, placed, stale, pushed = True, not undo, hit, True
                    if hit:
                        forget_blows(solver, shop)
    if entered:
        leave(solver)
    total = 0.0
    for g in range(shop.pose.shape[0]):
        for k in range(3 * LANES):
            total += abs(shop.pose[g, k]) + abs(shop.velocity[g, k])
    if state.diverged[world] or not total < math.inf:
        state.diverged[world] = True
        return calls
    for p in range(parts):
        at, to, lane = shop.pose[p // LANES], shop.velocity[p // LANES], p % LANES
        for k in range(3):
            place = at[k * LANES + lane]
            state.mean_velocity[world, p, k] = (place - state.pose[world, p, k]) / table.period
            state.pose[world, p, k] = place
            state.velocity[world, p, k] = 0.0 if state.fallen[world, p] else to[k * LANES + lane]
        if state.fallen[world, p]:
            state.sticking[world, p] = False
    return calls
