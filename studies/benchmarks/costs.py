"""Time per step: ``python -m studies.benchmarks.costs`` prints the tables of docs/performance.md, in about four minutes.

Time over worlds, parts and elements under a part, with one and two threads, time per stage of a step
(:mod:`vibgym.envs.step`), and the kernel between the limits of a core (:mod:`studies.benchmarks.roofline`). Every value is the
minimum of several measurements, in a separate process per number of threads; with one thread, of processor time, which other
processes affect little. The time of a nested stage is subtracted from the enclosing one, so that the shares add up; ``rest`` is
the step outside all stages (resets, ``info``, Gymnasium). ``--keep`` stores the figures in results/performance.json, from which
the build of the documentation makes the page.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import gymnasium as gym
import numpy as np

from agents.provenance import provenance
from studies import common
from studies.benchmarks import roofline
from studies.manual import performance
from vibgym import Part, Simulator, Surface
from vibgym.files import write_atomically
from vibgym.simulation.threads import available_threads

ROUNDS, WARM, ACTIONS = 60, 20, 8  # of the stages
CALLS = 15  # of each point of a curve

PITCH = 0.09
"""m between parts, which therefore never touch."""

SCENES: list[dict[str, Any]] = [
    {"name": "vibgym/Rotate-v0", "worlds": 1024, "steps": 4, "action": "element"},
    {"name": "vibgym/Align-v0", "worlds": 1024, "steps": 4, "action": "field"},
    {"name": "vibgym/SortCrowded-v0", "worlds": 64, "steps": 4, "action": "element"},
    {"name": "vibgym/SortCrowded-v0", "worlds": 64, "steps": 4, "action": "field"},
]


def fastest(work: Callable[[], Any], units: float) -> float:
    """Return us per unit, the minimum of several calls."""
    clock = time.process_time if available_threads() == 1 else time.perf_counter
    return 1e6 * float(common.interleaved({"": work}, CALLS, 1, clock)[""].min()) / units


def worlds(quick: bool) -> Iterator[tuple[float, float]]:
    """Yield sizes of a batch, and us per world and step."""
    for size in (1, 64, 1024) if quick else [2**k for k in range(15)]:
        env: Any = gym.make_vec("vibgym/Rotate-v0", num_envs=size, action="element")
        env.action_space.seed(0)
        actions, steps = [env.action_space.sample() for _ in range(8)], max(1, 256 // size)
        env.reset(seed=0)
        yield size, fastest(lambda: [env.step(actions[k % 8]) for k in range(steps)], size * steps)  # noqa: B023


def parts(quick: bool) -> Iterator[tuple[float, float]]:
    """Yield numbers of parts in a world, and us per part and period."""
    surface, rng = Surface(rows=115, columns=115), np.random.default_rng(0)
    block = Part.rectangle(0.05, 0.04, friction=0.6)
    side = math.floor(min(surface.width, surface.depth) / PITCH)
    shape = (surface.rows, surface.columns)
    amplitude, phase = rng.uniform(0.0, 3e-4, shape), rng.uniform(-math.pi, math.pi, shape)
    for count in (1, 32) if quick else (1, 2, 4, 8, 16, 32, 64, 125, 250, 500, 1000):
        places = [((k % side + 0.7) * PITCH, (k // side + 0.7) * PITCH, 0.3 * k) for k in range(count)]
        simulator = Simulator(surface, [block] * count, walls=["left", "right", "top", "bottom"])
        simulator.reset([places])
        simulator.advance(amplitude, phase, 20)
        yield count, fastest(lambda: simulator.advance(amplitude, phase, 5), 5 * count)  # noqa: B023


def elements(quick: bool) -> Iterator[tuple[float, float]]:
    """Yield numbers of elements under a part, and us per world and period."""
    surface, rng, batch = Surface(rows=40, columns=60), np.random.default_rng(0), 64
    shape = (batch, surface.rows, surface.columns)
    amplitude, phase = rng.uniform(0.0, surface.lift_off_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)
    middle = [surface.width / 2, surface.depth / 2]
    cell = surface.width * surface.depth / (surface.rows * surface.columns)
    for under in (2, 16) if quick else (0.5, 1, 2, 4, 8, 16, 32, 64, 128, 256):
        edge = math.sqrt(under * cell)
        simulator = Simulator(surface, Part.rectangle(edge, edge, friction=0.6), worlds=batch)
        simulator.reset([[[*middle, 0.1 * k]] for k in range(batch)])
        yield under, fastest(lambda: simulator.advance(amplitude, phase, 5), 5 * batch)  # noqa: B023


CURVES: dict[str, Callable[[bool], Iterator[tuple[float, float]]]] = {
    "worlds": worlds, "parts": parts, "elements": elements,
}  # fmt: skip


class StageClock:
    """Time (s) spent in each stage, without nested stages."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        self.readings = 0
        self._current, self._since = "rest", time.thread_time()

    def switch(self, stage: str) -> str:
        """Attribute the time until now to the current stage and make ``stage`` current; return the previous one."""
        now, before = time.thread_time(), self._current
        self.spent[before] = self.spent.get(before, 0.0) + now - self._since
        self._current, self._since = stage, now
        self.readings += 1
        return before

    def clear(self) -> None:
        """Set all times to zero."""
        self.switch("rest")
        self.spent, self.readings = {}, 0

    def timed(self, stage: Callable[..., Any], name: str = "") -> Callable[..., Any]:
        """Wrap a stage; without a name, that of its method."""
        name = name or getattr(stage, "func", stage).__name__

        def within(*arguments: Any) -> Any:
            before = self.switch(name)
            try:
                return stage(*arguments)
            finally:
                self.switch(before)

        return within


