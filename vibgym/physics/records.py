"""What the kernels of all models share: the table, the part and the state of the worlds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Table(NamedTuple):
    """The surface as the kernels need it."""

    rows: int
    columns: int
    element_size: float  # m
    gravity: float  # m/s^2
    period: float  # s
    radius: float  # m, of the horizontal motion
    speed: float  # m/s, of the horizontal motion


class Body(NamedTuple):
    """The part as the kernels need it; the motion does not depend on mass."""

    outline: np.ndarray  # (n, 2) m, about the centre of mass, counter-clockwise
    area: float  # m^2
    radius: float  # m, of the circle about the centre of mass that holds the outline
    gyration: float  # m^2, planar inertia over mass
    friction: float
    static_friction: float
    convex: bool
    turns: bool  # False for a disc, whose contact area does not depend on heading


class State(NamedTuple):
    """State of all worlds, changed in place."""

    pose: np.ndarray  # (worlds, 1, 3) m, m, rad
    velocity: np.ndarray  # (worlds, 1, 3) m/s, m/s, rad/s
    mean_velocity: np.ndarray  # (worlds, 1, 3) over the last period
    fallen: np.ndarray  # (worlds, 1) bool
    sticking: np.ndarray  # (worlds, 1) bool, at the current instant
    doubtful: np.ndarray  # (worlds, 1) bool: since the start the model has left the range that it is certified for
    diverged: np.ndarray  # (worlds,) bool
