"""Drives at their limits: lift-off, elements in opposite phase, and parts that spin fast."""

from __future__ import annotations

import cmath
import math

import numpy as np

from studies.accuracy.hard_cases.case import (
    CASES,
    Outcome,
    Scene,
    against_reference,
    at_most,
    block,
    case,
    follow,
    one_element,
    random_drive,
    sound,
)  # fmt: skip
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.simulator import Simulator

L = 0.026
STEADY = {0.3: (0.30485, 4.96), 0.6: (0.30438, 9.93), 0.9: (0.30359, 14.94)}
"""Speed (m/s) and direction (deg) of the steady mean velocity by friction coefficient, at full amplitude and alpha = 270
degrees, from an integration of thesis eqs. 3.26 and 3.27."""


@case("a_v exactly at lift-off", "Pressure touches zero: is the motion still right?")
def at_lift_off() -> Outcome:
    """Compare the steady mean velocity at full amplitude with ``STEADY``; each period starts at the middle."""
    surface, worst = one_element(), 0.0
    middle = 0.5 * surface.width
    for friction, (speed, degrees) in STEADY.items():
        expected = cmath.rect(speed, math.radians(degrees))
        sim = Simulator(surface, block(friction))
        for _ in range(40):
            sim.reset([middle, middle, 0.3], sim.velocity if sim.time else [expected.real, expected.imag, 0])
            sim.advance(surface.lift_off_amplitude, 1.5 * math.pi)
            sound(sim)
        worst = max(worst, abs(complex(*sim.mean_velocity[0, 0, :2]) - expected) / speed)
    return at_most(worst, 1e-3, "of speed", "steady mean velocity for mu = 0.3, 0.6, 0.9; pressure touches zero")


@case("a_v above lift-off", "A part would leave the surface: is that refused, by name, before anything moves?")
def beyond_lift_off() -> Outcome:
    surface, missing = Surface(), []
    above = surface.lift_off_amplitude * (1 + 1e-9)
    sim = Simulator(surface, block())
    one = np.zeros((8, 32))
    one[3, 7] = above
    start = sim.pose
    calls = [
        ("amplitude", lambda each=each: sim.advance(each, 0.0))
        for each in (above, 1.0, one, -1e-12, math.nan, math.inf)
    ]
    for name, call in (*calls, ("max_amplitude", lambda: Surface(max_amplitude=above))):
        try:
            call()
            missing.append(name)
        except ValueError as error:
            if not str(error).startswith(f"{name} must be"):
                missing.append(str(error))
    moved = (sim.pose != start).any() or sim.time != 0.0
    return Outcome(len(missing) + moved, 0, "of 7", not missing and not moved, "; ".join(missing))


# -- four elements against each other ----------------------------------------------------------------------------------

SQUARE = Part.rectangle(2 * L, 2 * L, friction=0.6)
TANGENTIAL = [math.pi - math.pi / 4 * k for k in (-3, -1, 3, 1)]
"""alpha(-r) = alpha(r) + pi. A phase alpha pushes a resting part along -(sin alpha, cos alpha): here to the left of r."""


