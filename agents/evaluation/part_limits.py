"""Limits of a part on a surface, for data sheets."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.actuators import DataSheet
from vibgym.allocation import Allocator
from vibgym.allocation.allocator import strongest
from vibgym.bounds import TimeBound
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.support import bridged_gap
from vibgym.simulation.plant import plant_of

POSES = 96
"""Poses, spread over an element and half a turn, at which a part's wrench is computed."""

TURNABLE = 0.05
"""Share of the largest push, at the radius of gyration, that has to turn a part at every pose."""

RUN_UP = 60
"""Periods until a part on a field in one direction has its final speed."""


class Limits:
    """Limits of the part of a task on its surface with its actuators, in SI units.

    Attributes:
        acceleration: m/s^2, of the part at rest, all elements under it at their largest amplitude.
        turn_acceleration: rad/s^2, at the worst and the best pose.
        top_speed: m/s, on an endless field in one direction.
        most_friction: of parts that slide all the time.
        smallest: scale at which this part could still be turned at every pose; nan if it cannot itself.
        circle: m, radius on which the part circles at rest.
        tipping: :attr:`vibgym.Part.tipping_ratio`; None: height not known.
        pulse: m, by which one period at the edge of a hard dead zone moves a part at rest; None: no such zone.
        gap: m, widest gap between elements that the part bridges, at most an element.
        bound: least time to a pose.

    Raises:
        ValueError: a part that may stick, to which the bounds do not apply.
    """

    def __init__(self, info: TaskInfo) -> None:
        surface, part, sheet = info.surface, info.parts[0], info.hardware
        share, square = strongest(surface, sheet), surface.angular_frequency**2
        sliding = plant_of(surface, [part], share)
        reach = reach_of(surface, part, sheet)
        most = min(sheet.limit, surface.lift_off_amplitude)
        self.acceleration = float(sliding.push[0])
        self.turn_acceleration = float(sliding.turn_push[0]) / share * np.array([reach.min(), reach.max()])
        self.top_speed = top_speed(surface, part, most)
        self.most_friction = surface.horizontal_amplitude * square / (surface.gravity + most * square)
        self.smallest = smallest_scale(surface, part, sheet)
        self.circle = part.friction * surface.gravity / square
        self.tipping = part.tipping_ratio if part.height_is_known else None
        # a_v w^2 T a_h w / g: friction both drives and brakes the part, so it cancels.
        pulse = sheet.dead_zone * square / surface.gravity * surface.period * surface.table_speed
        self.pulse = pulse if info.hard_dead_zone else None
        self.gap = bridged_gap(part, surface.element_size)
        self.bound = TimeBound(
            surface,
            part,
            position_tolerance=info.position_tolerance,
            heading_tolerance=info.heading_tolerance if part.symmetry else math.inf,
            heading_period=2.0 * math.pi / max(part.symmetry, 1),
            amplitude=min(sheet.limit, surface.max_amplitude or 0.0),
            latency=sheet.latency,
        )


def reach_of(surface: Surface, part: Part, sheet: DataSheet) -> np.ndarray:
    """Return (POSES,) the largest push that turns the part at its radius of gyration, over the largest push of all."""
    rng, size = np.random.default_rng(0), surface.element_size
    centre = size * (np.array([surface.columns // 2, surface.rows // 2]) + 0.5)
    # Where small parts lie on a single element: in its middle, at headings that begin with its own.
    centred = np.column_stack([np.tile(centre, (POSES // 4, 1)), np.arange(POSES // 4) * (math.pi / (POSES // 4))])
    drawn = rng.random((POSES - len(centred), 3))
    drawn = np.column_stack([centre + size * (drawn[:, :2] - 0.5), math.pi * drawn[:, 2]])
    pose = np.vstack([centred, drawn])
    return Allocator(surface, [part], sheet).reach(pose[:, None])[:, 0]


def smallest_scale(surface: Surface, part: Part, sheet: DataSheet) -> float:
    """Return the scale of the smallest part of this shape that can be turned at every pose (:data:`TURNABLE`); nan: not even
    this one."""
    if reach_of(surface, part, sheet).min() < TURNABLE:
        return math.nan
    low, high = 0.0, 1.0
    for _ in range(8):
        middle = 0.5 * (low + high)
        holes = [middle * hole for hole in part.holes]
        smaller = Part.polygon(middle * part.rim, holes=holes, friction=part.friction)
        if reach_of(surface, smaller, sheet).min() < TURNABLE:
            low = middle
        else:
            high = middle
    return high


def top_speed(surface: Surface, part: Part, amplitude: float) -> float:
    """Return the mean speed over the last of :data:`RUN_UP` periods on elements that all push along x, m/s."""
    room = 2.0 * part.radius + RUN_UP * surface.period * surface.table_speed
    columns = math.ceil(room / surface.element_size) + 2
    rows = math.ceil((2.0 * part.radius + 0.2 * room) / surface.element_size) + 2
    long = replace(surface, rows=rows, columns=columns, max_amplitude=None)
    simulator = Simulator(long, part, threads=1)
    simulator.reset([[[part.radius + long.element_size, 0.5 * long.depth, 0.0]]])
    # An element pushes towards (-S, -C): along x with a phase of -90 degrees.
    simulator.advance(np.full((rows, columns), amplitude), np.full((rows, columns), -0.5 * math.pi), RUN_UP)
    return float(np.hypot(*simulator.mean_velocity[0, 0, :2]))
