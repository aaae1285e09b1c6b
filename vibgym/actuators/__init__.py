"""Actuators: command -> drive, what the elements really do."""

from __future__ import annotations

from typing import Any

from vibgym import checks
from vibgym.actuators.base import Actuators
from vibgym.actuators.ideal import IdealActuators
from vibgym.registry import Registry
from vibgym.scene.surface import Surface

ACTUATORS: Registry[type[Actuators]] = Registry("actuators", {"ideal": IdealActuators})
"""Actuators by name; ``ACTUATORS.register(name, cls)`` adds some of your own."""


def actuators_from(value: Any, surface: Surface, worlds: int, periods: int) -> Actuators:
    """Actuators from their name or a mapping with ``kind`` and their own settings.

    Raises:
        ValueError: an unknown kind or setting, or a bad value.
    """
    kind, settings = checks.named("actuators", value, tuple(ACTUATORS))
    return checks.made("actuators", ACTUATORS[kind], (surface, worlds, periods), settings)


__all__ = ["ACTUATORS", "Actuators", "actuators_from"]
