"""A simulated machine that records: commands, latency, imperfect elements, and a camera with scale, offset and noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.actuators import ACTUATORS
from vibgym.identification.excitation import SECONDS, Excitation
from vibgym.identification.log import Log
from vibgym.physics.core.drive import polar_drive
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation import Simulator


@dataclass(frozen=True)
class Camera:
    """Map from true to measured poses: about the middle of the surface, positions are scaled and turned, then shifted.

    Args:
        scale: measured over true length.
        turn: rad, of the camera's axes against the table's.
        x, y: m, shift of the middle of the surface.
        noise_position, noise_heading: standard deviations of white noise, m and rad.
        dropout: probability that a part is not seen in an image.
    """

    scale: float = 1.0
    turn: float = 0.0
    x: float = 0.0
    y: float = 0.0
    noise_position: float = 0.0
    noise_heading: float = 0.0
    dropout: float = 0.0

    def measured(self, pose: np.ndarray, surface: Surface) -> np.ndarray:
        """Return measured poses (..., 3) without noise."""
        middle = np.array([0.5 * surface.width, 0.5 * surface.depth])
        out, c, s = np.empty_like(pose), self.scale * np.cos(self.turn), self.scale * np.sin(self.turn)
        dx, dy = pose[..., 0] - middle[0], pose[..., 1] - middle[1]
        out[..., 0], out[..., 1] = middle[0] + self.x + c * dx - s * dy, middle[1] + self.y + s * dx + c * dy
        out[..., 2] = pose[..., 2] + self.turn
        return out

    def corrected(self, measured: np.ndarray, surface: Surface) -> np.ndarray:
        """Return the poses (..., 3) whose images are these: the inverse of :meth:`measured`."""
        middle, out = np.array([0.5 * surface.width, 0.5 * surface.depth]), np.empty_like(measured)
        c, s = np.cos(self.turn) / self.scale, np.sin(self.turn) / self.scale
        dx, dy = measured[..., 0] - middle[0] - self.x, measured[..., 1] - middle[1] - self.y
        out[..., 0], out[..., 1] = middle[0] + c * dx + s * dy, middle[1] - s * dx + c * dy
        out[..., 2] = measured[..., 2] - self.turn
        return out


def record(
    surface: Surface,
    parts: Part | Sequence[Part],
    actuators: Any = "ideal",
    camera: Camera | None = None,
    *,
    excitation: Any = None,
    seconds: float = SECONDS,
    seed: int = 0,
    settings: Mapping[str, Any] | None = None,
    **knobs: Any,
) -> Log:
    """Record a simulated machine.

    Args:
        surface, parts, actuators: the true ones; parts must not touch one another.
        camera: None: an exact one.
        excitation: with ``start`` and ``command``, such as :class:`Excitation`, which is used by default.
        seconds: length of the recording.
        seed: of the actuators, the camera's noise and the default excitation.
        settings: nominal settings of the recording; None: the true ones.
        knobs: of :class:`vibgym.Simulator`, such as ``steps``.

    Raises:
        ValueError: a bad argument, or a part has fallen.
    """
    parts = (parts,) if isinstance(parts, Part) else tuple(parts)
    cycles = round(checks.number("seconds", seconds, above=0.0) * surface.frequency)
    camera, rng = Camera() if camera is None else camera, np.random.default_rng([seed, 1])
    excitation = Excitation(surface, parts, seed) if excitation is None else excitation
    stage = ACTUATORS.make("actuators", actuators, surface, 1, 1)
    simulator = Simulator(surface, parts, **knobs)
    idle = [[*surface.idle_velocity(part.friction), 0.0] for part in parts]
    simulator.reset(excitation.start, idle)
    shape = (1, surface.rows, surface.columns)
    stage.prepare(polar_drive(np.zeros(shape), np.zeros(shape), surface.angular_frequency))
    stage.reset(np.arange(1), np.random.default_rng([seed, 2]).random((1, stage.draws)))
    deviation = np.array([camera.noise_position, camera.noise_position, camera.noise_heading])

    def image() -> np.ndarray:
        exact = camera.measured(simulator.pose[0], surface)
        seen = rng.random(len(parts)) >= camera.dropout
        return np.where(seen[:, None], exact + deviation * rng.standard_normal(exact.shape), np.nan)

    amplitude, phase, pose, now = np.empty((cycles, *shape[1:])), np.empty((cycles, *shape[1:])), [], image()
    for k in range(cycles):
        amplitude[k], phase[k] = excitation.command(now)
        command = polar_drive(amplitude[k : k + 1], phase[k : k + 1], surface.angular_frequency)
        for drive, periods in stage.apply(command):
            simulator.advance_drive(drive, periods)
        if simulator.fallen.any():
            raise checks.conflict(f"a part has fallen off the surface after {simulator.time:.1f} s of the recording")
        now = image()
        pose.append(now)
    time = np.arange(cycles) * surface.period
    if settings is None:
        settings = {"surface": asdict(surface), "actuators": actuators, "parts": [part.to_dict() for part in parts]}
    return Log(time, amplitude, phase, np.array(pose), time + surface.period, settings)
