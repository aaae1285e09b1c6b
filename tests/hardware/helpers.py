"""Machines with faults, and actuators that round commands like a driver."""

from __future__ import annotations

import numpy as np

from vibgym.actuators import PrototypeActuators
from vibgym.hardware import SimulatedDriver
from vibgym.hardware.env import write_motion
from vibgym.physics.core.drive import polar_drive

IDEAL = {"kind": "prototype", "dead_zone": 0.0, "latency": 0, "gain_spread": 0.0, "phase_spread": 0.0, "seed": 0}
PROTOTYPE = {"kind": "prototype", "dead": 0.02}
SENSOR = {"kind": "pose", "delay": 1, "dropout": 0.1, "estimator": "model"}


class Polar(PrototypeActuators):
    """Actuators that are given amplitude and phase, as drivers are: the same rounding as on a machine."""

    def prepare(self, command):
        elements = np.zeros((2, 1, self.surface.rows, self.surface.columns))
        self.polar = polar_drive(*elements, self.surface.angular_frequency)
        super().prepare(self.polar)

    def apply(self, command):
        write_motion(command, self.surface, self.polar.amplitude[0], self.polar.phase[0])
        return super().apply(self.polar)


def as_image(k, measurement, now):
    """Change a measurement into an image whose bytes are the poses; see :class:`Faulty`."""
    image = np.frombuffer(measurement.pose.tobytes(), np.uint8).reshape(1, -1)
    return measurement._replace(pose=None, image=image), now


def locate(image):
    """Return the pose (1, 3) in an image."""
    return np.frombuffer(image.tobytes()).reshape(1, 3)


class Faulty:
    """A simulated machine whose measurements a function changes: ``change(k, measurement, now)`` of cycle k."""

    def __init__(self, change=lambda k, measurement, now: (measurement, now), skip=None, **settings):
        self.inner = SimulatedDriver("Align", seed=5, **settings)
        self.change, self.skip, self.k, self.sent = change, skip or {}, -1, []

    @property
    def amplitude(self):
        return self.inner.env.core.action.amplitude

    def send(self, amplitude, phase):
        self.sent.append((amplitude.copy(), phase.copy()))
        self.inner.send(amplitude, phase)

    def receive(self):
        self.k += 1
        for _ in range(self.skip.get(self.k, 0)):
            self.inner.receive()
        measurement, self.time = self.change(self.k, self.inner.receive(), self.inner.now())
        return measurement

    def now(self):
        return self.time

    def stop(self):
        self.inner.stop()

    def close(self):
        self.inner.close()
