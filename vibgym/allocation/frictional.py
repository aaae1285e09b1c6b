"""The frictional process and its inverse: pushes of the elements for wanted mean accelerations.

The thesis's "oscillation parameter calculation" (section 5.2.2, figs. 5.16 and 5.18), a feedback linearisation: with it, the
plant is a double integrator. Here it is of second order in ``eps = mu g / (a_h w^2)``. Friction is isotropic, so in the frame
of the mean velocity (first axis along it) the coefficients depend only on the speed ``s`` over the table's speed ``V``. With a
push ``(p, q)`` in m/s^2 and ``k = mu / (w V)``:

    a_1 / mu = -g d + Q p + k q (A0 g + A1 p)
    a_2 / mu = P q + k (B00 g^2 + B01 g p + B11 p^2 + B22 q^2)

The first order is the thesis's eqs. 5.60 and 5.61. The second order is that of
:func:`vibgym.physics.averaged.averages.second_order` for a uniform push under the part. It covers the decrease of the push with
speed, the drag, and the lead angle of pushes.

Spin is a separate channel, of first order and for nearly round parts: ``P`` and ``Q`` count half each, and the drag on spin is
the divergence of the force, ``mu / (2 V) (g <1 / |n|> + p <cos / |n|>)`` with ``|n|`` the slip over ``V``. For fast spin, at
which a part's rim is nearly as fast as the table, both are scaled like those of a ring that slides along itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vibgym import checks
from vibgym.kernels.jit import exact, jit
from vibgym.kernels.reference import reference
from vibgym.kernels.vector import LANES, load, store
from vibgym.physics.averaged.averages import cubic_weights, direction, new_scratch, place
from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation import threads as workers
from vibgym.simulation.averages_tables import COUPLING_NODES, COUPLING_STEP, averages, first_order, slips
from vibgym.simulation.plant import reached
from vibgym.simulation.schemes import check_sliding

NEWTON = 8
"""Most iterations; three or four suffice where the averaged model holds."""

CLOSE = 1e-6
"""Error over ``g`` below which the next step of Newton's method is the last one; it squares the error."""

ROUNDS, STILL = 8, 1e-4
"""Most iterations of the predicted velocity, and its change over the table's speed at convergence."""

GUESS = 2.0
"""Largest first-order push, over the limit, from which Newton's method starts without a limit; it converges there."""

REMEDY = "use an action or a policy that does not invert friction, such as 'field' or 'local_field'"


COLUMNS = 16
"""Columns of the table in kernels: those of :func:`coefficients` and zeros, whole vectors."""

SPIN_COLUMNS = 8
"""First columns, with those that :func:`spun` needs."""


class Pushes(NamedTuple):
    """Pushes of the elements and their effect."""

    push: np.ndarray  # (batch, parts, 3) over full amplitude: x, y, and the turning push; see FrictionalInverse
    acceleration: np.ndarray  # (batch, parts, 3) m/s^2, m/s^2, rad/s^2: mean acceleration under this push
    holds: np.ndarray  # (batch, parts) bool: slip stays clear of zero, so the averaged model may be relied on


class InverseParameters(NamedTuple):
    """Parameters of surface and kinds of parts for the kernels."""

    table: np.ndarray  # flat (2, nodes, COLUMNS), see coefficients()
    nodes: int
    kind: np.ndarray  # (batch, parts), or one row for all of the batch, see vibgym.scene.kinds; live
    friction: np.ndarray  # (kinds,)
    gyration: np.ndarray  # (kinds,) radii, m
    rim: np.ndarray  # (kinds,) m, see rim_of()
    second: np.ndarray  # (kinds,) k = mu / (w V), s^2/m
    gravity: float
    speed: float  # V, m/s
    full: np.ndarray  # (kinds,) a_v w^2 at the surface's largest amplitude, as it reaches the part, m/s^2
    limit: np.ndarray  # (kinds,) largest push, m/s^2
    ahead: float  # s, prediction horizon of the velocity


