"""The thesis's closed loops, connected as in figs. 5.15, 5.18, 5.22 and 5.23: one loop, two plants, two controllers.

    set position -> controller -> wanted acceleration -> plant -> measured position
                        ^                                |
                        +-- observer <- acceleration after saturation

The real plant is the planar simulator with actuators, after the inverse of the frictional process with its saturation; the
reduced plant is a double integrator. All elements get the same command, so headings are not controlled.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from studies.thesis.state_feedback import Estimate, Observer, feedback
from vibgym import Part, Simulator, Surface
from vibgym.actuators import ACTUATORS
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.physics.core.drive import polar_drive
from vibgym.policies.classical.linear_laws import Pid, PidMemory

START = (0.1, 0.104)
"""m, position of parts at the start; leaves room for an overshoot of twice a step of 0.3 m."""


class Response(NamedTuple):
    """Step response along x, arrays (steps, worlds) at the beginnings of periods, with the amplitudes that begin there."""

    time: np.ndarray  # (steps,) s
    position: np.ndarray  # m, relative to the start
    velocity: np.ndarray  # m/s, mean over the last period
    estimate: np.ndarray  # m/s, velocity of the observer
    wanted: np.ndarray  # m/s^2
    given: np.ndarray  # m/s^2, after saturation
    amplitude: np.ndarray  # m, commanded to all elements; 0 for the reduced plant

    def overshoot(self, step: float) -> np.ndarray:
        """Return the overshoot (worlds,) relative to the step, m."""
        return self.position.max(axis=0) / step - 1.0

    def rms(self, values: np.ndarray, seconds: float) -> np.ndarray:
        """Return the rms (worlds,) of values (steps, worlds) during the last seconds."""
        return np.sqrt((values[self.time > self.time[-1] - seconds] ** 2).mean(axis=0))

    def residual(self, step: float, seconds: float) -> np.ndarray:
        """Return the rms position error (worlds,) m during the last seconds."""
        return self.rms(self.position - step, seconds)


class ReducedPlant:
    """Double integrator. Arrays are (1, 1, 3), as (worlds, 1, 3) of :class:`RealPlant`.

    Args:
        period: s.
        limit: m/s^2, largest acceleration.
    """

    observer = None  # the state is known (figs. 5.15 and 5.22)

    def __init__(self, period: float, limit: float = np.inf) -> None:
        self.period, self.limit = period, limit
        self._state = Estimate(*np.zeros((2, 1, 1, 3)))
        self._state.position[..., :2] = START

    def measured(self) -> np.ndarray:
        """Return the position, without errors."""
        return self._state.position

    def state(self) -> Estimate:
        """Return position and velocity."""
        return self._state

    def give(self, wanted: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`RealPlant.give`."""
        limited = limit_length(wanted, self.limit)
        position, now = self._state
        self._state = Estimate(
            position + self.period * now + 0.5 * self.period**2 * limited, now + self.period * limited
        )
        return limited, np.zeros(1)


IDEAL = {"kind": "prototype", "dead_zone": 0.0, "latency": 0, "gain_spread": 0.0, "phase_spread": 0.0}
"""Settings of :class:`vibgym.actuators.PrototypeActuators` without errors."""


def common_command(surface: Surface, amplitude: np.ndarray, phase: np.ndarray) -> Any:
    """Return the command of amplitudes (m) and phases (rad), each broadcastable to (worlds, rows, columns)."""
    shape = (len(amplitude), surface.rows, surface.columns)
    return polar_drive(np.broadcast_to(amplitude, shape), np.broadcast_to(phase, shape), surface.angular_frequency)


def ready(hardware: Any, surface: Surface, worlds: int, random: np.random.Generator) -> Any:
    """Return actuators of each world that take commands of :func:`common_command`; ``random`` draws their errors."""
    actuators = ACTUATORS.make("hardware", hardware, surface, worlds, 1)
    none = np.zeros((worlds, 1, 1))
    actuators.prepare(common_command(surface, none, none))
    actuators.reset(np.arange(worlds), random.random((worlds, actuators.draws)))
    return actuators


