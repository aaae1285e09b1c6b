"""Time per step: ``python -m studies.benchmarks.costs`` writes ``runs/costs/costs.html``.

Time over worlds, parts and elements under a part, with one and two threads, and time per stage of a step
(:mod:`vibgym.envs.step`). Every value is the minimum of several measurements, in a separate process per number of threads. The
time of a nested stage is subtracted from the enclosing one, so that the shares add up; ``rest`` is the step outside all stages
(resets, ``info``, Gymnasium).
"""

from __future__ import annotations

import argparse
import base64
import json
import math
import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import jinja2
import markupsafe
import numpy as np
from matplotlib.figure import Figure

from agents.evaluation.figures import png, style
from studies.accuracy import figures
from studies.benchmarks import common
from vibgym import Part, Simulator, Surface, files
from vibgym.envs.core import Core

ROUNDS, WARM, ACTIONS = 60, 20, 8  # of the stages

PITCH = 0.09
"""m between parts, which therefore never touch."""

SCENES: list[dict[str, Any]] = [
    {"name": "vibgym/Rotate-v0", "worlds": 1024, "steps": 4, "action": "element"},
    {"name": "vibgym/Align-v0", "worlds": 1024, "steps": 4, "action": "field"},
    {"name": "vibgym/SortCrowded-v0", "worlds": 64, "steps": 4, "action": "element"},
    {"name": "vibgym/SortCrowded-v0", "worlds": 64, "steps": 4, "action": "field"},
]

AXES = {
    "worlds": ("worlds in a batch", "us per world and step, Rotate-v0, element"),
    "parts": (f"blocks {1e3 * PITCH:.0f} mm apart in one world, with walls", "us per part and period"),
    "elements": ("elements under a square part", "us per world and period, 64 worlds"),
}


def fastest(work: Callable[[], Any], units: float, seconds: float = 1.0) -> float:
    """Return us per unit: minimum of the calls within ``seconds``, at least three."""
    work()
    found: list[float] = []
    began = time.perf_counter()
    while len(found) < 3 or time.perf_counter() - began < seconds:
        start = time.perf_counter()
        work()
        found.append(time.perf_counter() - start)
    return 1e6 * min(found) / units


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
        self._current, self._since = "rest", time.perf_counter()

    def switch(self, stage: str) -> str:
        """Attribute the time until now to the current stage and make ``stage`` current; return the previous one."""
        now, before = time.perf_counter(), self._current
        self.spent[before] = self.spent.get(before, 0.0) + now - self._since
        self._current, self._since = stage, now
        self.readings += 1
        return before

    def clear(self) -> None:
        """Set all times to zero."""
        self.switch("rest")
        self.spent, self.readings = {}, 0

    def timed(self, run: Callable[..., None]) -> Callable[..., None]:
        """Wrap a stage, named after its method."""
        stage = run.__name__.strip("_")

        def within(*arguments: Any) -> None:
            before = self.switch(stage)
            try:
                run(*arguments)
            finally:
                self.switch(before)

        return within


def instrumented(clock: StageClock, name: str, worlds: int, **settings: Any) -> Any:
    """Return a vector environment whose stages are timed."""
    listed = Core._list_stages
    Core._list_stages = lambda core: tuple(each._replace(run=clock.timed(each.run)) for each in listed(core))
    try:
        return gym.make_vec(name, num_envs=worlds, **settings)
    finally:
        Core._list_stages = listed


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


def in_a_process(threads: int, *command: str) -> list[Any]:
    """Run this module in another process and return the JSON values that it prints, one per line."""
    environment = {**os.environ, "VIBGYM_THREADS": str(threads)}
    done = subprocess.run(
        [sys.executable, "-m", __spec__.name, *command], env=environment, text=True, stdout=subprocess.PIPE, check=True
    )
    return [json.loads(line) for line in done.stdout.splitlines()]


