"""Contacts compared with closed forms and with smaller steps: ``python -m studies.benchmarks.contacts [--only TABLE ...]``.

``contacts``: closed forms and limits.

1. Oblique impacts of two discs without friction on a table at rest: velocity and position, closed form.
2. Newton's cradle in the plane.
3. A part pressed against a wall by one of up to 2000 times its mass: largest overlap.
4. Two blocks that meet head-on at up to 10 m/s: largest overlap, energy, and whether they pass through each other.

``contacts-steps``: two blocks driven together on the prototype for 12 periods, in 64 worlds: distance from a run with 640 steps
per period, and the observed order from each number of steps to the next.

``contacts-order``: the same of certified contacts in six scenes, 4 periods in 32 worlds, against 1280 steps per period.

``contacts-heaps``: heaps of 12 blocks driven together on the prototype, by distance at the start: cost, overlap, energy, and
deviation after a second from certified contacts with 160 steps per period, which certified contacts with fewer steps have as
well.

``apart``: time per part and period of worlds with six separate parts, relative to worlds with one part.

``pile``: 30 parts of four kinds with walls and full amplitude towards a corner for a long time, to detect growing overlap,
parts that never come to rest, and memory leaks.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from studies import common
from studies.kept import show
from vibgym import Part, Simulator, Surface
from vibgym.fields import radial, uniform
from vibgym.physics.contacts.hulls import place_hulls, wall_gap
from vibgym.scene.hulls import WALLS, gaps_between
from vibgym.scene.parts import shipped_part

RADIUS, SPEED, WORLDS = 0.02, 0.6, 64
OFFSETS = (0.0, 0.5, 0.9, 0.99)
STILL = Surface(horizontal_amplitude=0.0)


def disc(restitution: float) -> Part:
    """Return a disc without friction."""
    return Part.disc(RADIUS, friction=0.0, restitution=restitution, contact_friction=0.0)


def oblique(offset: float, restitution: float, periods: int = 10, **knobs: Any) -> tuple[float, float]:
    """Return the errors of velocity (m/s) and position (m) after an impact at ``offset`` times the sum of radii."""
    aside = 2.0 * RADIUS * offset
    simulator = Simulator(STILL, [disc(restitution)] * 2, **knobs)
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


def cradle(gap: float, discs: int = 5, **knobs: Any) -> np.ndarray:
    """Return velocities along x of a disc and the row of discs, ``gap`` m apart, that it hits, over its initial speed."""
    simulator = Simulator(STILL, [disc(1.0)] * (discs + 1), **knobs)
    row = [[0.2 + k * (2.0 * RADIUS + gap), 0.1, 0.0] for k in range(discs)]
    simulator.reset([[0.1, 0.1, 0.0], *row], [[SPEED, 0.0, 0.0]] + [[0.0, 0.0, 0.0]] * discs)
    simulator.advance(0.0, 0.0, 12)
    return simulator.velocity[0, :, 0] / SPEED


def driven_together(steps: int, **knobs: Any) -> tuple[np.ndarray, float]:
    """Return positions (worlds, 2, 2) of two blocks after 12 periods in a radial field, and us per world and period."""
    surface = Surface()
    parts = [shipped_part("aluminium_block"), shipped_part("steel_block")]
    simulator = Simulator(surface, parts, worlds=WORLDS, threads=1, contact_steps=steps, **knobs)
    pose = np.tile([[0.35, 0.104, 0.2], [0.47, 0.104, -0.1]], (WORLDS, 1, 1))
    pose[:, :, 1] += np.linspace(-0.01, 0.01, WORLDS)[:, None] * [1.0, -1.0]
    pose[:, :, 2] += np.linspace(-1.0, 1.0, WORLDS)[:, None]
    simulator.reset(pose)
    drive = radial(0.416, 0.104).drive(surface)
    began = time.perf_counter()
    simulator.advance(*drive, periods=12)
    return simulator.pose[..., :2], 1e6 * (time.perf_counter() - began) / (12 * WORLDS)


def largest_overlap(simulator: Simulator) -> float:
    """Return the largest overlap of the parts of a world with one another or with walls, m."""
    pose, surface, hulls = simulator.pose, simulator.surface, simulator.hulls
    deepest, placed = float(-gaps_between(simulator.parts, pose).min()), np.empty_like(hulls.corner)
    for k, (x, y, heading) in enumerate(pose[0]):
        place_hulls(hulls, k, x, y, heading, placed)
        for name in simulator.walls:
            deepest = max(deepest, -float(wall_gap(hulls, placed, k, WALLS.index(name), surface.width, surface.depth)))
    return deepest


def heavy_on_light(ratio: float, **knobs: Any) -> float:
    """Return the largest overlap (m) of a heavy part that presses a light one against a wall, and in reverse order."""
    surface, deepest = Surface(), 0.0
    heavy = Part.rectangle(0.05, 0.04, friction=0.6, mass=0.01 * ratio)
    light = Part.rectangle(0.03, 0.03, friction=0.6, mass=0.01)
    for parts, x in (([light, heavy], (0.0151, 0.0553)), ([heavy, light], (0.0252, 0.0655))):
        simulator = Simulator(surface, parts, walls=WALLS, **knobs)
        simulator.reset([[x[0], 0.1, 0.0], [x[1], 0.1, 0.0]])
        for _ in range(80):
            simulator.advance(*uniform(math.pi).drive(surface))
            deepest = max(deepest, largest_overlap(simulator))
    return deepest


def head_on(speed: float, **knobs: Any) -> tuple[float, float, int]:
    """Return largest overlap (m), largest energy over that at the start, and the worlds in which a block passes the other."""
    block = Part.rectangle(0.05, 0.035, friction=0.0, restitution=1.0, contact_friction=0.0)
    simulator = Simulator(STILL, [block] * 2, worlds=WORLDS, threads=1, **knobs)
    start = np.tile([[0.35, 0.104, 0.0], [0.45, 0.104, 0.0]], (WORLDS, 1, 1))
    start[:, 0, 0] -= np.linspace(0.0, 0.05, WORLDS)
    simulator.reset(start, [[0.5 * speed, 0.0, 0.0], [-0.5 * speed, 0.0, 0.0]])
    simulator.advance(0.0, 0.0, math.ceil(0.12 / speed / simulator.surface.period))
    energy = (simulator.velocity[..., 0] ** 2).sum(axis=1) / (0.5 * speed**2)
    passed = simulator.pose[:, 0, 0] > simulator.pose[:, 1, 0]
    return simulator.deepest_overlap, float(energy.max()), int(passed.sum())


def joined(values: Iterable[float]) -> str:
    """Format values with two digits."""
    return ", ".join(f"{value:.2g}" for value in values)


def listed(values: Iterable[object]) -> str:
    """Return values as text."""
    return ", ".join(map(str, values))


KINDS: tuple[dict[str, Any], ...] = ({"contacts": "certified"}, {"contacts": "pymunk"}, {"contacts": "fast"})
"""Settings of the columns of :func:`closed_forms` and the blocks of rows of :func:`shorter_steps`."""

RATIOS, SPEEDS = (1, 10, 100, 1000, 2000), (0.5, 1, 2, 5, 10)
"""Of masses; m/s, of impacts."""


def closed_forms(keep: bool) -> None:
    """Compare with closed forms, and show the limits of each kind of contacts."""
    lines = []
    for restitution in (1.0, 0.3):
        what = f"oblique impact of two discs, restitution {restitution:g}, at {joined(OFFSETS)} of the sum of radii"
        wrong = 1e3 * np.array([[oblique(offset, restitution, **kind) for offset in OFFSETS] for kind in KINDS])
        for name, errors, unit in zip(
            ("velocity", "position 0.3 s later"), np.moveaxis(wrong, 2, 0), ("mm/s", "mm"), strict=True
        ):
            lines.append([f"{what}: error of the {name}, {unit}", *(joined(error) for error in errors)])
    for gap in (0.0, 1e-6, 1e-4):
        shares = [np.abs(cradle(gap, **kind)) for kind in KINDS]
        what = f"Newton's cradle, discs {1e3 * gap:g} mm apart: velocity of the last, at most of others (closed form: 1, 0)"
        lines.append([what, *(f"{share[-1]:.6f}, {share[:-1].max():.6f}" for share in shares)])
    deepest = [joined(1e3 * heavy_on_light(ratio, **kind) for ratio in RATIOS) for kind in KINDS]
    lines.append([f"part of {listed(RATIOS)} times the mass behind a light part at a wall: overlap, mm", *deepest])
    met = [[head_on(speed, **kind) for speed in SPEEDS] for kind in KINDS]
    what = f"elastic blocks that meet at {listed(SPEEDS)} m/s"
    lines.append(
        [f"{what}: overlap within a period, mm", *(joined(1e3 * deep + 0.0 for deep, _, _ in row) for row in met)]
    )
    lines.append([f"{what}: energy over that before", *(", ".join(f"{gain:.4f}" for _, gain, _ in row) for row in met)])
    lines.append([f"{what}: pass through each other, of 64", *(listed(n for _, _, n in row) for row in met)])
    show("contacts", ("contacts", *(kind["contacts"] for kind in KINDS)), lines, keep)


STEPS = (5, 10, 20, 40, 80, 160)
"""Coupling steps per period."""


def shorter_steps(keep: bool) -> None:
    """Compare numbers of coupling steps."""
    for kind in KINDS:
        driven_together(10, **kind)  # compiles
    finest, _ = driven_together(640)
    lines = []
    for kind in KINDS:
        name, run = kind["contacts"], [driven_together(steps, **kind) for steps in STEPS]
        errors = [1e3 * np.hypot(*np.moveaxis(position - finest, -1, 0)) for position, _ in run]
        medians = [float(np.median(error)) for error in errors]
        orders = ["", *(f"{math.log2(coarse / fine):.1f}" for coarse, fine in pairwise(medians))]
        for steps, median, error, order, (_, cost) in zip(STEPS, medians, errors, orders, run, strict=True):
            lines.append(
                [name, str(steps), f"{median:.3f} mm", f"{np.percentile(error, 95):.3f} mm", order, f"{cost:.0f} us"]
            )
    heads = ("contacts", "steps per period", "distance: median", "95 %", "observed order", "per world and period")
    show("contacts-steps", heads, lines, keep)


ORDER_WORLDS, ORDER_PERIODS, FINEST = 32, 4, 1280
"""Worlds and periods of :func:`orders`, and steps per period of its reference."""

CENTRES = np.array([0.416, 0.104]) + np.random.default_rng(0).uniform(-0.02, 0.02, (ORDER_WORLDS, 2))
"""Middles of the scenes of :func:`orders`, m."""


class Scene(NamedTuple):
    """Parts that touch at the start, or are close, in :data:`ORDER_WORLDS` worlds."""

    parts: list[Part]
    pose: np.ndarray  # (worlds, parts, 3)
    drive: tuple[np.ndarray, np.ndarray]
    walls: tuple[str, ...] = ()
    incline: tuple[float, float] = (0.0, 0.0)  # m/s^2


def squares(size: float, *friction: float) -> list[Part]:
    """Return squares with these coefficients of friction."""
    return [Part.rectangle(size, size, friction=mu) for mu in friction]


def in_a_row(count: int, size: float, turned: float, centres: np.ndarray) -> np.ndarray:
    """Return poses of touching squares around ``centres``, in rows turned by up to ``turned`` rad."""
    heading = np.linspace(-turned, turned, ORDER_WORLDS)[:, None]
    along = size * (np.arange(count) - 0.5 * (count - 1))
    x, y = centres[:, :1] + along * np.cos(heading), centres[:, 1:] + along * np.sin(heading)
    return np.stack([x, y, np.broadcast_to(heading, x.shape)], axis=-1)


def scenes() -> dict[str, Scene]:
    """Return the scenes of :func:`orders` by name."""
    surface, k = Surface(), np.arange(ORDER_WORLDS)
    amplitude, phase = radial(0.416, 0.104).drive(surface)
    left = np.stack([np.full(ORDER_WORLDS, 0.08), CENTRES[:, 1]], axis=1)
    bar = Part.rectangle(0.16, 0.05, friction=0.3, mass=0.8)
    block = Part.rectangle(0.04, 0.03, friction=0.58, contact_friction=0.3)
    sliding = np.zeros((ORDER_WORLDS, 2, 3))
    sliding[:, 0, :2], sliding[:, 1, 1] = [0.416, 0.025], 0.065
    sliding[:, 1, 0] = 0.37 + 0.001 * k
    height = 0.04 * math.sqrt(0.75)
    discs = [Part.disc(0.02, friction=mu) for mu in (0.3, 0.58, 0.45, 0.64, 0.5, 0.4)]
    heaped = np.zeros((ORDER_WORLDS, 6, 3))
    heaped[:, :, 0] = 0.25 + 0.01 * k[:, None] + 0.04 * np.array([0.0, 1.0, 2.0, 0.5, 1.5, 1.0])
    heaped[:, :, 1] = 0.02 + height * np.array([0.0, 0.0, 0.0, 1.0, 1.0, 2.0])
    return {
        "two squares driven together": Scene(squares(0.05, 0.58, 0.4), in_a_row(2, 0.05, 0.5, CENTRES), (amplitude, phase)),
        "a row pressed against a wall": Scene(
            squares(0.04, 0.3, 0.58, 0.45, 0.64), in_a_row(4, 0.04, 0.0, left), uniform(0.5 * math.pi).drive(surface),
            ("left",), (-8.0, 0.0),
        ),
        "a square between two that move apart": Scene(
            squares(0.04, 0.58, 0.58, 0.58), in_a_row(3, 0.04, 0.5, CENTRES), (amplitude, phase + math.pi)
        ),
        "a block that slides along a bar": Scene([bar, block], sliding, uniform(0.3).drive(surface), ("bottom",), (1.0, -8.0)),
        "a heap of discs at a wall": Scene(discs, heaped, uniform(1.0).drive(surface), ("bottom",), (0.0, -8.0)),
        "a crowd driven together": Scene(
            [shipped_part("aluminium_block")] * BLOCKS, heap(0.063)[:ORDER_WORLDS], (amplitude, phase)
        ),
    }  # fmt: skip


def final_positions(scene: Scene, steps: int) -> np.ndarray:
    """Return the positions (worlds, parts, 2) of a scene at the end."""
    made = Simulator(Surface(), scene.parts, walls=scene.walls, worlds=ORDER_WORLDS, threads=1, contact_steps=steps)
    made.reset(scene.pose)
    made.set_conditions(range(ORDER_WORLDS), incline=scene.incline)
    made.advance(*scene.drive, ORDER_PERIODS)
    return made.pose[..., :2]


def orders(keep: bool) -> None:
    """Compare numbers of coupling steps of certified contacts in several scenes."""
    lines = []
    for name, scene in scenes().items():
        finest = final_positions(scene, FINEST)
        off = [1e3 * float(np.median(np.linalg.norm(final_positions(scene, n) - finest, axis=-1))) for n in STEPS]
        order = math.log(off[0] / off[-1]) / math.log(STEPS[-1] / STEPS[0]) if off[-1] > 0.0 else math.inf
        lines.append([name, *(f"{median:.4f}" for median in off), f"{order:.1f}"])
    heads = ("mm, after 4 periods", *(f"{n} steps" for n in STEPS), f"order from {STEPS[0]} to {STEPS[-1]}")
    show("contacts-order", heads, lines, keep)


BLOCKS, SECOND = 12, 25
"""Parts of a heap, and periods of a second."""

CONTACTS: dict[str, dict[str, Any]] = {
    "certified": {},
    "certified, `contact_overlap=1e-4`": {"contact_overlap": 1e-4},
    "pymunk": {"contacts": "pymunk"},
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


def heaps(keep: bool) -> None:
    """Compare the kinds of contacts in heaps."""
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
    show("contacts-heaps", heads, lines, keep)


def apart(keep: bool) -> None:
    """Compare worlds with six separate parts with worlds that have one of them."""
    surface, part, worlds, generator = Surface(), shipped_part("aluminium_block"), 256, np.random.default_rng(0)
    shape = (worlds, surface.rows, surface.columns)
    drives = [
        (generator.uniform(0.0, surface.lift_off_amplitude, shape), generator.uniform(-np.pi, np.pi, shape))
        for _ in range(4)
    ]
    pose = np.zeros((worlds, 6, 3))
    pose[:, :, 0] = np.linspace(0.07, surface.width - 0.07, 6)
    pose[:, :, 1] = 0.104
    pose += generator.uniform(-0.01, 0.01, pose.shape)
    six = Simulator(surface, [part] * 6, worlds=worlds, threads=1)
    one = Simulator(surface, part, worlds=worlds, threads=1)

    def run(simulator: Simulator, start: np.ndarray) -> None:
        simulator.reset(start)
        for drive in drives:
            simulator.advance(*drive)

    calls = {"six": partial(run, six, pose), **{f"one, {k}": partial(run, one, pose[:, k : k + 1]) for k in range(6)}}
    took = common.interleaved(calls, 7, 1, time.thread_time)
    alone = sum(times for name, times in took.items() if name != "six")
    us = [f"{1e6 * np.median(times) / (len(drives) * worlds * 6):.2f} us" for times in (took["six"], alone)]
    heads = ("per part and period", "in worlds with one part", "speed relative to these", "target")
    show("apart", heads, [[*us, f"{np.median(alone / took['six']):.2f}", "0.7"]], keep)


COUNT, PERIODS = 30, 10_000
"""Parts and periods of the pile."""


def resident() -> float:
    """Return the memory of this process, MB."""
    with open("/proc/self/statm", encoding="utf-8") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def pile(keep: bool) -> None:
    """Push parts into a corner; print overlap, speed and memory after each tenth of the time."""
    corners = np.array([(0, 0), (50, 0), (50, 20), (20, 20), (20, 50), (0, 50)]) * 1e-3
    kinds = [
        shipped_part("steel_block"), shipped_part("aluminium_block"), Part.disc(0.02, friction=0.6),
        Part.polygon(corners, friction=0.6, name="L"),
    ]  # fmt: skip
    k, surface = np.arange(COUNT), Surface()
    simulator = Simulator(surface, [kinds[n % len(kinds)] for n in k], walls=WALLS, threads=1)
    simulator.reset(np.column_stack([0.05 + (k % 10) * 0.072, 0.035 + (k // 10) * 0.068, np.zeros(COUNT)]))
    drive = uniform(math.radians(225)).drive(surface)
    simulator.advance(*drive, 50)  # compiles kernels; parts arrive
    before, deepest, lines = resident(), 0.0, []
    for tenth in range(1, 11):
        fastest = 0.0
        for _ in range(PERIODS // 10):
            simulator.advance(*drive)
            deepest = max(deepest, largest_overlap(simulator))
            fastest = max(fastest, float(np.hypot(*simulator.mean_velocity[0, :, :2].T).max()))
        lines.append([
            str(tenth * PERIODS // 10), f"{1e3 * deepest:.4f} mm", f"{1e3 * fastest:.1f} mm/s",
            f"{resident() - before:+.2f} MB", str(int(simulator.fallen.sum() + simulator.diverged.sum())),
        ])  # fmt: skip
    heads = ("periods", "largest overlap so far", "fastest mean velocity", "memory", "fallen or diverged")
    show("pile", heads, lines, keep)


TABLES = {
    "contacts": closed_forms,
    "contacts-steps": shorter_steps,
    "contacts-order": orders,
    "contacts-heaps": heaps,
    "apart": apart,
    "pile": pile,
}


def main() -> None:
    """Measure the tables."""
    os.environ["VIBGYM_THREADS"] = "1"
    parser = common.parser(__doc__)
    parser.add_argument("--only", nargs="+", choices=list(TABLES), default=list(TABLES))
    asked = parser.parse_args()
    for name in asked.only:
        TABLES[name](asked.keep and name.startswith("contacts"))


if __name__ == "__main__":
    main()
