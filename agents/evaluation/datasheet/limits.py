"""What follows from surface, part and hardware alone, without an episode."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.actuators import DataSheet
from vibgym.allocation import Allocator
from vibgym.allocation.allocator import strongest
from vibgym.bounds import TimeBound
from vibgym.scene.sliding import sliding_of

PLACES = 96
"""Poses, spread over an element and half a turn, at which a part's wrench is looked at."""

TURNABLE = 0.05
"""Share of the largest push, at the radius of gyration, that has to turn a part wherever it lies."""

RUN_UP = 60
"""Periods until a part on a field in one direction is as fast as it gets."""


@dataclass(frozen=True)
class Limits:
    """Numbers in SI units."""

    acceleration: float  # m/s^2, of the part at rest, all elements under it at their largest amplitude
    turn_acceleration: tuple[float, float]  # rad/s^2, at the worst and the best place
    top_speed: float  # m/s, on a field in one direction that does not end
    most_friction: float  # of parts that slide all the time
    smallest: float  # scale at which this part could still be turned wherever it lies; nan if it cannot itself
    circle: float  # m, radius on which the part circles at rest
    tipping: float | None  # share of the way to the edge that friction takes, at rest; None: height not known
    bound: TimeBound  # of a pose


def limits_of(surface: Surface, part: Part, sheet: DataSheet, tolerances: tuple[float, float]) -> Limits:
    """Of a part on a surface with actuators of a data sheet.

    Args:
        tolerances: m and rad, within which a pose is reached.

    Raises:
        ValueError: a part that might stick, of which the bounds say nothing.
    """
    share = strongest(surface, sheet)
    sliding = sliding_of(surface, [part], share)
    reach = reach_of(surface, part, sheet)
    turn = float(sliding.push[0]) / share / math.sqrt(part.gyration)
    heading = math.inf if part.symmetry == 0 else tolerances[1]
    most = min(sheet.limit, surface.lift_off_amplitude)
    return Limits(
        acceleration=float(sliding.push[0]),
        turn_acceleration=(turn * float(reach.min()), turn * float(reach.max())),
        top_speed=top_speed(surface, part, most),
        most_friction=surface.horizontal_amplitude
        * surface.angular_frequency**2
        / (surface.gravity + most * surface.angular_frequency**2),
        smallest=smallest_scale(surface, part, sheet),
        circle=part.friction * surface.gravity / surface.angular_frequency**2,
        tipping=part.tipping_ratio if part.height_is_known else None,
        bound=TimeBound(
            surface,
            part,
            position_tolerance=tolerances[0],
            heading_tolerance=heading,
            heading_period=0.0 if part.symmetry == 0 else 2.0 * math.pi / part.symmetry,
            amplitude=min(sheet.limit, surface.max_amplitude or 0.0),
            latency=sheet.latency,
        ),
    )


def reach_of(surface: Surface, part: Part, sheet: DataSheet) -> np.ndarray:
    """(PLACES,) largest push that turns the part at its radius of gyration, over the largest push there is."""
    rng, size = np.random.default_rng(0), surface.element_size
    centre = size * (np.array([surface.columns // 2, surface.rows // 2]) + 0.5)
    # Where small parts lie on a single element: in its middle, at headings that begin with its own.
    centred = np.column_stack([np.tile(centre, (PLACES // 4, 1)), np.arange(PLACES // 4) * (math.pi / (PLACES // 4))])
    drawn = rng.random((PLACES - len(centred), 3))
    drawn = np.column_stack([centre + size * (drawn[:, :2] - 0.5), math.pi * drawn[:, 2]])
    pose = np.vstack([centred, drawn])
    return Allocator(surface, [part], sheet).reach(pose[:, None])[:, 0]


def smallest_scale(surface: Surface, part: Part, sheet: DataSheet) -> float:
    """Scale of the smallest part of this shape that can be turned wherever it lies, see :data:`TURNABLE`; nan: not this one."""
    if reach_of(surface, part, sheet).min() < TURNABLE:
        return math.nan
    low, high = 0.0, 1.0
    for _ in range(8):
        middle = 0.5 * (low + high)
        smaller = Part.polygon(middle * part.outline, friction=part.friction)
        if reach_of(surface, smaller, sheet).min() < TURNABLE:
            low = middle
        else:
            high = middle
    return high


def top_speed(surface: Surface, part: Part, amplitude: float) -> float:
    """Mean speed over the last of :data:`RUN_UP` periods on elements that all push along x, m/s."""
    room = 2.0 * part.radius + RUN_UP * surface.period * surface.table_speed
    columns = math.ceil(room / surface.element_size) + 2
    rows = math.ceil((2.0 * part.radius + 0.2 * room) / surface.element_size) + 2
    long = Surface(
        rows, columns, surface.element_size, surface.horizontal_amplitude, surface.frequency, surface.gravity
    )
    simulator = Simulator(long, part, threads=1)
    simulator.reset([[[part.radius + long.element_size, 0.5 * long.depth, 0.0]]])
    # An element pushes towards (-S, -C): along x with a phase of -90 degrees.
    simulator.advance(np.full((rows, columns), amplitude), np.full((rows, columns), -0.5 * math.pi), RUN_UP)
    return float(np.hypot(*simulator.mean_velocity[0, 0, :2]))
