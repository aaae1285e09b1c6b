"""Rigid parts against the planar model: ``python -m studies.tilting fields``, ``means``, ``hold`` and ``cost``.

- ``fields``: difference between the models on random fields after a second, and of the tilting model from itself with twice
  the steps, other ramps, another restitution; medians over fields.
- ``means``: force and torque on a rigid part relative to even pressure, from the mean velocity after wrenches of several sizes
  in random directions, held for five periods from rest.
- ``hold``: rms of the errors at the goal of Align over the second half of eight seconds.
- ``cost``: process time of a period, us on one core, medians of rounds in turn: rigid parts on level ground and on random
  fields, and parts that lie flat against the planar model.
"""

from __future__ import annotations

import math
import time
from functools import partial
from typing import Any

import numpy as np

from studies import common
from studies.benchmarks import pose_control
from studies.kept import show
from vibgym import Part, Simulator, Surface
from vibgym.envs import VibgymVectorEnv
from vibgym.scene.parts import shipped_part
from vibgym.seeds import RANGES

PARTS = ("aluminium_block", "steel_block")

# -- fields ------------------------------------------------------------------------------------------------------------

SQUARE = Surface(rows=24, columns=24)
AMPLITUDES = (1.0, 0.25, 0.1)
AGAINST: dict[str, dict[str, Any]] = {
    "planar": {"model": "planar"},
    "twice the steps": {"steps": 400},
    "ramps of 1 mm": {"ramp_mm": 1.0},
    "ramps of 10 mm": {"ramp_mm": 10.0},
    "restitution 0.5": {"restitution": 0.5},
}


def ends(part: Part, amplitude: np.ndarray, phase: np.ndarray, seed: int, **settings: Any) -> np.ndarray:
    """Return poses (worlds, 3) after a second."""
    rng, worlds = np.random.default_rng(seed), len(phase)
    pose = np.zeros((worlds, 1, 3))
    pose[..., :2] = 0.5 * SQUARE.width + SQUARE.element_size * rng.uniform(-0.5, 0.5, (worlds, 1, 2))
    pose[..., 2] = rng.uniform(-math.pi, math.pi, (worlds, 1))
    simulator = Simulator(SQUARE, part, worlds=worlds, **{"model": "tilting", **settings})
    simulator.reset(pose, np.append(SQUARE.idle_velocity(part.friction), 0.0))
    simulator.advance(amplitude, phase, 25)
    return simulator.pose[:, 0]


def fields(worlds: int = 48, seed: int = 300_000) -> None:
    """Show the differences."""
    rng, lines = np.random.default_rng(seed), []
    shape = worlds, SQUARE.rows, SQUARE.columns
    share, phase = rng.uniform(0, 1, shape), rng.uniform(-math.pi, math.pi, shape)
    for name in PARTS:
        for amplitude in AMPLITUDES:
            a_v = amplitude * (SQUARE.max_amplitude or 0.0) * share
            ours, cells = ends(shipped_part(name), a_v, phase, seed), []
            for settings in AGAINST.values():
                gap = ours - ends(shipped_part(name), a_v, phase, seed, **settings)
                place, turn = np.median(np.hypot(gap[:, 0], gap[:, 1])), np.median(np.abs(gap[:, 2]))
                cells.append(f"{1e3 * place:.2f} mm, {math.degrees(turn):.2f} deg")
            lines.append([name, f"{amplitude:g}", *cells])
    show("fields", ("part", "amplitude", *AGAINST), lines)


# -- means -------------------------------------------------------------------------------------------------------------

SIZES = (0.1, 0.25, 0.5, 1.0)


def gained(part: str, model: str, size: float, turning: bool, worlds: int) -> np.ndarray:
    """Return the velocity (worlds,) along the wanted force, m/s, or the spin, rad/s."""
    env = VibgymVectorEnv("Align", num_envs=worlds, model=model, parts=[part], action="wrench")
    env.reset(seed=list(range(worlds)))
    way = np.random.default_rng(1).uniform(-math.pi, math.pi, worlds)
    action = np.zeros((worlds, 3), np.float32)
    if turning:
        action[:, 2] = size
    else:
        action[:, 0], action[:, 1] = size * np.cos(way), size * np.sin(way)
    for _ in range(5):
        env.step(action)
    velocity = env.truth.mean_velocity[:, 0]
    return velocity[:, 2] if turning else velocity[:, 0] * np.cos(way) + velocity[:, 1] * np.sin(way)


def means(worlds: int = 96) -> None:
    """Show the shares."""
    lines = []
    for part in PARTS:
        for name, turning, unit in (("force", False, "m/s"), ("torque", True, "rad/s")):
            for size in SIZES:
                flat, rigid = (gained(part, model, size, turning, worlds) for model in ("planar", "tilting"))
                cells = f"{flat.mean():.3f} {unit}", f"{rigid.mean():.3f} +- {rigid.std():.3f}"
                lines.append([part, name, f"{size:.2f}", *cells, f"{rigid.mean() / flat.mean():.2f}"])
    show("means", ("part", "wrench", "size", "planar", "tilting, its deviation", "share delivered"), lines)


