"""Worlds with many parts: ``python -m studies.benchmarks.crowds``.

Time per part and period of worlds with six parts that never come near one another, against worlds with one part. How fast
crowds are beside PushT: :mod:`studies.benchmarks.peers`.
"""

from __future__ import annotations

import statistics
import time

import numpy as np

import vibgym
from vibgym.scene.parts import shipped_part

WORLDS, ROUNDS = 256, 7


def main() -> None:
    """Measure and print."""
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
    print(f"Six parts that never come near one another, {WORLDS} worlds, one core: {six.statistics}")
    print(
        f"  {together:.2f} us per part and period, {alone:.2f} us in worlds with one part: "
        f"{ratio:.2f} of its speed (target >= 0.7)"
    )


if __name__ == "__main__":
    main()
