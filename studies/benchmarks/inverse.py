"""Commanded against achieved mean acceleration: ``python -m studies.benchmarks.inverse [--worlds 400]``.

Poses, mean velocities up to the top speed, spins and wrenches over all that can be reached are drawn, commanded by
:class:`vibgym.allocation.Inverse`, and played for a period by the planar model at 64 cuts, from the state of one instant that
belongs to the mean one. Achieved is the change of mean velocity over the period's length. Errors are given over mu g, twice the
largest acceleration from rest, and over the size of what was wanted where that is at least a tenth of mu g: below, a direction
means little. Angular accelerations count times the radius of gyration.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from studies.kept import argument, show
from vibgym import Part, Simulator, Surface
from vibgym.allocation import Inverse, Periods, mean_acceleration, phasors_for

SURFACE = Surface()
TOP_SPEED, TOP_SPIN = 0.30, 6.0  # m/s, rad/s
FRICTIONS = (0.3, 0.6, 0.9)
FINE = {"steps": 64, "substeps": 2, "pieces": 4}
LEAST = 0.1  # of mu g, of what counts for size and direction
METHODS = {
    "at the start": {"over": "instant"},
    "mean over the period": {"over": "period"},
    "one correction": {"over": "period", "corrections": 1},
    "two corrections": {"over": "period", "corrections": 2},
}


def parts(friction: float) -> dict[str, Part]:
    """The thesis's blocks and a disc that often lies on one element."""
    return {
        "aluminium": Part.rectangle(0.050, 0.035, friction=friction),
        "steel": Part.rectangle(0.050, 0.040, friction=friction),
        "disc": Part.disc(0.010, friction=friction),
    }


class Cases(NamedTuple):
    """What is asked for, (worlds, 3) each."""

    pose: np.ndarray
    velocity: np.ndarray
    wrench: np.ndarray


def cases(part: Part, worlds: int, seed: int, speed: float = TOP_SPEED, spin: float = TOP_SPIN) -> Cases:
    """Random states, and wrenches between what elements at rest do and the most that can be had in a random direction."""
    rng = np.random.default_rng(seed)
    pose = rng.uniform([0.1, 0.06, -np.pi], [SURFACE.width - 0.1, SURFACE.depth - 0.06, np.pi], (worlds, 3))
    size, angle = speed * np.sqrt(rng.random(worlds)), rng.uniform(-np.pi, np.pi, worlds)
    velocity = np.stack([size * np.cos(angle), size * np.sin(angle), rng.uniform(-spin, spin, worlds)], axis=1)
    direction = rng.normal(size=(worlds, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    most = phasors_for(SURFACE, part, pose, velocity, 300.0 * direction / lever(part)).achieved
    idle = mean_acceleration(SURFACE, part, pose, velocity, 0.0, 0.0)
    return Cases(pose, velocity, idle + rng.random((worlds, 1)) * (most - idle))


def lever(part: Part) -> np.ndarray:
    """What makes accelerations of one kind of a wrench."""
    return np.array([1.0, 1.0, np.sqrt(part.gyration)])


class Errors(NamedTuple):
    """Of the cases that were reached."""

    absolute: np.ndarray  # over mu g
    size: np.ndarray  # over what was wanted, where that is large enough
    direction: np.ndarray  # deg, likewise
    several: np.ndarray  # (all that were reached,) bool: on several elements
    large: np.ndarray  # likewise: large enough

    def on(self, several: bool) -> Errors:
        """Those on one element, or on several."""
        few = self.several[self.large] == several
        rows = self.several == several
        return Errors(self.absolute[rows], self.size[few], self.direction[few], self.several[rows], self.large[rows])


def errors(part: Part, asked: Cases, **settings: object) -> Errors:
    """What comes of the cases."""
    found = Inverse(SURFACE, part, **settings).phasors(*asked)  # type: ignore[arg-type]
    motion = found.amplitude, found.phase
    got = Periods(SURFACE, part, 1, **FINE).mean_acceleration(asked.pose, asked.velocity, *motion)
    good = found.reachable & ~np.isnan(got).any(axis=1)
    wanted, got = (asked.wrench * lever(part))[good], (got * lever(part))[good]
    size, achieved = np.linalg.norm(wanted, axis=1), np.linalg.norm(got, axis=1)
    scale = part.friction * SURFACE.gravity
    large = size >= LEAST * scale
    cosine = (wanted * got).sum(axis=1)[large] / (size * achieved)[large]
    return Errors(
        np.linalg.norm(got - wanted, axis=1) / scale,
        np.abs(achieved / size - 1.0)[large],
        np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))),
        ((found.amplitude > 0.0).sum(axis=(1, 2)) > 1)[good],
        large,
    )


