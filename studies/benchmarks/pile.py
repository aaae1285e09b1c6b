"""A pile of parts pushed into a corner for a long time: ``python -m studies.benchmarks.pile [--periods 10000]``.

30 parts of four kinds on the prototype, with walls and full amplitude towards a corner, to detect growing overlap, parts that
never come to rest, and memory leaks.
"""

from __future__ import annotations

import math
import os
import time

import numpy as np

from studies.benchmarks import common
from vibgym import Part, Simulator, Surface
from vibgym.fields import uniform
from vibgym.physics.contacts.hulls import all_gaps, place_hulls, wall_gap
from vibgym.scene.hulls import WALLS
from vibgym.scene.parts import shipped_part

COUNT = 30


def kinds() -> list[Part]:
    """Return a steel and an aluminium block, a disc and an L-shape."""
    corners = np.array([(0, 0), (50, 0), (50, 20), (20, 20), (20, 50), (0, 50)]) * 1e-3
    return [
        shipped_part("steel_block"),
        shipped_part("aluminium_block"),
        Part.disc(0.02, friction=0.6),
        Part.polygon(corners, friction=0.6, name="L"),
    ]


def start(count: int) -> np.ndarray:
    """Return poses (count, 3) on a grid without contacts."""
    columns = math.ceil(count / 3)
    k = np.arange(count)
    return np.column_stack([0.05 + (k % columns) * 0.072, 0.035 + (k // columns) * 0.068, np.zeros(count)])


def largest_overlap(simulator: Simulator) -> float:
    """Return the largest overlap of parts with one another or with walls, m."""
    pose, surface, hulls = simulator.pose, simulator.surface, simulator.hulls
    gaps = np.empty((1, len(pose[0]), len(pose[0])))
    all_gaps(hulls, pose, gaps)
    smallest = float(gaps.min())
    placed = np.empty_like(hulls.corner)
    for k, (x, y, heading) in enumerate(pose[0]):
        place_hulls(hulls, k, x, y, heading, placed)
        for name in simulator.walls:
            gap = wall_gap(hulls, placed, k, WALLS.index(name), surface.width, surface.depth)
            smallest = min(smallest, float(gap))
    return -smallest


def kinetic_energy(simulator: Simulator) -> float:
    """Return the kinetic energy of all parts, J."""
    velocity = simulator.velocity[0]
    return sum(
        0.5 * part.mass * float(vx * vx + vy * vy + part.gyration * spin * spin)
        for part, (vx, vy, spin) in zip(simulator.parts, velocity)
    )


def resident() -> float:
    """Return the memory of this process, MB."""
    with open("/proc/self/statm", encoding="utf-8") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> None:
    """Simulate the pile and print overlap, energy, speed and memory."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--periods", type=int, default=10_000)
    parser.add_argument("--parts", type=int, default=COUNT, help="at most 33")
    arguments = parser.parse_args()
    some = kinds()
    surface, parts = Surface(), [some[k % len(some)] for k in range(arguments.parts)]
    simulator = Simulator(surface, parts, walls=WALLS, threads=1)
    simulator.reset(start(len(parts)))
    fields = uniform(math.radians(225)).drive(surface)
    simulator.advance(*fields, min(50, arguments.periods))  # compiles kernels; parts arrive
    before, spent, deepest, fastest = resident(), 0.0, 0.0, 0.0
    print(f"{len(parts)} parts, {arguments.periods} periods; {before:.1f} MB")
    rest = arguments.periods - min(50, arguments.periods)
    for period in range(1, rest + 1):
        began = time.perf_counter()
        simulator.advance(*fields)
        spent += time.perf_counter() - began
        deepest = max(deepest, largest_overlap(simulator))
        fastest = max(fastest, float(np.abs(simulator.mean_velocity[0, :, :2]).max()))
        if period % max(1, rest // 10) == 0:
            print(
                f"  period {period + 50:6d}: largest overlap so far {1e3 * deepest:.4f} mm, "
                f"energy {1e3 * kinetic_energy(simulator):.3f} mJ, "
                f"fastest {1e3 * np.hypot(*simulator.velocity[0, :, :2].T).max():.1f} mm/s "
                f"(mean over the period {1e3 * np.hypot(*simulator.mean_velocity[0, :, :2].T).max():.2f} mm/s), "
                f"{resident():.1f} MB, {1e6 * spent / period:.0f} us per period",
                flush=True,
            )
    print(
        f"largest overlap at a period's end {1e3 * deepest:.4f} mm, fastest mean velocity of all periods "
        f"{1e3 * fastest:.1f} mm/s; memory grew by {resident() - before:.2f} MB; fallen {int(simulator.fallen.sum())}, "
        f"diverged {int(simulator.diverged.sum())}; {simulator.statistics}"
    )


if __name__ == "__main__":
    main()
