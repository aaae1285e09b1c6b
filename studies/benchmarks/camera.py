"""What the camera reaches: ``python -m studies.benchmarks.camera``."""

from __future__ import annotations

import math
import time

import numpy as np

from studies.thesis.quantisation import centre_errors, chain_errors
from vibgym import Part, Surface
from vibgym.physics.core.records import new_state
from vibgym.scene.parts import shipped_part
from vibgym.sensing.camera import CameraSensor, Settings, Setup
from vibgym.sensing.camera.fitting import fit_errors

SPACING = 0.0368
"""m, the least distance between parts that the spacing rule allows."""


def quantisation() -> None:
    """Fig. 5.8."""
    for diameter, target in ((2, 0.17), (10, 0.08), (40, 0.035)):
        whole, centres, grey = (
            chain_errors(diameter, 10_000),
            centre_errors(diameter, 10_000),
            chain_errors(diameter, 10_000, True),
        )
        print(
            f"disc of {diameter:2} px: centroid std {whole.std():.4f} px thresholded (by pixel centres {centres.std():.4f}; "
            f"target {target}), {grey.std():.4f} px by grey levels"
        )


def accuracy() -> None:
    """Of the shipped blocks, with default noise, blur, light and distortion."""
    blocks = [shipped_part("aluminium_block"), shipped_part("steel_block")]
    for lines in ("all", "half"):
        for edge in ("grey", "threshold"):
            setup = Setup(Surface(), blocks, Settings(lines=lines, edge=edge), 0.04)
            errors = fit_errors(setup)
            total = np.sqrt(errors.fixed**2 + errors.white**2)
            for k, block in enumerate(blocks):
                print(
                    f"{block.name}, {lines} lines, {edge} edges: position {1e3 * np.sqrt((total[k, :2] ** 2).mean()):.3f} mm, "
                    f"heading {math.degrees(total[k, 2]):.3f} deg (fixed {math.degrees(errors.fixed[k, 2]):.3f}, "
                    f"new at each look {math.degrees(errors.white[k, 2]):.3f})"
                )


def calibration() -> None:
    """How far the calibrated way is off on the surface."""
    for lines in ("all", "half"):
        setup = Setup(Surface(), [shipped_part("steel_block")], Settings(lines=lines, distortion=0.01), 0.04)
        points = np.random.default_rng(1).uniform([0, 0], [setup.surface.width, setup.surface.depth], (20_000, 2))
        residual = setup.residual(points)
        print(
            f"calibration, 1 % distortion, {lines} lines: residual {math.sqrt((residual**2).mean()):.4f} px rms, "
            f"{residual.max():.4f} px at most (target 0.1)"
        )


def wandering(frames: int, parts: list[Part], seed: int) -> np.ndarray:
    """(frames, parts, 3) poses of parts that cross each other's ways, turn, and keep the spacing rule.

    Every part goes straight on at up to 0.3 m/s and 3 rad/s; where the next step would bring it too near to another one or to
    the border, it stops dead and takes another direction: no part on the surface can be more sudden.
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
    """The state of one world with these poses, and mean velocities since the period before."""
    state = new_state(1, len(pose))
    state.pose[0] = pose
    state.fallen[:] = False
    if before is not None:
        state.mean_velocity[0] = (pose - before) / 0.04
    return state


def identities(lines: str, edge: str, frames: int = 1000) -> None:
    """Parts that cross each other's ways."""
    parts = [shipped_part("aluminium_block")] * 3 + [shipped_part("steel_block")] * 3
    poses = wandering(frames, parts, 7)
    sensor = CameraSensor(Surface(), parts, 1, 1, lines=lines, edge=edge)
    sensor.reset(np.array([0]), state_of(poses[0], None), np.array([[0.1, 0.2]]))
    total, crossings, worst = np.zeros(3, dtype=int), 0, 0.0
    for before, now in zip(poses[:-1], poses[1:], strict=True):
        sensor.look(state_of(now, before))
        total += sensor.track.count[0]
        order, then = (np.sign(each[:, None, 0] - each[:, 0]) for each in (before, now))
        crossings += int((order != then).sum()) // 2
        error = sensor.due.pose[0] - now
        worst = max(worst, float(np.abs(error[sensor.due.seen[0]][:, :2]).max()))
    swaps, merges, losses = total
    print(
        f"six blocks wandering for {frames} frames, {lines} lines, {edge} edges: {crossings} times two pass along the table, "
        f"{swaps} swaps, {merges} merges, {losses} losses, largest error {1e3 * worst:.2f} mm"
    )


def speed() -> None:
    """Eleven parts, found, measured and tracked on one core, images included."""
    parts = (
        [shipped_part("aluminium_block")] * 4 + [shipped_part("steel_block")] * 4 + [Part.disc(0.020, friction=0.5)] * 3
    )
    x = np.linspace(0.06, 0.77, 6)
    pose = np.array([[x[p % 6] + 0.02 * (p // 6), 0.055 + 0.1 * (p // 6), 0.3 * p] for p in range(11)])
    for lines in ("half", "all"):
        for edge in ("grey", "threshold"):
            sensor = CameraSensor(Surface(), parts, 1, 1, lines=lines, edge=edge)
            state = state_of(pose, None)
            sensor.reset(np.array([0]), state, np.array([[0.1, 0.2]]))
            assert sensor.due.seen.all()
            took = []
            for _ in range(200):
                began = time.thread_time()
                sensor.look(state)
                took.append(time.thread_time() - began)
            print(f"eleven parts, {lines} lines, {edge} edges: {1e3 * float(np.median(took)):.2f} ms a look (target 4)")


def statistical() -> None:
    """Cost of the statistical sensor."""
    worlds, block = 4096, shipped_part("aluminium_block")
    sensor = CameraSensor(Surface(), [block], worlds, 1, statistical=True)
    state = new_state(worlds, 1)
    random = np.random.default_rng(1)
    state.pose[:] = random.uniform([0.05, 0.05, -3.0], [0.75, 0.15, 3.0], (worlds, 1, 3))
    state.fallen[:] = False
    sensor.reset(np.arange(worlds), state, random.random((worlds, 2)))
    took = []
    for _ in range(100):
        began = time.thread_time()
        sensor.look(state)
        took.append(time.thread_time() - began)
    print(f"statistical sensor: {1e6 * float(np.median(took)) / worlds:.3f} us a world and part (target 0.5)")


if __name__ == "__main__":
    quantisation()
    calibration()
    accuracy()
    identities("half", "grey")
    identities("all", "threshold")
    speed()
    statistical()
