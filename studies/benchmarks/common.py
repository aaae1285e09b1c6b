"""Argument parser, hardware models and timing shared by the benchmarks."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from studies.kept import argument

HARDWARE: dict[str, dict[str, Any]] = {
    "ideal": {},
    "prototype": {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}},
}
"""Arguments of environments by hardware model."""


def parser(doc: str | None, keep: bool = True) -> argparse.ArgumentParser:
    """Return a parser whose help is a module's docstring; with ``keep``, it has the option ``--keep`` for tables."""
    made = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if keep:
        argument(made)
    return made


def policy(text: str) -> Any:
    """Parse a policy of the command line: JSON, or a name or path."""
    return json.loads(text) if text.lstrip().startswith(("{", '"')) else text


def interleaved(calls: Mapping[str, Callable[[], object]], rounds: int, warm: int) -> dict[str, np.ndarray]:
    """Return times (rounds,) s of calls by name, measured in turn (A B C A B C ...), so that drift cancels in ratios.

    Args:
        calls: by name.
        rounds: number of measurements of each call.
        warm: rounds before them.
    """
    took: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(warm + rounds):
        for name, call in calls.items():
            began = time.perf_counter()
            call()
            took[name].append(time.perf_counter() - began)
    return {name: np.array(each[warm:]) for name, each in took.items()}