# -- hold --------------------------------------------------------------------------------------------------------------

MODELS: dict[str, Any] = {
    "planar": "planar",
    "tilting": "tilting",
    "ramps of 1 mm": {"kind": "tilting", "ramp_mm": 1.0},
    "restitution 0.5": {"kind": "tilting", "restitution": 0.5},
}


def hold(worlds: int = 64) -> None:
    """Show the table."""
    lines, seeds = [], RANGES["held_out"][:worlds]
    for part, policies in {"aluminium_block": ("pose", "learned"), "steel_block": ("pose",)}.items():
        for policy in policies:
            for name, model in MODELS.items():
                held = pose_control.hold(policy, part, seeds, 8.0, 4.0, model=model)
                position, heading = (float(np.sqrt((errors**2).mean())) for errors in (held.distance, held.turn))
                lines.append([part, policy, name, f"{1e3 * position:.3f} mm", f"{math.degrees(heading):.3f} deg"])
    show("hold", ("part", "policy", "model", "position", "heading"), lines)


# -- cost --------------------------------------------------------------------------------------------------------------

WIDE = Surface(rows=16, columns=32)
LARGEST = WIDE.max_amplitude or 0.0
WORLDS, ROUNDS = 64, 9


def scene(part: Part, model: str, seed: int) -> Simulator:
    """Return a simulator with parts at random poses, so that some are over borders of plates."""
    rng = np.random.default_rng(seed)
    simulator = Simulator(WIDE, part, worlds=WORLDS, model=model, threads=1)
    low, high = 0.3 * WIDE.depth, 0.7 * WIDE.depth
    pose = np.concatenate([rng.uniform(low, high, (WORLDS, 1, 2)), rng.uniform(-3.0, 3.0, (WORLDS, 1, 1))], axis=2)
    simulator.reset(pose, np.append(WIDE.idle_velocity(part.friction), 0.0))
    return simulator


def tilted(part: Part, share: float, level: bool) -> float:
    """Return us per period and part, of periods that end with a tilted part; every round begins with 0.03 rad."""
    rng, times = np.random.default_rng(1), []
    shape = WORLDS, 1 if level else WIDE.rows, 1 if level else WIDE.columns
    for seed in range(ROUNDS):
        simulator = scene(part, "tilting", seed)
        amplitude = share * LARGEST * rng.uniform(0.0 if not level else 1.0, 1.0, shape)
        phase = rng.uniform(-3.0, 3.0, shape)
        way = rng.uniform(-3.0, 3.0, (WORLDS, 1))
        simulator.tip(slice(None), 0.03 * np.stack([np.cos(way), np.sin(way)], axis=-1))
        taken = periods = 0.0
        for _ in range(1 if level else 5):
            began = time.process_time()
            simulator.advance(amplitude, phase)
            taken += time.process_time() - began
            periods += float((~simulator.fallen).sum())
        times.append(1e6 * taken / periods)
    return float(np.median(times))


def flat(part: Part, periods: int) -> str:
    """Return us per period of flat parts: planar, tilting, and the median ratio."""
    both = {model: scene(part, model, 0) for model in ("planar", "tilting")}
    start, calls = both["planar"].pose, {}
    for model, simulator in both.items():
        calls[model] = partial(simulator.advance, 0.3 * LARGEST, 0.3, periods)
    took: dict[str, list[np.ndarray]] = {model: [] for model in both}
    for _ in range(2 * ROUNDS):
        for simulator in both.values():
            simulator.reset(start)
        for model, times in common.interleaved(calls, 3, 0, time.process_time).items():
            took[model].append(1e6 * times / WORLDS / periods)
    planar, tilting = (np.concatenate(took[model]) for model in both)
    return f"{np.median(planar):.2f}, {np.median(tilting):.2f}, {np.median(tilting / planar):.3f}"


def cost() -> None:
    """Show the table."""
    lines = []
    for part in (*map(shipped_part, PARTS), Part.disc(0.020, friction=0.5, name="20 mm disc")):
        costs = [tilted(part, 0.25, True), tilted(part, 0.25, False), tilted(part, 1.0, False)]
        lines.append([part.name, *(f"{us:.0f}" for us in costs), *(flat(part, periods) for periods in (1, 5))])
    flats = (f"flat, {text}: planar, tilting, ratio" for text in ("one period a call", "five"))
    heads = ("us per period", "level ground", "random fields, a quarter of the amplitude", "full amplitude", *flats)
    show("cost", heads, lines)
