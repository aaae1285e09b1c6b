"""What a step costs, on one page: ``python -m studies.benchmarks.costs`` writes ``runs/costs/costs.html``.

Cost against worlds, parts and elements under a part, with one thread and with two, and the share of every stage of some
environments (:mod:`studies.benchmarks.stages`). Every measurement is the quietest of some, in processes of their own for each
number of threads. ``--quick``: fewer sizes, to see that it works.
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

PITCH = 0.09
"""m between parts: none meets another, but all may."""

SCENES: list[dict[str, Any]] = [
    {"name": "vibgym/Rotate-v0", "worlds": 1024, "steps": 4, "action": "element"},
    {"name": "vibgym/Align-v0", "worlds": 1024, "steps": 4, "action": "field"},
    {"name": "vibgym/SortCrowded-v0", "worlds": 64, "steps": 4, "action": "element"},
    {"name": "vibgym/SortCrowded-v0", "worlds": 64, "steps": 4, "action": "field"},
]

AXES = {
    "worlds": ("worlds in a batch", "us a world and step, Rotate-v0, element"),
    "parts": (f"blocks {1e3 * PITCH:.0f} mm apart in one world, with walls", "us a part and period"),
    "elements": ("elements under a square part", "us a world and period, 64 worlds"),
}


def quietest(work: Callable[[], Any], units: float, seconds: float = 1.0) -> float:
    """us a unit: least of what fits into the time, at least three."""
    work()
    found: list[float] = []
    began = time.perf_counter()
    while len(found) < 3 or time.perf_counter() - began < seconds:
        start = time.perf_counter()
        work()
        found.append(time.perf_counter() - start)
    return 1e6 * min(found) / units


def worlds(quick: bool) -> Iterator[tuple[float, float]]:
    """Sizes, and what a world's step costs."""
    for size in (1, 64, 1024) if quick else [2**k for k in range(15)]:
        env: Any = gym.make_vec("vibgym/Rotate-v0", num_envs=size, action="element")
        env.action_space.seed(0)
        actions, steps = [env.action_space.sample() for _ in range(8)], max(1, 256 // size)
        env.reset(seed=0)
        yield size, quietest(lambda: [env.step(actions[k % 8]) for k in range(steps)], size * steps)  # noqa: B023


def parts(quick: bool) -> Iterator[tuple[float, float]]:
    """Parts of one world, and what a part's period costs."""
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
        yield count, quietest(lambda: simulator.advance(amplitude, phase, 5), 5 * count)  # noqa: B023


def elements(quick: bool) -> Iterator[tuple[float, float]]:
    """Elements under a part, and what its period costs."""
    surface, rng, batch = Surface(rows=40, columns=60), np.random.default_rng(0), 64
    shape = (batch, surface.rows, surface.columns)
    amplitude, phase = rng.uniform(0.0, surface.lift_off_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)
    middle = [surface.width / 2, surface.depth / 2]
    cell = surface.width * surface.depth / (surface.rows * surface.columns)
    for under in (2, 16) if quick else (0.5, 1, 2, 4, 8, 16, 32, 64, 128, 256):
        edge = math.sqrt(under * cell)
        simulator = Simulator(surface, Part.rectangle(edge, edge, friction=0.6), worlds=batch)
        simulator.reset([[[*middle, 0.1 * k]] for k in range(batch)])
        yield under, quietest(lambda: simulator.advance(amplitude, phase, 5), 5 * batch)  # noqa: B023


CURVES: dict[str, Callable[[bool], Iterator[tuple[float, float]]]] = {
    "worlds": worlds, "parts": parts, "elements": elements,
}  # fmt: skip


def in_a_process(threads: int, *command: str) -> list[Any]:
    """Run a module in a process of its own and return the JSON values that it prints, one per line."""
    environment = {**os.environ, "VIBGYM_THREADS": str(threads)}
    done = subprocess.run(
        [sys.executable, "-m", *command], env=environment, text=True, stdout=subprocess.PIPE, check=True
    )
    return [json.loads(line) for line in done.stdout.splitlines()]


def drawn(curve: str, found: dict[int, list[Any]]) -> str:
    """A curve for each number of threads, as the page takes it."""
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
<html lang="en"><head><meta charset="utf-8"><title>vibgym: what a step costs</title><style>{{ style }}
.bar { display: inline-block; height: .8em; background: var(--accent); border-radius: 2px; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
</style></head><body><header><h1>What a step costs</h1><p class="soft">{{ machine }}. Least of some runs; µs.</p></header><main>
{% for name, image in images.items() %}<h2>{{ axes[name][0] | capitalize }}</h2>
<div class="card"><img alt="{{ axes[name][1] }}" src="data:image/png;base64,{{ image }}"></div>{% endfor %}
{% for scene, found in shares %}<h2>{{ scene.name }}, {{ scene.action }}, {{ scene.worlds }} worlds, one thread</h2>
<div class="card"><table>{% set all = found.stages.values() | sum %}
<tr><th>stage</th><th>µs a world and step</th><th>share</th><th></th></tr>
{% for stage, spent in found.stages.items() if spent > 0 %}<tr><td>{{ stage }}</td>
<td class="number">{{ "%.3f" | format(spent) }}</td>
<td class="number">{{ "%.1f" | format(100 * spent / all) }} %</td>
<td><span class="bar" style="width: {{ (300 * spent / all) | round }}px"></span></td></tr>{% endfor %}
<tr><td>all</td><td class="number">{{ "%.3f" | format(all) }}</td><td></td><td></td></tr></table>
<p class="note">Reading the clock is {{ "%.3f" | format(found.clock) }} µs of it.</p></div>{% endfor %}
</main></body></html>"""


def main() -> None:
    """Measure and write the page; or, with ``--curve``, print one curve's points."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--output", type=Path, default=Path("runs/costs"))
    parser.add_argument("--quick", action="store_true", help="fewer sizes")
    parser.add_argument("--curve", choices=CURVES, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.curve:
        for point in CURVES[arguments.curve](arguments.quick):
            print(json.dumps(point), flush=True)
        return
    quick = ["--quick"] if arguments.quick else []
    curves = {
        curve: {threads: in_a_process(threads, __spec__.name, "--curve", curve, *quick) for threads in (1, 2)}
        for curve in CURVES
    }
    scenes = SCENES[:1] if arguments.quick else SCENES
    found = in_a_process(1, "studies.benchmarks.stages", *(f"--json={json.dumps(scene)}" for scene in scenes))
    style = re.search(
        r"<style>(.*?)</style>", Path(figures.__file__).with_name("page.html.j2").read_text("utf-8"), re.DOTALL
    )
    shares = list(zip(scenes, found, strict=True))
    page = jinja2.Environment(autoescape=True).from_string(PAGE).render(
        style=markupsafe.Markup(style[1] if style else ""), axes=AXES, shares=shares,
        images={curve: drawn(curve, each) for curve, each in curves.items()},
        machine=f"{platform.machine()}, {len(os.sched_getaffinity(0))} processors, Python {platform.python_version()}",
    )  # fmt: skip
    arguments.output.mkdir(parents=True, exist_ok=True)
    figures_as_json = json.dumps({"curves": curves, "shares": shares}, indent=1)
    files.write_together({arguments.output / "costs.html": page, arguments.output / "costs.json": figures_as_json})
    print(arguments.output / "costs.html")


if __name__ == "__main__":
    main()