def four(surface: Surface, phases: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return full amplitude on the four elements around the grid corner (12, 4); phases from the lower left, row by row."""
    amplitude, phase = np.zeros((8, 32)), np.zeros((8, 32))
    amplitude[3:5, 11:13] = surface.lift_off_amplitude
    phase[3:5, 11:13] = np.reshape(phases, (2, 2))
    return amplitude, phase


@case("four elements in opposite phase, pure torque", "Do opposed elements cancel in force and add up in torque?")
def pure_torque() -> Outcome:
    """Compare torque with first order in eps = mu g / (a_h w^2), which is accurate to a few eps for low friction; no force.

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
    # From period means, since torque oscillates; spin is damped by mu g / (2 a_h w).
    turned = np.diff(path.pose[:, 2])
    damping = friction * surface.gravity / (2.0 * surface.table_speed)
    rate = (turned[-1] - turned[0]) / surface.period / ((periods - 1) * surface.period)
    rate += damping * turned.mean() / surface.period
    drift = np.hypot(*(path.pose[-1] - path.pose[0])[:2]) / periods / (2 * math.pi * radius)
    if drift > 0.01:
        raise ArithmeticError(f"drifts by {drift:.3g} of its circle in a period")
    note = f"eps = 1.5e-4; drift {drift:.2g} of its circle a period"
    return at_most(abs(rate / expected - 1.0), 0.01, "of torque", note)


def _four(phases: list[float]) -> Scene:
    surface = Surface()
    return Scene(surface, SQUARE, [12 * L, 4 * L, 0.0], [0, 0, 0], *four(surface, phases), 5)


CASES += against_reference(
    "four elements in opposite phase, tangential",
    "Is a part at the meeting point of four opposed elements right?",
    lambda: _four(TANGENTIAL),
)
CASES += against_reference(
    "four elements in opposite phase, chequered",
    "Opposed neighbours: force and torque nearly cancel; is what is left right?",
    lambda: _four([0, math.pi, math.pi, 0]),
)

# -- spin --------------------------------------------------------------------------------------------------------------


def _spinning() -> Scene:
    surface, part = Surface(), block()
    spin = 10.0 * surface.table_speed / part.radius
    return Scene(surface, part, [0.4, 0.1, 0.3], [0, 0, spin], *random_drive(surface, 14), 3)


CASES += against_reference(
    "spin of ten times the table's speed",
    "Corners ten times faster than the table: is friction over the area still right?",
    _spinning,
    pieces=32,
)


@case("spin on a still table", "Does a spinning disc stop after the right angle, in place, and exactly?")
def spun_out() -> Outcome:
    """omega falls by (4/3) mu g / r a second, down to exactly 0."""
    surface, radius, friction = one_element(horizontal_amplitude=0.0), 0.03, 0.6
    disc = Part.disc(radius, friction=friction)
    slowing, worst = 4.0 * friction * surface.gravity / (3.0 * radius), 0.0
    for spin in (1.0, 30.0, 10 * Surface().table_speed / radius):
        periods = math.ceil(spin / slowing / surface.period) + 1
        path = follow(Scene(surface, disc, [1, 1, 0], [0, 0, spin], 0, 0, periods))
        worst = max(worst, abs(path.pose[-1, 2] / (spin**2 / (2 * slowing)) - 1.0))
        if (path.velocity[-1] != 0.0).any() or np.abs(path.pose[-1, :2] - 1.0).max() > 1e-9:
            raise ArithmeticError(f"spin {spin:g} rad/s: ends at {path.pose[-1]} with {path.velocity[-1]}")
    return at_most(worst, 1e-2, "of angle", "the torque's area integral has an error of its own")


@case("slide and spin on a still table, fine pieces", "Does that ratio converge?", ({"pieces": 64}, 0.01))
@case(
    "slide and spin on a still table",
    "Do sliding and spinning of a disc end at the same instant, with speeds in the known ratio?",
    ({}, 0.05),
)
def slides_and_spins(knobs: dict[str, int], bound: float) -> Outcome:
    """Sliding and spinning end together, at v / (omega r) = 0.653, which a disc that has it keeps (Farkas et al. 2003)."""
    surface, radius = one_element(0.12, horizontal_amplitude=0.0, frequency=400.0), 0.03
    disc, worst = Part.disc(radius, friction=0.6), 0.0
    for speed, spin in ((0.653 * 0.3, 10.0), (0.653 * 0.6, 20.0), (0.3, 10.0), (0.1, 10.0)):
        path = follow(Scene(surface, disc, [0.04, 0.06, 0], [speed, 0, spin], 0, 0, 80), **knobs)
        slides, spins = path.velocity[:, 0] != 0.0, path.velocity[:, 2] != 0.0
        if (slides != spins).any() or slides[-1]:
            raise ArithmeticError("sliding and spinning do not end together")
        ratio = path.velocity[slides, 0] / (path.velocity[slides, 2] * radius)
        if abs(ratio[0] - 0.653) < 1e-9:
            worst = max(worst, float(np.abs(ratio / 0.653 - 1.0).max()))
        elif not abs(ratio[-1] - 0.653) < 0.8 * abs(ratio[0] - 0.653):
            raise ArithmeticError(f"v / (omega r) goes from {ratio[0]:.3f} to {ratio[-1]:.3f}")
    return at_most(worst, bound, "of 0.653", "kept until the end by two motions, approached by two")
