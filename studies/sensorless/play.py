"""Many schedules from the same starts on the same hardware, all in one batch; errors of their poses, and their cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.actuators import actuators_from
from vibgym.physics.core.drive import phasor_drive
from vibgym.policies.trained.schedule import Schedule

MOST_WORLDS = 4096
"""Simulated at once: their commands take 2 kB each."""


class Trials(NamedTuple):
    """Random conditions, the same for all schedules in a comparison.

    Attributes:
        pose: (trials, 3) of the part at the start, m, m, rad.
        friction: (trials,) factor on the part's friction.
        machine: (trials, draws) uniform numbers from which the actuators are drawn.
    """

    pose: np.ndarray
    friction: np.ndarray
    machine: np.ndarray


def draw_trials(
    part: Part, surface: Surface, hardware: Any, friction: tuple[float, float], trials: int, seed: Sequence[int]
) -> Trials:
    """Return starts anywhere on the surface, without overhang, at any heading; hardware; friction factors in a range."""
    random = np.random.default_rng(list(seed))
    room = np.array([surface.width, surface.depth]) - 2.0 * part.radius
    place = part.radius + room * random.random((trials, 2))
    pose = np.column_stack([place, random.uniform(-math.pi, math.pi, trials)])
    factors = random.uniform(*friction, trials)
    return Trials(pose, factors, random.random((trials, actuators_from(hardware, surface, 1, 1).draws)))


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
    """Return poses (steps + 1, schedules, trials, 3) at the ends of steps, the start included.

    Args:
        schedules: of any number of segments.
        trials: starts, friction and machines.
        part, surface: the scene.
        hardware: as ``actuators=`` of an environment.
        seconds: to simulate.
        model: of the simulator; ``"averaged"`` takes a step in one stride.
        periods: oscillation periods of a step; commands stay the same in it.
        threads: of the simulator.
    """
    each = max(MOST_WORLDS // len(trials.pose), 1)
    chunks = [schedules[k : k + each] for k in range(0, len(schedules), each)]
    return np.concatenate(
        [_play(chunk, trials, part, surface, hardware, seconds, model, periods, threads) for chunk in chunks], 1
    )


def _play(
    schedules: Sequence[Schedule],
    trials: Trials,
    part: Part,
    surface: Surface,
    hardware: Any,
    seconds: float,
    model: str,
    periods: int,
    threads: int | None,
) -> np.ndarray:
    count, many = len(schedules), len(trials.pose)
    worlds, size = count * many, 2 * surface.rows * surface.columns
    knobs: dict[str, Any] = {"stride": periods} if model == "averaged" else {}
    simulator = Simulator(surface, part, worlds=worlds, model=model, threads=threads, **knobs)
    stage = actuators_from(hardware, surface, worlds, periods)
    stage.prepare(phasor_drive(np.zeros((worlds, size), np.float32), surface.columns, surface.full_scale))
    stage.reset(np.arange(worlds), np.tile(trials.machine, (count, 1)))
    idle = np.array([[*surface.idle_velocity(part.friction * factor), 0.0] for factor in trials.friction.tolist()])
    simulator.reset(np.tile(trials.pose, (count, 1))[:, None], np.tile(idle, (count, 1))[:, None])
    simulator.set_conditions(slice(None), friction=np.tile(trials.friction, count)[:, None])
    step = periods * surface.period
    steps = math.ceil(seconds / step - 1e-9)
    shares = [schedule.shares(step * np.arange(steps), step) for schedule in schedules]
    changes = np.any([np.any(np.diff(each, axis=0, prepend=-1.0) != 0.0, axis=1) for each in shares], axis=0)
    phasors = [schedule.phasors(surface).reshape(-1, size) for schedule in schedules]
    poses, drive = [simulator.pose[:, 0]], None
    for k in range(steps):
        if changes[k]:
            command = np.array([share[k] @ fields for share, fields in zip(shares, phasors)], dtype=np.float32)
            drive = phasor_drive(np.repeat(command, many, axis=0), surface.columns, surface.full_scale)
        assert drive is not None  # the first step always changes
        for each, stretch in stage.apply(drive):
            simulator.run(each, stretch)
        poses.append(simulator.pose[:, 0])
    return np.array(poses).reshape(steps + 1, count, many, 3)


FINE = (0.002, math.radians(3.0))
"""m, rad: Align's tolerances."""

COARSE = (0.005, math.radians(5.0))


class Errors(NamedTuple):
    """Distance from the goal (m) and heading's deviation modulo the part's symmetry (rad), arrays of one shape."""

    distance: np.ndarray
    turn: np.ndarray

    def within(self, tolerance: tuple[float, float]) -> np.ndarray:
        """Return where both are within a tolerance, bool."""
        return (self.distance <= tolerance[0]) & (self.turn <= tolerance[1])


def errors_of(pose: np.ndarray, goal: np.ndarray, symmetry: int) -> Errors:
    """Return the errors (...) of poses (..., 3); with ``symmetry`` 0, of a disc, all headings are equal."""
    distance = np.hypot(pose[..., 0] - goal[0], pose[..., 1] - goal[1])
    if symmetry == 0:
        return Errors(distance, np.zeros_like(distance))
    period = 2.0 * math.pi / symmetry
    turn = pose[..., 2] - goal[2]
    return Errors(distance, np.abs(turn - period * np.round(turn / period)))


def cost(errors: Errors) -> np.ndarray:
    """Return the smooth cost (schedules,) of errors (periods + 1, schedules, trials): the mean over time plus that of the end.

    A single error, in units of Align's tolerances, costs ``log(1 + e^2)``, so that both large errors and
    errors just outside of the tolerance matter. The end is the last tenth of the time.
    """
    each = np.log1p((errors.distance / FINE[0]) ** 2 + (errors.turn / FINE[1]) ** 2).mean(axis=-1)
    last = max(len(each) // 10, 1)
    return each.mean(axis=0) + each[-last:].mean(axis=0)
