"""Sensing: true state -> measurement, from which observations and the aim of actions are computed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from vibgym import checks
from vibgym.registry import Registry
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing.base import IdealSensor, PoseSensor, Sensor
from vibgym.sensing.effects import EFFECTS, Effect
from vibgym.sensing.estimation import ESTIMATORS, Plant
from vibgym.sensing.measurement import Measurement, Reading
from vibgym.sensing.stage import Estimator, ExactSensing, Sensing
from vibgym.settings import read

SENSORS: Registry[type[Sensor]] = Registry("sensor", {"ideal": IdealSensor, "pose": PoseSensor}, "vibgym.sensors")
"""Sensors by name, constructed with surface, parts, worlds, and periods of a step; ``SENSORS.register(name, cls)`` or an entry
point in group ``vibgym.sensors`` adds one."""

MEASUREMENT_FEATURES = {"age": ("age",), "sigma": ("sigma",), "contacts": ("contact_normal", "contact_impulse")}
"""Features of the measurement that the setting ``report`` adds to observations, by name."""


def sensing_from(
    value: Any,
    surface: Surface,
    parts: Sequence[Part],
    worlds: int,
    periods: int,
    *,
    plant: Plant,
    latency: int,
    walls: Sequence[str],
) -> Sensing:
    """Return a sensing stage from a sensor's name, or a mapping: ``kind``, settings, effects, ``estimator``, ``report``.

    Args:
        plant: nominal actuators without latency, for estimators with a model.
        latency: periods between a command and its effect.
        walls: of the table.

    Raises:
        ValueError: an unknown kind or setting, or a bad value.
    """
    kind, options = SENSORS.split("sensor", value)
    own = {name: options.pop(name) for name in Sensing.Settings.model_fields if name in options}
    settings = read(Sensing.Settings, own, "sensor")
    reported = tuple(name for name in MEASUREMENT_FEATURES if name in settings.report)
    if len(reported) < len(settings.report):
        raise checks.refuse("sensor.report", settings.report, "a list of different names")
    sensor = SENSORS.make("sensor", {"kind": kind, **options}, surface, parts, worlds, periods)
    if sensor.exact and settings.estimator == "none":
        return ExactSensing(sensor, reported)
    if "contacts" in reported:
        raise checks.conflict("sensor.report with 'contacts' requires an ideal sensor without estimator")
    estimator = ESTIMATORS.make("sensor.estimator", settings.estimator, sensor, plant, latency, walls)
    return Sensing(sensor, estimator, reported)


__all__ = [
    "EFFECTS",
    "ESTIMATORS",
    "MEASUREMENT_FEATURES",
    "SENSORS",
    "Effect",
    "Estimator",
    "IdealSensor",
    "Measurement",
    "PoseSensor",
    "Reading",
    "Sensing",
    "Sensor",
    "sensing_from",
]
