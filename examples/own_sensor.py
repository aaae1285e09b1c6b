"""A sensor of your own: it is off by a constant, one for each episode. ``python examples/own_sensor.py [EPISODES]``."""

import sys

import numpy as np

from vibgym.policies import rollout
from vibgym.sensing import SENSORS, Sensor


class Biased(Sensor):
    """Knows positions but for a constant error."""

    draws = 2  # uniform numbers that an episode needs

    def __init__(self, *scene, bias=0.001, **base):
        super().__init__(*scene, **base)
        self.bias = bias  # m, largest
        self.offset = np.zeros((self.worlds, 2))

    def begin(self, worlds, uniform):
        """An episode begins in some worlds."""
        self.offset[worlds] = self.bias * (2.0 * uniform - 1.0)

    def measure(self, state, reading):
        """Write what is seen of the true state; delay, dropout and noise come after, for every sensor."""
        reading.pose[...] = state.pose
        reading.pose[..., :2] += self.offset[:, None]
        reading.mean_velocity[...] = state.mean_velocity
        reading.gone[...] = state.fallen

    @property
    def sigma(self):
        """For estimators: how far a reading may be off."""
        return np.tile([0.6 * self.bias, 0.6 * self.bias, 0.0], (len(self.parts), 1))

    def own_state(self):
        """What a snapshot must hold."""
        return {"offset": self.offset}


SENSORS.register("biased", Biased)
episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 100
for bias in (0.0, 0.0005, 0.001, 0.002, 0.004):
    sensor = {"kind": "biased", "bias": bias, "dropout": 0.05, "estimator": "model"}
    found = rollout("pose", "vibgym/Align-v0", seeds=range(episodes), sensor=sensor)
    off = 1e3 * np.median(found.position_error)
    print(
        f"off by up to {1e3 * bias:.1f} mm: success {100 * found.success.mean():.0f} %, ends {off:.2f} mm from its goal"
    )