@lru_cache(maxsize=1)
def coefficients() -> np.ndarray:
    """Return ``d, P, Q, A0, A1, B00, B01, B11, B22, <1 / |n|>, <cos(theta) / |n|>`` over slip, (2, nodes, 11).

    Nodes as in :mod:`vibgym.simulation.averages_tables`: parts slower and parts faster than the table.
    """
    s = slips(COUPLING_STEP, COUPLING_NODES)
    d, across, along, total = first_order(s)
    inverse_slip = (total - s * d) / (1.0 - s * s)
    # c[j, a, k] of coupling_coefficients(): only products with a uniform push remain.
    c = np.moveaxis(averages().coupling.reshape(*s.shape, 3, 3, 3), (2, 3, 4), (0, 1, 2))
    second = [
        c[0, 0, 0] + c[1, 0, 2] + c[0, 2, 0] + c[1, 2, 1],
        c[0, 1, 0] + c[1, 1, 2] + c[0, 2, 1] + c[1, 2, 2],
        c[1, 0, 0] + c[2, 0, 1],
        c[1, 0, 1] + c[2, 0, 2] + c[1, 1, 0] + c[2, 1, 1],
        c[1, 1, 1] + c[2, 1, 2],
        c[1, 2, 0] + c[2, 2, 2],
    ]
    table = [d, across, along, *(-coefficient for coefficient in second), inverse_slip, s * inverse_slip - d]
    result = np.ascontiguousarray(np.stack(table, axis=-1))
    # At rest no direction is distinguished, so these vanish except for rounding, which would move elements without a push.
    result[0, 0, [0, 4, 5, 7, 8, 10]] = 0.0
    return result


@jit
def force(c, gravity, second, p, q):
    """Return the mean acceleration over ``mu`` along and across the velocity under a push (p, q), all m/s^2."""
    along = -gravity * c[0] + c[2] * p + second * q * (c[3] * gravity + c[4] * p)
    across = c[1] * q + second * (c[5] * gravity * gravity + c[6] * gravity * p + c[7] * p * p + c[8] * q * q)
    return along, across


@exact
def look_up(parameters, speed, columns, scratch):
    """Interpolate the first columns of the table at a speed (m/s) into ``scratch.values``."""
    side, at = place(speed / parameters.speed)
    table, weights = parameters.table, scratch.weights[0]
    row = (side * parameters.nodes + cubic_weights(at * (1.0 / COUPLING_STEP), parameters.nodes, weights)) * COLUMNS
    w0, w1, w2, w3 = weights[0], weights[1], weights[2], weights[3]
    for k in range(0, columns, LANES):
        one, two = w0 * load(table, row + k), w1 * load(table, row + COLUMNS + k)
        three, four = w2 * load(table, row + 2 * COLUMNS + k), w3 * load(table, row + 3 * COLUMNS + k)
        store(scratch.values, k, (one + two) + (three + four))


@jit
def newton(c, gravity, second, limit, along, across, idle, idle_across, p, q, share):
    """Return the push (p, q) whose force is (along, across), from a first guess, and 1.

    With a ``limit`` > 0, return the push of that length whose force is on the line from (idle, idle_across) to (along, across),
    and the position on that line, of which ``share`` is a first guess.
    """
    change, change_across = along - idle, across - idle_across
    for _ in range(NEWTON):
        now, now_across = force(c, gravity, second, p, q)
        left, left_across = idle + share * change - now, idle_across + share * change_across - now_across
        over = 0.5 * (limit * limit - p * p - q * q) if limit > 0.0 else 0.0
        close = abs(left) + abs(left_across) < CLOSE * gravity and abs(over) < CLOSE * limit * gravity + 1e-300
        xx, xy = c[2] + second * q * c[4], second * (c[3] * gravity + c[4] * p)
        yx, yy = second * (c[6] * gravity + 2.0 * c[7] * p), c[1] + 2.0 * second * c[8] * q
        determinant = xx * yy - xy * yx
        if abs(determinant) < 1e-3 * c[1] * c[2]:
            break
        inverse = 1.0 / determinant
        step_p, step_q = inverse * (left * yy - left_across * xy), inverse * (left_across * xx - left * yx)
        if limit > 0.0:
            per_p, per_q = inverse * (change * yy - change_across * xy), inverse * (change_across * xx - change * yx)
            slope = p * per_p + q * per_q
            if slope <= 0.0:  # far beyond where the averaged model holds
                break
            more = (over - p * step_p - q * step_q) / slope
            share, step_p, step_q = share + more, step_p + more * per_p, step_q + more * per_q
        p, q = p + step_p, q + step_q
        if close:
            break
    return p, q, share


