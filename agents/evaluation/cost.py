"""What one period costs against the number of parts: simulation and control apart, one world on one thread.

The question of section 7.3.1 of the thesis (table 7.1), asked of this simulator and of our controllers.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

import vibgym  # noqa: F401 - registers the environments
from agents.workers import on_one_thread
from vibgym.config import part_from
from vibgym.physics.core.drive import element_drive
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.scene import Part, Surface
from vibgym.simulation import Simulator
from vibgym.tasks.lattice import lattice

COUNTS = (1, 2, 4, 8, 16, 32, 64)
BLOCKS = ("steel_block", "aluminium_block")
GAP = 1e-4
"""Between parts in touch, m."""

FITTED = (8, 64)
"""Parts between which the exponent is fitted: with fewer the fixed cost of a call counts."""

WARM_UP, PERIODS = 2, 5
"""Periods of a run before the clock starts, and while it runs."""

REPETITIONS = 15
POLICIES = ("local_field", "planner")


@dataclass(frozen=True)
class Curve:
    """Cost against the number of parts."""

    what: str  # "simulation", or the policy whose predict() was timed
    rows: int  # elements of the surface
    columns: int
    touching: bool  # whether parts lie in one heap, 0.1 mm apart; else they keep sqrt(2) element sizes
    parts: tuple[int, ...]
    seconds: tuple[float, ...]  # of one period, median over repetitions

    @property
    def exponent(self) -> float | None:
        """Of parts in the cost, least squares of the logarithms over :data:`FITTED`; None with fewer than three points."""
        points = [(n, s) for n, s in zip(self.parts, self.seconds, strict=True) if FITTED[0] <= n <= FITTED[1]]
        if len(points) < 3:
            return None
        n, seconds = np.log(points).T
        return float(np.polyfit(n, seconds, 1)[0])


@dataclass(frozen=True)
class Cost:
    """All curves."""

    period: float  # s, that one period lasts in the world
    repetitions: int
    curves: tuple[Curve, ...]

    def as_values(self) -> dict[str, Any]:
        """For JSON."""
        curves = [{**vars(curve), "exponent": curve.exponent} for curve in self.curves]
        return {"period_s": self.period, "repetitions": self.repetitions, "curves": curves}


def block_kinds(count: int, rows: int) -> list[int]:
    """Kind of each of ``count`` blocks that fill columns of ``rows``: columns of steel and of aluminium in turn."""
    return [k // rows % 2 for k in range(count)]


def heap_rows(surface: Surface, count: int) -> int:
    """Blocks in a column of a heap of ``count``: about a square, one block's width clear of the border."""
    height = max(float(np.ptp(part_from(name).outline[:, 1])) for name in BLOCKS)
    fit = math.floor((surface.depth - 2.0 * height) / (height + GAP))
    return max(1, min(math.ceil(math.sqrt(count)), fit))


def heaped(surface: Surface, parts: Sequence[Part], rows: int) -> np.ndarray:
    """Poses (parts, 3) of a heap in columns of ``rows`` blocks in the middle of the surface, 0.1 mm apart."""
    pose, left = np.zeros((len(parts), 3)), 0.0
    for first in range(0, len(parts), rows):
        column = parts[first : first + rows]
        width, height = np.ptp(column[0].outline, axis=0)
        pose[first : first + rows, 0] = left + 0.5 * width
        pose[first : first + rows, 1] = (height + GAP) * (np.arange(len(column)) - 0.5 * (len(column) - 1))
        left += width + GAP
    pose[:, 0] += 0.5 * (surface.width - left + GAP)
    pose[:, 1] += 0.5 * surface.depth
    return pose


