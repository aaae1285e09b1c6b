"""Actuators: command -> drive, the executed motion of the elements."""

from __future__ import annotations

from typing import Any

from vibgym import checks
from vibgym.actuators.prototype import PrototypeActuators
from vibgym.actuators.stage import Actuators, ActuatorStage, DataSheet, IdealActuators
from vibgym.config import to_si
from vibgym.registry import Registry
from vibgym.scene.surface import Surface

ACTUATORS: Registry[type[ActuatorStage]] = Registry(
    "actuators", {"ideal": IdealActuators, "prototype": PrototypeActuators}
)
"""Actuators by name; ``ACTUATORS.register(name, cls)`` adds custom ones."""


def actuators_from(value: Any, surface: Surface, worlds: int, periods: int) -> ActuatorStage:
    """Return actuators from their name or a mapping with ``kind`` and settings; keys may carry a unit (``dead_zone_mm``).

    Raises:
        ValueError: an unknown kind or setting, or a bad value.
    """
    kind, settings = checks.named("actuators", value, tuple(ACTUATORS))
    return checks.made("actuators", ACTUATORS[kind], (surface, worlds, periods), to_si(settings, "actuators"))


def nominal(actuators: ActuatorStage) -> ActuatorStage:
    """Return nominal actuators for a model: those of the data sheet, without latency."""
    return actuators.nominal() or IdealActuators(actuators.surface, actuators.worlds, actuators.periods)


__all__ = ["ACTUATORS", "ActuatorStage", "Actuators", "DataSheet", "PrototypeActuators", "actuators_from", "nominal"]
