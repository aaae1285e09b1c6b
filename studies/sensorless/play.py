"""Many schedules from the same starts on the same machines, all in one batch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.actuators import actuators_from
from vibgym.physics.core.drive import phasor_drive
from vibgym.policies.trained.schedule import Schedule

MOST_WORLDS = 4096
"""That run at once: their commands take 2 kB each."""


@dataclass(frozen=True, eq=False)
class Trials:
    """What is drawn before a schedule begins, the same for all that are compared.

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
    """Starts anywhere on the surface, without overhang, at any heading; machines; friction evenly in a range of factors."""
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
    """Poses (steps + 1, schedules, trials, 3) at the ends of steps, the start included.

    Args:
        schedules: to compare, of any number of segments.
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