def drawn(curve: str, found: dict[int, list[Any]]) -> str:
    """Return the plot of a curve for each number of threads, base64."""
    figure = Figure(figsize=(7.2, 4.0), layout="constrained")
    axes = figure.subplots()
    for threads, points in found.items():
        axes.loglog(*zip(*points, strict=True), marker="o", label=f"{threads} thread{'s' if threads > 1 else ''}")
    axes.set_xlabel(AXES[curve][0])
    axes.set_ylabel(AXES[curve][1].replace("us", "µs"))
    axes.legend()
    style(axes)
    return base64.b64encode(png(figure)).decode("ascii")


PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>vibgym: time per step</title><style>{{ style }}
.bar { display: inline-block; height: .8em; background: var(--accent); border-radius: 2px; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
</style></head><body><header><h1>Time per step</h1>
<p class="soft">{{ machine }}. Minimum of several runs, µs.</p></header><main>
{% for name, image in images.items() %}<h2>{{ axes[name][0] | capitalize }}</h2>
<div class="card"><img alt="{{ axes[name][1] }}" src="data:image/png;base64,{{ image }}"></div>{% endfor %}
{% for scene, found in shares %}<h2>{{ scene.name }}, {{ scene.action }}, {{ scene.worlds }} worlds, one thread</h2>
<div class="card"><table>{% set all = found.stages.values() | sum %}
<tr><th>stage</th><th>µs per world and step</th><th>share</th><th></th></tr>
{% for stage, spent in found.stages.items() if spent > 0 %}<tr><td>{{ stage }}</td>
<td class="number">{{ "%.3f" | format(spent) }}</td>
<td class="number">{{ "%.1f" | format(100 * spent / all) }} %</td>
<td><span class="bar" style="width: {{ (300 * spent / all) | round }}px"></span></td></tr>{% endfor %}
<tr><td>all</td><td class="number">{{ "%.3f" | format(all) }}</td><td></td><td></td></tr></table>
<p class="note">Of which {{ "%.3f" | format(found.clock) }} µs for reading the clock.</p></div>{% endfor %}
</main></body></html>"""


def main() -> None:
    """Measure and write the page; with ``--curve`` or ``--stages``, print JSON."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--output", type=Path, default=Path("runs/costs"))
    parser.add_argument("--quick", action="store_true", help="a few sizes, to test the command")
    parser.add_argument("--curve", choices=CURVES, help=argparse.SUPPRESS)
    parser.add_argument("--stages", action="append", default=[], help=argparse.SUPPRESS)  # arguments of shares()
    arguments = parser.parse_args()
    for scene in arguments.stages:
        print(json.dumps(shares(**json.loads(scene))), flush=True)
    if arguments.curve:
        for point in CURVES[arguments.curve](arguments.quick):
            print(json.dumps(point), flush=True)
    if arguments.curve or arguments.stages:
        return
    quick = ["--quick"] if arguments.quick else []
    curves = {
        curve: {threads: in_a_process(threads, "--curve", curve, *quick) for threads in (1, 2)} for curve in CURVES
    }
    scenes = SCENES[:1] if arguments.quick else SCENES
    found = in_a_process(1, *(f"--stages={json.dumps(scene)}" for scene in scenes))
    style = re.search(
        r"<style>(.*?)</style>", Path(figures.__file__).with_name("page.html.j2").read_text("utf-8"), re.DOTALL
    )
    shared = list(zip(scenes, found, strict=True))
    page = jinja2.Environment(autoescape=True).from_string(PAGE).render(
        style=markupsafe.Markup(style[1] if style else ""), axes=AXES, shares=shared,
        images={curve: drawn(curve, each) for curve, each in curves.items()},
        machine=f"{platform.machine()}, {len(os.sched_getaffinity(0))} processors, Python {platform.python_version()}",
    )  # fmt: skip
    arguments.output.mkdir(parents=True, exist_ok=True)
    figures_as_json = json.dumps({"curves": curves, "shares": shared}, indent=1)
    files.write_together({arguments.output / "costs.html": page, arguments.output / "costs.json": figures_as_json})
    print(arguments.output / "costs.html")


if __name__ == "__main__":
    main()
