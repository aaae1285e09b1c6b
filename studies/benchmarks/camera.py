"""Accuracy and speed of the camera: ``python -m studies.benchmarks.camera``.

Centroids of discs as in the thesis's fig. 5.8, calibration, errors of the shipped blocks with default noise, blur, light and
distortion, tracking of blocks whose paths cross, and time per sample.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from studies import common
from studies.kept import show
from studies.thesis.centroid_error import centre_errors, chain_errors
from vibgym import Part, Surface
from vibgym.physics.core.records import new_state
from vibgym.plugins.camera import CameraSensor, Setup
from vibgym.plugins.camera.fitting import fit_errors
from vibgym.scene.parts import shipped_part

SPACING = 0.0368
"""m, smallest distance between parts by the spacing rule."""

Settings = CameraSensor.Settings
LINES = {"half": "half of the lines", "all": "all lines"}
EDGES = {"grey": "grey-level edges", "threshold": "whole pixels"}

Row = list[str]
"""What, measured, target."""


def joined(values: Iterable[float], digits: int) -> str:
    """Format values with ``digits`` decimals."""
    return ", ".join(f"{value:.{digits}f}" for value in values)


def quantisation(discs: int = 10_000) -> list[Row]:
    """Return standard deviations of centroids (fig. 5.8)."""
    sizes, what = (2, 10, 40), "centroid of a disc of 2, 10, 40 px: standard deviation"
    methods: dict[str, tuple[Callable[[int], np.ndarray], str]] = {
        "whole pixels (thesis, fig. 5.8)": (lambda size: chain_errors(size, discs), "0.17, 0.08, 0.035 px"),
        "pixels whose centres it covers": (lambda size: centre_errors(size, discs), ""),
        "grey-level edges": (lambda size: chain_errors(size, discs, True), ""),
    }
    return [
        [f"{what}, {name}", f"{joined((errors(size).std() for size in sizes), 4)} px", target]
        for name, (errors, target) in methods.items()
    ]


def calibration() -> list[Row]:
    """Return the residuals of the calibration on the surface."""
    rows = []
    for lines, name in LINES.items():
        setup = Setup(Surface(), [shipped_part("steel_block")], Settings(lines=lines, distortion=0.01), 0.04)
        points = np.random.default_rng(1).uniform([0, 0], [setup.surface.width, setup.surface.depth], (20_000, 2))
        residual = setup.residual(points)
        rms = math.sqrt((residual**2).mean())
        what = f"residual of the calibration at 1 % distortion, {name}: largest, rms"
        rows.append([what, f"{joined((residual.max(), rms), 3)} px", "0.1 px"])
    return rows


def accuracy() -> list[Row]:
    """Return the errors of the shipped blocks: constant while a block is at rest, and new at each sample."""
    blocks = [shipped_part("aluminium_block"), shipped_part("steel_block")]
    rows = []
    for lines in LINES:
        for edge in EDGES:
            errors = fit_errors(Setup(Surface(), blocks, Settings(lines=lines, edge=edge), 0.04))
            total = np.sqrt(errors.fixed**2 + errors.white**2)
            for k, block in enumerate(blocks):
                heading, fixed, white = np.degrees([error[k, 2] for error in (total, errors.fixed, errors.white)])
                name = block.name.replace("_", " ")
                rows.append([
                    f"{name}, {LINES[lines]}, {EDGES[edge]}: position, heading (of which fixed, new at each sample)",
                    f"{1e3 * np.sqrt((total[k, :2] ** 2).mean()):.3f} mm, {heading:.3f} deg ({joined((fixed, white), 3)})",
                    "0.1 deg" if (block.name, lines, edge) == ("aluminium_block", "all", "grey") else "",
                ])  # fmt: skip
    return rows


def wandering(frames: int, parts: list[Part], seed: int) -> np.ndarray:
    """Return poses (frames, parts, 3) of parts that rotate, cross each other's paths and obey the spacing rule.

    Every part moves straight at up to 0.3 m/s and 3 rad/s. Where the next step would violate the distance to another part or to
    the border, it stops and takes another direction: an upper bound on real changes of velocity.
    """
    random, surface, step = np.random.default_rng(seed), Surface(), 0.04
    radius = np.array([part.radius for part in parts])
    apart = radius[:, None] + radius + SPACING
    low, high = np.array([0.04, 0.04]), np.array([surface.width, surface.depth]) - 0.04
    pose = np.zeros((len(parts), 3))
    for p in range(len(parts)):
        while True:
            pose[p, :2] = random.uniform(low, high)
            if (np.hypot(*(pose[:p, :2] - pose[p, :2]).T) > apart[p, :p]).all():
                break
    velocity = np.zeros((len(parts), 3))
    result = np.empty((frames, len(parts), 3))
    for frame in range(frames):
        result[frame] = pose
        for p in range(len(parts)):
            then = pose[p] + step * velocity[p]
            away = np.hypot(*(pose[:, :2] - then[:2]).T) - apart[p]
            away[p] = np.inf
            if (away > 0).all() and (then[:2] > low).all() and (then[:2] < high).all() and velocity[p].any():
                pose[p] = then
            else:
                angle, speed = random.uniform(-math.pi, math.pi), random.uniform(0.05, 0.3)
                velocity[p] = speed * math.cos(angle), speed * math.sin(angle), random.uniform(-3.0, 3.0)
    return result


def state_of(pose: np.ndarray, before: np.ndarray | None):
    """Return the state of a world with these poses, and mean velocities since the previous period."""
    state = new_state(1, len(pose))
    state.pose[0] = pose
    state.fallen[:] = False
    if before is not None:
        state.mean_velocity[0] = (pose - before) / 0.04
    return state


def identities(lines: str, edge: str, frames: int = 1000) -> list[Row]:
    """Return errors of tracking for blocks whose paths cross."""
    parts = [shipped_part("aluminium_block")] * 3 + [shipped_part("steel_block")] * 3
    poses = wandering(frames, parts, 7)
    sensor = CameraSensor(Surface(), parts, 1, 1, Settings(lines=lines, edge=edge))
    sensor.reset(np.array([0]), state_of(poses[0], None), np.array([[0.1, 0.2]]))
    total, crossings, worst = np.zeros(3, dtype=int), 0, 0.0
    for before, now in zip(poses[:-1], poses[1:], strict=True):
        sensor.sample(state_of(now, before))
        total += sensor.track.count[0]
        order, then = (np.sign(side[:, None, 0] - side[:, 0]) for side in (before, now))
        crossings += int((order != then).sum()) // 2
        error = sensor.due.pose[0] - now
        worst = max(worst, float(np.abs(error[sensor.due.seen[0]][:, :2]).max()))
    swaps, merges, losses = total
    what = f"six blocks for {frames} frames, of which two pass along the table {crossings} times, {LINES[lines]}, {EDGES[edge]}"
    return [
        [f"{what}: swaps, merges, losses", f"{swaps}, {merges}, {losses}", "0 swaps"],
        ["the same: largest error of a coordinate", f"{1e3 * worst:.2f} mm", ""],
    ]


def sample_time(sensor: CameraSensor, state: Any, samples: int) -> float:
    """Return the median time of a sample on one core, s."""
    took = []
    for _ in range(samples):
        began = time.thread_time()
        sensor.sample(state)
        took.append(time.thread_time() - began)
    return float(np.median(took))


def speed() -> list[Row]:
    """Return the time of a sample of eleven parts on one core, images included."""
    parts = (
        [shipped_part("aluminium_block")] * 4 + [shipped_part("steel_block")] * 4 + [Part.disc(0.020, friction=0.5)] * 3
    )
    x = np.linspace(0.06, 0.77, 6)
    pose = np.array([[x[p % 6] + 0.02 * (p // 6), 0.055 + 0.1 * (p // 6), 0.3 * p] for p in range(11)])
    rows = []
    for lines in LINES:
        for edge in EDGES:
            sensor = CameraSensor(Surface(), parts, 1, 1, Settings(lines=lines, edge=edge))
            state = state_of(pose, None)
            sensor.reset(np.array([0]), state, np.array([[0.1, 0.2]]))
            assert sensor.due.seen.all()
            what = f"eleven parts, image included, one core: a sample, {LINES[lines]}, {EDGES[edge]}"
            rows.append([what, f"{1e3 * sample_time(sensor, state, 200):.2f} ms", "4 ms"])
    return rows


def statistical(worlds: int = 4096) -> list[Row]:
    """Return the time of a sample of the statistical sensor."""
    block = shipped_part("aluminium_block")
    sensor = CameraSensor(Surface(), [block], worlds, 1, Settings(statistical=True))
    state = new_state(worlds, 1)
    random = np.random.default_rng(1)
    state.pose[:] = random.uniform([0.05, 0.05, -3.0], [0.75, 0.15, 3.0], (worlds, 1, 3))
    state.fallen[:] = False
    sensor.reset(np.arange(worlds), state, random.random((worlds, 2)))
    took = 1e6 * sample_time(sensor, state, 100) / worlds
    return [[f'`"statistical": True`, {worlds} worlds, one core: a world and part', f"{took:.2f} us", "0.5 us"]]


def main() -> None:
    """Measure everything."""
    keep = common.parser(__doc__).parse_args().keep
    tracked = [*identities("half", "grey"), *identities("all", "threshold")]
    rows = [*quantisation(), *calibration(), *accuracy(), *tracked, *speed(), *statistical()]
    show("camera", ("camera", "measured", "target"), rows, keep)


if __name__ == "__main__":
    main()
