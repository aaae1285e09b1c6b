"""Many schedules from the same starts on the same machines, all in one batch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.learned.schedule import Schedule
from vibgym import Part, Simulator, Surface
from vibgym.actuators import actuators_from
from vibgym.physics.core.drive import phasor_drive

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
    room = np.array([surface.width, surface.height]) - 2.0 * part.radius
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
    model: str = "averaged",
    threads: int | None = None,
) -> np.ndarray:
    """Poses (periods + 1, schedules, trials, 3) at the ends of periods, the start included.

    Args:
        schedules: to compare, of any number of segments.
        trials: starts, friction and machines.
        part, surface: the scene.
        hardware: as ``actuators=`` of an environment.
        seconds: to simulate.
        model: of the simulator.
        threads: of the simulator.
    """
    each = max(MOST_WORLDS // len(trials.pose), 1)
    chunks = [schedules[k : k + each] for k in range(0, len(schedules), each)]
    return np.concatenate([_play(chunk, trials, part, surface, hardware, seconds, model, threads) for chunk in chunks], 1)


def _play(
    schedules: Sequence[Schedule],
    trials: Trials,
    part: Part,
    surface: Surface,
    hardware: Any,
    seconds: float,
    model: str,
    threads: int | None,
) -> np.ndarray:
    count, many = len(schedules), len(trials.pose)
    worlds, size = count * many, 2 * surface.rows * surface.columns
    simulator = Simulator(surface, part, worlds=worlds, model=model, threads=threads)
    stage = actuators_from(hardware, surface, worlds, 1)
    stage.prepare(phasor_drive(np.zeros((worlds, size), np.float32), surface.columns, surface.full_scale))
    stage.reset(np.arange(worlds), np.tile(trials.machine, (count, 1)))
    idle = np.array([[*surface.idle_velocity(part.friction * factor), 0.0] for factor in trials.friction.tolist()])
    simulator.reset(np.tile(trials.pose, (count, 1))[:, None], np.tile(idle, (count, 1))[:, None])
    simulator.set_conditions(slice(None), friction=np.tile(trials.friction, count)[:, None])
    phasors = [schedule.phasors(surface).reshape(-1, size) for schedule in schedules]
    periods = math.ceil(seconds / surface.period - 1e-9)
    poses, before, drive = [simulator.pose[:, 0]], None, None
    for period in range(periods):
        now = np.array([period * surface.period])
        shares = [schedule.shares(now, surface.period)[0] for schedule in schedules]
        changed = before is None or any((a != b).any() for a, b in zip(shares, before))
        if changed:
            command = np.array([share @ fields for share, fields in zip(shares, phasors)], dtype=np.float32)
            drive = phasor_drive(np.repeat(command, many, axis=0), surface.columns, surface.full_scale)
        before = shares
        for each, stretch in stage.apply(drive):  # type: ignore[arg-type]
            simulator.run(each, stretch)
        poses.append(simulator.pose[:, 0])
    return np.array(poses).reshape(periods + 1, count, many, 3)
