"""Outlines against the grid: edges on grid lines, slivers, parts of every size and shape, and the border."""

from __future__ import annotations

import functools
import math

import numpy as np

from studies.accuracy.hard_cases.case import (
    CASES,
    FINE,
    Outcome,
    Scene,
    against_reference,
    at_most,
    case,
    exactly,
    follow,
    gap,
    one_element,
    random_drive,
)  # fmt: skip
from studies.accuracy.reference import Trajectory
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

L = 0.026
MU = 0.6
TWO_BY_ONE = Part.rectangle(2 * L, L, friction=MU)
U_SHAPE = Part.polygon(
    np.array([[0, 0], [7, 0], [7, 5], [5, 5], [5, 2], [2, 2], [2, 5], [0, 5]]) * 0.01, friction=MU, name="U"
)  # its centre of mass is outside its material
GRID = [12 * L, 4.5 * L, 0.0]  # TWO_BY_ONE exactly on two elements, its corners on grid corners


def regular(corners: int, radius: float) -> Part:
    angle = 2.0 * math.pi * np.arange(corners) / corners
    outline = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
    return Part.polygon(outline, friction=MU, name=f"{corners} corners")


def prototype(part: Part, pose: list[float], velocity: list[float], seed: int, periods: int = 4) -> Scene:
    surface = Surface()
    return Scene(surface, part, pose, velocity, *random_drive(surface, seed), periods)


# -- on the grid -------------------------------------------------------------------------------------------------------


@case("a shift of one rounding", "Does a shift by the last bit change the motion?", (GRID, 6e-17, 1e-12))
@case(
    "corners on grid lines",
    "Does a shift of 1e-12 m change the motion of a part whose centre lies on a grid corner?",
    ([12 * L, 4 * L, math.pi / 4], 1e-12, 1e-10),
)
@case(
    "edges on grid lines, corners on grid corners",
    "Does a shift of 1e-12 m off the grid lines change the motion?",
    (GRID, 1e-12, 1e-10),
)
def shifted(pose: list[float], by: float, bound: float) -> Outcome:
    """Return the largest difference that a small shift of the start makes, in eight directions and two turns."""
    angles = math.pi / 4 * np.arange(8)
    shifts = [by * np.array([round(math.cos(angle)), round(math.sin(angle)), 0]) for angle in angles]
    shifts += [np.array([0.0, 0.0, turn]) for turn in (by / TWO_BY_ONE.radius, -by / TWO_BY_ONE.radius)]
    base, *others = (
        follow(prototype(TWO_BY_ONE, list(pose + shift), [0, 0, 0], 7, 6)).pose for shift in [np.zeros(3), *shifts]
    )
    return at_most(max(gap(TWO_BY_ONE, other, base) for other in others), bound, "m", f"shifts of {by:g} m, 6 periods")


@case(
    "sliver of {:.0e} of the area",
    "Does a sliver on a neighbouring element have more effect than its area has, or break its centroid?",
    (1e-4,), (1e-6,), (1e-12,), (-1e-12,),
)  # fmt: skip
def sliver(share: float) -> Outcome:
    """Slide a block along a grid line on a still table, ``share`` of it on the next column, which is at full amplitude.

    The distance changes by no more than the sliver's share of the friction, and the block neither turns nor leaves the line.
    """
    surface, part = Surface(horizontal_amplitude=0.0), Part.rectangle(L / 2, L / 2, friction=MU)
    amplitude = np.zeros((8, 32))
    amplitude[:, 11:] = surface.lift_off_amplitude
    pose, velocity = [11 * L - L / 4 + share * L / 2, 3.2 * L, 0.0], [0, 0.5, 0]
    beside = follow(Scene(surface, part, pose, velocity, amplitude, 0.3, 6))
    alone = follow(Scene(surface, part, pose, velocity, 0.0, 0.0, 6))
    way = 0.5**2 / (2 * MU * surface.gravity)
    if abs(alone.pose[-1, 1] - pose[1] - way) > 1e-6:
        raise ArithmeticError(f"stops after {alone.pose[-1, 1] - pose[1]:.9g} m, not {way:.9g} m")
    # At most twice the pressure on the sliver, and a torque with the same effect again.
    bound = 4.0 * max(share, 0.0) * way + 1e-13
    return at_most(gap(part, beside.pose, alone.pose), bound, "m", f"way {1e3 * way:.3g} mm")


@case("uniform field around a grid corner", "Do four equal quarters give exactly equal wrenches?")
def mirrored() -> Outcome:
    surface, square = Surface(), Part.rectangle(L, L, friction=MU)
    worst = 0.0
    for heading in (0.0, math.pi / 4, math.pi / 2, 0.3):
        path = follow(Scene(surface, square, [12 * L, 4 * L, heading], [0, 0, 0], surface.lift_off_amplitude, 0.7, 3))
        worst = max(worst, float(np.abs(path.pose[:, 2] - heading).max()))
    return at_most(worst, 1e-12, "rad", "uniform field, 3 periods, edges on grid lines at the start")


