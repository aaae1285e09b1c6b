"""Error and time of the planar model: ``python -m studies.benchmarks.accuracy``.

Steady velocities relative to an independent integration; random fields, with independent amplitudes in [0, g/w^2] and phases
of elements, relative to a converged run; that run relative to a finer one and to point sampling; time over error.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from studies import common
from studies.accuracy import point_sampling
from studies.kept import show
from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

STEADY = {0.3: (0.30485, 4.96), 0.6: (0.30438, 9.93), 0.9: (0.30359, 14.94)}
"""Steady speed (m/s) and direction (deg) by friction: full amplitude, phase 270 deg, from an independent integration."""

CONVERGED: dict[str, Any] = {"steps": 128, "substeps": 2, "pieces": 6}
FINER: dict[str, Any] = {"steps": 256, "substeps": 2, "pieces": 10}
WORLDS = 64
PERIODS = 25  # one second
MARGIN = 0.100  # m, distance of the initial centre from the border, where the surface is large enough


def parts() -> dict[str, Part]:
    """Return the compared parts by name."""
    side, arm = 0.060, 0.030
    corners = [[0, 0], [side, 0], [side, arm], [arm, arm], [arm, side], [0, side]]
    return {
        "aluminium block": shipped_part("aluminium_block"),
        "steel block": shipped_part("steel_block"),
        "20 mm disc": Part.disc(0.010, friction=0.6),
        "60x60 mm L-shape": Part.polygon(corners, friction=0.6),
        "100x20 mm bar": Part.rectangle(0.100, 0.020, friction=0.6),
    }


def random_scene(surface: Surface, seed: int, spin: float) -> tuple[np.ndarray, ...]:
    """Return pose and velocity (worlds, 1, 3), amplitude and phase (worlds, rows, columns)."""
    rng = np.random.default_rng(seed)
    pose = np.empty((WORLDS, 1, 3))
    for axis, extent in enumerate((surface.width, surface.depth)):
        margin = min(MARGIN, 0.5 * extent)
        pose[:, 0, axis] = rng.uniform(margin, extent - margin, WORLDS)
    pose[:, 0, 2] = rng.uniform(-math.pi, math.pi, WORLDS)
    velocity = np.zeros((WORLDS, 1, 3))
    velocity[:, 0, 2] = spin
    shape = (WORLDS, surface.rows, surface.columns)
    return pose, velocity, rng.uniform(0.0, surface.lift_off_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)


def run(surface: Surface, part: Part, scene: tuple[np.ndarray, ...], periods: int, **scheme: Any) -> Simulator:
    """Run a scene; return the simulator."""
    pose, velocity, amplitude, phase = scene
    simulator = Simulator(surface, part, worlds=len(pose), **scheme)
    simulator.reset(pose, velocity)
    simulator.advance(amplitude, phase, periods)
    return simulator


def errors(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position (mm) and heading (deg) errors of poses (n, 3)."""
    return 1e3 * np.hypot(*(one - other)[:, :2].T), np.degrees(np.abs(one - other)[:, 2])


