"""What a period costs: ``python -m studies.tilting cost``. Microseconds of one core's own time (what else
runs on the machine counts for little), medians of rounds in turn.

Rigid parts on level ground and on random fields; and parts that lie flat, against the planar model.
"""

from __future__ import annotations

import time

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

SURFACE = Surface(rows=16, columns=32)
WORLDS, ROUNDS, PERIODS = 64, 9, 5
TILT = 0.03
"""rad, with which every round begins."""


def scene(part: Part, model: str, seed: int) -> Simulator:
    """Parts at random, so that some plates' borders lie beneath."""
    rng = np.random.default_rng(seed)
    simulator = Simulator(SURFACE, part, worlds=WORLDS, model=model, threads=1)
    low, high = 0.3 * SURFACE.depth, 0.7 * SURFACE.depth
    pose = np.concatenate([rng.uniform(low, high, (WORLDS, 1, 2)), rng.uniform(-3.0, 3.0, (WORLDS, 1, 1))], axis=2)
    simulator.reset(pose, np.append(SURFACE.idle_velocity(part.friction), 0.0))
    return simulator


def rigid(part: Part, share: float, level: bool) -> float:
    """us a period and part, of those periods that ended with the part tilted."""
    rng, found = np.random.default_rng(1), []
    shape = WORLDS, 1 if level else SURFACE.rows, 1 if level else SURFACE.columns
    for seed in range(ROUNDS):
        simulator = scene(part, "tilting", seed)
        amplitude = share * (SURFACE.max_amplitude or 0.0) * rng.uniform(0.0 if not level else 1.0, 1.0, shape)
        phase = rng.uniform(-3.0, 3.0, shape)
        way = rng.uniform(-3.0, 3.0, (WORLDS, 1))
        simulator.tip(slice(None), TILT * np.stack([np.cos(way), np.sin(way)], axis=-1))
        taken = rigid_periods = 0.0
        for _ in range(1 if level else PERIODS):
            began = time.process_time()
            simulator.advance(amplitude, phase)
            taken += time.process_time() - began
            rigid_periods += float((~simulator.fallen).sum())
        found.append(1e6 * taken / rigid_periods)
    return float(np.median(found))


def flat(part: Part, periods: int) -> tuple[float, float, float]:
    """us a period of flat parts: planar, tilting, and the median ratio."""
    both = [scene(part, model, 0) for model in ("planar", "tilting")]
    start, found = both[0].pose, []
    for turn in range(6 * ROUNDS):
        row = []
        for each in both:
            if turn % 3 == 0:
                each.reset(start)
            began = time.process_time()
            each.advance(0.3 * (SURFACE.max_amplitude or 0.0), 0.3 * turn, periods)
            row.append(1e6 * (time.process_time() - began) / WORLDS / periods)
        found.append(row)
    planar, tilting = np.median(found, axis=0)
    return planar, tilting, float(np.median([b / a for a, b in found]))


def main() -> None:
    """Print the table."""
    parts = [
        shipped_part("aluminium_block"),
        shipped_part("steel_block"),
        Part.disc(0.020, friction=0.5, name="20 mm disc"),
    ]
    print(
        "part: us a period on level ground, on random fields at a quarter and at full amplitude; flat: planar, tilting, ratio"
    )
    for part in parts:
        costs = [rigid(part, 0.25, True), rigid(part, 0.25, False), rigid(part, 1.0, False)]
        lying = ", ".join("{:.2f} {:.2f} {:.3f}".format(*flat(part, periods)) for periods in (1, 5))
        print(
            f"{part.name:16} {costs[0]:.0f} {costs[1]:.0f} {costs[2]:.0f}; one period a call, five: {lying}", flush=True
        )


if __name__ == "__main__":
    main()
