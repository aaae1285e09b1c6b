"""Sensing: true state -> measurement, from which observations and the aim of actions are computed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from vibgym import checks
from vibgym.config import to_si
from vibgym.registry import Registry
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing.base import Sensor
from vibgym.sensing.effects import EFFECTS, Effect
from vibgym.sensing.estimation import ESTIMATORS, Plant, estimator_from
from vibgym.sensing.measurement import Measurement, Reading
from vibgym.sensing.pose import IdealSensor, PoseSensor
from vibgym.sensing.stage import Estimator, ExactSensing, Sensing

SENSORS: Registry[type[Sensor]] = Registry("sensor", {"ideal": IdealSensor, "pose": PoseSensor}, "vibgym.sensors")
"""Sensors by name; ``SENSORS.register(name, cls)`` or an entry point in group ``vibgym.sensors`` adds one."""

MEASUREMENT_FEATURES = {"age": ("age",), "sigma": ("sigma",), "contacts": ("contact_normal", "contact_impulse")}
"""Features of the measurement that the setting ``tell`` adds to observations, by name."""


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
    """Return a sensing stage from a sensor's name, or a mapping: ``kind``, settings, effects, ``estimator``, ``tell``.

    Args:
        plant: nominal actuators without latency, for estimators with a model.
        latency: periods between a command and its effect.
        walls: of the table.

    Raises:
        ValueError: an unknown kind or setting, or a bad value.
    """
    kind, settings = checks.named("sensor", value, SENSORS)
    settings = to_si(settings, "sensor")
    chosen = settings.pop("estimator", "none")
    reported = _reported(settings.pop("tell", ()))
    sensor = sensor_from({"kind": kind, **settings}, surface, parts, worlds, periods, ("estimator", "tell"))
    if sensor.exact and chosen == "none":
        return ExactSensing(sensor, reported)
    if "contacts" in reported:
        raise checks.conflict("sensor.tell with 'contacts' requires an ideal sensor without estimator")
    return Sensing(sensor, estimator_from(chosen, sensor, plant, latency, walls), reported)


def sensor_from(
    value: Any, surface: Surface, parts: Sequence[Part], worlds: int, periods: int, more: tuple[str, ...] = ()
) -> Sensor:
    """Return a sensor from its name, or a mapping with ``kind``, settings and effects; ``more``: further allowed keys."""
    kind, settings = checks.named("sensor", value, SENSORS)
    cls = SENSORS[kind]
    effects = tuple(EFFECTS) if "effects" in checks.keywords(cls) else ()
    return checks.made("sensor", cls, (surface, parts, worlds, periods), to_si(settings, "sensor"), (*effects, *more))


def _reported(value: Any) -> tuple[str, ...]:
    """Return the names in ``tell``, checked and in the order of :data:`MEASUREMENT_FEATURES`."""
    if not isinstance(value, list | tuple) or any(
        not isinstance(each, str) or each not in MEASUREMENT_FEATURES or value.count(each) > 1 for each in value
    ):
        raise checks.refuse("sensor.tell", value, f"a list of different names among {', '.join(MEASUREMENT_FEATURES)}")
    return tuple(each for each in MEASUREMENT_FEATURES if each in value)


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
    "sensor_from",
]
