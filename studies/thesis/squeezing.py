"""The squeeze experiment of the thesis (section 7.2.2): parts put down at random in a squeeze field, without a sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.actuators import ACTUATORS
from vibgym.fields import squeeze
from vibgym.physics.core.drive import polar_drive

LINE = 0.078
"""m, y of the squeeze line, the middle of the six rows on the thesis's axis."""

START = 0.442
"""m, x of the parts at the start, the middle of the thesis's axis."""

REACH = 0.013
"""m: every element pushes in full, for the nearest centres are half an element from the line."""

SECONDS = 10.0
TRANSIENT, LAST = 2.0, 1.5  # s, at the beginning and at the end
RESTING = math.radians(10.0)
STABLE = math.radians(22.5)


@dataclass(frozen=True)
class Squeezed:
    """Courses of the parts, one of each world.

    Attributes:
        time: (k,) s.
        pose: (k, worlds, 3) m, rad, not wrapped.
        symmetry: the heading is told modulo ``2 pi / symmetry``, as the thesis does with half a turn.
    """

    time: np.ndarray
    pose: np.ndarray
    symmetry: int

    @property
    def offset(self) -> np.ndarray:
        """(k, worlds) m, distance from the squeeze line along y."""
        return self.pose[..., 1] - LINE

    @property
    def turned(self) -> np.ndarray:
        """(k, worlds) rad, heading relative to the one that the parts have in the end in the mean, modulo the symmetry."""
        final = np.exp(1j * self.symmetry * self.pose[-1, :, 2]).mean()
        return np.angle(np.exp(1j * self.symmetry * self.pose[..., 2]) * np.conj(final)) / self.symmetry

    @property
    def late(self) -> np.ndarray:
        """(k,) whether the transient is over."""
        return self.time >= TRANSIENT

    @property
    def resting(self) -> float:
        """Share of the parts whose heading changes by less than 10 deg during the last 1.5 s."""
        return float(self._rests().mean())

    @property
    def stable(self) -> float:
        """Share of the parts that also end within 22.5 deg of the common heading."""
        return float((self._rests() & (np.abs(self.turned[-1]) < STABLE)).mean())

    def _rests(self) -> np.ndarray:
        heading = self.pose[self.time >= self.time[-1] - LAST, :, 2]
        return np.ptp(heading, axis=0) < RESTING


def squeezed(
    part: Part, hardware: str, *, worlds: int = 200, strength: float = 1.0, seconds: float = SECONDS, seed: int = 74
) -> Squeezed:
    """Put parts down at random and let a squeeze field act.

    Args:
        part: with any number of corners.
        hardware: ``"ideal"``, or ``"prototype"`` with the defaults of :class:`vibgym.actuators.PrototypeActuators`: a machine
            of its own in every world.
        worlds: number of starts.
        strength: of the field; 1 is the lift-off amplitude.
        seconds: to simulate.
        seed: of starts and machines.

    Raises:
        ValueError: unknown hardware.
    """
    surface = Surface()
    shape = (worlds, surface.rows, surface.columns)
    amplitude, phase = squeeze(START, LINE, 0.0, strength, REACH).drive(surface)
    command = polar_drive(np.broadcast_to(amplitude, shape), np.broadcast_to(phase, shape), surface.angular_frequency)
    stage = ACTUATORS.choose("hardware", hardware)(surface, worlds, 1)
    random = np.random.default_rng(seed)
    stage.prepare(command)
    pose = np.zeros((worlds, 1, 3))
    pose[:, 0, 0] = START
    pose[:, 0, 1] = random.uniform(part.radius, 2.0 * LINE - part.radius, worlds)
    pose[:, 0, 2] = random.uniform(-math.pi, math.pi, worlds)
    stage.reset(np.arange(worlds), random.random((worlds, stage.draws)))
    simulator = Simulator(surface, part, worlds=worlds)
    simulator.reset(pose, [*surface.idle_velocity(part.friction), 0.0])
    poses = [simulator.pose[:, 0]]
    for _ in range(round(seconds / surface.period)):
        for drive, periods in stage.apply(command):
            simulator.run(drive, periods)
        poses.append(simulator.pose[:, 0])
    return Squeezed(np.arange(len(poses)) * surface.period, np.array(poses), max(part.symmetry, 1))
