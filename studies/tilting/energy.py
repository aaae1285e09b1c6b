"""Energy balance of a rigid part: ``python -m studies.tilting energy``.

Every step's impulses do work at the velocities of table and plates. Any further growth of the part's energy is an error of the
scheme, or comes from ramps, which lift sliding points without decelerating them. The kernels run as plain Python, to record
their impulses; this is set at import and therefore requires a separate process.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
from typing import NamedTuple

import numpy as np

PLAIN = {"NUMBA_DISABLE_JIT": "1"}
CASES = [(part, share, tilt) for part in ("steel_block", "disc") for share in (0.25, 1.0) for tilt in (1.0, 5.0)]
PERIODS = 8
RESTITUTION = (0.0, 0.2, 1.0)


class Balance(NamedTuple):
    """J/kg, sums over all steps of a motion."""

    given: float  # positive work of table and plates
    made: float  # excess growth of energy, over the steps with growth
    lost: float  # excess loss of energy, over the other steps
    most: float  # largest excess over any sequence of steps; 0 for a process that only loses


def balance(name: str, share: float, tilt: float, restitution: float, periods: int, seed: int = 0) -> Balance:
    """Return the balance of a part tipped by ``tilt`` (rad) on random fields at a share of the largest amplitude."""
    from vibgym import Part, Simulator, Surface
    from vibgym.plugins.tilting import period as kernels
    from vibgym.plugins.tilting.ground import ground
    from vibgym.plugins.tilting.records import CX, CY, CZ, LX, LY, LZ, PN, PX, PY, RX, RY, VX, VY, VZ, WX, WY, WZ
    from vibgym.scene.parts import shipped_part

    take_step, resolve = kernels.take_step, kernels.resolve_contacts
    surface, rng = Surface(rows=8, columns=8), np.random.default_rng(seed)
    part = Part.disc(0.02, friction=0.5, height=0.01) if name == "disc" else shipped_part(name)
    work: list[float] = []
    steps: list[tuple[float, float]] = []

    def energy(motion: np.ndarray) -> float:
        swift = motion[VX] ** 2 + motion[VY] ** 2 + motion[VZ] ** 2
        turning = motion[LX] * motion[WX] + motion[LY] * motion[WY] + motion[LZ] * motion[WZ]
        return 0.5 * (swift + turning) + surface.gravity * motion[CZ]

    def watched(working, n, friction, table_x, table_y):  # type: ignore[no-untyped-def]
        resolve(working, n, friction, table_x, table_y)
        motion, contact = working.motion, working.contact
        rigid, turn = scene
        shift = surface.horizontal_amplitude * np.array(
            [rigid.scheme.cosine[2 * turn + 1], rigid.scheme.sine[2 * turn + 1]]
        )
        for k in range(n):
            x, y = motion[CX] + contact[k, RX] - shift[0], motion[CY] + contact[k, RY] - shift[1]
            rate = ground(rigid, x, y)[1]  # of the plate, without the rise along a ramp
            work[-1] += contact[k, PN] * rate + contact[k, PX] * table_x + contact[k, PY] * table_y

    def step(rigid, world, kind, friction, level, turn):  # type: ignore[no-untyped-def]
        nonlocal scene
        scene, before = (rigid, turn), energy(rigid.work.motion)
        work.append(0.0)
        take_step(rigid, world, kind, friction, level, turn)
        steps.append((energy(rigid.work.motion) - before, work[-1]))

    scene: tuple = ()
    kernels.take_step, kernels.resolve_contacts = step, watched
    try:
        simulator = Simulator(surface, part, model="tilting", restitution=restitution)
        middle = 0.5 * surface.width
        simulator.reset([middle, middle, rng.uniform(-3.0, 3.0)], np.append(surface.idle_velocity(part.friction), 0.0))
        way = rng.uniform(-math.pi, math.pi)
        simulator.tip(0, [tilt * math.cos(way), tilt * math.sin(way)])
        shape = 1, surface.rows, surface.columns
        amplitude = share * (surface.max_amplitude or 0.0) * rng.uniform(0.0, 1.0, shape)
        phase = rng.uniform(-math.pi, math.pi, shape)
        for _ in range(periods):
            simulator.advance(amplitude, phase)
    finally:
        kernels.take_step, kernels.resolve_contacts = take_step, resolve
    gained, made = np.array(steps).T
    excess = gained - made
    total = np.concatenate([[0.0], np.cumsum(excess)])
    most = float((total - np.minimum.accumulate(total)).max())
    return Balance(float(made[made > 0].sum()), float(excess[excess > 0].sum()), -float(excess[excess < 0].sum()), most)


def table() -> None:
    """Print a line per case."""
    print(
        "part, share of amplitude, tilt, restitution: work of the drive, excess made and lost, most made in a row, J/kg"
    )
    for name, share, tilt in CASES:
        for restitution in RESTITUTION:
            row = balance(name, share, math.radians(tilt), restitution, PERIODS)
            print(
                f"{name:12} {share:4} {tilt:3} deg {restitution:3}: {row.given:.4f}  {row.made:.5f} {row.lost:.4f}  "
                f"{row.most:.6f} ({1e3 * row.most / 9.81:.4f} mm high)",
                flush=True,
            )


def main() -> None:
    """Run the study in a process whose kernels are plain Python."""
    command = [sys.executable, "-W", "ignore", "-c", "from studies.tilting.energy import table; table()"]
    subprocess.run(command, env={**os.environ, **PLAIN}, check=True)


if __name__ == "__main__":
    main()
