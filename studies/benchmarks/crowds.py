"""Time of worlds with many parts: ``python -m studies.benchmarks.crowds``.

1. Time per part and period of worlds with six separate parts, relative to worlds with one part.
2. Time per part and period of a world with 32 and with 1000 parts, with the same initial distances and walls: periods 20 to
   120, with increasingly many contacts.

:mod:`studies.benchmarks.peers` compares crowds with PushT.
"""

from __future__ import annotations

import math
import statistics
import time

import numpy as np

import vibgym
from studies.benchmarks import common
from vibgym.scene.hulls import WALLS
from vibgym.scene.parts import shipped_part

WORLDS, ROUNDS = 256, 7


def apart() -> None:
    """Measure six separate parts."""
    surface = vibgym.Surface()
    part = shipped_part("aluminium_block")
    generator = np.random.default_rng(0)
    shape = (WORLDS, surface.rows, surface.columns)
    drives = [
        (generator.uniform(0.0, surface.lift_off_amplitude, shape), generator.uniform(-np.pi, np.pi, shape))
        for _ in range(4)
    ]
    pose = np.zeros((WORLDS, 6, 3))
    pose[:, :, 0] = np.linspace(0.07, surface.width - 0.07, 6)
    pose[:, :, 1] = 0.104
    pose += generator.uniform(-0.01, 0.01, pose.shape)
    six = vibgym.Simulator(surface, [part] * 6, worlds=WORLDS, threads=1)
    one = vibgym.Simulator(surface, part, worlds=WORLDS, threads=1)

    def per_part(simulator: vibgym.Simulator, start: np.ndarray) -> float:
        simulator.reset(start)
        began = time.perf_counter()
        for amplitude, phase in drives:
            simulator.advance(amplitude, phase)
        return (time.perf_counter() - began) / (len(drives) * WORLDS * start.shape[1])

    per_part(six, pose), per_part(one, pose[:, :1])
    pairs = [(per_part(six, pose), per_part(one, pose[:, k % 6 : k % 6 + 1])) for k in range(3 * ROUNDS)]
    ratio = statistics.median(b / a for a, b in pairs)
    together, alone = (1e6 * statistics.median(each) for each in zip(*pairs))
    print(f"\nSix separate parts, {WORLDS} worlds, one core: {six.statistics}")
    print(
        f"  {together:.2f} us per part and period, {alone:.2f} us in worlds with one part: "
        f"{ratio:.2f} of its speed (target >= 0.7)"
    )


PITCH, LARGE = 0.09, 115
"""m, initial distance of parts; elements along a side of the table for 1000 parts."""


def crowd(count: int) -> tuple[vibgym.Simulator, tuple[np.ndarray, np.ndarray]]:
    """Return a world with ``count`` blocks on a square grid, at a constant density, and amplitude and phase of its elements."""
    side = math.ceil(math.sqrt(count))
    elements = math.ceil(LARGE * side / 32)
    surface, generator = vibgym.Surface(elements, elements), np.random.default_rng(0)
    k = np.arange(count)
    margin = 0.5 * (surface.width - (side - 1) * PITCH)
    pose = np.column_stack([margin + PITCH * (k % side), margin + PITCH * (k // side), generator.uniform(-3, 3, count)])
    simulator = vibgym.Simulator(surface, [shipped_part("aluminium_block")] * count, walls=WALLS)
    simulator.reset(pose)
    shape = (elements, elements)
    return simulator, (generator.uniform(0.0, 3e-4, shape), generator.uniform(-math.pi, math.pi, shape))


def crowds() -> None:
    """Measure crowds: minimum thread time of three rounds, in turn."""
    scenes = {count: crowd(count) for count in (32, 1000)}
    least, counts = dict.fromkeys(scenes, math.inf), {}
    for _ in range(3):
        for count, (simulator, drive) in scenes.items():
            simulator.reset(crowd(count)[0].pose)
            simulator.advance(*drive, 20)
            before, began = simulator.statistics["contact_steps"], time.thread_time()
            simulator.advance(*drive, 100)
            least[count] = min(least[count], (time.thread_time() - began) / (100 * count))
            counts[count] = (simulator.statistics["contact_steps"] - before) / (100 * count)
    print("\nOne world of blocks 90 mm apart, walls, elements of up to 0.3 mm, periods 20 to 120")
    for count, spent in least.items():
        print(
            f"  {count:4d} parts: {1e6 * spent:.2f} us per part and period, {counts[count]:.2f} calls of the solver, "
            f"largest overlap {1e3 * scenes[count][0].deepest_overlap:.3f} mm"
        )
    print(f"  ratio {least[1000] / least[32]:.2f} (target <= 1.3)")


if __name__ == "__main__":
    common.parser(__doc__, keep=False).parse_args()
    apart()
    crowds()
