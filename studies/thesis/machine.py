"""Model of the thesis's machine: parameters, and predictions of all measurements by simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from studies.thesis.closed_loop import CONTROLLERS, RealPlant, Response, controller, step_response
from studies.thesis.friction_radius import FREQUENCIES, fit_friction, sliding_circles
from studies.thesis.measurements import AMPLITUDES, EXPERIMENTS, MEASUREMENTS
from studies.thesis.prototype_steps import LAST, MACHINES, SECONDS
from studies.thesis.squeeze import squeezed
from studies.thesis.velocity import steady_velocity
from vibgym import Part, Surface
from vibgym.scene.friction_laws import Stribeck
from vibgym.scene.parts import shipped_part

REFERENCE_SLIP = 0.1
"""m/s, at which ``Machine.friction`` is the coefficient: within the 0 to 0.14 m/s of the friction experiment up to 10 Hz."""

FLAT = 4e-3
"""m, height of the part: that of the steel block. Sliding does not depend on it."""

EARLY = 1.0
"""s, until which measured and simulated steps agree (7.3.2)."""

SPREAD = {"gain_spread": 0.05, "phase_spread": math.radians(5.0)}
"""Of the elements; the thesis's values are lost."""

SQUEEZED, SQUEEZE_SECONDS = 24, 8.0
"""Starts, and the end of the axis of fig. 7.5."""

SMALLEST = 1e-4
"""m, amplitude below which the thesis finds that commands are not realised."""


@dataclass(frozen=True)
class Machine:
    """Parameters of a machine; defaults are the nominal ones.

    Args:
        friction: coefficient at a slip of :data:`REFERENCE_SLIP`.
        rise, speed, shape: of :class:`vibgym.scene.friction_laws.Stribeck`; rise 0: constant coefficient.
        horizontal_amplitude: m.
        frequency: Hz.
        top_frequency: Hz, at which the largest speed was measured; None: as all others.
        reach: m, commanded amplitude at which it was measured; None: as large as lift-off needs.
        gain: actual over commanded amplitude of the elements.
        dead_zone, form: m, and one of :data:`vibgym.physics.core.hardware.FORMS`.
        latency: periods in addition to that of eq. 5.81.
        limit: m, largest amplitude in the step responses.
        step: m, of the set position.
    """

    friction: float = 0.58
    rise: float = 0.0
    speed: float = 0.2
    shape: float = 2.0
    horizontal_amplitude: float = 2.7e-3
    frequency: float = 25.0
    top_frequency: float | None = None
    reach: float | None = 0.4e-3
    gain: float = 1.0
    dead_zone: float = 1e-4
    form: str = "hard"
    latency: int = 1
    limit: float = 0.25e-3
    step: float = 0.3

    @property
    def part(self) -> Part:
        """Aluminium block with this friction, flat: at 20 mm it would tip where friction at rest is large."""
        block = replace(shipped_part("aluminium_block"), height=FLAT, centre_height=0.5 * FLAT)
        if self.rise == 0.0:
            return replace(block, friction=self.friction, static_friction=self.friction)
        law = {"rise": self.rise, "speed": self.speed, "shape": self.shape}
        fast = self.friction / float(Stribeck(Stribeck.Settings(**law))(np.array(REFERENCE_SLIP)))
        rest = fast * (1.0 + self.rise)
        return replace(block, friction=fast, static_friction=rest, friction_law={"kind": "stribeck", **law})

    def surface(self, frequency: float) -> Surface:
        """Return the surface at a frequency, Hz."""
        return Surface(horizontal_amplitude=self.horizontal_amplitude, frequency=frequency)

    @property
    def actuators(self) -> dict[str, Any]:
        """Settings of :class:`vibgym.actuators.PrototypeActuators`."""
        names = ("dead_zone", "latency", "gain")
        return {**{name: getattr(self, name) for name in names}, "dead_zone_form": self.form, **SPREAD}


def friction(machine: Machine) -> dict[str, float]:
    """Predict the friction experiment: closed form of a sweep down, and the thesis's fit of a constant coefficient."""
    circles = sliding_circles(FREQUENCIES, machine.part, machine.horizontal_amplitude)
    slides = circles.radius < machine.horizontal_amplitude
    fitted, _ = fit_friction(FREQUENCIES, circles.radius)
    surface = machine.surface(10.0)
    expected = np.minimum(machine.horizontal_amplitude, fitted * surface.gravity / (2.0 * math.pi * FREQUENCIES) ** 2)
    away = (circles.radius - expected)[slides]
    down, up = circles.window
    return {"coefficient": fitted, "window": up - down, "departure": 1e3 * math.sqrt(float(np.mean(away**2)))}