def rim_of(part: Part) -> float:
    """Return the radius (m) of the ring equivalent to a part in spin: ``<r^4> / <r^2> = r_rim^2``.

    Torque is ``<r f(r spin)>``. For odd f, the ring's linear and cubic terms are exact.
    """
    ax, ay = part.outline.T
    bx, by = np.roll(part.outline, -1, axis=0).T
    # Over the triangles of the centre and an edge, r^2 = |s a + t b|^2: int s^i t^j = i! j! / (i + j + 2)!.
    cross, a, c, m = ax * by - bx * ay, ax * ax + ay * ay, bx * bx + by * by, ax * bx + ay * by
    fourth = cross @ ((a * a + c * c) / 30.0 + (a + c) * m / 30.0 + (4.0 * m * m + 2.0 * a * c) / 180.0)
    return math.sqrt(fourth / (0.5 * cross.sum()) / part.gyration)


@jit
def spun(parameters, k, spin, scratch):
    """Return the factors by which spin changes friction and turning pushes of a part of kind ``k``: 1 and 1 near rest."""
    rim = abs(spin) * parameters.rim[k]
    look_up(parameters, rim, SPIN_COLUMNS, scratch)
    slip = rim / parameters.speed
    return 2.0 * scratch.values[0] / slip if slip > 1e-6 else 1.0, 2.0 * scratch.values[2]


@jit
def respond(parameters, k, c, spin, friction, p, q):
    """Return the mean acceleration along, across (m/s^2) and angular (rad/s^2) of a part of kind ``k`` under a push (p, q).

    ``friction`` is the factor of :func:`spun`.
    """
    mu = parameters.friction[k]
    along, across = force(c, parameters.gravity, parameters.second[k], p, q)
    drag = 0.5 * mu / parameters.speed * (parameters.gravity * c[9] + c[10] * p)
    return mu * along, mu * across, -friction * drag * spin


@jit
def clear_of_sticking(parameters, k, length, p, q):
    """Return whether slip stays clear of zero, see :func:`vibgym.physics.averaged.averages.slip_margin`."""
    return abs(length / parameters.speed - 1.0) > parameters.second[k] * (parameters.gravity + math.sqrt(p * p + q * q))


@jit
def forward_part(parameters, k, velocity, push, scratch, acceleration):
    """Compute ``acceleration`` (3,) of a part of kind ``k`` under a push (3,) over full amplitude.

    Returns:
        Whether the model holds.
    """
    c, full = scratch.values, parameters.full[k]
    friction, turning = spun(parameters, k, velocity[2], scratch)
    length, cosine, sine = direction(velocity[0], velocity[1])
    look_up(parameters, length, COLUMNS, scratch)
    x, y, turn = full * push[0], full * push[1], full * push[2]
    p, q = cosine * x + sine * y, cosine * y - sine * x
    along, across, angular = respond(parameters, k, c, velocity[2], friction, p, q)
    angular += 0.5 * turning * parameters.friction[k] * (c[1] + c[2]) * turn / parameters.gyration[k]
    acceleration[0], acceleration[1] = cosine * along - sine * across, sine * along + cosine * across
    acceleration[2] = angular
    return clear_of_sticking(parameters, k, length, p, q)


@jit
def invert_part(parameters, k, velocity, wanted, scratch, push, acceleration, share):
    """Compute ``push`` (3,) over full amplitude of a part of kind ``k`` for a wanted mean acceleration, and its acceleration.

    Args:
        share: 0, or the result at a velocity nearby, whose ``push`` is then the first guess.

    Returns:
        Whether the model holds, and the share of the wanted change of acceleration that is within the limit.
    """
    c, limit, gravity, full = scratch.values, parameters.limit[k], parameters.gravity, parameters.full[k]
    mu, second = parameters.friction[k], parameters.second[k]
    friction, turning = spun(parameters, k, velocity[2], scratch)
    length, cosine, sine = direction(velocity[0], velocity[1])
    look_up(parameters, length, COLUMNS, scratch)
    x, y = wanted[0] / mu, wanted[1] / mu
    along, across = cosine * x + sine * y, cosine * y - sine * x
    idle, idle_across = force(c, gravity, second, 0.0, 0.0)
    p, q = full * (cosine * push[0] + sine * push[1]), full * (cosine * push[1] - sine * push[0])
    if 0.0 < share < 1.0:
        p, q, share = newton(c, gravity, second, limit, along, across, idle, idle_across, p, q, share)
    if not 0.0 < share < 1.0:
        if share == 0.0:
            p, q = (along - idle) / c[2], (across - idle_across) / c[1]
        share = 1.0
        if p * p + q * q < GUESS * GUESS * limit * limit:
            p, q, share = newton(c, gravity, second, 0.0, along, across, idle, idle_across, p, q, share)
        if p * p + q * q > limit * limit:
            share = limit / math.sqrt(p * p + q * q)
            p, q, share = newton(
                c, gravity, second, limit, along, across, idle, idle_across, share * p, share * q, share
            )
    if p * p + q * q > limit * limit:  # Newton's method may end above the limit
        shorter = limit / math.sqrt(p * p + q * q)
        p, q = p * shorter, q * shorter
    turning *= 0.5 * mu * (c[1] + c[2]) / parameters.gyration[k]
    along, across, angular = respond(parameters, k, c, velocity[2], friction, p, q)
    turn = min(max((wanted[2] - angular) / turning, -limit), limit)
    push[0], push[1], push[2] = (cosine * p - sine * q) / full, (sine * p + cosine * q) / full, turn / full
    acceleration[0], acceleration[1] = cosine * along - sine * across, sine * along + cosine * across
    acceleration[2] = angular + turning * turn
    return clear_of_sticking(parameters, k, length, p, q), share


