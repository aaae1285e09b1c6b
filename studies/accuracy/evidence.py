"""Evidence for ``model="auto"``: ``python -m studies.accuracy.evidence`` measures it and writes it into the package.

For every class of scenes (:mod:`vibgym.simulation.choice`) every candidate runs the hardest members: parts at the class's
largest ``eps`` and smallest ``scale``, with held random fields, random fields that change every period, and all elements at
full amplitude with random phases, from rest and with spin. The stored error is the largest median over the worlds, in units
of ``a_h``, against a converged run. The largest 95th percentile and the median cost are stored as well.
"""

from __future__ import annotations

import json
import math
import platform
import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from vibgym.scene import Part, Surface
from vibgym.simulation import Simulator, choice
from vibgym.simulation.choice import PERIODS

WORLDS = 48
STICKING_WORLDS = 16  # parts that stick and slip all the time cost a hundred times as much
CONVERGED: dict[str, Any] = {"steps": 128, "substeps": 2, "pieces": 6}
CONVERGED_STICKING: dict[str, Any] = {"steps": 72, "substeps": 2, "pieces": 5}
PLANAR = [
    *({"steps": steps, "substeps": substeps} for steps, substeps in ((4, 3), (5, 4), (6, 4), (9, 3), (12, 3), (18, 2))),
    {"steps": 24, "substeps": 2},
    *({"steps": steps, "substeps": 2, "pieces": pieces} for steps, pieces in ((24, 2), (48, 3))),
]
AVERAGED = [
    {"order": 2, "stride": 1, "steps": 1},
    {"order": 2, "stride": 1, "steps": 2},
    {"order": 2, "stride": 2, "steps": 1},
    {"order": 2, "stride": 5, "steps": 1},
    {"order": 1, "stride": 1, "steps": 1},
]
PLAYS = (("held", 0.0), ("changing", 0.0), ("held", 5.0), ("full", 0.0))
"""Drive and spin (rad/s) at the start."""
AMPLITUDE, FREQUENCY, GRAVITY = 2.7e-3, 25.0, 9.81
CLASSES = [
    *(("many elements", eps, scale) for eps in (0.05, 0.1, 0.2, 0.5) for scale in (0.6, 0.4, 0.2, 0.1)),
    *(("one element", eps, scale) for eps in (0.05, 0.1, 0.2, 0.5) for scale in (0.4, 0.1)),
    *(("stick-slip", eps, 0.2) for eps in (1.0, 3.0)),
]


def members(kind: str, eps: float, scale: float) -> Iterator[tuple[Surface, Part]]:
    """Yield the hardest scenes of a class: large parts on small elements, and small parts on large ones."""
    travel = 2.0 * math.pi * AMPLITUDE
    omega = 2.0 * math.pi * FREQUENCY
    friction = eps * AMPLITUDE * omega**2 / GRAVITY
    size = scale * travel  # radius of gyration
    small = size * math.sqrt(6.0)  # edge of a square with it
    # Wide enough for the displacement by random fields; a single element drives its part steadily, at up to 0.3 m/s.
    reach = 1.0 + 8.0 * small if kind == "one element" else 0.3 + 8.0 * small
    for element, shape in ((small, "block"), (small, "bar"), (1.5 * small, "square"), (2.5 * small, "disc")):
        count = 1 if kind == "one element" else math.ceil(reach / element)
        edge = max(element, reach) if kind == "one element" else element
        # Near the limit of permanent sliding the amplitude must be slightly below the lift-off limit.
        limit = GRAVITY / omega**2
        room = 0.999 * (1.0 / eps - 1.0) * limit
        surface = Surface(
            rows=count, columns=count, element_size=edge, horizontal_amplitude=AMPLITUDE, frequency=FREQUENCY, gravity=GRAVITY,
            max_amplitude=limit if kind == "stick-slip" else min(limit, room),
        )  # fmt: skip
        if shape == "block":
            part = Part.rectangle(2.0 * small, 1.4 * small, friction=friction)
        elif shape == "bar":
            part = Part.rectangle(4.0 * small, 1.05 * small, friction=friction)
        elif shape == "square":
            part = Part.rectangle(small, small, friction=friction)
        else:
            part = Part.disc(math.sqrt(2.0) * size, friction=friction)
        yield surface, part


def fields(surface: Surface, worlds: int, seed: int, turn: int) -> tuple[np.ndarray, np.ndarray]:
    """Return random amplitude and phase of every element in every world."""
    rng = np.random.default_rng((seed, turn))
    shape = (worlds, surface.rows, surface.columns)
    assert surface.max_amplitude is not None
    return rng.uniform(0.0, surface.max_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)