@case("part within one element", "A part within one element must not turn, and its size must not matter.")
def alone_on_an_element() -> Outcome:
    """Compare with the path of another part on one large element."""
    surface, small = Surface(), Part.rectangle(0.005, 0.004, friction=MU)
    amplitude, phase = random_drive(surface, 8)
    amplitude *= 0.3  # so that it stays within the element
    start = [*surface.idle_velocity(MU), 0]
    inside = follow(Scene(surface, small, [12.5 * L, 4.5 * L, 0.3], start, amplitude, phase, 3), steps=9, substeps=2)
    large = Scene(one_element(), TWO_BY_ONE, [1, 1, 0.3], start, amplitude[4, 12], phase[4, 12], 3)
    outside = follow(large, steps=9, substeps=2)
    apart = (inside.pose - inside.pose[0]) - (outside.pose - outside.pose[0])
    return at_most(np.abs(apart).max(), 1e-12, "m, rad", "same path and no rotation for any part")


# -- against the reference ---------------------------------------------------------------------------------------------


def _covering() -> Scene:
    surface = Surface(rows=4, columns=6)
    plate = Part.rectangle(0.2, 0.15, friction=MU)
    return Scene(surface, plate, [0.078, 0.052, 0.1], [0, 0, 1.0], *random_drive(surface, 10), 4)


def _small() -> Scene:
    return prototype(Part.rectangle(0.005, 0.004, friction=MU), [12 * L, 4 * L + 0.001, 0.4], [0, 0, 2], 11)


for _name, _question, _make in (
    ("part exactly on two elements", "Are grid lines under the edges counted twice or not at all?",
     lambda: prototype(TWO_BY_ONE, GRID, [0, 0, 0], 7)),
    ("part smaller than an element",
     "A part of 5 x 4 mm crosses element edges in a fraction of a period: is it still right?", _small),
    ("part that covers the surface", "A plate larger than the surface rests on all of it: is the load shared rightly?",
     _covering),
    ("64 corners", "Does an outline of 64 corners cut rightly?",
     lambda: prototype(regular(64, 0.03), [0.4, 0.1, 0.4], [0, 0, 3], 12)),
    ("non-convex outline", "Does a U whose centre of mass lies outside its material cut rightly?",
     lambda: prototype(U_SHAPE, [0.4, 0.1, 0.4], [0, 0, 3], 13)),
    ("overhang without falling",
     "Is the load of an overhanging part carried by what is supported, while its area changes?",
     lambda: prototype(TWO_BY_ONE, [0.012, 0.19, 0.5], [0.05, -0.1, 1.0], 9, 3)),
):  # fmt: skip
    CASES += against_reference(_name, _question, _make)

# -- the border --------------------------------------------------------------------------------------------------------

BORDERS = (
    ("right", 0.0, [0.80, 0.1, 0.3]),
    ("left", math.pi, [0.03, 0.1, 0.3]),
    ("top", math.pi / 2, [0.4, 0.18, 0.3]),
    ("corner", math.pi / 4, [0.81, 0.19, 0.3]),
)


@functools.cache
def _falls() -> list[tuple[str, Scene, Trajectory]]:
    """Return motions by the reference of a block, and of a part whose centre of mass lies outside its material, over all
    borders. The table pushes most strongly towards ``direction`` with phase 270 degrees less that."""
    surface, cases = Surface(), []
    for part in (TWO_BY_ONE, U_SHAPE):
        for name, direction, pose in BORDERS:
            phase = 1.5 * math.pi - direction
            scene = Scene(surface, part, pose, [0, 0, 0], surface.lift_off_amplitude, phase, 12)
            cases.append((f"{part.name} at the {name}", scene, exactly(scene)))
    return cases


@case("overhang up to falling, fine steps", "Do time and place of the fall converge?", (FINE,))
@case(
    "overhang up to falling",
    "Does a part that is pushed over the border fall when and where its centre of mass leaves its support?",
    ({},),
)
def falling(knobs: dict[str, int]) -> Outcome:
    worst, note = 0.0, []
    steps = knobs.get("steps", 5)
    for name, scene, exact in _falls():
        path = follow(scene, **knobs)
        if not exact.fallen or not path.fallen[-1]:
            raise ArithmeticError(f"{name}: fallen {path.fallen[-1]}, reference {exact.fallen}")
        period, expected = int(np.argmax(path.fallen)), exact.fall_time / scene.surface.period
        # The model checks once a step, and detects a fall within a step of it.
        if not math.ceil(expected - 1 / steps) <= period <= math.ceil(expected + 1 / steps):
            raise ArithmeticError(f"{name}: fell in period {period}, reference {expected:.3f}")
        speed = float(np.hypot(*exact.velocity[math.floor(expected), :2]))
        off = float(np.hypot(*(path.pose[-1] - exact.pose[-1])[:2]))
        worst = max(worst, off / (speed * scene.surface.period / steps))
        note.append(f"{1e3 * off:.2g}")
    return at_most(worst, 1.2, "steps", "distance over the way of one step; mm: " + ", ".join(note))
