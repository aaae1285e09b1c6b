"""Actuators: command -> drive, the executed motion of the elements."""

from __future__ import annotations

from vibgym.actuators.custom import Actuators
from vibgym.actuators.prototype import PrototypeActuators
from vibgym.actuators.stage import ActuatorStage, DataSheet, IdealActuators
from vibgym.registry import Registry

ACTUATORS: Registry[type[ActuatorStage]] = Registry(
    "actuators", {"ideal": IdealActuators, "prototype": PrototypeActuators}
)
"""Actuators by name, constructed with surface, worlds, and periods of a step; ``ACTUATORS.register(name, cls)`` adds custom
ones."""


__all__ = ["ACTUATORS", "ActuatorStage", "Actuators", "DataSheet", "PrototypeActuators"]
