"""Whether a recording requires a coefficient of friction that depends on speed, and which one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from vibgym.identification.solver import Estimate, Solver, System
from vibgym.scene.friction_laws import law_table
from vibgym.scene.parts import Part

SPEEDS = (0.05, 0.1, 0.2, 0.4)
"""m/s, speeds over which friction may fall, each tried; slip is at most 0.8 m/s on the prototype."""

SIGNIFICANT = 13.41
"""Decrease of chi squared from which on the best of them is required, the quantile of 1 - 0.001 / 4 for one degree of freedom:
0.1 % false alarms at most, since a law that is fitted needlessly makes friction, horizontal amplitude and gain less certain."""

UNSEEN = 1e-2
"""Information on a rise, the reciprocal of its variance, up to which it has no effect: parts never slip that slowly."""

RISE_STEP, SPEED_STEP = 0.05, 1.05
"""Finite differences: added to the rise, and factor on the speed."""

LARGEST_RISE, SMALLEST_RISE = 5.0, -0.8
SLOWEST, FASTEST = 0.02, 2.0
"""Range of a fitted law; speeds in m/s."""


class Rise(NamedTuple):
    """Stribeck's law with a shape of 2, see :class:`vibgym.scene.friction_laws.Stribeck`.

    Attributes:
        rise, speed: of the law (m/s).
        gain: decrease of chi squared by this law, or by the last step of its parameters.
        covariance: (2, 2) of the rise and the logarithm of the speed.
        products: (unknowns, 2) products of the derivatives by these two with those by all other unknowns.
    """

    rise: float
    speed: float
    gain: float = 0.0
    covariance: np.ndarray = np.zeros((2, 2))
    products: np.ndarray = np.zeros((0, 2))

    @property
    def law(self) -> dict[str, Any]:
        """Setting ``friction_law`` of a part."""
        return {"kind": "stribeck", "rise": self.rise, "speed": self.speed, "shape": 2.0, "viscous": 0.0}


def applied(part: Part, law: Mapping[str, Any]) -> Part:
    """Return a part with a friction law; its static friction is at least that of the law at rest."""
    static = max(part.static_friction, part.friction * float(law_table(law)[0]))
    return replace(part, friction_law=dict(law), static_friction=static)


def likeliest(solver: Solver, now: Estimate, system: System, fixed: Sequence[int], kind: int) -> Rise:
    """Return the best law near a constant coefficient: one speed of :data:`SPEEDS`, everything else fitted linearly."""
    laws = [Rise(RISE_STEP, speed).law for speed in SPEEDS]
    slope, square, _ = _products(solver, now, system, fixed, kind, laws, np.full(len(laws), RISE_STEP))
    information = np.diag(square)
    gains = np.where(information > UNSEEN, slope**2 / np.maximum(information, UNSEEN), 0.0)
    k = int(np.argmax(gains))
    rise = float(np.clip(slope[k] / max(information[k], UNSEEN), SMALLEST_RISE, LARGEST_RISE))
    return Rise(rise, SPEEDS[k], float(gains[k]))


def improved(solver: Solver, now: Estimate, system: System, fixed: Sequence[int], kind: int, old: Rise) -> Rise:
    """Return a law after a Gauss-Newton step from the law ``old`` of a kind, everything else fitted linearly."""
    steps = np.array([RISE_STEP, math.log(SPEED_STEP)])
    laws = [old._replace(rise=old.rise + RISE_STEP).law, old._replace(speed=old.speed * SPEED_STEP).law]
    slope, square, products = _products(solver, now, system, fixed, kind, laws, steps)
    covariance = np.linalg.inv(square)
    step = covariance @ slope
    rise = float(np.clip(old.rise + np.clip(step[0], -0.5, 0.5), SMALLEST_RISE, LARGEST_RISE))
    speed = float(np.clip(old.speed * math.exp(np.clip(step[1], -0.7, 0.7)), SLOWEST, FASTEST))
    return Rise(rise, speed, float(slope @ step), covariance, products)


def _products(
    solver: Solver,
    now: Estimate,
    system: System,
    fixed: Sequence[int],
    kind: int,
    laws: Sequence[Mapping[str, Any]],
    steps: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return products of derivatives by the laws' m parameters: with residuals (m,), one another (m, m) and other unknowns.

    The first two are of what all other unknowns cannot explain, the last (unknowns, m) of what initial states cannot.
    Differences of laws are added to the predictions, so that summation over contact points need not be as accurate as the
    series that these predictions use.
    """
    changes = solver.plant.laws(system.which, now.parameters, now.starts, kind, laws)
    predicted = [
        solver.plant.segments[k].pose - residual + change
        for k, residual, change in zip(system.which, system.residuals, changes, strict=True)
    ]
    gram, rights = solver.scan(now, system, predicted, fixed)
    turn = np.concatenate([np.ones((len(laws), 1)), -np.eye(len(laws))], axis=1) / steps[:, None]
    return turn @ gram[:, 0], turn @ gram @ turn.T, rights @ turn.T
