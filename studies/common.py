"""Argument parser, hardware models, cells, stored results and timing shared by the benchmarks."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from agents.evaluation.statistics import Interval, quartiles
from agents.evaluation.table import quantity
from studies.kept import argument
from vibgym.files import write_atomically

HARDWARE: dict[str, dict[str, Any]] = {
    "ideal": {},
    "prototype": {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}},
}
"""Arguments of environments by hardware model."""

LEVEL, RESAMPLES = 0.95, 9999
"""Of all intervals."""


def parser(doc: str | None, keep: bool = True) -> argparse.ArgumentParser:
    """Return a parser whose help is a module's docstring; with ``keep``, it has the option ``--keep`` for tables."""
    made = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if keep:
        argument(made)
    return made


def policy(text: str) -> Any:
    """Parse a policy of the command line: JSON, or a name or path."""
    return json.loads(text) if text.lstrip().startswith(("{", '"')) else text


def outcome(
    success: np.ndarray, time: np.ndarray, digits: int = 1, interval: Interval | None = None, note: str = ""
) -> str:
    """Format a success rate, its interval with a note, and the median of finite times (s)."""
    text = quantity(float(success.mean()), 100.0, digits, "%")
    if interval is not None:
        text += f" ({100 * interval.low:.{digits}f} to {100 * interval.high:.{digits}f}{note})"
    return f"{text}, {quantity(quartiles(time).median, 1.0, 2, 's')}"


def stored(path: Path, compute: Callable[[], Any]) -> Any:
    """Return JSON values from a file, which is computed and written if it is missing."""
    if not path.exists():
        write_atomically(path, json.dumps(compute()))
    return json.loads(path.read_text(encoding="utf-8"))


def interleaved(
    calls: Mapping[str, Callable[[], object]], rounds: int, warm: int, clock: Callable[[], float] = time.perf_counter
) -> dict[str, np.ndarray]:
    """Return times (rounds,) s of calls by name, measured in turn (A B C A B C ...), so that drift cancels in ratios.

    Args:
        calls: by name.
        rounds: number of measurements of each call.
        warm: rounds before them.
        clock: returns s; ``time.thread_time`` excludes other processes, and other threads of this one.
    """
    took: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(warm + rounds):
        for name, call in calls.items():
            began = clock()
            call()
            took[name].append(clock() - began)
    return {name: np.array(times[warm:]) for name, times in took.items()}


def step_costs(
    envs: Mapping[str, Any], steps: int, rounds: int, warm: int, clock: Callable[[], float] = time.perf_counter
) -> dict[str, str]:
    """Return the time of a step under random actions by name: as a multiple of the first one, and us per world.

    Args:
        envs: vector environments by name; they are reset.
        steps: of a measurement; actions repeat after 16.
        rounds, warm, clock: of :func:`interleaved`.
    """

    def run(env: gym.vector.VectorEnv, actions: list[Any]) -> None:
        for k in range(steps):
            env.step(actions[k % len(actions)])

    calls = {}
    for name, env in envs.items():
        env.reset(seed=0)
        env.action_space.seed(0)
        calls[name] = partial(run, env, [env.action_space.sample() for _ in range(16)])
    took = interleaved(calls, rounds, warm, clock)
    first = next(iter(took.values()))
    us = {name: 1e6 * float(np.median(times)) / steps / envs[name].num_envs for name, times in took.items()}
    return {name: f"{np.median(times / first):.2f} x ({us[name]:.2f} us)" for name, times in took.items()}