def instrumented(clock: StageClock, name: str, worlds: int, **settings: Any) -> Any:
    """Return a vector environment whose stages are timed."""
    env: Any = gym.make_vec(name, num_envs=worlds, **settings)
    pipeline = env.unwrapped.core.pipeline
    pipeline.before = [clock.timed(stage) for stage in pipeline.before]
    pipeline.after = [clock.timed(stage) for stage in pipeline.after]
    pipeline.advance = clock.timed(pipeline.advance)
    pipeline.by_block = [
        [clock.timed(stage, "score" if stage in scoring else "") for stage in stages]
        for stages, scoring in zip(pipeline.by_block, pipeline.score, strict=True)
    ]
    return env


def shares(name: str, worlds: int, steps: int, **settings: Any) -> dict[str, Any]:
    """Return us per world and step of every stage, and of reading the clock: the fastest of :data:`ROUNDS` rounds."""
    clock = StageClock()
    env = instrumented(clock, name, worlds, **settings)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(ACTIONS)]
    env.reset(seed=0)
    for k in range(WARM):
        env.step(actions[k % ACTIONS])
    best: dict[str, float] = {}
    for _ in range(ROUNDS):
        clock.clear()
        for k in range(steps):
            env.step(actions[k % ACTIONS])
        clock.switch("rest")
        if not best or sum(clock.spent.values()) < sum(best.values()):
            best = dict(clock.spent)
    readings = clock.readings
    env.close()
    clock.clear()
    for _ in range(10_000):
        clock.switch("rest")
    unit = 1e6 / (worlds * steps)
    reading = sum(clock.spent.values()) / 10_000
    return {"stages": {stage: unit * spent for stage, spent in best.items()}, "clock": unit * reading * readings}


def curve(name: str, quick: bool) -> list[tuple[float, float]]:
    """Return the points of a curve."""
    return list(CURVES[name](quick))


def limit_threads(threads: int) -> None:
    """Set the number of threads of this process."""
    os.environ["VIBGYM_THREADS"] = str(threads)


def in_a_process(threads: int, function: Callable[..., Any], *arguments: Any, **more: Any) -> Any:
    """Return the result of a function, called in a new process with this number of threads."""
    with ProcessPoolExecutor(1, get_context("spawn"), limit_threads, (threads,)) as pool:
        return pool.submit(function, *arguments, **more).result()


def main() -> None:
    """Measure, print and store the figures."""
    parser = common.parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="a few sizes, to test the command")
    asked = parser.parse_args()
    quick, scenes = asked.quick, SCENES[:1] if asked.quick else SCENES
    about = {"command": "python -m studies.benchmarks.costs", **provenance(), "load": os.getloadavg()[0]}
    costs = {
        "about": about,
        "roofline": in_a_process(1, roofline.measure, 2 if quick else roofline.ROUNDS),
        "stages": [{**scene, **in_a_process(1, shares, **scene)} for scene in scenes],
        "curves": {name: {threads: in_a_process(threads, curve, name, quick) for threads in (1, 2)} for name in CURVES},
    }
    figures = json.dumps(costs, indent=1) + "\n"
    for text in performance.tables(json.loads(figures)).values():
        print(text, end="\n\n")
    if asked.keep:
        write_atomically(performance.STORED, figures)


if __name__ == "__main__":
    main()