def play(surface: Surface, part: Part, worlds: int, drive: str, spin: float, **settings: Any) -> Simulator:
    """Return the simulator after a run."""
    simulator = Simulator(surface, part, worlds=worlds, **settings)
    rng = np.random.default_rng(3)
    pose = np.empty((worlds, 1, 3))
    middle = np.array([surface.width, surface.depth]) / 2.0
    pose[:, 0, :2] = middle + rng.uniform(-0.5, 0.5, (worlds, 2)) * 2.0 * surface.element_size
    if surface.rows == 1:
        pose[:, 0, :2] = middle
    pose[:, 0, 2] = rng.uniform(-math.pi, math.pi, worlds)
    simulator.reset(pose, [0.0, 0.0, spin])
    if drive == "held":
        simulator.advance(*fields(surface, worlds, 5, 0), PERIODS)
    elif drive == "full":  # reaches the largest speed on one element
        simulator.advance(surface.max_amplitude, fields(surface, worlds, 5, 0)[1], PERIODS)
    else:
        for period in range(PERIODS):
            simulator.advance(*fields(surface, worlds, 6, period))
    return simulator


def displacement(simulator: Simulator, truth: Simulator) -> np.ndarray:
    """Return the largest displacement of a point of the outline, (worlds,) m; infinite where a run failed."""
    difference = np.abs(simulator.pose[:, 0] - truth.pose[:, 0])
    way = np.hypot(difference[:, 0], difference[:, 1]) + simulator.parts[0].radius * difference[:, 2]
    failed = simulator.diverged | (simulator.fallen[:, 0] != truth.fallen[:, 0])
    return np.where(failed, np.inf, way)


def timed(surface: Surface, part: Part, worlds: int, periods: int, settings: dict[str, Any]) -> float:
    """Return microseconds per period and world on one core, the best of a few runs."""
    simulator = Simulator(surface, part, worlds=worlds, threads=1, **settings)
    drive = fields(surface, worlds, 5, 0)
    best = math.inf
    for _ in range(3):
        began = time.perf_counter()
        simulator.advance(*drive, periods)
        best = min(best, time.perf_counter() - began)
    return 1e6 * best / (worlds * periods)


def rounded(value: float) -> float | None:
    """Return a value with four digits; None where a run failed."""
    return float(f"{value:.4g}") if math.isfinite(value) else None


def measure(kind: str, eps: float, scale: float) -> dict[str, Any]:
    """Measure error and cost of every candidate for a class."""
    candidates = [("planar", knobs) for knobs in PLANAR]
    if kind != "stick-slip":
        candidates += [("averaged", knobs) for knobs in AVERAGED]
    worlds, converged = (STICKING_WORLDS, CONVERGED_STICKING) if kind == "stick-slip" else (WORLDS, CONVERGED)
    worst, tail = [0.0] * len(candidates), [0.0] * len(candidates)
    scenes = list(members(kind, eps, scale))
    for surface, part in scenes:
        for drive, spin in PLAYS:
            truth = play(surface, part, worlds, drive, spin, **converged)
            for k, (model, knobs) in enumerate(candidates):
                error = displacement(play(surface, part, worlds, drive, spin, model=model, **knobs), truth) / AMPLITUDE
                worst[k] = max(worst[k], float(np.median(error)))
                tail[k] = max(tail[k], float(np.percentile(error, 95, method="higher")))
    rows = []
    for (model, knobs), error, most in zip(candidates, worst, tail, strict=True):
        one, many = (
            statistics.median(timed(*scene, worlds, periods, {"model": model, **knobs}) for scene in scenes)
            for periods in (1, PERIODS)
        )
        per_call = max(0.0, (one - many) / (1.0 - 1.0 / PERIODS))
        rows.append({
            "model": model, "knobs": knobs, "error": rounded(error), "error_95": rounded(most),
            "us_per_period": round(max(one - per_call, 0.0), 3), "us_per_call": round(per_call, 3),
        })  # fmt: skip
    return {"kind": kind, "eps": eps, "scale": scale, "rows": rows}


def main() -> None:
    """Measure all classes and write the file."""
    classes = []
    for kind, eps, scale in CLASSES:
        began = time.perf_counter()
        classes.append(measure(kind, eps, scale))
        print(f"{kind}, eps {eps}, scale {scale}: {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
    written = {
        "host": platform.processor() or platform.machine(),
        "periods": PERIODS,
        "classes": classes,
    }
    path = Path(choice.__file__).parent / "evidence.json"
    lines = json.dumps(written, indent=1).splitlines()
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(path)


if __name__ == "__main__":
    main()
