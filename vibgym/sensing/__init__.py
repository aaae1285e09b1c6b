"""Sensing: true state -> measurement, the only thing that policies and the aim of their actions get to know."""

from __future__ import annotations

from typing import Any

from vibgym import checks
from vibgym.registry import Registry
from vibgym.scene.surface import Surface
from vibgym.sensing.base import Measurement, Sensor
from vibgym.sensing.ideal import IdealSensor

SENSORS: Registry[type[Sensor]] = Registry("sensor", {"ideal": IdealSensor})
"""Sensors by name; ``SENSORS.register(name, cls)`` adds one of your own."""


def sensor_from(value: Any, surface: Surface, worlds: int, parts: int, periods: int) -> Sensor:
    """A sensor from its name or a mapping with ``kind`` and its own settings.

    Raises:
        ValueError: an unknown kind or setting, or a bad value.
    """
    kind, settings = checks.named("sensor", value, tuple(SENSORS))
    return checks.made("sensor", SENSORS[kind], (surface, worlds, parts, periods), settings)


__all__ = ["SENSORS", "Measurement", "Sensor", "sensor_from"]
