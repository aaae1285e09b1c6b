"""Laws of sliding friction: factors on a part's coefficient of friction by slip speed.

A law is chosen by ``kind`` in a part's ``friction_law``; :data:`FRICTION_LAWS` takes others: a class whose instances, made with
the other keys of the mapping, return factors for an array of speeds. Kernels read a table of it, so a law may be any function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.physics.core.records import CONSTANT, LAW_SPEED
from vibgym.registry import Registry

ENTRIES = 1024
"""Of the table of a law, which ends at 2.05 m/s; the factor is constant beyond."""

LEAST, MOST = 0.01, 100.0
"""Range of factors."""

NARROWEST = 0.01
"""m/s, least speed over which the Stribeck law may fall: the table is then accurate to 0.5 % of ``rise``."""


class Stribeck:
    """Stribeck's curve: ``1 + rise exp(-(v / speed)^shape) + viscous v``.

    The part's coefficient is that at large speeds without viscous friction (B. Armstrong-Helouvry, P. Dupont, C. Canudas de
    Wit, "A survey of models, analysis tools and compensation methods for the control of machines with friction", 1994).

    Args:
        rise: additional factor at rest, from -0.9 (friction rises with speed) to 10.
        speed: m/s, at which ``1 / e`` of it is left.
        shape: exponent; 1 and 2 are common.
        viscous: increase of the factor with speed, s/m.

    Raises:
        ValueError: a value out of its range.
    """

    def __init__(self, *, rise: Any = 0.0, speed: Any = 0.1, shape: Any = 2.0, viscous: Any = 0.0) -> None:
        self.rise = checks.number("friction_law.rise", rise, least=-0.9, most=10.0)
        self.speed = checks.number("friction_law.speed", speed, least=NARROWEST, most=10.0)
        self.shape = checks.number("friction_law.shape", shape, least=0.5, most=4.0)
        self.viscous = checks.number("friction_law.viscous", viscous, least=0.0, most=10.0)

    def __call__(self, speed: np.ndarray) -> np.ndarray:
        """Return the factors at slip speeds, m/s."""
        return 1.0 + self.rise * np.exp(-((speed / self.speed) ** self.shape)) + self.viscous * speed


FRICTION_LAWS: Registry[Callable[..., Callable[[np.ndarray], np.ndarray]]] = Registry(
    "friction law", {"stribeck": Stribeck}, "vibgym.friction_laws"
)
"""Laws by name, called with the other keys of ``friction_law``; ``FRICTION_LAWS.register(name, cls)`` adds one."""


def law_table(law: Mapping[str, Any] | None) -> np.ndarray:
    """Return the factors of a law at multiples of :data:`vibgym.physics.core.records.LAW_SPEED`, or (1,) for None.

    Raises:
        ValueError: an unknown law, invalid settings, or factors out of range.
    """
    if law is None:
        return CONSTANT
    if not isinstance(law, Mapping):
        raise checks.refuse("friction_law", law, "a mapping with kind and settings")
    kind, given = checks.named("friction_law", law, FRICTION_LAWS)
    made = checks.made("friction_law", FRICTION_LAWS[kind], (), given)
    factors = np.asarray(made(LAW_SPEED * np.arange(ENTRIES)), dtype=np.float64)
    if factors.shape != (ENTRIES,) or not (factors >= LEAST).all() or not (factors <= MOST).all():
        raise checks.refuse(
            "friction_law", factors, f"a law that gives one factor of {LEAST:g} to {MOST:g} for each speed"
        )
    return factors
