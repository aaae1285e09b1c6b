"""A custom sensor with a constant error per episode: ``python examples/custom_sensor.py [EPISODES]``."""

import sys

import numpy as np
from pydantic import Field

from vibgym.policies import rollout
from vibgym.sensing import SENSORS, Sensor
from vibgym.settings import Length


class Biased(Sensor):
    """Pose sensor with a constant error of the position, drawn for each episode."""

    class Settings(Sensor.Settings):
        """Settings in the sensor's mapping, beside those of every sensor."""

        bias: Length = Field(0.001, ge=0.0)
        """Largest error along x and y."""

    draws = 2  # uniform numbers that an episode needs

    def __init__(self, *scene, **base):
        super().__init__(*scene, **base)
        self.offset = np.zeros((self.worlds, 2))

    def begin(self, worlds, uniform):
        """Start episodes in some worlds."""
        self.offset[worlds] = self.settings.bias * (2.0 * uniform - 1.0)

    def measure(self, state, reading):
        """Write the measurement of the true state; the base class applies delay, dropout and noise afterwards."""
        reading.pose[...] = state.pose
        reading.pose[..., :2] += self.offset[:, None]
        reading.mean_velocity[...] = state.mean_velocity
        reading.gone[...] = state.fallen

    @property
    def sigma(self):
        """Return the standard deviation of a reading (parts, 3), m and rad, for estimators."""
        return np.tile(0.6 * self.settings.bias * np.array([1.0, 1.0, 0.0]), (len(self.parts), 1))

    def custom_state(self):
        """Return the arrays of a snapshot."""
        return {"offset": self.offset}


SENSORS.register("biased", Biased)
episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 100
for bias in (0.0, 0.0005, 0.001, 0.002, 0.004):
    sensor = {"kind": "biased", "bias": bias, "dropout": 0.05, "estimator": "model"}
    result = rollout("pose", "vibgym/Align-v0", seeds=range(episodes), sensor=sensor)
    off = 1e3 * np.median(result.position_error)
    print(
        f"off by up to {1e3 * bias:.1f} mm: success {100 * result.success.mean():.0f} %, ends {off:.2f} mm from its goal"
    )
