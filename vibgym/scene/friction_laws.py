"""Laws of sliding friction: factors on a part's coefficient of friction by slip speed.

A law is chosen by ``kind`` in a part's ``friction_law``; :data:`FRICTION_LAWS` takes others: a class whose instances, made with
the other keys of the mapping as its ``Settings``, return factors for an array of speeds. Kernels read a table of it, so a law
may be any function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.physics.core.records import CONSTANT, LAW_SPEED
from vibgym.registry import Registry
from vibgym.settings import BaseSettings, Speed

ENTRIES = 1024
"""Of the table of a law, which ends at 2.05 m/s; the factor is constant beyond."""

MIN, MAX = 0.01, 100.0
"""Range of factors."""

NARROWEST = 0.01
"""m/s, least speed over which the Stribeck law may fall: the table is then accurate to 0.5 % of ``rise``."""


class Stribeck:
    """Stribeck's curve: ``1 + rise exp(-(v / speed)^shape) + viscous v``.

    The part's coefficient is that at large speeds without viscous friction (B. Armstrong-Helouvry, P. Dupont, C. Canudas de
    Wit, "A survey of models, analysis tools and compensation methods for the control of machines with friction", 1994).

    """

    class Settings(BaseSettings):
        """Settings of Stribeck's curve."""

        rise: float = Field(default=0.0, ge=-0.9, le=10.0)
        """Additional factor at rest; below zero friction rises with speed."""

        speed: Speed = Field(default=0.1, ge=NARROWEST, le=10.0)
        """Speed at which ``1 / e`` of ``rise`` is left."""

        shape: float = Field(default=2.0, ge=0.5, le=4.0)
        """Exponent; 1 and 2 are common."""

        viscous: float = Field(default=0.0, ge=0.0, le=10.0)
        """Increase of the factor with speed, s/m."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings

    def __call__(self, speed: np.ndarray) -> np.ndarray:
        """Return the factors at slip speeds, m/s."""
        own = self.settings
        return 1.0 + own.rise * np.exp(-((speed / own.speed) ** own.shape)) + own.viscous * speed


FRICTION_LAWS: Registry[Callable[..., Callable[[np.ndarray], np.ndarray]]] = Registry(
    "friction law", {"stribeck": Stribeck}, "vibgym.friction_laws"
)
"""Laws by name; ``FRICTION_LAWS.register(name, cls)`` adds one."""


def law_table(law: Mapping[str, Any] | None) -> np.ndarray:
    """Return the factors of a law at multiples of :data:`vibgym.physics.core.records.LAW_SPEED`, or (1,) for None.

    Raises:
        ValueError: an unknown law, invalid settings, or factors out of range.
    """
    if law is None:
        return CONSTANT
    if not isinstance(law, Mapping):
        raise checks.refuse("friction_law", law, "a mapping with kind and settings")
    made = FRICTION_LAWS.make("friction_law", law)
    factors = np.asarray(made(LAW_SPEED * np.arange(ENTRIES)), dtype=np.float64)
    if factors.shape != (ENTRIES,) or not (factors >= MIN).all() or not (factors <= MAX).all():
        raise checks.refuse(
            "friction_law", factors, f"a law that gives one factor of {MIN:g} to {MAX:g} for each speed"
        )
    return factors
