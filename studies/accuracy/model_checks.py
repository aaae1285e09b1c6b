"""Sections of the report on the models alone: convergence orders, the bound on speed, and the promise of model='auto'."""

from __future__ import annotations

import math
import statistics
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from studies.accuracy import errors
from studies.accuracy.candidates import prepare_model, prepare_simulator
from studies.accuracy.ladder import lever, timed
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


@dataclass(frozen=True)
class Order:
    """Of one scene.

    Attributes:
        scene: in words.
        steps: Runge-Kutta steps per period.
        errors: median strong error at each, m.
        order: slope of the logarithms, fitted by least squares.
        wanted: the least order that the model is held to, or None.
    """

    scene: str
    steps: tuple[int, ...]
    errors: tuple[float, ...]
    order: float
    wanted: float | None

    @property
    def passed(self) -> bool:
        """Whether it is what it is held to."""
        return self.wanted is None or self.order >= self.wanted


def fitted_order(steps: tuple[int, ...], found: tuple[float, ...]) -> float:
    """Minus the slope of log error over log steps; NaN where an error is zero or not finite."""
    if not all(0.0 < each < math.inf for each in found):
        return math.nan
    return -float(np.polyfit(np.log(steps), np.log(found), 1)[0])


def measured_order(scene: Scene, steps: tuple[int, ...], substeps: int, wanted: float | None) -> Order:
    """Halving steps, against steps eight times finer than the finest."""
    finest = prepare_model(scene, "planar", {"steps": 8 * steps[-1], "substeps": substeps}, threads=2)().pose
    found = []
    for count in steps:
        pose = prepare_model(scene, "planar", {"steps": count, "substeps": substeps}, threads=2)().pose
        found.append(errors.spread(errors.strong_errors(pose, finest, lever(scene))).median)
    total = tuple(substeps * each for each in steps)
    return Order(scene.name, total, tuple(found), fitted_order(total, tuple(found)), wanted)


def measured_orders() -> list[Order]:
    """Of all three scenes."""

    return [
        measured_order(scene_from(SMOOTH, "smooth"), (32, 45, 64, 90, 128), 1, 3.8),
        measured_order(scene_from(EDGES, "edges"), (8, 11, 16, 23, 32, 45, 64), 4, None),
        measured_order(scene_from(STICKING, "sticking"), (16, 23, 32, 45, 64, 90, 128), 2, 1.8),
    ]


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
    """``count`` wrenches a lane, each at a slip that depends on the one before, so that none can be left out."""
    ux, uy, spin = load(slip, 0), load(slip, LANES), load(turn, 0)
    for k in range(count):
        ax, ay, aw, square, varies = expanded_wrench(moments, -drive_c[k & 63], drive_s[k & 63], ux, uy, spin)
        ux, uy, spin = ux + 1e-9 * ax, uy + 1e-9 * ay, spin + 1e-9 * (aw + square + varies)
    store(slip, 0, ux)
    store(slip, LANES, uy)
    store(turn, 0, spin)


def friction_bound(steps: int) -> Bound:
    """Measure it, for so many Runge-Kutta steps in a period (substeps counted)."""
    rng = np.random.default_rng(0)
    moments = rng.normal(size=MOMENT_ROWS * LANES) * 1e-3
    moments[:LANES] = 9.81
    slip, turn = rng.uniform(0.2, 0.4, 2 * LANES), rng.uniform(-1.0, 1.0, LANES)
    angle = np.arange(64) * (2.0 * math.pi / 64)
    given = (moments, slip, turn, np.cos(angle), np.sin(angle))
    evaluate(*given, 1)
    times = []
    for _ in range(BOUND_ROUNDS):
        began = time.perf_counter()
        evaluate(*given, EVALUATIONS)
        times.append((time.perf_counter() - began) / (EVALUATIONS * LANES))
    each = 1e9 * statistics.median(times)
    return Bound(each, steps, 1e-3 * each * STAGES * steps)


AUTO_ROUNDS = 3


@dataclass(frozen=True)
class AutoRow:
    """A scene and a tolerance.

    Attributes:
        tolerance: m, asked for.
        refused: what the simulator says where it has nothing good enough, or "".
        model, setting, reason: its choice.
        promised, measured: m, median over worlds of how far the part's outline strays in 25 periods.
        promised_95, measured_95: the same for the 95th percentile, which is reported without a promise.
        cost, planar_cost: us per period, world and core, of the choice and of the planar model as it comes.
        held: whether the measured median is within the tolerance.
    """

    scene: str
    tolerance: float
    refused: str = ""
    model: str = ""
    setting: str = ""
    reason: str = ""
    promised: float | None = None
    measured: float | None = None
    promised_95: float | None = None
    measured_95: float | None = None
    cost: float | None = None
    planar_cost: float | None = None
    held: bool | None = None


def auto_rows(scene: Scene, tolerances: list[float], settings: TruthSettings) -> list[AutoRow]:
    """One row for each tolerance, over the scene's first 25 periods, which is what the promise is about."""
    short = first_periods(scene, PERIODS, scene.worlds)
    per_call = min(each.periods for each in short.segments)
    truth = prepare_model(short, "planar", settings.model_dump(include={"steps", "substeps", "pieces"}), threads=2)()
    planar = prepare_model(short, "planar", {})
    planar()
    found = []
    for tolerance in tolerances:
        try:
            simulator = Simulator(
                scene.surface, scene.part, worlds=scene.worlds, threads=1, model="auto", tolerance=tolerance,
                periods_per_call=per_call,
            )  # fmt: skip
        except ValueError as error:
            found.append(AutoRow(scene.name, tolerance, refused=" ".join(str(error).split())))
            continue
        choice = simulator.choice
        runner = prepare_simulator(short, simulator)
        outcome = runner()
        strayed = errors.strong_errors(outcome.pose, truth.pose, scene.part.radius)
        strayed[outcome.fallen != truth.fallen] = np.inf
        found_error = errors.spread(strayed)
        times = [(timed(runner), timed(planar)) for _ in range(AUTO_ROUNDS)]
        cost, planar_cost = (
            1e6 * statistics.median(each) / (scene.worlds * short.periods) for each in zip(*times, strict=True)
        )
        found.append(
            AutoRow(
                scene=scene.name,
                tolerance=tolerance,
                model=choice.model,
                setting=", ".join(f"{name}={value}" for name, value in choice.knobs.items()),
                reason=choice.reason,
                promised=choice.error,
                measured=found_error.median,
                promised_95=choice.error_95,
                measured_95=found_error.p95,
                cost=cost,
                planar_cost=planar_cost,
                held=found_error.median <= tolerance,
            )
        )
    return found
