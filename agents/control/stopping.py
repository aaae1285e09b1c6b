"""From which speed a part can still stop: braking curves by the averaged friction, for ways and for turns.

Friction helps to brake, the more the faster a part is, and elements brake harder at speed: at 0.3 m/s a part on the prototype
can be slowed down by 4.4 m/s^2, near rest by 2.9. A law that counts on the latter all the way loses a twentieth of a second.
"""

from __future__ import annotations

import numpy as np

from vibgym.allocation.frictional import FrictionalInverse

NODES = 512


class StoppingCurve:
    """Speeds from which parts stop within a way under a share of the largest braking push, and the time that they take.

    Args:
        process: friction and elements.
        share: (parts,) of the push at the limit that brakes.
        top: (parts,) speed at which the curve ends, m/s or rad/s.
        turning: a curve for turns, rad and rad/s.
    """

    def __init__(self, process: FrictionalInverse, share: np.ndarray, top: np.ndarray, turning: bool) -> None:
        parts, limit = len(top), process.limit / process.surface.max_amplitude  # type: ignore[operator]
        axis = 2 if turning else 0
        speed = np.linspace(0.0, 1.0, NODES)[:, None] * top
        velocity, push = np.zeros((NODES, parts, 3)), np.zeros((NODES, parts, 3))
        velocity[..., axis], push[..., axis] = speed, -limit * share
        braking = -process.acceleration(velocity, push)[0][..., axis]
        step = np.diff(speed, axis=0)
        middle = 0.5 * (braking[1:] + braking[:-1])
        mean = 0.5 * (speed[1:] + speed[:-1])
        zero = np.zeros((1, parts))
        self.speed = speed
        self.way = np.concatenate([zero, np.cumsum(mean * step / middle, axis=0)])
        self.time = np.concatenate([zero, np.cumsum(step / middle, axis=0)])

    def at(self, way: np.ndarray) -> np.ndarray:
        """Speeds (batch, parts) from which parts stop within ``way`` (batch, parts) >= 0; the top speed beyond the curve."""
        return self._read(way, self.way, self.speed)

    def time_for(self, way: np.ndarray) -> np.ndarray:
        """s that a part takes for the last ``way`` (batch, parts): at the top speed, and then along the curve."""
        beyond = np.maximum(way - self.way[-1], 0.0)
        return self._read(way, self.way, self.time) + beyond / self.speed[-1]

    @staticmethod
    def _read(way: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        result = np.empty_like(way)
        for p in range(way.shape[1]):
            result[:, p] = np.interp(way[:, p], x[:, p], y[:, p])
        return result
