"""No estimator: what was read last is taken for the present."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibgym.physics.core.drive import Drive
from vibgym.sensing.base import Sensor
from vibgym.sensing.estimation.predictors import Plant
from vibgym.sensing.measurement import Reading, new_measurement


class Hold:
    """The last reading of each part, however old; see :class:`vibgym.sensing.stage.Estimator`."""

    lead = 0

    def __init__(self, sensor: Sensor, plant: Plant, latency: int, walls: Sequence[str]) -> None:
        self._sensor = sensor
        self.measurement = new_measurement(sensor.worlds, len(sensor.parts))
        self.measurement.sigma[...] = sensor.all_sigma

    def prepare(self, command: Drive) -> None:
        pass

    def reset(self, worlds: np.ndarray, reading: Reading) -> None:
        for kept, read in zip(self.measurement[:3], reading[:3]):
            kept[worlds] = read[worlds]
        self.measurement.age[worlds] = 0

    def renew(self, which: np.ndarray, reading: Reading) -> None:
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