@jit
def look_ahead(parameters, k, velocity, acceleration, share, later):
    """Correct the velocity (3,) at which friction acts, ``later``; returns its error over the table's speed.

    Args:
        share: see :func:`invert_part`. Beyond the limit acceleration decreases with ``later``, roughly by the drag near rest.
    """
    moved = 0.0
    drag = 0.5 * parameters.friction[k] * parameters.gravity / parameters.speed if share < 1.0 else 0.0
    factor = 1.0 / (1.0 + parameters.ahead * drag)
    for j in range(3):
        now = velocity[j] + parameters.ahead * acceleration[j]
        moved += abs(now - later[j]) if j < 2 else 0.1 * abs(now - later[j])  # spin: of a lever of a decimetre
        later[j] += factor * (now - later[j])
    return moved / parameters.speed


@jit
def guess_ahead(parameters, k, velocity, wanted, later):
    """Write a first guess of ``later`` (3,): under the wanted acceleration, or that of the limit at rest if it is less."""
    most = 0.5 * parameters.friction[k] * parameters.limit[k]
    push = parameters.ahead * most / max(math.sqrt(wanted[0] * wanted[0] + wanted[1] * wanted[1]), most)
    turn = parameters.ahead * most / max(abs(wanted[2]) * parameters.gyration[k], most)
    later[0], later[1] = velocity[0] + push * wanted[0], velocity[1] + push * wanted[1]
    later[2] = velocity[2] + turn * wanted[2]


@jit
def forward(parameters, velocity, push, scratch, later, acceleration, holds):
    """Compute ``acceleration`` (batch, parts, 3) under pushes (batch, parts, 3) over full amplitude."""
    parameters, scratch = reference(parameters), reference(scratch)
    for i in range(velocity.shape[0]):
        for p in range(velocity.shape[1]):
            k, at, change = parameters.kind[min(i, parameters.kind.shape[0] - 1), p], velocity[i, p], acceleration[i, p]
            later[0], later[1], later[2] = at[0], at[1], at[2]
            holds[i, p] = forward_part(parameters, k, at, push[i, p], scratch, change)
            for _ in range(ROUNDS):
                if look_ahead(parameters, k, at, change, 0.0, later) < STILL:
                    break
                holds[i, p] = forward_part(parameters, k, later, push[i, p], scratch, change)


@jit
def invert_ahead(parameters, k, velocity, wanted, scratch, later, push, acceleration):
    """Compute what :func:`invert_part` computes, with friction at the predicted velocity, ``later`` (3,), overwritten.

    Returns:
        Whether the model holds.
    """
    holds, share = False, 0.0
    push[:] = 0.0
    guess_ahead(parameters, k, velocity, wanted, later)
    for _ in range(ROUNDS):
        holds, share = invert_part(parameters, k, later, wanted, scratch, push, acceleration, share)
        if look_ahead(parameters, k, velocity, acceleration, share, later) < STILL:
            break
    return holds


@jit
def invert(start, stop, parameters, velocity, wanted, scratch, later, push, acceleration, holds):
    """Compute ``push`` (batch, parts, 3) over full amplitude for wanted mean accelerations, and their accelerations.

    Args:
        start, stop: first row of the batch, and the one after the last.
    """
    parameters, scratch = reference(parameters), reference(scratch)
    for i in range(start, stop):
        for p in range(velocity.shape[1]):
            k, at, goal = parameters.kind[min(i, parameters.kind.shape[0] - 1), p], velocity[i, p], wanted[i, p]
            holds[i, p] = invert_ahead(parameters, k, at, goal, scratch, later, push[i, p], acceleration[i, p])


