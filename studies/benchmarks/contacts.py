"""Contacts compared with closed forms and with smaller steps: ``python -m studies.benchmarks.contacts``.

1. Oblique impacts of two discs without friction on a table at rest: velocity and position, closed form.
2. Newton's cradle in the plane.
3. Two blocks driven together on the prototype for 12 periods, in 64 worlds: distance from a run with 640 coupling steps per
   period. Friction and contacts alternate, so the error is of first order in the step.
4. A part pressed against a wall by one of 1000 times its mass: largest overlap.
5. Fast contacts: 12 blocks driven together on the prototype, by distance at the start: cost, overlap, energy, and deviation
   after a second from certified contacts with 160 steps per period, which certified contacts with fewer steps have as well.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from typing import Any

import numpy as np

from studies.benchmarks import common
from studies.benchmarks.pile import largest_overlap
from studies.kept import show
from vibgym import Part, Simulator, Surface
from vibgym.fields import radial, uniform
from vibgym.scene.hulls import WALLS, gaps_between
from vibgym.scene.parts import shipped_part

RADIUS, SPEED, WORLDS = 0.02, 0.6, 64
OFFSETS = (0.0, 0.5, 0.9, 0.99)
STILL = Surface(horizontal_amplitude=0.0)


def disc(restitution: float) -> Part:
    """Return a disc without friction."""
    return Part.disc(RADIUS, friction=0.0, restitution=restitution, contact_friction=0.0)


def oblique(offset: float, restitution: float, periods: int = 10) -> tuple[float, float]:
    """Return the errors of velocity (m/s) and position (m) after an impact at ``offset`` times the sum of radii."""
    aside = 2.0 * RADIUS * offset
    simulator = Simulator(STILL, [disc(restitution)] * 2)
    simulator.reset([[0.3, 0.1, 0.0], [0.4, 0.1 + aside, 0.0]], [[SPEED, 0.0, 0.0], [0.0, 0.0, 0.0]])
    simulator.advance(0.0, 0.0, periods)
    along = math.sqrt(4.0 * RADIUS**2 - aside**2)
    normal = np.array([along, aside]) / (2.0 * RADIUS)
    blow = 0.5 * (1.0 + restitution) * SPEED * normal[0] * normal
    met = (0.1 - along) / SPEED
    left = simulator.time - met
    first = np.array([0.3 + SPEED * met, 0.1]) + (np.array([SPEED, 0.0]) - blow) * left
    second = np.array([0.4, 0.1 + aside]) + blow * left
    velocity = np.abs(simulator.velocity[0, :, :2] - [np.array([SPEED, 0.0]) - blow, blow]).max()
    return float(velocity), float(np.abs(simulator.pose[0, :, :2] - [first, second]).max())


def cradle(gap: float, discs: int = 5) -> np.ndarray:
    """Return velocities along x of a disc and the row of discs, ``gap`` m apart, that it hits, over its initial speed."""
    simulator = Simulator(STILL, [disc(1.0)] * (discs + 1))
    row = [[0.2 + k * (2.0 * RADIUS + gap), 0.1, 0.0] for k in range(discs)]
    simulator.reset([[0.1, 0.1, 0.0], *row], [[SPEED, 0.0, 0.0]] + [[0.0, 0.0, 0.0]] * discs)
    simulator.advance(0.0, 0.0, 12)
    return simulator.velocity[0, :, 0] / SPEED


def driven_together(steps: int) -> tuple[np.ndarray, float]:
    """Return positions (worlds, 2, 2) of two blocks after 12 periods in a radial field, and us per world and period."""
    surface = Surface()
    parts = [shipped_part("aluminium_block"), shipped_part("steel_block")]
    simulator = Simulator(surface, parts, worlds=WORLDS, threads=1, contact_steps=steps)
    pose = np.tile([[0.35, 0.104, 0.2], [0.47, 0.104, -0.1]], (WORLDS, 1, 1))
    pose[:, :, 1] += np.linspace(-0.01, 0.01, WORLDS)[:, None] * [1.0, -1.0]
    pose[:, :, 2] += np.linspace(-1.0, 1.0, WORLDS)[:, None]
    simulator.reset(pose)
    drive = radial(0.416, 0.104).drive(surface)
    began = time.perf_counter()
    simulator.advance(*drive, periods=12)
    return simulator.pose[..., :2], 1e6 * (time.perf_counter() - began) / (12 * WORLDS)


def heavy_on_light(ratio: float) -> float:
    """Return the largest overlap (m) of a heavy part that presses a light one against a wall, and in reverse order."""
    surface, deepest = Surface(), 0.0
    heavy = Part.rectangle(0.05, 0.04, friction=0.6, mass=0.01 * ratio)
    light = Part.rectangle(0.03, 0.03, friction=0.6, mass=0.01)
    for parts, x in (([light, heavy], (0.0151, 0.0553)), ([heavy, light], (0.0252, 0.0655))):
        simulator = Simulator(surface, parts, walls=WALLS)
        simulator.reset([[x[0], 0.1, 0.0], [x[1], 0.1, 0.0]])
        for _ in range(80):
            simulator.advance(*uniform(math.pi).drive(surface))
            deepest = max(deepest, largest_overlap(simulator))
    return deepest


def joined(values: Iterable[float]) -> str:
    """Format values with two digits."""
    return ", ".join(f"{value:.2g}" for value in values)


def closed_forms(keep: bool) -> None:
    """Compare with closed forms."""
    lines = []
    for restitution in (1.0, 0.3):
        what = f"oblique impact of two discs, restitution {restitution:g}, at {joined(OFFSETS)} of the sum of radii"
        wrong = 1e3 * np.array([oblique(offset, restitution) for offset in OFFSETS])
        for name, errors, unit in zip(("velocity", "position 0.3 s later"), wrong.T, ("mm/s", "mm"), strict=True):
            lines.append([f"{what}: error of the {name}", f"{joined(errors)} {unit}", ""])
    for gap in (0.0, 1e-6, 1e-4):
        *others, last = np.abs(cradle(gap))
        what = f"Newton's cradle, five discs {1e3 * gap:g} mm apart: share of the velocity with the last, at most with others"
        lines.append([what, f"{last:.6f}, {max(others):.6f}", "1, 0"])
    deepest = heavy_on_light(1000.0)
    lines.append(
        ["part of 1000 times the mass behind a light part at a wall: overlap", f"{1e3 * deepest:.3f} mm", "0.3 mm"]
    )
    show("contacts", ("contacts", "measured", "target"), lines, keep)


def shorter_steps(keep: bool) -> None:
    """Compare numbers of coupling steps."""
    driven_together(10)  # compiles
    finest, _ = driven_together(640)
    lines = []
    for steps in (5, 10, 20, 40, 80, 160):
        position, cost = driven_together(steps)
        error = 1e3 * np.hypot(*np.moveaxis(position - finest, -1, 0))
        lines.append([str(steps), f"{np.median(error):.3f} mm", f"{np.percentile(error, 95):.3f} mm", f"{cost:.0f} us"])
    heads = ("coupling steps per period", "distance from 640 steps: median", "95 %", "per world and period")
    show("contacts-steps", heads, lines, keep)


BLOCKS, SECOND = 12, 25
"""Parts of a heap, and periods of a second."""

CONTACTS: dict[str, dict[str, Any]] = {
    "certified": {},
    "certified, `contact_overlap=1e-4`": {"contact_overlap": 1e-4},
    "fast": {"contacts": "fast"},
}


def heap(pitch: float) -> np.ndarray:
    """Return poses (worlds, blocks, 3) around the middle, ``pitch`` m apart, with random headings."""
    k, generator = np.arange(BLOCKS), np.random.default_rng(0)
    pose = np.zeros((WORLDS, BLOCKS, 3))
    pose[..., 0], pose[..., 1] = 0.416 + pitch * (k % 4 - 1.5), 0.104 + pitch * (k // 4 - 1)
    pose[..., 2] = generator.uniform(-math.pi, math.pi, (WORLDS, BLOCKS))
    return pose


def together(pitch: float, **knobs: Any) -> Simulator:
    """Return worlds with a heap; ``knobs`` are those of the simulator."""
    made = Simulator(Surface(), [shipped_part("aluminium_block")] * BLOCKS, worlds=WORLDS, threads=1, **knobs)
    made.reset(heap(pitch))
    return made


def elastic_energy(pitch: float, **knobs: Any) -> str:
    """Return the kinetic energy of elastic blocks without friction after a second, over that at the start: lowest, highest."""
    block = Part.rectangle(0.05, 0.035, friction=0.0, restitution=1.0, contact_friction=0.0)
    large = Surface(20, 20, 0.05, horizontal_amplitude=0.0)
    simulator = Simulator(large, [block] * BLOCKS, worlds=WORLDS, threads=1, **knobs)
    speed = np.random.default_rng(1).uniform(-0.2, 0.2, (WORLDS, BLOCKS, 3)) * [1.0, 1.0, 0.0]
    simulator.reset(heap(pitch) + [0.084, 0.396, 0.0], speed)
    weight = [1.0, 1.0, block.gyration]
    simulator.advance(0.0, 0.0, SECOND)
    share = (simulator.velocity**2 * weight).sum(axis=(1, 2)) / (speed**2 * weight).sum(axis=(1, 2))
    return f"{share.min():.4f}, {share.max():.4f}"


def fast_contacts(keep: bool) -> None:
    """Compare fast with certified contacts."""
    drive, lines = radial(0.416, 0.104).drive(Surface()), []
    for pitch in (0.085, 0.074, 0.063):
        finest = together(pitch, contact_steps=160)
        finest.advance(*drive, SECOND)
        took: dict[str, list[float]] = {name: [] for name in CONTACTS}
        for _ in range(4):  # the first one compiles
            for name, knobs in CONTACTS.items():
                simulator, began = together(pitch, **knobs), time.thread_time()
                simulator.advance(*drive, SECOND)
                took[name].append(1e6 * (time.thread_time() - began) / (SECOND * WORLDS * BLOCKS))
        for name, knobs in CONTACTS.items():
            simulator, overlap = together(pitch, **knobs), []
            for _ in range(SECOND):
                simulator.advance(*drive)
                overlap.append(np.maximum(-gaps_between(simulator.parts, simulator.pose).min(axis=(1, 2)), 0.0))
            off = simulator.pose - finest.pose
            steps = simulator.statistics["contact_steps"] / (SECOND * WORLDS)
            lines.append([
                f"{1e3 * pitch:.0f} mm", name, f"{np.median(took[name][1:]):.1f} us", f"{steps:.1f}",
                f"{1e3 * np.median(overlap):.3f}, {1e3 * np.max(overlap):.3f} mm", elastic_energy(pitch, **knobs),
                f"{1e3 * np.median(np.hypot(off[..., 0], off[..., 1])):.2f} mm, "
                f"{math.degrees(np.median(np.abs(off[..., 2]))):.2f} deg",
            ])  # fmt: skip
    heads = (
        "distance", "contacts", "per part and period", "contact steps per period", "overlap: median, largest",
        "energy of elastic parts: lowest, highest", "deviation",
    )  # fmt: skip
    show("contacts-fast", heads, lines, keep)


def main() -> None:
    """Measure everything."""
    keep = common.parser(__doc__).parse_args().keep
    closed_forms(keep)
    shorter_steps(keep)
    fast_contacts(keep)


if __name__ == "__main__":
    main()
