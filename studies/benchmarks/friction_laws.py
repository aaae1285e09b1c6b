"""Coefficients of friction that depend on speed: cost, error and consequences: ``python -m studies.benchmarks.friction_laws``.

- Cost: time of a period of 256 worlds with one block each on driven elements, relative to a constant coefficient.
- Error: distance after one second to the result with 8 x as many steps and 8 x 8 cells for each element, median of 64 worlds.
- Consequences: largest speed after 60 periods with all elements in phase, and policies on Align that assume the nominal
  coefficient.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from studies import common
from studies.kept import show
from vibgym import Part, Simulator, Surface
from vibgym.policies import rollout
from vibgym.seeds import RANGES

LAWS: dict[str, dict[str, Any] | None] = {
    "constant": None,
    "rise 0.3 below 50 mm/s": {"kind": "stribeck", "rise": 0.3, "speed": 0.05},
    "rise 0.5 below 200 mm/s": {"kind": "stribeck", "rise": 0.5, "speed": 0.2},
    "rise 0.5 below 500 mm/s": {"kind": "stribeck", "rise": 0.5, "speed": 0.5},
    "viscous, 0.5 s/m": {"kind": "stribeck", "viscous": 0.5},
}
"""Speeds at which ``1 / e`` of the rise is left."""

POLICIES: dict[str, Any] = {"pose": {"kind": "pose", "action": "velocity"}, "lqr": "lqr", "learned": "learned"}
WORLDS, TESTED, FRICTION = 256, 64, 0.58


def block(law: dict[str, Any] | None) -> Part:
    """Return the aluminium block of the thesis with a law of friction."""
    return Part.rectangle(0.050, 0.035, height=0.020, mass=0.0945, friction=FRICTION, friction_law=law)


def scene(
    law: dict[str, Any] | None, worlds: int, settings: dict[str, Any]
) -> tuple[Simulator, np.ndarray, np.ndarray, np.ndarray]:
    """Return a simulator, start poses, and a random drive of each element."""
    rng, surface = np.random.default_rng(0), Surface()
    simulator = Simulator(surface, block(law), worlds=worlds, **settings)
    size = (worlds, surface.rows, surface.columns)
    start = np.column_stack(
        [rng.uniform(0.3, 0.5, worlds), rng.uniform(0.08, 0.12, worlds), rng.uniform(-3, 3, worlds)]
    )
    return simulator, start[:, None], surface.max_amplitude * rng.random(size), rng.uniform(-np.pi, np.pi, size)


def costs(rounds: int) -> dict[str, str]:
    """Return the time of a period relative to the constant coefficient, by law, in processor time measured alternately."""
    calls = {}
    for name, law in LAWS.items():
        simulator, start, amplitude, phase = scene(law, WORLDS, {})
        simulator.reset(start)
        simulator.advance(amplitude, phase, 2)
        calls[name] = lambda now=simulator, a=amplitude, p=phase, at=start: (now.reset(at), now.advance(a, p, 5))
    took = common.interleaved(calls, rounds, 2, time.process_time)
    first = took["constant"]
    return {name: f"{np.median(times / first):.1f} x" for name, times in took.items()}


def error(law: dict[str, Any] | None) -> float:
    """Return the median distance after one second to the result of finer steps and cells, m."""
    poses = []
    for settings in ({}, {"steps": 72, "substeps": 8, "pieces": 8}):
        simulator, start, amplitude, phase = scene(law, TESTED, settings)
        simulator.reset(start)
        simulator.advance(amplitude, phase, 25)
        poses.append(np.where(simulator.fallen[..., None], np.nan, simulator.pose)[:, 0, :2])
    return float(np.nanmedian(np.hypot(*np.subtract(*poses).T)))


def top_speed(law: dict[str, Any] | None) -> float:
    """Return the steady speed along x with all elements at full amplitude in phase, m/s."""
    surface = Surface(columns=400)
    phases = np.linspace(-np.pi, np.pi, 73)
    simulator = Simulator(surface, block(law), worlds=len(phases))
    simulator.reset([0.5 * surface.width, 0.5 * surface.depth, 0.0])
    grid = np.broadcast_to(phases[:, None, None], (len(phases), surface.rows, surface.columns))
    simulator.advance(surface.max_amplitude, grid, 60)
    return float(simulator.mean_velocity[:, 0, 0].max())


def main() -> None:
    """Measure and print; with ``--keep`` write the table of the documentation."""
    parser = common.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=15)
    asked = parser.parse_args()
    cost, lines = costs(asked.rounds), []
    seeds = RANGES["held_out"][: asked.episodes]
    for name, law in LAWS.items():
        cells = []
        for policy in POLICIES.values():
            result = rollout(policy, "Align", seeds=seeds, parts=[block(law)])
            cells.append(common.outcome(result.success, result.time_to_goal))
        lines.append([name, cost[name], f"{1e6 * error(law):.0f} um", f"{1e3 * top_speed(law):.0f} mm/s", *cells])
        print(*lines[-1], flush=True)
    heads = ("factor on friction", "cost", "error", "top speed", *(f"Align, `{name}`" for name in POLICIES))
    show("friction-laws", heads, lines, asked.keep)


if __name__ == "__main__":
    main()
