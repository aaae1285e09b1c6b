"""Many parts: initial contact, wedges, large mass ratios, thin and fast parts, hooks, crowds, and the border."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from studies.accuracy.hard_cases.case import Outcome, at_most, case, one_element, random_drive, sound
from vibgym.fields import Field, radial, uniform
from vibgym.physics.contacts.hulls import all_gaps, place_hulls, wall_gap
from vibgym.scene.hulls import WALLS
from vibgym.scene.parts import Part, shipped_part
from vibgym.scene.surface import Surface
from vibgym.simulation.simulator import Simulator

MU = 0.6
PUSHED = 3e-4
"""m of overlap at the end of a period that the hardest push may leave, a fifth of a pixel of the prototype's camera."""


def overlap(sim: Simulator) -> float:
    """Return the largest overlap (m) of two parts, or a part and a wall; 0 if all are apart. Fallen parts are left out.

    Raises:
        ArithmeticError: a number is not finite, or a world diverged.
    """
    sound(sim)
    pose, fallen = sim.pose, sim.fallen
    gaps = np.empty((len(pose), len(sim.parts), len(sim.parts)))
    all_gaps(sim.hulls, pose, gaps)
    gaps[fallen] = math.inf
    gaps.transpose(0, 2, 1)[fallen] = math.inf
    smallest = float(gaps.min())
    placed = np.empty_like(sim.hulls.corner)
    for world, part in np.argwhere(~fallen):
        place_hulls(sim.hulls, part, *pose[world, part], placed)
        for wall in sim.walls:
            gap = wall_gap(sim.hulls, placed, part, WALLS.index(wall), sim.surface.width, sim.surface.depth)
            smallest = min(smallest, float(gap))
    return max(-smallest, 0.0)


def driven(
    parts: Sequence[Part], pose: Any, field: Field, periods: int, walls: Sequence[str] = ()
) -> tuple[float, Simulator]:
    """Return the largest overlap (m) at the ends of ``periods`` under a held field on the prototype, and the simulator."""
    sim, deepest = Simulator(Surface(), parts, walls=walls), 0.0
    sim.reset(pose)
    drive = field.drive(sim.surface)
    for _ in range(periods):
        sim.advance(*drive)
        deepest = max(deepest, overlap(sim))
    return deepest, sim


def masses(parts: Sequence[Part]) -> np.ndarray:
    """Return the mass (kg) of each part."""
    return np.array([part.mass for part in parts])


def energy(sim: Simulator) -> float:
    """Return the kinetic energy of the first world, J."""
    mass, velocity = masses(sim.parts), sim.velocity
    inertia = mass * [part.gyration for part in sim.parts]
    return float((0.5 * ((velocity[..., :2] ** 2).sum(axis=2) @ mass + velocity[..., 2] ** 2 @ inertia))[0])


def shape(corners: list[tuple[float, float]], name: str, **properties: Any) -> Part:
    """Return a part with corners in mm."""
    return Part.polygon(np.array(corners) * 1e-3, name=name, **{"friction": MU, **properties})


def u_shape(**properties: float) -> Part:
    return shape([(0, 0), (70, 0), (70, 50), (50, 50), (50, 20), (20, 20), (20, 50), (0, 50)], "U", **properties)


# -- at rest and pushed ------------------------------------------------------------------------------------------------