def together(all_errors: list[Errors]) -> Errors:
    """Of several parts."""
    return Errors(*(np.concatenate(each) for each in zip(*all_errors)))


def line(name: str, found: Errors) -> list[str]:
    """Median, 95 % and worst of each."""
    columns = [100.0 * found.absolute, 100.0 * found.size, found.direction]
    numbers = [
        ", ".join(f"{np.percentile(each, q):.2f}" for q in (50, 95, 100)) if len(each) else "–" for each in columns
    ]
    return [name, str(len(found.absolute)), *numbers]


HEADS = ("cases", "error over mu g: median, 95 %, worst (%)", "size (%)", "direction (deg)")


def accuracy(worlds: int, keep: bool) -> None:
    """Print errors by method and friction, and what they are made of."""
    lines = []
    for method, settings in METHODS.items():
        for friction in FRICTIONS:
            found = [errors(part, cases(part, worlds, 1), **settings) for part in parts(friction).values()]
            lines.append(line(f"{method}, {friction}", together(found)))
    show("inverse", ("method, friction", *HEADS), lines, keep)
    one = METHODS["one correction"]
    lines = [line(name, errors(part, cases(part, worlds, 2), **one)) for name, part in parts(0.6).items()]
    disc = errors(parts(0.6)["disc"], cases(parts(0.6)["disc"], 2 * worlds, 3, spin=0.0), **one)
    lines += [line("disc on one element", disc.on(False)), line("disc on several", disc.on(True))]
    show("inverse-parts", ("friction 0.6, one correction", *HEADS), lines, keep)
    lines = []
    for friction, speed, spin in ((0.15, 0.0, 0.0), (0.3, 0.0, 0.0), (0.6, 0.0, 0.0), (0.6, 0.3, 0.0), (0.6, 0.3, 6.0)):
        part = Part.rectangle(0.050, 0.035, friction=friction)
        found = errors(part, cases(part, worlds, 4, speed, spin), over="period")
        lines.append(line(f"friction {friction}, up to {speed} m/s and {spin} rad/s", found))
    show("inverse-speeds", ("aluminium, mean over the period", *HEADS), lines, keep)


def cost() -> None:
    """Print what a call takes beside a period of the planar model, best of calls that take turns."""
    part = parts(0.58)["aluminium"]
    for worlds in (1, 256):
        asked = cases(part, worlds, 5)
        simulator = Simulator(SURFACE, part, worlds=worlds)
        simulator.reset(asked.pose[:, None], asked.velocity[:, None])
        still = np.zeros((worlds, SURFACE.rows, SURFACE.columns))
        calls: dict[str, Callable[[], object]] = {"a simulated period": lambda: simulator.advance(still, still)}  # noqa: B023
        for name, settings in METHODS.items():
            inverse = Inverse(SURFACE, part, **settings)  # type: ignore[arg-type]
            calls[name] = lambda inverse=inverse: inverse.phasors(*asked)  # noqa: B023
        best = dict.fromkeys(calls, np.inf)
        for _ in range(30):
            for name, call in calls.items():
                began = time.perf_counter()
                call()
                best[name] = min(best[name], time.perf_counter() - began)
        print(f"\n{worlds} worlds: " + ", ".join(f"{name} {1e3 * took:.2f} ms" for name, took in best.items()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=400, help="cases for each part and friction")
    argument(parser)
    asked = parser.parse_args()
    accuracy(asked.worlds, asked.keep)
    cost()
