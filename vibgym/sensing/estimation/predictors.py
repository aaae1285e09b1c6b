"""Predictors of the state after a step: the simulator under the commands, or friction alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from vibgym.kernels.jit import jit
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import new_state
from vibgym.sensing.base import Sensor
from vibgym.simulation.plant import drag_of, motion
from vibgym.simulation.simulator import Simulator


class Plant(Protocol):
    """Actuators of a model of the hardware, as in :mod:`vibgym.actuators`."""

    draws: int
    """Number of uniform random numbers for an episode's start; a model uses 0.5 for each."""

    def prepare(self, command: Drive) -> None:
        """Allocate buffers for commands of this form."""

    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Restart in ``worlds``."""

    def apply(self, command: Drive) -> Iterable[tuple[Drive, int]]:
        """Return the executed drives of a step, and the number of periods of each."""
        ...

    def live(self) -> dict[str, np.ndarray]:
        """Return all live arrays of a snapshot."""
        ...


class ModelPredictor:
    """The simulator with nominal parts and nominal actuators.

    Args:
        sensor: with surface, parts and worlds.
        plant: nominal actuators.
        walls: of the table.
        model: of the simulator.
        delivered: factor on the parts' coupling to the elements' motion.
    """

    def __init__(self, sensor: Sensor, plant: Plant, walls: Sequence[str], model: str, delivered: float = 1.0) -> None:
        parts = sensor.kinds.changed(lambda part: replace(part, coupling=delivered * part.coupling))
        self.simulator = Simulator(sensor.surface, parts, walls=walls, worlds=sensor.worlds, model=model)
        self.state, self._plant, self._periods = self.simulator.state, plant, sensor.periods
        self._kinds = sensor.kinds
        self._idle = self._kinds.values(lambda part: np.append(sensor.surface.idle_velocity(part.friction), 0.0))

    def prepare(self, command: Drive) -> None:
        """Allocate buffers for commands of this form."""
        self._plant.prepare(command)

    def place(self, worlds: Any, pose: np.ndarray, fallen: np.ndarray) -> None:
        """Place parts at rest in ``worlds``."""
        self._plant.reset(worlds, np.full((len(worlds), self._plant.draws), 0.5))
        idle = self._idle[self._kinds.rows(worlds)]
        self.simulator.place(worlds, pose, np.where(fallen[..., None], 0.0, idle), 0.0, fallen)

    def reset_parts(self, which: np.ndarray, pose: np.ndarray, fallen: np.ndarray) -> None:
        """Place the parts ``which`` (worlds, parts) at poses (n, 3); ``fallen`` (n,): off the table."""
        idle = np.broadcast_to(self._idle, self.state.velocity.shape)[which]
        self.state.pose[which], self.state.velocity[which] = pose, np.where(fallen[:, None], 0.0, idle)
        self.state.mean_velocity[which], self.state.sticking[which], self.state.fallen[which] = 0.0, False, fallen

    def run(self, command: Drive, instant: int, kept: np.ndarray) -> None:
        """Advance by a step, and write the poses after ``instant`` periods to ``kept`` (worlds, parts, 3)."""
        elapsed = 0
        for drive, periods in self._plant.apply(command):
            end = elapsed + periods
            if elapsed < instant < end:
                self.simulator.advance_drive(drive, instant - elapsed)
                kept[...] = self.state.pose
                self.simulator.advance_drive(drive, end - instant)
            else:
                self.simulator.advance_drive(drive, periods)
                if end == instant:
                    kept[...] = self.state.pose
            elapsed = end

    def live(self) -> dict[str, np.ndarray]:
        """Return all live arrays of a snapshot."""
        plant = {f"plant_{name}": values for name, values in self._plant.live().items()}
        return {**self.state._asdict(), **plant}


def drags_of(sensor: Sensor) -> np.ndarray:
    """Return (worlds, parts) 1/s, see :func:`vibgym.scene.sliding.drag_of`; live."""
    return sensor.kinds.values(lambda part: drag_of(sensor.surface, [part])[0], sensor.worlds)


@jit
def glide(state, drag, time):
    """Advance parts under friction alone, see :mod:`vibgym.simulation.plant`."""
    for w in range(state.pose.shape[0]):
        for p in range(state.pose.shape[1]):
            if state.fallen[w, p]:
                continue
            way, _, left = motion(drag[w, p], time)
            for k in range(3):
                state.pose[w, p, k] += way * state.mean_velocity[w, p, k]
                state.mean_velocity[w, p, k] *= left


class FreePredictor:
    """Friction alone; all other accelerations are process noise of the filter. Methods are those of :class:`ModelPredictor`."""

    def __init__(self, sensor: Sensor) -> None:
        self.state = new_state(sensor.worlds, len(sensor.parts))
        self._drag = drags_of(sensor)
        self._period, self._periods = sensor.surface.period, sensor.periods

    def prepare(self, command: Drive) -> None:
        pass

    def place(self, worlds: Any, pose: np.ndarray, fallen: np.ndarray) -> None:
        self.state.pose[worlds], self.state.mean_velocity[worlds], self.state.fallen[worlds] = pose, 0.0, fallen

    def reset_parts(self, which: np.ndarray, pose: np.ndarray, fallen: np.ndarray) -> None:
        self.place(which, pose, fallen)

    def run(self, command: Drive, instant: int, kept: np.ndarray) -> None:
        glide(self.state, self._drag, instant * self._period)
        kept[...] = self.state.pose
        if instant < self._periods:
            glide(self.state, self._drag, (self._periods - instant) * self._period)

    def live(self) -> dict[str, np.ndarray]:
        return {"pose": self.state.pose, "mean_velocity": self.state.mean_velocity, "fallen": self.state.fallen}