def _laid_together() -> tuple[list[Part], np.ndarray]:
    """Return blocks in two rows with discs on top, all at a distance of exactly zero from their neighbours."""
    steel, disc = shipped_part("steel_block"), Part.disc(0.02, friction=MU)
    pose = [[0.3 + 0.05 * (k % 3), 0.06 + 0.04 * (k // 3), 0.0] for k in range(6)]
    pose += [[0.31 + 0.04 * k, 0.14, 0.0] for k in range(3)]
    return [steel] * 6 + [disc] * 3, np.array(pose)


@case("in touch, still table", "Do parts that lie against one another fly apart?")
def stays_where_it_is() -> Outcome:
    """Check that touching parts do not move, and that an overlap of 0.09 mm is only removed."""
    parts, pose = _laid_together()
    surface, worst = Surface(horizontal_amplitude=0.0), 0.0
    for squeezed, allowed in ((0.0, 0.0), (0.9e-4, 3e-4)):
        sim = Simulator(surface, parts)
        start = pose.copy()
        start[:, 0] -= squeezed * np.array([0, 1, 2, 0, 1, 2, 0, 1, 2])
        sim.reset(start)
        sim.advance(0.0, 0.0, 25)
        sound(sim)
        moved = float(np.hypot(*(sim.pose[0] - start)[:, :2].T).max())
        worst = max(worst, moved - allowed, float(np.abs(sim.velocity).max()))
    return at_most(worst, 0.0, "m, m/s", "9 parts in touch; with 0.09 mm of overlap, at most 0.3 mm of motion")


@case("in touch, driven", "Do parts that begin in touch become faster than what drives them?")
def starts_in_touch() -> Outcome:
    parts, pose = _laid_together()
    surface, fastest = Surface(), 0.0
    for seed in range(8):
        sim = Simulator(surface, parts)
        sim.reset(pose)
        for _ in range(10):
            sim.advance(*random_drive(surface, seed))
            sound(sim)
            fastest = max(fastest, float(np.hypot(*sim.velocity[0, :, :2].T).max()))
    return at_most(fastest / surface.table_speed, 1.0, "of table speed", "8 fields, 10 periods, 9 parts")


@case("wedge at a wall", "A wedge driven between a wall and a part: does it sink into either?")
def wedge() -> Outcome:
    slender = shape([(0, 60), (0, 0), (2, 0), (12, 60)], "wedge")
    pose = [[-slender.outline[:, 0].min() + 5e-4, 0.13, 0.0], [0.004 + 0.025, 0.05, 0.0]]
    deepest = 0.0
    for mass in (0.05, 50.0):
        parts = [slender, Part.rectangle(0.05, 0.06, friction=MU, mass=mass)]
        depth, sim = driven(parts, pose, uniform(math.radians(262)), 80, walls=("left", "bottom"))
        deepest = max(deepest, depth)
        if sim.fallen.any() or sim.pose[0, 0, 0] < 0.0:
            raise ArithmeticError(f"the wedge went through the wall: {sim.pose[0, 0]}")
    return at_most(deepest, PUSHED, "m", "80 periods at full amplitude; block of 0.05 and 50 kg")


@case("heavy on light", "A thousandfold mass behind a light part at a wall: is it squashed?")
def heavy_on_light() -> Outcome:
    """Press a light part against a wall by a heavy one, and vice versa."""
    heavy = Part.rectangle(0.05, 0.04, friction=MU, mass=0.01 * 1000.0)
    light = Part.rectangle(0.03, 0.03, friction=MU, mass=0.01)
    deepest = 0.0
    for parts, x in (([light, heavy], (0.0151, 0.0553)), ([heavy, light], (0.0252, 0.0655))):
        depth, _ = driven(parts, [[place, 0.1, 0.0] for place in x], uniform(math.pi), 80, WALLS)
        deepest = max(deepest, depth)
    return at_most(deepest, PUSHED, "m", "80 periods at full amplitude, either next to the wall")


# -- fast and thin -----------------------------------------------------------------------------------------------------


@case(
    "{:g} m/s on a plate of 1 mm",
    "A fast part against a thin one: does it pass through, is momentum lost?",
    (5.0,), (50.0,),
)  # fmt: skip
def fast_on_thin(speed: float) -> Outcome:
    """Compare a disc's impact from 24 distances with the closed form."""
    surface, worst = one_element(40.0, horizontal_amplitude=0.0), 0.0
    parts = [Part.disc(0.01, friction=0.0, restitution=0.5), Part.rectangle(0.001, 0.06, friction=0.0, restitution=0.5)]
    mass = masses(parts)
    sim = Simulator(surface, parts, worlds=24)
    pose, velocity = np.full((24, 2, 3), 20.0), np.zeros((24, 2, 3))
    pose[..., 2] = 0.0
    pose[:, 1, 0] += 0.0105 + speed * surface.period * np.linspace(0.01, 1.0, 24)
    velocity[:, 0, 0] = speed
    sim.reset(pose, velocity)
    sim.advance(0.0, 0.0, 2)
    sound(sim)
    impulse = 1.5 * speed / (1.0 / mass).sum()
    exact = np.array([speed - impulse / mass[0], impulse / mass[1]])
    worst = float(np.abs(sim.velocity[..., 0] - exact).max() / speed)
    momentum = float(np.abs(sim.velocity[..., 0] @ mass / (speed * mass[0]) - 1.0).max())
    if momentum > 1e-12 or (sim.pose[:, 1, 0] < sim.pose[:, 0, 0]).any():
        raise ArithmeticError(f"momentum off by {momentum:.3g}, or the disc has passed the plate")
    return at_most(worst, 1e-9, "of speed", "24 distances; momentum kept, the disc never passes the plate")


# -- shapes ------------------------------------------------------------------------------------------------------------


@case("hooks torn apart", "Two U hooked into one another: do they hold without overlap?")
def hooks() -> Outcome:
    """Pull apart two parts with an arm of each in the other's slot: they hold, and momentum is conserved."""
    surface, deepest = one_element(2.0, horizontal_amplitude=0.0), 0.0
    u = u_shape(friction=0.0)
    mass = masses([u, u])
    low = u.outline.min(axis=0)  # the arms' play in the slots is 5 mm to either side and to the bottom
    pose = [[1.0, 1.0, 0.0], [1.0 + 0.095 + 2.0 * low[0], 1.0 + 0.075 + 2.0 * low[1], math.pi]]
    for x, y, spin in ((0.3, 0.0, 0.0), (-0.3, 0.05, 0.0), (0.2, 0.0, 3.0), (0.0, -0.2, 0.0)):
        sim = Simulator(surface, [u, u])
        sim.reset(pose, [[-x, -y, spin], [x, y, 0.0]])
        before = sim.velocity[0, :, :2].T @ mass
        apart = sim.pose[0, 1, :2] - sim.pose[0, 0, :2]
        for period in range(8):
            sim.advance(0.0, 0.0)
            deepest = max(deepest, overlap(sim))
            moved = np.abs(sim.pose[0, 1, :2] - sim.pose[0, 0, :2] - apart)
            if period < 1 and moved[0] > 0.02:
                raise ArithmeticError(f"they came {1e3 * moved[0]:.3g} mm apart")
        off = float(np.abs(sim.velocity[0, :, :2].T @ mass - before).max() / (mass[0] * math.hypot(x, y)))
        if off > 1e-12:
            raise ArithmeticError(f"momentum off by {off:.3g}")
    return at_most(deepest, 1e-4, "m of overlap", "4 directions of pulling, 8 periods")


@case("hooks driven", "Non-convex parts inside one another under full fields: do they overlap?")
def hooked_and_driven() -> Outcome:
    """Drive L-shapes one inside the other, and a U around a block."""
    deepest = 0.0
    l_shape = shape([(0, 0), (50, 0), (50, 20), (20, 20), (20, 50), (0, 50)], "L")
    parts = [l_shape, l_shape, u_shape(), Part.rectangle(0.025, 0.025, friction=MU)]
    corner, slot = parts[0].outline.min(axis=0), parts[2].outline.min(axis=0)
    pose = [
        [0.3, 0.1, 0.0],
        # Inner corners face each other: each part extends 25 mm into the other.
        [0.3 + 2.0 * corner[0] + 0.075, 0.1 + 2.0 * corner[1] + 0.075, math.pi],
        [0.5, 0.1, 0.0],
        [0.5 + slot[0] + 0.035, 0.1 + slot[1] + 0.0335, 0.0],
    ]
    for direction in (0.0, 90.0, 180.0, 270.0, 45.0):
        depth, sim = driven(parts, pose, uniform(math.radians(direction)), 20, WALLS)
        deepest = max(deepest, depth)
        if sim.fallen.any():
            raise ArithmeticError(f"fallen in spite of walls: {sim.fallen}")
    return at_most(deepest, PUSHED, "m", "5 directions, 20 periods")


@case("spinning bar", "A bar that hits discs: does energy grow, or does it overlap discs?")
def spinning_bar() -> Outcome:
    """Return the largest rise of kinetic energy in a period on a still table, over the initial one."""
    bar = Part.rectangle(0.12, 0.008, friction=0.2)
    parts = [bar] + [Part.disc(0.012, friction=0.2)] * 10
    angle = np.arange(10) * 2.0 * math.pi / 10
    around = np.column_stack([0.4 + 0.045 * np.cos(angle + 0.3), 0.1 + 0.045 * np.sin(angle + 0.3), angle])
    around[:, :2] += 0.02 * np.column_stack([np.cos(angle + 0.3), np.sin(angle + 0.3)])
    sim = Simulator(Surface(horizontal_amplitude=0.0), parts)
    velocity = np.zeros((11, 3))
    velocity[0, 2] = 60.0
    velocity[1:, :2] = 0.5 * ([0.4, 0.1] - around[:, :2]) / 0.065
    sim.reset(np.vstack([[0.4, 0.1, 0.0], around]), velocity)
    begun = before = energy(sim)
    worst, deepest = 0.0, 0.0
    for _ in range(25):
        sim.advance(0.0, 0.0)
        deepest = max(deepest, overlap(sim))
        now = energy(sim)
        worst, before = max(worst, (now - before) / begun), now
    if deepest > 1e-4 or sim.statistics["contact_steps"] < 10:
        raise ArithmeticError(f"overlap {1e3 * deepest:.3g} mm, {sim.statistics}")
    return at_most(worst, 1e-12, "of energy", f"60 rad/s, 10 discs, overlap at most {1e3 * deepest:.3g} mm")


@case("grains between blocks", "Parts much smaller than an element, squeezed: do they overlap?")
def grains() -> Outcome:
    """Squeeze discs of 2 and 4 mm, a tenth of an element, between blocks that a field drives together."""
    steel = shipped_part("steel_block")
    small, smaller = Part.disc(0.004, friction=MU), Part.disc(0.002, friction=MU)
    parts = [steel, steel] + [small, smaller] * 4
    pose = [[0.36, 0.1, 0.0], [0.44, 0.1, 0.0]]
    pose += [[0.395 + 0.004 * (k % 2) + 0.003, 0.076 + 0.0065 * k, 0.0] for k in range(8)]
    deepest, _ = driven(parts, pose, radial(0.4, 0.1), 40)
    return at_most(deepest, PUSHED, "m", f"40 periods; mass ratio {steel.mass / smaller.mass:.0f}")


# -- crowds ------------------------------------------------------------------------------------------------------------


@case("64 parts", "A table full of parts driven together: overlaps, escapes, excessive speeds?")
def crowded() -> Outcome:
    surface = Surface()
    kinds = [Part.rectangle(0.022, 0.016, friction=0.64), Part.disc(0.009, friction=MU)]
    kinds.append(shape([(0, 0), (20, 0), (20, 8), (8, 8), (8, 20), (0, 20)], "small L"))
    parts = [kinds[k % 3] for k in range(64)]
    k = np.arange(64)
    sim = Simulator(surface, parts, walls=WALLS)
    sim.reset(np.column_stack([0.2 + 0.03 * (k % 13), 0.03 + 0.03 * (k // 13), np.zeros(64)]))
    deepest, fastest = 0.0, 0.0
    for _ in range(30):
        sim.advance(*radial(0.4, 0.1).drive(surface))
        deepest = max(deepest, overlap(sim))
        fastest = max(fastest, float(np.hypot(*sim.velocity[0, :, :2].T).max()))
    if sim.fallen.any() or fastest > 2.0 * surface.table_speed:
        raise ArithmeticError(f"{int(sim.fallen.sum())} fallen, fastest {fastest:.3g} m/s")
    return at_most(deepest, PUSHED, "m", f"30 periods, {sim.statistics['contact_steps']} calls of the solver")


@case(
    "pushed over the border",
    "Others push a part off: does it fall, stay where it fell, and let them go on?",
)
def over_the_border() -> Outcome:
    surface = Surface()
    frictionless = Part.rectangle(0.04, 0.04, friction=0.0, name="pushed")  # only contacts move it
    parts = [shipped_part("steel_block"), shipped_part("aluminium_block"), frictionless]
    sim = Simulator(surface, parts)
    x = surface.width - 0.03
    sim.reset([[x - 0.1, 0.1, 0.0], [x - 0.048, 0.1, 0.0], [x, 0.1, 0.0]])
    wrong, rest, when = 0, None, 0
    for period in range(60):
        before = sim.pose
        sim.advance(*uniform(0.0).drive(surface))
        sound(sim)
        if sim.fallen[0, 2] and rest is None:
            rest, when = sim.pose[0, 2], period
            wrong += int(sim.fallen[0, :2].any()) + int((before[0, :2] == sim.pose[0, :2]).all())
        elif rest is not None:
            wrong += int((sim.pose[0, 2] != rest).sum()) + int((sim.velocity[0, 2] != 0.0).sum())
    if rest is None or not sim.fallen.all():
        raise ArithmeticError(f"fallen: {sim.fallen[0].tolist()}, from {x - 0.1:.3g} m to {sim.pose[0, 0, 0]:.3g} m")
    return at_most(wrong, 0, "numbers", f"fell in period {when}; the others followed")
