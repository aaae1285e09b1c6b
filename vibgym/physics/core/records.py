"""Records of all models' kernels: table, parts and state of the worlds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout


class Table(NamedTuple):
    """The vibrating surface."""

    rows: int
    columns: int
    element_size: float  # m
    gravity: float  # m/s^2
    period: float  # s
    radius: float  # m, of the horizontal motion
    speed: float  # m/s, of the horizontal motion
    left: float  # m; a part falls when its centre of mass is beyond: the border, or a little farther with a wall,
    right: float  # since parts overlap walls a little
    bottom: float
    top: float


EVEN = np.ones((1, 1))
"""Friction factors of a uniform surface."""

CONSTANT = np.ones(1)
"""Law of a coefficient of sliding friction that does not depend on speed."""

LAW_SPEED = 2e-3
"""m/s between the entries of a law."""


class Body(NamedTuple):
    """One part; without contacts its motion does not depend on mass."""

    outline: np.ndarray  # (n, 2) m, about the centre of mass, counter-clockwise
    area: float  # m^2
    radius: float  # m, of the circumscribed circle about the centre of mass
    gyration: float  # m^2, planar inertia over mass
    friction: float
    static_friction: float
    convex: bool
    turns: bool  # False for a disc, whose contact area does not depend on heading
    coupling: float = 1.0  # share of the elements' vertical motion that reaches the part
    incline_x: float = 0.0  # m/s^2, constant acceleration by the incline of the table
    incline_y: float = 0.0
    patches: np.ndarray = EVEN  # (rows, columns) or (1, 1): factor of elements on friction
    law: np.ndarray = CONSTANT  # (entries,) factor on friction by slip speed, at most 1, see law_factor; (1,): constant


class Bodies(NamedTuple):
    """The kinds of parts as arrays, so that one compiled kernel takes any number of them, and the parts of the worlds."""

    kind: np.ndarray  # (worlds, parts) kind of every part, live; one row where all worlds have the same parts
    outline: np.ndarray  # (all corners, 2)
    first: np.ndarray  # (kinds + 1,) first corner of each kind
    area: np.ndarray  # (kinds,) and so on
    radius: np.ndarray
    gyration: np.ndarray
    friction: np.ndarray
    static_friction: np.ndarray
    convex: np.ndarray
    turns: np.ndarray
    coupling: np.ndarray
    even: np.ndarray  # EVEN
    laws: np.ndarray  # (kinds, entries)


@jit
def kind_in(bodies, world, part):
    """Return the kind of a part in its world."""
    return bodies.kind[min(world, bodies.kind.shape[0] - 1), part]


@jit
def body_of(bodies, kind):
    """Return the body of a kind."""
    return Body(
        outline=bodies.outline[bodies.first[kind] : bodies.first[kind + 1]],
        area=bodies.area[kind],
        radius=bodies.radius[kind],
        gyration=bodies.gyration[kind],
        friction=bodies.friction[kind],
        static_friction=bodies.static_friction[kind],
        convex=bodies.convex[kind],
        turns=bodies.turns[kind],
        coupling=bodies.coupling[kind],
        incline_x=0.0,
        incline_y=0.0,
        patches=bodies.even,
        law=bodies.laws[kind],
    )


class Scheme(NamedTuple):
    """Step sizes of the friction dynamics, and trigonometric tables."""

    steps: int  # cuts of the contact area a period
    substeps: int  # Runge-Kutta steps from cut to cut
    pieces: int  # cells per element and direction; 0: series where it holds, else by spin; -1: by spin
    cosine: np.ndarray  # (3 * steps * substeps + 1) cos wt at the stage times
    sine: np.ndarray


class State(NamedTuple):
    """State of all worlds, changed in place."""

    pose: np.ndarray  # (worlds, parts, 3) m, m, rad
    velocity: np.ndarray  # (worlds, parts, 3) m/s, m/s, rad/s
    mean_velocity: np.ndarray  # (worlds, parts, 3) over the last period
    pushed: np.ndarray  # (worlds, parts, 2) m/s, change of velocity by contacts with parts and walls in the last period
    fallen: np.ndarray  # (worlds, parts) bool
    sticking: np.ndarray  # (worlds, parts) bool, at the current instant
    doubtful: np.ndarray  # (worlds, parts) bool: the model has left its range of validity since the start
    diverged: np.ndarray  # (worlds,) bool
    friction: np.ndarray  # (worlds, parts) factor on both coefficients of friction between part and table
    mass: np.ndarray  # (worlds, parts) factor on mass and inertia
    incline: np.ndarray  # (worlds, 2) m/s^2, acceleration by the incline
    patches: np.ndarray  # (worlds, rows, columns) or (worlds, 1, 1): factor of elements on friction


CONDITIONS = {"friction": 1.0, "mass": 1.0, "incline": 0.0, "patches": 1.0}
"""Fields of the state that the physics does not change, and their defaults."""


def new_state(worlds: int, parts: int) -> State:
    """Allocate the state of parts at rest at the origin of a level table."""
    return State(
        pose=np.zeros((worlds, parts, 3)),
        velocity=np.zeros((worlds, parts, 3)),
        mean_velocity=np.zeros((worlds, parts, 3)),
        pushed=np.zeros((worlds, parts, 2)),
        fallen=np.zeros((worlds, parts), np.bool_),
        sticking=np.zeros((worlds, parts), np.bool_),
        doubtful=np.zeros((worlds, parts), np.bool_),
        diverged=np.zeros(worlds, np.bool_),
        friction=np.ones((worlds, parts)),
        mass=np.ones((worlds, parts)),
        incline=np.zeros((worlds, 2)),
        patches=np.ones((worlds, 1, 1)),
    )


@jit
def incline_size(state, world):
    """Return the magnitude of a world's incline, m/s^2."""
    return math.sqrt(
        state.incline[world, 0] * state.incline[world, 0] + state.incline[world, 1] * state.incline[world, 1]
    )