def apart(surface: Surface, parts: Sequence[Part]) -> np.ndarray | None:
    """Poses (parts, 3), random headings, spread over a lattice with sqrt(2) element sizes between; None if it has no room."""
    gap, radius = math.sqrt(2.0) * surface.element_size, max(part.radius for part in parts)
    cells = lattice(np.zeros(2), np.array([surface.width, surface.depth]), radius, gap)
    if len(cells) < len(parts):
        return None
    chosen = cells[(np.arange(len(parts)) * len(cells)) // len(parts)]
    return np.column_stack([chosen, np.random.default_rng(len(parts)).uniform(-math.pi, math.pi, len(parts))])


def idle(surface: Surface, parts: Sequence[Part]) -> np.ndarray:
    """Velocities (parts, 3) with which parts slide in place."""
    return np.array([np.append(surface.idle_velocity(part.friction), 0.0) for part in parts])


class Simulating:
    """Times periods of the simulation under random fields, a new one every period."""

    def __init__(self, surface: Surface, parts: Sequence[Part], pose: np.ndarray) -> None:
        self.simulator = Simulator(surface, list(parts), threads=1)
        self.pose = pose
        self.velocity = idle(surface, parts)
        random = np.random.default_rng(0).uniform(-1.0, 1.0, (WARM_UP + PERIODS, 1, surface.rows * surface.columns * 2))
        self.drives = [element_drive(each, surface.columns, surface.full_scale) for each in random.astype(np.float32)]

    def seconds(self) -> float:
        """Of one period, mean over a run."""
        self.simulator.reset(self.pose, self.velocity)
        for drive in self.drives[:WARM_UP]:
            self.simulator.run(drive)
        began = time.perf_counter()
        for drive in self.drives[WARM_UP:]:
            self.simulator.run(drive)
        return (time.perf_counter() - began) / PERIODS


class Controlling:
    """Times a policy's predict() in closed loop, sorting the parts into the two halves of the surface."""

    def __init__(self, surface: Surface, parts: Sequence[Part], pose: np.ndarray, policy: str) -> None:
        half = 0.5 * surface.width
        zones = {BLOCKS[0]: (0.0, 0.0, half, surface.depth), BLOCKS[1]: (half, 0.0, surface.width, surface.depth)}
        names = [part.name for part in parts]
        settings: dict[str, Any] = {
            "num_envs": 1,
            "surface": surface,
            "parts": names,
            "zones": {name: zones[name] for name in dict.fromkeys(names)},
        }
        self.policy = make_policy(policy, TaskInfo.of(gym.make_vec("vibgym/Sort-v0", **settings)))
        spoken: dict[str, Any] = {"action": self.policy.action, "observation": self.policy.observation}
        self.env = gym.make_vec("vibgym/Sort-v0", **settings, **spoken)
        self.pose = pose

    def seconds(self) -> float:
        """Of one call, mean over a run."""
        total, state = 0.0, None
        observation, _ = self.env.reset(seed=0, options={"pose": self.pose})
        for period in range(WARM_UP + PERIODS):
            began = time.perf_counter()
            action, state = self.policy.predict(observation, state, np.array([period == 0]))
            if period >= WARM_UP:
                total += time.perf_counter() - began
            observation = self.env.step(action)[0]
        return total / PERIODS


def measure(
    quiet: bool = False,
    counts: Sequence[int] = COUNTS,
    surfaces: Sequence[Surface] | None = None,
    policies: Sequence[str] = POLICIES,
    repetitions: int = REPETITIONS,
) -> Cost:
    """Time simulation and control; every repetition does all of it once, so that a slow moment hits no curve alone.

    Args:
        quiet: no progress bar.
        counts: of parts, ascending.
        surfaces: tables; by default one of 32 x 64 elements, on which 64 parts have room, and the prototype. Counts for which
            one has no room are left out.
        policies: names.
        repetitions: of which the median counts.
    """
    surfaces = (Surface(rows=32, columns=64), Surface()) if surfaces is None else surfaces
    benches: dict[tuple[str, int, bool], dict[int, Any]] = {}
    for index, surface in enumerate(surfaces):
        for count in counts:
            rows = heap_rows(surface, count)
            parts = [part_from(BLOCKS[kind]) for kind in block_kinds(count, rows)]
            poses = {False: apart(surface, parts), True: heaped(surface, parts, rows)}
            if poses[False] is None:
                break
            for touching, pose in poses.items():
                if count > 1 or not touching:
                    assert pose is not None
                    benches.setdefault(("simulation", index, touching), {})[count] = Simulating(surface, parts, pose)
            for policy in policies:
                benches.setdefault((policy, index, False), {})[count] = Controlling(
                    surface, parts, poses[False], policy
                )
    times: dict[tuple[tuple[str, int, bool], int], list[float]] = {
        (key, count): [] for key, bench in benches.items() for count in bench
    }
    for repetition in tqdm(range(repetitions + 1), desc="cost of one period", unit="round", disable=quiet):
        for (key, count), found in times.items():
            seconds = benches[key][count].seconds()
            if repetition > 0:  # the first one may compile kernels
                found.append(seconds)
    curves = [
        Curve(
            what,
            surfaces[index].rows,
            surfaces[index].columns,
            touching,
            tuple(bench),
            tuple(float(np.median(times[(what, index, touching), count])) for count in bench),
        )
        for (what, index, touching), bench in benches.items()
    ]
    return Cost(surfaces[0].period, repetitions, tuple(curves))


def measure_alone(quiet: bool = False, counts: Sequence[int] = COUNTS, repetitions: int = REPETITIONS) -> Cost:
    """:func:`measure` in a process of its own, in which no library has more than one thread."""
    return on_one_thread(measure, quiet, tuple(counts), None, POLICIES, repetitions)
