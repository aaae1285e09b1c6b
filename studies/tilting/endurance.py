"""Ten thousand random disturbed worlds for a simulated minute: ``python -m studies.tilting endurance``.

Random convex parts, squat and slender, on fields that change every few periods (level, random, of a few plates), struck at
random and thrown down hard, with any restitution and ramps. Told are worlds that diverged, parts out of play, and the extremes
of what the drive
can give at most: speed over the table's, height over what a plate at full speed throws, spin times radius over the table's
    speed.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

from studies.tilting.releases import leans
from vibgym import Part, Simulator, Surface

WORLDS, KINDS, SECONDS = 10_000, 40, 60.0
SURFACE = Surface(rows=16, columns=16)

SETTLED = 25
"""Periods after which what parts were thrown down with is gone."""


class Extremes(NamedTuple):
    """Of one kind of parts."""

    diverged: int
    gone: float  # share of parts, at the end
    speed: float
    spin: float
    height: float  # m
    tilted: float  # share of the periods


def random_part(rng: np.random.Generator) -> Part:
    """A convex part, squat or slender."""
    properties = {"friction": rng.uniform(0.1, 0.9), "height": rng.uniform(0.003, 0.04), "name": "part"}
    kind = rng.integers(3)
    if kind == 0:
        return Part.disc(rng.uniform(0.008, 0.03), **properties)
    if kind == 1:
        return Part.rectangle(*rng.uniform(0.015, 0.06, 2), **properties)
    turn = np.sort(rng.uniform(0, 2 * math.pi / 7, 7) + 2 * math.pi / 7 * np.arange(7))
    return Part.polygon(rng.uniform(0.01, 0.03) * np.column_stack([np.cos(turn), np.sin(turn)]), **properties)


def field(rng: np.random.Generator, worlds: int) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude and phase of the elements: level, random, or of a few plates."""
    shape = worlds, SURFACE.rows, SURFACE.columns
    most = SURFACE.max_amplitude or 0.0
    level = most * rng.uniform(0, 1, (worlds, 1, 1)) * np.ones(shape)
    amplitude = np.where(rng.uniform(size=(worlds, 1, 1)) < 0.4, level, most * rng.uniform(0, 1, shape))
    amplitude *= rng.uniform(size=shape) < rng.choice([0.1, 1.0], size=(worlds, 1, 1))
    phase = rng.uniform(-math.pi, math.pi, shape)
    return amplitude, np.where(rng.uniform(size=(worlds, 1, 1)) < 0.4, phase[:, :1, :1], phase)


def steepest(part: Part) -> float:
    """rad, to which parts are tipped: most of what they stand."""
    return 0.8 * math.atan(1.0 / part.slenderness)


def endure(seed: int, worlds: int, seconds: float) -> Extremes:
    """Run one kind of parts."""
    rng = np.random.default_rng(seed)
    part = random_part(rng)
    simulator = Simulator(
        SURFACE,
        part,
        worlds=worlds,
        model="tilting",
        restitution=float(rng.uniform(0, 1)),
        ramp_mm=float(rng.uniform(0, 13)),
    )
    middle = 0.5 * SURFACE.width
    pose = np.concatenate(
        [rng.uniform(0.5 * middle, 1.5 * middle, (worlds, 1, 2)), rng.uniform(-3, 3, (worlds, 1, 1))], axis=2
    )
    simulator.reset(pose, rng.normal(0, [0.3, 0.3, 5.0], (worlds, 1, 3)))
    speed = spin = height = tilted = 0.0
    periods = round(seconds / SURFACE.period)
    done = 0
    while done < periods:
        amplitude, phase = field(rng, worlds)
        struck = rng.uniform(size=worlds) < 0.2
        simulator.tip(
            slice(None), leans(steepest(part), worlds, rng) * rng.uniform(0, 1, (worlds, 1, 1)), which=struck[:, None]
        )
        span = int(rng.integers(1, 9))
        simulator.advance(amplitude, phase, span)
        done += span
        state = simulator.get_state()
        back = simulator.fallen[:, 0] & ~simulator.diverged  # fell off: put another one there
        if done < SETTLED:
            continue
        speed = max(speed, float(np.hypot(*state["velocity"][:, 0, :2].T).max()) / SURFACE.table_speed)
        spin = max(spin, float(np.abs(state["velocity"][:, 0, 2]).max()) * part.radius / SURFACE.table_speed)
        height = max(height, float((state["height"] - part.centre_height).max()))
        tilted += float((state["mode"] == 1).mean()) * span
        if back.any():
            simulator.place(back, pose[back], 0.0, 0.0)
    return Extremes(int(simulator.diverged.sum()), float(back.mean()), speed, spin, height, tilted / done)


def main(worlds: int = WORLDS, seconds: float = SECONDS) -> None:
    """Print a line for each kind, and the sums."""
    began, found = time.perf_counter(), []
    print(
        "kind: diverged, share fallen in the last call, speed and spin over the table's, height, share above the plane"
    )
    for seed in range(KINDS):
        found.append(endure(seed, worlds // KINDS, seconds))
        each = found[-1]
        print(
            f"{seed:3}: {each.diverged} {each.gone:.3f} {each.speed:.2f} {each.spin:.2f} {1e3 * each.height:.2f} mm "
            f"{each.tilted:.2f} ({time.perf_counter() - began:.0f} s)",
            flush=True,
        )
    diverged, speed, spin, height = (
        sum(each.diverged for each in found), *(max(each[k] for each in found) for k in (2, 3, 4))
    )  # fmt: skip
    print(f"{worlds} worlds, {seconds:g} s each: {diverged} diverged")
    print(f"at most {speed:.2f} and {spin:.2f} of the table's speed, {1e3 * height:.2f} mm up")