class RealPlant:
    """Parts in the planar simulator, on elements with a common command. Arrays are (worlds, 1, 3).

    Args:
        part: as known to the controller, on the prototype's surface.
        machine: actual surface and part; None: as known.
        worlds: number of independent machines.
        limit: m, largest amplitude; None: the lift-off amplitude.
        noise: m, standard deviation of measured positions.
        seed: of noise and machines.
        **actuators: settings of :class:`vibgym.actuators.PrototypeActuators`; ideal by default.
    """

    def __init__(
        self,
        part: Part,
        *,
        machine: tuple[Surface, Part] | None = None,
        worlds: int = 1,
        limit: float | None = None,
        noise: float = 0.0,
        seed: int = 0,
        **actuators: Any,
    ) -> None:
        known = Surface()
        surface, actual = (known, part) if machine is None else machine
        self.surface = surface
        self.worlds, self.period, self.noise = worlds, surface.period, noise
        assert known.max_amplitude is not None
        self.scale = known.max_amplitude  # m, of pushes
        self.inverse = FrictionalInverse(known, part, limit=limit)
        self.observer = Observer(known.period)
        self.generator = np.random.default_rng(seed)
        self.actuators = ready({**IDEAL, "limit": limit, **actuators}, surface, worlds, self.generator)
        self.simulator = Simulator(surface, actual, worlds=worlds, threads=1)
        self.simulator.reset([*START, 0.0], [*surface.idle_velocity(actual.friction), 0.0])
        self._mean = np.zeros((worlds, 1, 3))

    def measured(self) -> np.ndarray:
        """Return positions at the beginning of the period, with noise; headings, not controlled, are zero."""
        position = self.simulator.pose + self.noise * self.generator.normal(size=(self.worlds, 1, 3))
        position[..., 2] = 0.0
        return position

    def state(self) -> Estimate:
        """Return true positions, and mean velocities over the last period."""
        return Estimate(self.simulator.pose, self._mean)

    def give(self, wanted: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Advance a period; return accelerations after saturation, as known to the controller, and amplitudes (worlds,) m.

        Args:
            wanted: accelerations.
            velocity: mean velocities known to the controller.
        """
        push, limited, _ = self.inverse.push(velocity, wanted)
        x, y = push[..., 0, None], push[..., 1, None]
        amplitude = np.minimum(np.hypot(x, y), 1.0) * self.scale
        for drive, periods in self.actuators.apply(common_command(self.surface, amplitude, np.arctan2(-x, -y))):
            self.simulator.advance_drive(drive, periods)
        self._mean = self.simulator.mean_velocity
        return limited, amplitude[:, 0, 0]


class PidController:
    """PID control of positions (fig. 5.18); the observer serves the inverse of the frictional process only."""

    def __init__(self, period: float, **settings: Any) -> None:
        self.pid = Pid(period, **settings)
        self.memory: PidMemory | None = None

    def wanted(self, target: np.ndarray, position: np.ndarray, estimate: Estimate) -> np.ndarray:
        """Return accelerations, from set and measured positions (worlds, 1, 3) and the observer's estimate."""
        memory = self.pid.initial(position.shape) if self.memory is None else self.memory
        wanted, self.memory = self.pid.output(target - position, memory)
        return wanted

    def applied(self, limited: np.ndarray) -> None:
        """Receive the accelerations after saturation."""
        assert self.memory is not None
        self.memory = self.pid.applied(limited, self.memory)


class StateController:
    """State feedback (fig. 5.23)."""

    def wanted(self, target: np.ndarray, position: np.ndarray, estimate: Estimate) -> np.ndarray:
        """See :meth:`PidController.wanted`."""
        return feedback(target, estimate)

    def applied(self, limited: np.ndarray) -> None:
        """Without memory."""


def step_response(
    controller: PidController | StateController, plant: ReducedPlant | RealPlant, step: float, seconds: float
) -> Response:
    """Return the response of a controller and a plant in their initial states to a step (m) in the set position along x."""
    start = plant.measured()
    target = np.broadcast_to([START[0] + step, START[1], 0.0], start.shape)
    estimate, rows = Estimate(start, np.zeros_like(start)), []
    for _ in range(round(seconds / plant.period)):
        position, state = plant.measured(), plant.state()
        estimate = state if plant.observer is None else estimate
        wanted = controller.wanted(target, position, estimate)
        limited, amplitude = plant.give(wanted, estimate.velocity)
        controller.applied(limited)
        along = (v[:, 0, 0] for v in (state.position - START[0], state.velocity, estimate.velocity, wanted, limited))
        rows.append([*along, amplitude])
        if plant.observer is not None:
            estimate = plant.observer.update(estimate, position, limited)
    values = np.moveaxis(np.array(rows), 1, 0)
    return Response(plant.period * np.arange(len(rows)), *values)


def controller(name: str) -> PidController | StateController:
    """Return one of :data:`CONTROLLERS` for the prototype."""
    return PidController(Surface().period) if name == "PID" else StateController()


CONTROLLERS = ("PID", "state space")


def limit_length(vectors: np.ndarray, most: float) -> np.ndarray:
    """Shorten vectors (..., n) beyond the limit ``most`` to it: the saturation of figs. 5.18 and 5.23."""
    length = np.sqrt((vectors**2).sum(axis=-1))
    return vectors / np.maximum(length / most, 1.0)[..., None]