@jit
def body_incline(body):
    """Return the magnitude of a body's incline, m/s^2."""
    return math.sqrt(body.incline_x * body.incline_x + body.incline_y * body.incline_y)


@jit
def grip_of(patches, row, column):
    """Return the factor on friction of the element at ``(row, column)``, from patches (rows, columns) or (1, 1)."""
    return patches[min(row, patches.shape[0] - 1), min(column, patches.shape[1] - 1)]


@jit
def best_grip(patches):
    """Return the largest factor on friction of any element."""
    most = patches[0, 0]
    for row in range(patches.shape[0]):
        for column in range(patches.shape[1]):
            most = max(most, patches[row, column])
    return most


@jit
def most_friction(body):
    """Return the largest coefficient of sliding friction of a body on any element."""
    return body.friction * best_grip(body.patches)


@jit
def friction_in(bodies, state, world, part):
    """Return the coefficient of sliding friction of a part in its world."""
    return state.friction[world, part] * bodies.friction[kind_in(bodies, world, part)]


@jit
def under_conditions(body, state, world, part):
    """Return a body with its world's factors on friction and incline."""
    factor = state.friction[world, part]
    return Body(
        outline=body.outline,
        area=body.area,
        radius=body.radius,
        gyration=body.gyration,
        friction=factor * body.friction,
        static_friction=factor * body.static_friction,
        convex=body.convex,
        turns=body.turns,
        coupling=body.coupling,
        incline_x=state.incline[world, 0],
        incline_y=state.incline[world, 1],
        patches=state.patches[world],
        law=body.law,
    )


@jit
def law_factor(law, speed):
    """Return the factor on friction at a slip speed (m/s), linear between the entries of a law and constant after the last."""
    at = min(speed * (1.0 / LAW_SPEED), law.shape[0] - 1.0)
    k = min(int(at), law.shape[0] - 2)
    return law[k] + (at - k) * (law[k + 1] - law[k])


@jit
def body_in(bodies, state, world, part):
    """Return the body of a part in its world."""
    return under_conditions(body_of(bodies, kind_in(bodies, world, part)), state, world, part)


class Motion(NamedTuple):
    """Pose and velocity of one part."""

    x: float  # m
    y: float  # m
    heading: float  # rad
    vx: float  # m/s
    vy: float  # m/s
    spin: float  # rad/s


@jit
def is_finite(motion):
    """Return whether all numbers are finite; by comparison, since isfinite(a + b) does not survive reassociation."""
    return abs(motion.x + motion.y + motion.heading + motion.vx + motion.vy + motion.spin) < math.inf


STATE: Layout[State] = Layout("STATE", __name__)
state_at = STATE.at
