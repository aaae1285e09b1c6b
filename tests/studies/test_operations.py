"""Counts of the kernel's operations, and times of the stages of a step."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from studies.benchmarks import costs, operations

RUN = """
import json
from studies.benchmarks import operations

found, pose = operations.count()
print(json.dumps([found, pose.tolist()]))
"""


def test_the_counted_kernel_moves_parts_as_the_compiled_one():
    environment = {**os.environ, **operations.SETTINGS}
    done = subprocess.run([sys.executable, "-c", RUN], env=environment, text=True, capture_output=True, check=True)
    totals, pose = json.loads(done.stdout)
    simulator, amplitude, phase = operations.scene()
    for _ in range(operations.PERIODS):
        simulator.advance(amplitude, phase, 1)
    # Without fused operations; the few parts that change between sticking and sliding differ more.
    assert np.median(np.abs(simulator.pose - pose)) < 1e-12
    # Five steps of four Runge-Kutta steps with four stages, each with one root.
    assert totals["sqrt"] == pytest.approx(80.0)
    assert totals["flops"] == sum(totals[kind] for kind in operations.FLOATING)
    assert 16 * (totals["load"] + totals["store"]) / 2 >= totals["cache_bytes"] > 4 * (totals["load"] + totals["store"])
    # A block of 50 x 40 mm lies on two or more rows of elements; a cache line holds eight elements of a row.
    assert 2 * 2 * operations.LINE < totals["memory_bytes"] < 2 * 8 * 256


def test_times_of_stages_add_up_to_the_step():
    shares = costs.shares("vibgym/Align-v0", 2, 1, action="field")
    assert {"decode", "advance", "score", "write_observations", "rest"} <= shares["stages"].keys()
    assert min(shares["stages"].values()) > 0.0 and shares["stages"]["advance"] > shares["stages"]["allocate"]
