"""Sensing stage of an environment: a sensor, and an estimator that computes the measurement from its readings."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import State
from vibgym.sensing.base import Sensor
from vibgym.sensing.measurement import Measurement, Reading
from vibgym.snapshots import Live


class Estimator(Protocol):
    """Turns readings into what is known now; batched."""

    measurement: Measurement
    lead: int
    """Periods after the present for which the measurement is predicted; default 0."""

    def prepare(self, command: Drive) -> None:
        """See what commands will look like, once, before the first of them."""

    def reset(self, worlds: np.ndarray, reading: Reading) -> None:
        """Start afresh in ``worlds`` (index array) from what was read of them at the start."""

    def renew(self, which: np.ndarray, reading: Reading) -> None:
        """Start afresh with parts that have come or gone, ``which`` (worlds, parts); only tasks whose parts do ask for it."""

    def predict(self, command: Drive) -> None:
        """Carry the estimate on by a step under its command, before it acts."""

    def correct(self, reading: Reading) -> None:
        """Correct the estimate by the reading that is due at the step's end."""

    def live(self) -> dict[str, np.ndarray]:
        """Return all live arrays of a snapshot."""
        ...


class Sensing(Live):
    """A sensor and an estimator.

    Attributes:
        exact: whether the measurement is always the truth of this instant.
        instant: periods after a step's start at which :meth:`look` is due.
        lead: periods after the present for which the measurement is predicted.
        measurement: what is known now.
        draws: uniform numbers that an episode's start needs.
        tell: features of the measurement added to observations, see :data:`vibgym.sensing.MEASUREMENT_FEATURES`.
    """

    SNAPSHOT, exact = "sensor", False

    def __init__(self, sensor: Sensor, estimator: Estimator, tell: tuple[str, ...] = ()) -> None:
        self.sensor, self.estimator, self.tell = sensor, estimator, tell
        self.instant, self.draws = sensor.instant, sensor.all_draws
        self.lead = getattr(estimator, "lead", 0)

    @property
    def measurement(self) -> Measurement:
        """What is known now."""
        return self.estimator.measurement

    def facts(self) -> dict[str, np.ndarray]:
        """Return live arrays (worlds, ...) of the measurement that ``info`` reports, by name."""
        known = self.estimator.measurement
        return {"age": known.age, "sigma": known.sigma, **self.sensor.facts()}

    def prepare(self, command: Drive) -> None:
        """See what commands will look like, once, before the first of them."""
        self.estimator.prepare(command)

    def reset(self, worlds: np.ndarray, state: State, uniform: np.ndarray) -> None:
        """Start afresh in ``worlds``, see :meth:`Sensor.reset`."""
        self.sensor.reset(worlds, state, uniform)
        self.estimator.reset(worlds, self.sensor.due)

    def renew(self, which: np.ndarray, state: State) -> None:
        """Start afresh with single parts, see :meth:`Sensor.renew`."""
        self.sensor.renew(which, state)
        self.estimator.renew(which, self.sensor.due)

    def predict(self, command: Drive) -> None:
        """Carry the estimate on by a step under its command, before it acts."""
        self.estimator.predict(command)

    def look(self, state: State) -> None:
        """Take in the true state of this instant."""
        self.sensor.look(state)

    def correct(self) -> None:
        """Bring the measurement up to date at a step's end."""
        self.estimator.correct(self.sensor.due)

    def live(self) -> dict[str, np.ndarray]:
        own = {f"estimator_{name}": values for name, values in self.estimator.live().items()}
        return {**self.sensor.live(), **own}


class ExactSensing(Sensing):
    """An exact sensor by itself: the measurement is the live true state, and nothing is copied or kept."""

    exact = True

    def __init__(self, sensor: Sensor, tell: tuple[str, ...] = ()) -> None:
        self.sensor, self.tell = sensor, tell
        self.instant, self.draws, self.lead = sensor.instant, 0, 0
        shape = (sensor.worlds, len(sensor.parts))
        self._none = np.zeros(shape, dtype=np.int64), np.zeros((*shape, 3))
        self._truth: Measurement | None = None

    @property
    def measurement(self) -> Measurement:
        """The true state."""
        assert self._truth is not None  # an episode has begun
        return self._truth

    def facts(self) -> dict[str, np.ndarray]:
        return {}

    def prepare(self, command: Drive) -> None:
        pass

    def reset(self, worlds: np.ndarray, state: State, uniform: np.ndarray) -> None:
        self._truth = Measurement(state.pose, state.mean_velocity, state.fallen, *self._none, state.pushed)

    def renew(self, which: np.ndarray, state: State) -> None:
        pass

    def predict(self, command: Drive) -> None:
        pass

    def look(self, state: State) -> None:
        pass

    def correct(self) -> None:
        pass

    def live(self) -> dict[str, np.ndarray]:
        return {}