@lru_cache
def _simulated_speeds() -> np.ndarray:
    """Return the thesis's simulation of fig. 7.3, mm/s: at 0.08 mm and :data:`AMPLITUDES`, constant friction, no dead zone."""
    return 1e3 * steady_velocity(Machine().part, 1e-3 * np.array([0.08, *AMPLITUDES]))


def steady(machine: Machine) -> dict[str, float]:
    """Predict fig. 7.3: speeds minus those of the thesis's simulation."""
    speeds = 1e3 * steady_velocity(
        machine.part, 1e-3 * np.array([0.08, *AMPLITUDES]), surface=machine.surface(machine.frequency),
        dead_zone=machine.dead_zone, form=machine.form, gain=machine.gain,
    )  # fmt: skip
    names = (f"steady {amplitude:.2f}" for amplitude in (0.08, *AMPLITUDES))
    return dict(zip(names, (speeds - _simulated_speeds()).tolist(), strict=True))


def top_speed(machine: Machine) -> dict[str, float]:
    """Predict the largest speed: that at the amplitude ``reach``, or at lift-off if that is less."""
    surface = machine.surface(machine.frequency if machine.top_frequency is None else machine.top_frequency)
    lift_off = surface.lift_off_amplitude
    amplitude = lift_off if machine.reach is None else min(machine.gain * machine.reach, lift_off)
    return {"top": 1e3 * float(steady_velocity(machine.part, [amplitude], surface=surface)[0])}


def response(machine: Machine, name: str) -> Response:
    """Return the step responses of machines with elements that differ; the controller knows the nominal machine.

    Args:
        name: of the controller, among :data:`CONTROLLERS`.
    """
    plant = RealPlant(
        Machine().part, machine=(machine.surface(machine.frequency), machine.part), worlds=MACHINES, limit=machine.limit,
        **machine.actuators,
    )  # fmt: skip
    return step_response(controller(name), plant, machine.step, SECONDS)


@lru_cache(maxsize=256)
def _simulated(name: str, step: float, limit: float) -> tuple[float, float]:
    """Return position at 1 s and largest position of the thesis's simulation, m: nominal machine, no dead zone or latency."""
    run = step_response(controller(name), RealPlant(Machine().part, limit=limit), step, 4.0)
    return float(run.position[_at(run)][0]), float(run.position.max())


def _at(run: Response) -> int:
    return int(np.abs(run.time - EARLY).argmin())


def steps(machine: Machine) -> dict[str, float]:
    """Predict figs. 7.8 to 7.10: medians over machines."""
    values: dict[str, float] = {}
    for name, prefix in zip(CONTROLLERS, ("", "state "), strict=True):
        run = response(machine, name)
        position, peak = _simulated(name, machine.step, machine.limit)
        values[f"{prefix}early"] = 1e3 * (float(np.median(run.position[_at(run)])) - position)
        values[f"{prefix}residual"] = 1e3 * float(np.median(run.residual(machine.step, LAST)))
        if name == "PID":
            largest = float(np.median(run.position.max(axis=0)))
            values["overshoot"] = 100.0 * (largest / machine.step - 1.0)
            values["excess"] = 100.0 * (largest - peak) / machine.step
            values["peak"] = 1e3 * largest
            values["fastest"] = 1e3 * float(np.median(run.velocity.max(axis=0)))
        else:
            small = run.amplitude < SMALLEST
            small[: int(np.abs(run.amplitude).argmax(axis=0).max())] = False  # the first commands rise
            values["separated"] = float(np.median(run.time[np.argmax(small, axis=0)]))
    return values


def squeeze(machine: Machine) -> dict[str, float]:
    """Predict fig. 7.5."""
    run = squeezed(
        machine.part, {"kind": "prototype", **machine.actuators}, worlds=SQUEEZED,
        surface=machine.surface(machine.frequency), seconds=SQUEEZE_SECONDS,
    )  # fmt: skip
    heading = run.heading[run.late].std(axis=1)
    return {
        "squeeze y": 1e3 * float(run.offset[run.late].std(axis=1).max()),
        "squeeze heading": math.degrees(float(np.median(heading))),
    }


PREDICT: dict[str, Callable[[Machine], dict[str, float]]] = {
    "friction": friction, "steady": steady, "top speed": top_speed, "steps": steps, "squeeze": squeeze,
}  # fmt: skip
"""Predictions by experiment: values by the keys of :data:`studies.thesis.measurements.MEASUREMENTS`."""


def predictions(machine: Machine, experiments: Iterable[str] = EXPERIMENTS) -> dict[str, float]:
    """Return the values of all measurements of some experiments."""
    return {key: value for name in experiments for key, value in PREDICT[name](machine).items()}


def residuals(predicted: dict[str, float]) -> np.ndarray:
    """Return residuals (n,) in units of the errors, see :meth:`studies.thesis.measurements.Measurement.residual`."""
    return np.array([MEASUREMENTS[name].residual(value) for name, value in predicted.items()])
