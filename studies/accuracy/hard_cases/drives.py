"""Elements in opposite phase, and a part that spins ten times faster than the table moves."""

from __future__ import annotations

import math

import numpy as np

from studies.accuracy.hard_cases.case import (
    HardCase,
    Outcome,
    Scene,
    against_reference,
    at_most,
    follow,
    random_drive,
)
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

L = 0.026
# -- four elements against each other ----------------------------------------------------------------------------------


def four(surface: Surface, phases: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Full amplitude on the four elements around the grid corner (12, 4); phases from the lower left, row by row."""
    amplitude, phase = np.zeros((8, 32)), np.zeros((8, 32))
    amplitude[3:5, 11:13] = surface.lift_off_amplitude
    phase[3:5, 11:13] = np.reshape(phases, (2, 2))
    return amplitude, phase


TANGENTIAL = [math.pi - math.pi / 4 * k for k in (-3, -1, 3, 1)]
"""alpha(-r) = alpha(r) + pi. A phase alpha pushes a resting part along -(sin alpha, cos alpha): here to the left of r."""


def pure_torque() -> Outcome:
    """Little friction, so that first order in eps = mu g / (a_h w^2) is good to a few eps: torque and no force.

    From the piece's mean acceleration -(mu a / 2) (S, C) at its centroid, all quarters of a square of side 2 L:
    ``mu A / 2 * sqrt(2) L / 2 / k^2``.
    """
    friction, periods = 0.001, 5
    surface, square = Surface(), Part.rectangle(2 * L, 2 * L, friction=friction)
    amplitude, phase = four(surface, TANGENTIAL)
    radius = friction * surface.gravity / surface.angular_frequency**2
    start = surface.idle_velocity(friction)
    pose = [12 * L + start[1] / surface.angular_frequency, 4 * L - start[0] / surface.angular_frequency, 0.0]
    path = follow(Scene(surface, square, pose, [*start, 0], amplitude, phase, periods))
    expected = 0.5 * friction * surface.gravity * math.sqrt(0.5) * L / square.gyration
    # From period means, as torque swings within a period; spin is damped by mu g / (2 a_h w) meanwhile.
    turned = np.diff(path.pose[:, 2])
    damping = friction * surface.gravity / (2.0 * surface.table_speed)
    rate = (turned[-1] - turned[0]) / surface.period / ((periods - 1) * surface.period)
    rate += damping * turned.mean() / surface.period
    drift = np.hypot(*(path.pose[-1] - path.pose[0])[:2]) / periods / (2 * math.pi * radius)
    if drift > 0.01:
        raise ArithmeticError(f"drifts by {drift:.3g} of its circle in a period")
    return at_most(
        abs(rate / expected - 1.0), 0.01, "of torque", f"eps = 1.5e-4; drift {drift:.2g} of its circle a period"
    )


def _four(phases: list[float]) -> Scene:
    surface = Surface()
    square = Part.rectangle(2 * L, 2 * L, friction=0.6)
    return Scene(surface, square, [12 * L, 4 * L, 0.0], [0, 0, 0], *four(surface, phases), 5)


# -- spin --------------------------------------------------------------------------------------------------------------


def _spinning() -> Scene:
    surface, disc = Surface(), Part.rectangle(0.05, 0.035, friction=0.6)
    spin = 10.0 * surface.table_speed / disc.radius
    return Scene(surface, disc, [0.4, 0.1, 0.3], [0, 0, spin], *random_drive(surface, 14), 3)


CASES = (
    HardCase(
        "four elements in opposite phase, pure torque",
        "Do opposed elements cancel in force and add up in torque?",
        pure_torque,
    ),
    *against_reference(
        "four elements in opposite phase, tangential",
        "Is a part at the meeting point of four opposed elements right?",
        lambda: _four(TANGENTIAL),
    ),
    *against_reference(
        "four elements in opposite phase, chequered",
        "Opposed neighbours: force and torque nearly cancel; is what is left right?",
        lambda: _four([0, math.pi, math.pi, 0]),
    ),
    *against_reference(
        "spin of ten times the table's speed",
        "Corners ten times faster than the table: is friction over the area still right?",
        _spinning,
        pieces=32,
    ),
)
