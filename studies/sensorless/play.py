"""Simulation of many schedules in one batch, errors of their final poses, and the cost of these."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from studies.sensorless.schedule import Schedule
from vibgym import Part, Simulator, Surface
from vibgym.actuators import ACTUATORS
from vibgym.physics.core.drive import phasor_drive

MAX_WORLDS = 4096
"""Largest batch: the commands of a world take 2 kB."""


class Trials(NamedTuple):
    """Random conditions, equal for all compared schedules.

    Attributes:
        pose: (trials, 3) initial pose of the part, m, m, rad.
        friction: (trials,) factor on the part's friction.
        uniform: (trials, draws) random numbers in [0, 1) from which the actuators are drawn.
    """

    pose: np.ndarray
    friction: np.ndarray
    uniform: np.ndarray


def draw_trials(
    part: Part, surface: Surface, hardware: Any, friction: tuple[float, float], trials: int, seed: Sequence[int]
) -> Trials:
    """Draw starts anywhere on the surface without overhang, at any heading, friction factors and properties of actuators."""
    random = np.random.default_rng(list(seed))
    room = np.array([surface.width, surface.depth]) - 2.0 * part.radius
    position = part.radius + room * random.random((trials, 2))
    pose = np.column_stack([position, random.uniform(-math.pi, math.pi, trials)])
    factors = random.uniform(*friction, trials)
    return Trials(pose, factors, random.random((trials, ACTUATORS.make("hardware", hardware, surface, 1, 1).draws)))


def play(
    schedules: Sequence[Schedule],
    trials: Trials,
    part: Part,
    surface: Surface,
    hardware: Any,
    seconds: float,
    model: str = "planar",
    periods: int = 1,
    threads: int | None = None,
) -> np.ndarray:
    """Simulate schedules; return poses (steps + 1, schedules, trials, 3) at the start and at the ends of steps.

    Args:
        schedules: with any number of segments.
        trials: conditions.
        part, surface: the scene.
        hardware: as ``actuators=`` of an environment.
        seconds: duration, s.
        model: of the simulator; ``"averaged"`` integrates a step in one stride.
        periods: oscillation periods per step, during which commands are constant.
        threads: of the simulator.
    """
    most = max(MAX_WORLDS // len(trials.pose), 1)
    if len(schedules) > most:
        chunks = [schedules[k : k + most] for k in range(0, len(schedules), most)]
        return np.concatenate(
            [play(chunk, trials, part, surface, hardware, seconds, model, periods, threads) for chunk in chunks], axis=1
        )
    count, many = len(schedules), len(trials.pose)
    worlds, size = count * many, 2 * surface.rows * surface.columns
    settings: dict[str, Any] = {"stride": periods} if model == "averaged" else {}
    simulator = Simulator(surface, part, worlds=worlds, model=model, threads=threads, **settings)
    actuators = ACTUATORS.make("hardware", hardware, surface, worlds, periods)
    actuators.prepare(phasor_drive(np.zeros((worlds, size), np.float32), surface.columns, surface.full_scale))
    actuators.reset(np.arange(worlds), np.tile(trials.uniform, (count, 1)))
    idle = np.array([[*surface.idle_velocity(part.friction * factor), 0.0] for factor in trials.friction.tolist()])
    simulator.reset(np.tile(trials.pose, (count, 1))[:, None], np.tile(idle, (count, 1))[:, None])
    simulator.set_conditions(slice(None), friction=np.tile(trials.friction, count)[:, None])
    step = periods * surface.period
    steps = math.ceil(seconds / step - 1e-9)
    shares = [schedule.shares(step * np.arange(steps), step) for schedule in schedules]
    changes = np.any([np.any(np.diff(share, axis=0, prepend=-1.0) != 0.0, axis=1) for share in shares], axis=0)
    phasors = [schedule.phasors(surface).reshape(-1, size) for schedule in schedules]
    poses, drive = [simulator.pose[:, 0]], None
    for k in range(steps):
        if changes[k]:
            command = np.array([share[k] @ fields for share, fields in zip(shares, phasors)], dtype=np.float32)
            drive = phasor_drive(np.repeat(command, many, axis=0), surface.columns, surface.full_scale)
        assert drive is not None  # the first step always changes the command
        for applied, stretch in actuators.apply(drive):
            simulator.advance_drive(applied, stretch)
        poses.append(simulator.pose[:, 0])
    return np.array(poses).reshape(steps + 1, count, many, 3)


FINE = (0.002, math.radians(3.0))
"""Tolerances of Align, m and rad."""

COARSE = (0.005, math.radians(5.0))
"""m and rad."""


class Errors(NamedTuple):
    """Distance to the goal (m) and heading error modulo the part's symmetry (rad), arrays of one shape."""

    distance: np.ndarray
    heading: np.ndarray

    def within(self, tolerance: tuple[float, float]) -> np.ndarray:
        """Return whether both errors are within a tolerance, bool."""
        return (self.distance <= tolerance[0]) & (self.heading <= tolerance[1])


def errors_of(pose: np.ndarray, goal: np.ndarray, symmetry: int) -> Errors:
    """Return the errors (...) of poses (..., 3); ``symmetry`` 0 (disc): no heading errors."""
    distance = np.hypot(pose[..., 0] - goal[0], pose[..., 1] - goal[1])
    if symmetry == 0:
        return Errors(distance, np.zeros_like(distance))
    period = 2.0 * math.pi / symmetry
    heading = pose[..., 2] - goal[2]
    return Errors(distance, np.abs(heading - period * np.round(heading / period)))


def cost(errors: Errors) -> np.ndarray:
    """Return the cost (schedules,) of errors (periods + 1, schedules, trials): mean over time plus mean over the last tenth.

    The cost of an error e, in units of Align's tolerances, is ``log(1 + e^2)``. It is sensitive to large errors and to errors
    near the tolerance.
    """
    costs = np.log1p((errors.distance / FINE[0]) ** 2 + (errors.heading / FINE[1]) ** 2).mean(axis=-1)
    last = max(len(costs) // 10, 1)
    return costs.mean(axis=0) + costs[-last:].mean(axis=0)
