"""Sensing stage of an environment: a sensor, and an estimator that computes the measurement from its readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Protocol

import numpy as np

from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import State
from vibgym.sensing.base import Sensor
from vibgym.sensing.measurement import Measurement, Reading, new_measurement
from vibgym.settings import BaseSettings
from vibgym.snapshots import Live


class Estimator(Protocol):
    """Computes measurements from readings; batched."""

    measurement: Measurement
    lead: int
    """Periods after the present for which the measurement is predicted; default 0."""

    def prepare(self, command: Drive) -> None:
        """Allocate buffers for commands of this form, once, before the first of them."""

    def reset(self, worlds: np.ndarray, reading: Reading) -> None:
        """Restart in ``worlds`` (index array) from the first reading of an episode."""

    def reset_parts(self, which: np.ndarray, reading: Reading) -> None:
        """Restart for parts that have arrived or left, ``which`` (worlds, parts); called by tasks with such parts."""

    def predict(self, command: Drive) -> None:
        """Predict the state after a step under its command, before the step."""

    def correct(self, reading: Reading) -> None:
        """Correct the estimate by the reading that is due at the end of the step."""

    def live(self) -> dict[str, np.ndarray]:
        """Return all live arrays of a snapshot."""
        ...


class Hold:
    """Estimator that holds the last reading of each part; see :class:`Estimator`."""

    lead = 0

    class Settings(BaseSettings):
        """There are none."""

    def __init__(
        self, sensor: Sensor, plant: Any, latency: int, walls: Sequence[str], settings: Settings | None = None
    ) -> None:
        self._sensor = sensor
        self.measurement = new_measurement(sensor.worlds, len(sensor.parts))
        self.measurement.sigma[...] = sensor.all_sigma

    def prepare(self, command: Drive) -> None:
        pass

    def reset(self, worlds: np.ndarray, reading: Reading) -> None:
        self.reset_parts(worlds, reading)

    def reset_parts(self, which: np.ndarray, reading: Reading) -> None:
        for kept, read in zip(self.measurement[:3], reading[:3]):
            kept[which] = read[which]
        self.measurement.age[which] = 0

    def predict(self, command: Drive) -> None:
        pass

    def correct(self, reading: Reading) -> None:
        pose, mean_velocity, gone, age, *_ = self.measurement
        seen = reading.seen
        if seen.all():
            pose[...], mean_velocity[...], gone[...] = reading.pose, reading.mean_velocity, reading.gone
            age[...] = self._sensor.delay
            return
        for kept, read in ((pose, reading.pose), (mean_velocity, reading.mean_velocity)):
            np.copyto(kept, read, where=seen[..., None])
        np.copyto(gone, reading.gone, where=seen)
        age += self._sensor.periods
        age[seen] = self._sensor.delay

    def live(self) -> dict[str, np.ndarray]:
        return self.measurement._asdict()


class Sensing(Live):
    """A sensor and an estimator.

    Attributes:
        exact: whether the measurement always equals the true state. Then the stages :meth:`predict`, :meth:`sample` and
            :meth:`correct` are left out.
        instant: periods after a step's start at which :meth:`sample` is due.
        lead: periods after the present for which the measurement is predicted.
        draws: uniform random numbers for the start of an episode.
        report: features of the measurement added to observations, see :data:`vibgym.sensing.MEASUREMENT_FEATURES`.
    """

    SNAPSHOT, exact = "sensor", False

    class Settings(BaseSettings):
        """Settings of sensing, in the mapping of the sensor."""

        estimator: str | Mapping[str, Any] = "none"
        """Among :data:`vibgym.sensing.ESTIMATORS`: its name, or a mapping with ``kind`` and its settings."""

        report: tuple[Literal["age", "sigma", "contacts"], ...] = ()
        """Features of the measurement that are added to observations, see :data:`vibgym.sensing.MEASUREMENT_FEATURES`."""

    def __init__(self, sensor: Sensor, estimator: Estimator, report: tuple[str, ...] = ()) -> None:
        self.sensor, self.estimator, self.report = sensor, estimator, report
        self.instant, self.draws = sensor.instant, sensor.all_draws
        self.lead = getattr(estimator, "lead", 0)

    @property
    def measurement(self) -> Measurement:
        """The present measurement, live."""
        return self.estimator.measurement

    def info(self) -> dict[str, np.ndarray]:
        """Return live arrays (worlds, ...) of the measurement that ``info`` reports, by name."""
        measured = self.estimator.measurement
        return {"age": measured.age, "sigma": measured.sigma, **self.sensor.info()}

    def prepare(self, command: Drive) -> None:
        """Allocate buffers for commands of this form, once, before the first of them."""
        self.estimator.prepare(command)

    def reset(self, worlds: np.ndarray, state: State, uniform: np.ndarray) -> None:
        """Restart in ``worlds``, see :meth:`Sensor.reset`."""
        self.sensor.reset(worlds, state, uniform)
        self.estimator.reset(worlds, self.sensor.due)

    def reset_parts(self, which: np.ndarray, state: State) -> None:
        """Restart for single parts, see :meth:`Sensor.reset_parts`."""
        self.sensor.reset_parts(which, state)
        self.estimator.reset_parts(which, self.sensor.due)

    def predict(self, command: Drive) -> None:
        """Predict the state after a step under its command, before the step."""
        self.estimator.predict(command)

    def sample(self, state: State) -> None:
        """Sample the true state of this instant."""
        self.sensor.sample(state)

    def correct(self) -> None:
        """Update the measurement at the end of a step."""
        self.estimator.correct(self.sensor.due)

    def live(self) -> dict[str, np.ndarray]:
        own = {f"estimator_{name}": values for name, values in self.estimator.live().items()}
        return {**self.sensor.live(), **own}


class ExactSensing(Sensing):
    """An exact sensor without estimator: the measurement is the live true state; nothing is copied."""

    exact = True

    def __init__(self, sensor: Sensor, report: tuple[str, ...] = ()) -> None:
        self.sensor, self.report = sensor, report
        self.instant, self.draws, self.lead = sensor.instant, 0, 0
        shape = (sensor.worlds, len(sensor.parts))
        self._none = np.zeros(shape, dtype=np.int64), np.zeros((*shape, 3))
        self._truth: Measurement | None = None

    @property
    def measurement(self) -> Measurement:
        """The true state."""
        assert self._truth is not None  # an episode has begun
        return self._truth

    def info(self) -> dict[str, np.ndarray]:
        return {}

    def prepare(self, command: Drive) -> None:
        pass

    def reset(self, worlds: np.ndarray, state: State, uniform: np.ndarray) -> None:
        self._truth = Measurement(state.pose, state.mean_velocity, state.fallen, *self._none, state.pushed)

    def reset_parts(self, which: np.ndarray, state: State) -> None:
        pass

    def live(self) -> dict[str, np.ndarray]:
        return {}