def compare(one: Simulator, other: Simulator) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the errors of the worlds in which neither part fell, and the number of other worlds."""
    fell = (one.fallen | other.fallen)[:, 0]
    return *errors(one.pose[~fell, 0], other.pose[~fell, 0]), int(fell.sum())


def spread(values: np.ndarray) -> list[str]:
    """Format median, 95th percentile and maximum."""
    return [f"{value:.2g}" for value in (np.median(values), np.percentile(values, 95), values.max())]


SPREADS = ("position: median", "95 %", "largest (mm)", "heading: median", "95 %", "largest (deg)")


def steady_velocities(keep: bool) -> None:
    """Compare steady velocities: full amplitude, phase 270 deg, default settings."""
    surface = Surface(rows=60, columns=200)  # long enough to settle: 5.2 m
    lines = []
    for friction, (speed, direction) in STEADY.items():
        simulator = Simulator(surface, Part.rectangle(0.050, 0.035, friction=friction))
        simulator.reset([0.3, 0.3, 0.4])
        simulator.advance(surface.max_amplitude, 1.5 * math.pi, 250)
        x, y, _ = simulator.mean_velocity[0, 0]
        v, angle = math.hypot(x, y), math.degrees(math.atan2(y, x))
        speeds = [f"{speed:.5f} m/s", f"{100 * (v / speed - 1):+.4f} %", "0.1 %"]
        lines.append([str(friction), *speeds, f"{direction:.2f} deg", f"{angle - direction:+.4f} deg", "0.1 deg"])
    heads = ("friction", "steady speed", "error", "target", "direction", "error", "target")
    show("accuracy-steady", heads, lines, keep)


def random_fields(surface: Surface, keep: bool) -> None:
    """Compare the default settings with the converged run."""
    lines = []
    for name, part in parts().items():
        for spin in (0.0, 5.0):
            scene = random_scene(surface, 1, spin)
            reference = run(surface, part, scene, PERIODS, **CONVERGED)
            position, heading, fell = compare(run(surface, part, scene, PERIODS), reference)
            counts = [str(fell), str(int(reference.sticking.sum()))]
            lines.append([name, f"{spin:g}", *spread(position), *spread(heading), *counts])
    heads = ("part", "spin at the start (rad/s)", *SPREADS, "fallen", "sticking at the end")
    show("accuracy-fields", heads, lines, keep)


def reference_error(surface: Surface, keep: bool) -> None:
    """Compare the converged run with a finer run and with point sampling."""
    part = shipped_part("aluminium_block")
    lines = []
    for spin in (0.0, 5.0):
        scene = random_scene(surface, 1, spin)
        finer, converged = (run(surface, part, scene, PERIODS, **scheme) for scheme in (FINER, CONVERGED))
        position, heading, fell = compare(converged, finer)
        label = f"{FINER['steps']} cuts, {FINER['pieces'] ** 2} cells an element, {PERIODS} periods"
        lines.append([label, f"{spin:g}", *spread(position), *spread(heading), str(WORLDS - fell)])
    few, periods, points, steps = 4, 10, 200, 128
    label = f"{points} x {points} points, {steps} Runge-Kutta steps, {periods} periods"
    for spin in (0.0, 5.0):
        pose, velocity, amplitude, phase = scene = tuple(values[:few] for values in random_scene(surface, 1, spin))
        sampled, _ = point_sampling.simulate(
            surface, part, pose[:, 0], velocity[:, 0], amplitude, phase, periods, points=points, steps=steps
        )
        converged = run(surface, part, scene, periods, **CONVERGED)
        position, heading = errors(converged.pose[:, 0], sampled)
        lines.append([label, f"{spin:g}", *spread(position), *spread(heading), str(few)])
    heads = ("converged run against", "spin at the start (rad/s)", *SPREADS, "worlds")
    show("accuracy-reference", heads, lines, keep)


def speed_against_error(surface: Surface, keep: bool) -> None:
    """Measure time and error for several settings: aluminium block, initial spin 0, one thread."""
    part = shipped_part("aluminium_block")
    scene = random_scene(surface, 1, 0.0)
    reference = run(surface, part, scene, PERIODS, **CONVERGED)
    lines = []
    for steps, substeps in ((4, 3), (5, 4), (9, 2), (12, 3), (24, 2)):
        scheme = {"steps": steps, "substeps": substeps, "threads": 1}
        position, heading, _ = compare(run(surface, part, scene, PERIODS, **scheme), reference)
        best = math.inf
        for _ in range(5):
            simulator = Simulator(surface, part, worlds=WORLDS, **scheme)
            simulator.reset(scene[0], scene[1])
            start = time.perf_counter()
            simulator.advance(scene[2], scene[3], PERIODS)
            best = min(best, time.perf_counter() - start)
        numbers = [np.median(position), np.percentile(position, 95), np.median(heading)]
        texts = [f"{number:.4f} {unit}" for number, unit in zip(numbers, ("mm", "mm", "deg"), strict=True)]
        lines.append([f"{steps} x {substeps}", *texts, f"{1e6 * best / WORLDS / PERIODS:.2f} us"])
    heads = ("cuts x Runge-Kutta steps", "position: median", "95 %", "heading: median", "per period and core")
    show("accuracy-speed", heads, lines, keep)


def main() -> None:
    """Measure everything."""
    keep = common.parser(__doc__).parse_args().keep
    surface = Surface()
    steady_velocities(keep)
    random_fields(surface, keep)
    reference_error(surface, keep)
    speed_against_error(surface, keep)


if __name__ == "__main__":
    main()
