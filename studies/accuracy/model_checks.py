"""Sections of the report on the models alone: convergence orders and the promise of ``model="auto"``; a bound on speed."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from studies.accuracy import errors
from studies.accuracy.candidates import prepare_model, prepare_simulator
from studies.accuracy.ladder import timed
from studies.accuracy.scenes import Scene, first_periods, scene_from
from studies.accuracy.settings import TruthSettings
from vibgym.kernels.jit import exact
from vibgym.kernels.vector import LANES, load, store
from vibgym.physics.planar.pressure_moments import MOMENT_ROWS
from vibgym.physics.planar.wrench import expanded_wrench
from vibgym.simulation.choice import PERIODS
from vibgym.simulation.simulator import Simulator

SMOOTH = {
    "name": "one element, always sliding",
    "surface": {"rows": 1, "columns": 1, "element_size": 4.0},
    "part": {"shape": "rectangle", "length": 0.050, "width": 0.035, "friction": 0.6},
    "worlds": 16,
    "periods": 10,
    "start": {"spin": [-1.0, 1.0]},
    "drive": {"kind": "uniform"},
}
EDGES = {
    "name": "random field, edges crossed",
    "part": "aluminium_block",
    "worlds": 64,
    "periods": 10,
    "drive": {"kind": "random"},
}
STICKING = {
    "name": "caught and let go within a period",
    "surface": {"horizontal_amplitude": 3e-4, "rows": 1, "columns": 1, "element_size": 4.0},
    "part": {"shape": "rectangle", "length": 0.050, "width": 0.035, "friction": 0.5, "static_friction": 0.58},
    "worlds": 32,
    "periods": 10,
    "drive": {"kind": "uniform", "phase": 0.7},
}
ORDERS: list[tuple[dict[str, Any], tuple[int, ...], int, float | None]] = [
    (SMOOTH, (32, 45, 64, 90, 128), 1, 3.8),
    (EDGES, (8, 11, 16, 23, 32, 45, 64), 4, None),
    (STICKING, (16, 23, 32, 45, 64, 90, 128), 2, 1.8),
]
"""Scene, steps, substeps, and the smallest acceptable order, or None."""


class Order(NamedTuple):
    """Measured order of convergence on one scene."""

    scene: str  # name
    steps: tuple[int, ...]  # Runge-Kutta steps per period
    errors: tuple[float, ...]  # m, median strong error at each
    order: float  # slope of the logarithms, fitted by least squares
    wanted: float | None  # smallest acceptable order

    @property
    def passed(self) -> bool:
        """Whether the order is large enough."""
        return self.wanted is None or self.order >= self.wanted


def fitted_order(steps: tuple[int, ...], medians: tuple[float, ...]) -> float:
    """Return minus the slope of log error over log steps; NaN where an error is zero or not finite."""
    if not all(0.0 < error < math.inf for error in medians):
        return math.nan
    return -float(np.polyfit(np.log(steps), np.log(medians), 1)[0])


def measured_orders() -> list[Order]:
    """Return the orders on all three scenes, against steps eight times finer than the finest."""
    rows = []
    for settings, steps, substeps, wanted in ORDERS:
        scene = scene_from(settings, "scene")
        finest, *poses = (
            prepare_model(scene, "planar", {"steps": count, "substeps": substeps}, threads=2)().pose
            for count in (8 * steps[-1], *steps)
        )
        medians = tuple(errors.spread(errors.strong_errors(pose, finest, scene.lever)).median for pose in poses)
        total = tuple(substeps * step for step in steps)
        rows.append(Order(scene.name, total, medians, fitted_order(total, medians), wanted))
    return rows


STAGES = 4
"""Evaluations in a Runge-Kutta step."""

BOUND_ROUNDS = 9
EVALUATIONS = 4000  # per lane and round


class Bound(NamedTuple):
    """``evaluation``: ns of one friction wrench of one world. ``period``: us of those in a period of ``steps``."""

    evaluation: float
    steps: int
    period: float


@exact
def evaluate(moments, slip, turn, drive_c, drive_s, count):
    """Evaluate ``count`` wrenches per lane, each at a slip that depends on the previous one, so that none is optimised away."""
    ux, uy, spin = load(slip, 0), load(slip, LANES), load(turn, 0)
    for k in range(count):
        ax, ay, aw, square, varies = expanded_wrench(moments, -drive_c[k & 63], drive_s[k & 63], ux, uy, spin)
        ux, uy, spin = ux + 1e-9 * ax, uy + 1e-9 * ay, spin + 1e-9 * (aw + square + varies)
    store(slip, 0, ux)
    store(slip, LANES, uy)
    store(turn, 0, spin)


def friction_bound(steps: int) -> Bound:
    """Measure the friction evaluations alone, for ``steps`` Runge-Kutta steps in a period (substeps included)."""
    rng = np.random.default_rng(0)
    moments = rng.normal(size=MOMENT_ROWS * LANES) * 1e-3
    moments[:LANES] = 9.81
    slip, turn = rng.uniform(0.2, 0.4, 2 * LANES), rng.uniform(-1.0, 1.0, LANES)
    angle = np.arange(64) * (2.0 * math.pi / 64)
    arguments = (moments, slip, turn, np.cos(angle), np.sin(angle))
    evaluate(*arguments, 1)
    times = []
    for _ in range(BOUND_ROUNDS):
        began = time.perf_counter()
        evaluate(*arguments, EVALUATIONS)
        times.append((time.perf_counter() - began) / (EVALUATIONS * LANES))
    duration = 1e9 * statistics.median(times)
    return Bound(duration, steps, 1e-3 * duration * STAGES * steps)


AUTO_ROUNDS = 3


class AutoRow(NamedTuple):
    """The choice of ``model="auto"`` on a scene for a tolerance."""

    scene: str
    tolerance: float  # m
    refused: str = ""  # the simulator's error where no setting is good enough
    model: str = ""
    setting: str = ""
    reason: str = ""
    promised: float | None = None  # m, median over worlds of the displacement of the part's outline in 25 periods
    measured: float | None = None
    promised_95: float | None = None  # the same for the 95th percentile, without a promise
    measured_95: float | None = None
    cost: float | None = None  # us per period, world and core
    planar_cost: float | None = None  # of the planar model with default knobs
    held: bool | None = None  # whether the measured median is within the tolerance


def auto_rows(scene: Scene, tolerances: Sequence[float], settings: TruthSettings) -> list[AutoRow]:
    """Return one row for each tolerance, over the scene's first 25 periods, which the promise covers."""
    short = first_periods(scene, PERIODS, scene.worlds)
    per_call = min(segment.periods for segment in short.segments)
    truth = prepare_model(short, "planar", settings.knobs, threads=2)()
    planar = prepare_model(short, "planar", {})
    planar()
    rows = []
    for tolerance in tolerances:
        try:
            simulator = Simulator(
                scene.surface, scene.part, worlds=scene.worlds, threads=1, model="auto", tolerance=tolerance,
                periods_per_call=per_call,
            )  # fmt: skip
        except ValueError as error:
            rows.append(AutoRow(scene.name, tolerance, refused=" ".join(str(error).split())))
            continue
        choice = simulator.choice
        runner = prepare_simulator(short, simulator)
        outcome = runner()
        deviation = errors.strong_errors(outcome.pose, truth.pose, scene.part.radius)
        deviation[outcome.fallen != truth.fallen] = np.inf
        measured, measured_95, _ = errors.spread(deviation)
        times = [(timed(runner), timed(planar)) for _ in range(AUTO_ROUNDS)]
        costs = [1e6 * statistics.median(took) / (scene.worlds * short.periods) for took in zip(*times, strict=True)]
        setting = ", ".join(f"{name}={value}" for name, value in choice.knobs.items())
        rows.append(
            AutoRow(
                scene.name, tolerance, "", choice.model, setting, choice.reason, choice.error, measured, choice.error_95,
                measured_95, costs[0], costs[1], measured <= tolerance,
            )
        )  # fmt: skip
    return rows