class FrictionalInverse:
    """Computes pushes from wanted mean accelerations, for parts that always slide.

    A push is relative to full amplitude, as for :class:`vibgym.allocation.Allocator`. Its x and y are in the first-order
    direction at rest (phasor ``(C, S) = -full_scale (y, x)``). The third is the moment of the elements' pushes about the centre
    of mass over the radius of gyration. The second order includes the lead angle, so no correction is needed afterwards.

    Pushes beyond the limit are scaled down: the change of acceleration relative to elements at rest keeps its direction. The
    turning push is limited separately.

    Args:
        surface, parts: the scene.
        limit: m, largest amplitude of the elements, at most the surface's; None: the surface's.
        ahead: s, 0 to one period. Friction is evaluated at the velocity predicted for this time ahead; with half a step,
            accelerations are means over the step. On the prototype, friction takes an eighth of the velocity in half a period.
        threads: None uses all processors of this process; results do not depend on it.

    Attributes:
        parameters: of the kernels.

    Raises:
        ValueError: a part that can stick, a part without friction, or elements that cannot move.
    """

    def __init__(
        self,
        surface: Surface,
        parts: Part | Sequence[Part],
        *,
        limit: float | None = None,
        ahead: float = 0.0,
        threads: int | None = None,
    ) -> None:
        checks.instance("surface", surface, Surface)
        if not isinstance(parts, (Part, list, tuple, Kinds)):
            raise checks.refuse("parts", parts, "a Part, or a list of them")
        sequence = (parts,) if isinstance(parts, Part) else parts
        for part in sequence:
            checks.instance("parts", part, Part)
        self.surface, self.parts = surface, Kinds.of(sequence)
        largest = surface.max_amplitude
        assert largest is not None
        for part in self.parts.every:
            check_sliding(surface, part.static_friction, argument="parts", value=part.name, remedy=REMEDY)
            checks.number(f"friction of part {part.name!r}", part.friction, above=0.0)
        if limit is not None:
            limit = checks.number("limit", limit, above=0.0)
        elif largest == 0.0:
            raise checks.refuse("surface.max_amplitude", largest, "> 0: elements at rest do not push")
        self.limit = largest if limit is None else min(limit, largest)
        self._threads = workers.available_threads() if threads is None else checks.count("threads", threads, most=4096)
        every = self.parts.every
        friction = np.array([part.friction for part in every])
        share = reached(every)
        table = coefficients()
        self.parameters = InverseParameters(
            np.pad(table, ((0, 0), (0, 0), (0, COLUMNS - table.shape[2]))).ravel(),
            table.shape[1],
            self.parts.kind,
            friction,
            np.sqrt([part.gyration for part in every]),
            np.array([rim_of(part) for part in every]),
            friction / (surface.angular_frequency * surface.table_speed),
            surface.gravity,
            surface.table_speed,
            share * surface.full_scale,
            share * (self.limit * surface.angular_frequency**2),
            checks.number("ahead", ahead, least=0.0, most=surface.period),
        )

    def push(self, velocity: np.ndarray, wanted: np.ndarray) -> Pushes:
        """Return pushes that give the parts the wanted accelerations, within the limit.

        Args:
            velocity: (batch, parts, 3) mean velocities, m/s and rad/s; not those of one instant.
            wanted: (batch, parts, 3) mean accelerations, m/s^2 and rad/s^2, including friction.
        """
        velocity, wanted = _rows(velocity), _rows(wanted)
        result = Pushes(np.empty_like(wanted), np.empty_like(wanted), np.empty(wanted.shape[:2], dtype=bool))

        def work(start: int, stop: int) -> None:
            invert(start, stop, self.parameters, velocity, wanted, new_scratch(), np.empty(3), *result)

        workers.share(work, len(wanted), self._threads)
        return result

    def acceleration(self, velocity: np.ndarray, push: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean accelerations (batch, parts, 3) under pushes, and where the averaged model holds."""
        velocity, push = _rows(velocity), _rows(push)
        acceleration, holds = np.empty_like(velocity), np.empty(velocity.shape[:2], dtype=bool)
        forward(self.parameters, velocity, push, new_scratch(), np.empty(3), acceleration, holds)
        return acceleration, holds


def _rows(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=np.float64)
