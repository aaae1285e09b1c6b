"""From the true state to what a controller may know: the door that every sensor goes through."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.physics.core.records import State
from vibgym.scene.surface import Surface
from vibgym.snapshots import copied, restored


class Measurement(NamedTuple):
    """What is known of the parts of all worlds; not to be kept, since the next step overwrites it."""

    pose: np.ndarray  # (worlds, parts, 3) m, m, rad
    mean_velocity: np.ndarray  # (worlds, parts, 3) over the last period, m/s, m/s, rad/s
    gone: np.ndarray  # (worlds, parts) bool, parts that are not on the surface


def new_measurement(worlds: int, parts: int) -> Measurement:
    """Arrays for ``worlds`` worlds."""
    shape = (worlds, parts, 3)
    return Measurement(np.zeros(shape), np.zeros(shape), np.zeros((worlds, parts), dtype=bool))


class Sensor(ABC):
    """Base of all sensors: batched, with a delay in periods.

    A sensor of your own is a subclass with :meth:`measure`, and ``vibgym.sensing.SENSORS.register`` gives it a name. It
    looks at the true state once a step, ``delay`` periods before the step's end or at the end of an earlier step; the base
    class keeps what it saw until it is due. Just after a reset that is what it saw then.

    Args:
        surface: the table.
        worlds, parts: number of worlds, and of parts in each.
        periods: oscillation periods of a step.
        delay: periods between an instant and the observation that tells of it.

    Attributes:
        instant: periods after a step's start at which the sensor looks.
        measurement: what is known now.

    Raises:
        ValueError: a bad setting.
    """

    exact: ClassVar[bool] = False
    """Whether what it says is always the truth of this instant: what follows from it then is not computed twice."""

    draws: int = 0
    """Uniform numbers that it needs at the start of each episode, in :meth:`begin`."""

    def __init__(self, surface: Surface, worlds: int, parts: int, periods: int, *, delay: int = 0) -> None:
        self.surface, self.worlds, self.parts = surface, worlds, parts
        self.delay = checks.count("sensor.delay", delay, least=0, most=10_000)
        self.instant = periods - self.delay % periods
        self._seen = [new_measurement(worlds, parts) for _ in range(self.delay // periods + 1)]  # the oldest first

    @property
    def measurement(self) -> Measurement:
        """What is known now."""
        return self._seen[0]

    def reset(self, worlds: np.ndarray, state: State, uniform: np.ndarray) -> None:
        """Start afresh in ``worlds`` (index array), whose parts have been put down.

        Args:
            uniform: (len(worlds), draws) in [0, 1).
        """
        self.begin(worlds, uniform)
        fresh = new_measurement(self.worlds, self.parts)
        self.measure(state, fresh)
        for each in self._seen:
            for kept, seen in zip(each, fresh, strict=True):
                kept[worlds] = seen[worlds]

    def look(self, state: State) -> None:
        """Take in the true state of this instant; called once a step, at :attr:`instant`."""
        oldest = self._seen.pop(0)
        self.measure(state, oldest)
        self._seen.append(oldest)

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:  # noqa: B027 - most have nothing to do
        """Set what holds for the whole episodes of ``worlds``; see :meth:`reset`."""

    @abstractmethod
    def measure(self, state: State, measurement: Measurement) -> None:
        """Write what is seen of ``state`` (not to be changed or kept) into ``measurement``, for all worlds."""

    def own_state(self) -> dict[str, np.ndarray]:
        """Live arrays that belong to a snapshot, by name, besides what the base class keeps."""
        return {}

    def get_state(self) -> dict[str, Any]:
        """Everything needed to go on bit for bit."""
        return copied(self._state())

    def check_state(self, state: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """What :meth:`get_state` gave, checked; for :meth:`set_state`."""
        return restored("state['sensor']", self._state(), state)

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from a checked state."""
        for name, values in self._state().items():
            values[...] = state[name]

    def _state(self) -> dict[str, np.ndarray]:
        kept = {f"{name}{k}": values for k, each in enumerate(self._seen) for name, values in each._asdict().items()}
        return {**kept, **self.own_state()}
