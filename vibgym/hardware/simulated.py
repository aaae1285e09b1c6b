"""The simulator as a machine: :class:`SimulatedDriver`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from vibgym import checks
from vibgym.envs.actions import Action
from vibgym.envs.core import Core
from vibgym.envs.single import VibgymEnv
from vibgym.envs.vector import environment_id
from vibgym.hardware.driver import PoseMeasurement
from vibgym.physics.core.drive import Drive, polar_drive


class GivenMotion(Action):
    """Amplitude and phase of every element in :attr:`amplitude` and :attr:`phase`; the action itself is ignored."""

    def __init__(self, *scene: Any) -> None:
        super().__init__(*scene)
        self.shape = (1,)
        elements = (1, self.surface.rows, self.surface.columns)
        self.amplitude, self.phase = np.zeros(elements), np.zeros(elements)
        self._polar = polar_drive(self.amplitude, self.phase, self.surface.angular_frequency)

    def command(self, values: np.ndarray, measurement: Any) -> Drive:
        return self._polar


class SimulatedCore(Core):
    """Core whose commands are amplitudes and phases of the elements."""

    action: GivenMotion

    def new_action(self) -> Action:
        return GivenMotion(self.surface, self.parts)


class SimulatedMachine(VibgymEnv):
    """Environment of :class:`SimulatedDriver`."""

    core: SimulatedCore
    core_class = SimulatedCore


class SimulatedDriver:
    """The simulator with its actuators and its sensor as a :class:`Driver`, in lockstep with the control loop.

    :meth:`receive` advances by one step under the last command, except the first time. So a command takes effect from the
    beginning of its cycle, as in ``env.step``; a machine that needs the time of a cycle has ``latency`` 1.

    Args:
        task: id or short name of an environment.
        seed: of the episode: start, hardware and noise are those of ``gym.make(task, **environment).reset(seed=seed)``.
        options: of the reset.
        images: measurements are the camera's images; requires ``sensor="camera"``.
        **environment: keyword arguments of the environment. Estimator, action, observation and ``compensate`` of the
            actuators have no effect.

    Attributes:
        env: with the true state, ``env.truth``.
        surface: the table.  parts: their number.  step_time: s, of a cycle.
        info: of the last step, by the true state.

    Raises:
        ValueError: an unknown environment, or an invalid setting.
    """

    def __init__(
        self,
        task: str,
        *,
        seed: int | None = None,
        options: Mapping[str, Any] | None = None,
        images: bool = False,
        **environment: Any,
    ) -> None:
        kwargs = {**gym.spec(environment_id(task)).kwargs, **environment, "action": "element", "observation": "state"}
        sensor = kwargs.get("sensor")
        if isinstance(sensor, Mapping):
            kwargs["sensor"] = {name: value for name, value in sensor.items() if name not in ("estimator", "report")}
        actuators = kwargs.get("actuators")
        if isinstance(actuators, Mapping):  # the control loop compensates
            kwargs["actuators"] = {name: value for name, value in actuators.items() if name != "compensate"}
        self.env = SimulatedMachine(**kwargs)
        self.surface, self.parts, self.step_time = self.env.surface, len(self.env.parts), self.env.step_time
        self.info: dict[str, Any] = {}
        self._camera: Any = self.env.core.sensing.sensor if images else None
        if images:
            if not hasattr(self._camera, "keep_pictures"):
                raise checks.conflict("images=True requires sensor='camera', or a mapping of that kind")
            self._camera.keep_pictures()
        self.start(seed, options)

    def start(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Begin another episode: the parts are placed anew, and the clock starts at 0."""
        _, self.info = self.env.reset(seed=seed, options=None if options is None else dict(options))
        self.stop()
        self._cycle = -1

    def send(self, amplitude: np.ndarray, phase: np.ndarray) -> None:
        action, most = self.env.core.action, float(self.surface.max_amplitude or 0.0)
        sent = checks.array("amplitude", amplitude, action.amplitude.shape[1:], least=0.0, most=most * (1.0 + 1e-12))
        action.amplitude[0], action.phase[0] = sent, checks.array("phase", phase, action.phase.shape[1:])

    def receive(self) -> PoseMeasurement:
        if self._cycle >= 0:
            self.info = self.env.step(np.zeros(1, dtype=np.float32))[-1]
        self._cycle += 1
        return self._measured()

    def now(self) -> float:
        return max(self._cycle, 0) * self.step_time

    def stop(self) -> None:
        self.env.core.action.amplitude[...] = 0.0

    def close(self) -> None:
        self.env.close()

    def _measured(self) -> PoseMeasurement:
        """Return what the sensor measures now."""
        core = self.env.core
        sensor, state = core.sensing.sensor, core.simulator.state
        if core.sensing.exact:
            return PoseMeasurement(np.where(state.fallen[0, :, None], np.nan, state.pose[0]), self.now())
        reading = sensor.due
        lost = reading.gone[0] | ~reading.seen[0]
        sample = int(sensor.samples[0]) - sensor.delay // sensor.periods
        sample = max(sample - sample % sensor.every, 0)  # the last one with an image
        taken = max(sample * sensor.step - (sensor.periods - sensor.instant) * core.surface.period, 0.0)
        if self._camera is not None:
            return PoseMeasurement(None, taken, self._camera.image()[0])
        return PoseMeasurement(np.where(lost[:, None], np.nan, reading.pose[0]), taken)
