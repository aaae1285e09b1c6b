"""Shared by the benchmarks: argument parser, hardware, and interleaved timing."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from studies.kept import argument

HARDWARE: dict[str, dict[str, Any]] = {
    "ideal": {},
    "prototype": {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}},
}
"""Arguments of environments, by the name of the hardware."""


def parser(doc: str | None, keep: bool = True) -> argparse.ArgumentParser:
    """Return a parser whose help is a module's docstring; with ``keep``, it has the option ``--keep`` for tables."""
    made = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if keep:
        argument(made)
    return made


def interleaved(
    calls: Mapping[str, Callable[[], object]],
    rounds: int,
    warm: int = 1,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, np.ndarray]:
    """Return the times (rounds,) s of each call, measured in turn (A B C A B C ...): drift of the host cancels in ratios.

    Args:
        calls: to measure, by name.
        rounds: that count.
        warm: rounds before them that do not count.
        clock: returns s.
    """
    took: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(warm + rounds):
        for name, call in calls.items():
            began = clock()
            call()
            took[name].append(clock() - began)
    return {name: np.array(each[warm:]) for name, each in took.items()}
