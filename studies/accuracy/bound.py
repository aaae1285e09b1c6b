"""A bound on the planar model's speed: as many evaluations of its friction wrench, and nothing else."""

from __future__ import annotations

import math
import statistics
import time
from typing import NamedTuple

import numpy as np

from vibgym.kernels.jit import exact
from vibgym.kernels.vector import LANES, load, store
from vibgym.physics.planar.pressure_moments import MOMENT_ROWS
from vibgym.physics.planar.wrench import expanded_wrench

STAGES = 4
"""Evaluations in a Runge-Kutta step."""

ROUNDS = 9
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
    for _ in range(ROUNDS):
        began = time.perf_counter()
        evaluate(*given, EVALUATIONS)
        times.append((time.perf_counter() - began) / (EVALUATIONS * LANES))
    each = 1e9 * statistics.median(times)
    return Bound(each, steps, 1e-3 * each * STAGES * steps)
