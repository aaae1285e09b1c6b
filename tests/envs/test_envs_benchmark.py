"""Gymnasium's benchmark of vector environments (since 1.4) counts the steps of every autoreset mode."""

import itertools

import pytest
from gymnasium.utils import performance

from tests.envs.helpers import batch

pytestmark = pytest.mark.skipif(
    not hasattr(performance, "benchmark_vector_step"), reason="Gymnasium 1.4 brought benchmark_vector_step"
)

WORLDS, LIMIT, STEPS = 3, 5, 21


@pytest.mark.parametrize("task", ["Align", "AlignShapes", "Sort"])
@pytest.mark.parametrize("mode, resets", [("NextStep", 3), ("SameStep", 0), ("Disabled", 0)])
def test_gymnasiums_vector_benchmark(task, mode, resets, monkeypatch):
    """In NextStep mode, each of the three resets in 21 calls takes a call of its own."""
    envs = batch(task, WORLDS, action="velocity", autoreset_mode=mode, max_episode_steps=LIMIT)
    seconds = itertools.count()
    monkeypatch.setattr(performance.time, "time", lambda: float(next(seconds)))  # each call takes a second
    throughput = performance.benchmark_vector_step(envs, target_duration=STEPS - 1, seed=0)
    assert throughput == WORLDS * (STEPS - resets) / STEPS
