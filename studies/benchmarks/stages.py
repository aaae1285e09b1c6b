"""Where the time of a step goes: every stage reads the clock when it begins and when it ends, in place.

Kernels and methods are replaced by ones that do so around the same work, in a process of its own whose kernels are compiled
for that (``VIBGYM_CACHE=0``, ``VIBGYM_THREADS=1``). A stage within another one is taken off it, so the shares add up. What a
reading costs is measured and told. Stages are found by name: what has another name by now counts as part of what it is in,
and is told too.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from vibgym.kernels.foreign import call_foreign, foreign
from vibgym.kernels.jit import borrowing, jit
from vibgym.kernels.reference import Layout, Pinned

METHODS = {
    "check": ("core.action.shaped",),
    "decode": ("core.action.command",),
    "actuators": ("core.actuators.apply",),
    "simulation, around its kernels": ("core.simulator.run", "core.simulator.go_on"),
    "score": ("core.scoring.score",),
    "observe": ("core.observe",),
    "info": ("core.information.read",),
    "resets": ("_begin", "_begin_anew"),
}
"""Of a vector environment; where there are several, one of them is there."""

PLANAR, COLLISION = "vibgym.physics.planar", "vibgym.physics.contacts"

KERNELS = {
    "friction": (
        f"{PLANAR}.series.slide_by_series",
        f"{PLANAR}.stepper.slide_group",
        f"{PLANAR}.points.slide_by_points",
    ),
    "cut": (f"{PLANAR}.outline.cut_outline", f"{PLANAR}.group_cut.cut_outlines"),
    "moments": (f"{PLANAR}.pressure_moments.pressure_moments", f"{PLANAR}.pressure_moments.collect_pieces"),
}
"""That other kernels call."""

ROOTS = {
    "contacts": (f"{COLLISION}.multibody.resolve", f"{COLLISION}.multibody.broad_phase"),
    "simulation, between these": (f"{PLANAR}.friction.slide_rows",),
    "score": ("vibgym.tasks.episode.score_worlds", "vibgym.tasks.episode.relate_worlds"),
    "observe": ("vibgym.envs.writing.write_rows",),
    "info": ("vibgym.envs.info.report_worlds",),
}
"""That Python calls: handed records as they are, which kernels hand on by reference."""

ROUNDS = 60

STAGES = ("rest", *dict.fromkeys((*METHODS, *KERNELS, *ROOTS)))


class Clock(NamedTuple):
    """What every reading adds to; times in ns."""

    now: np.ndarray  # (2,) s, ns: what the system's clock writes
    current: np.ndarray  # (2,) the stage that runs, and since when
    spent: np.ndarray  # (stages,)
    readings: np.ndarray  # (1,)


CLOCK: Layout[Clock] = Layout("CLOCK", __name__)
_clock_at = CLOCK.at
_pinned = Pinned(CLOCK, Clock(*(np.zeros(n, dtype=np.int64) for n in (2, 2, len(STAGES), 1))))
_address, _now = _pinned.address, _pinned.record.now.ctypes.data
_function = ctypes.cast(ctypes.CDLL(None).clock_gettime, ctypes.c_void_p).value or 0
_read = foreign(_function, "int64", "int64")
_MONOTONIC = time.CLOCK_MONOTONIC


@borrowing
def turn_to(stage):
    """The time until now goes to the stage that ran, that from now on to this one; returns the one that ran."""
    clock = _clock_at(_address)
    call_foreign(_read, (_MONOTONIC, _now))
    now = clock.now[0] * 1_000_000_000 + clock.now[1]
    before = clock.current[0]
    clock.spent[before] += now - clock.current[1]
    clock.current[0], clock.current[1] = stage, now
    clock.readings[0] += 1
    return before


def timed(kernel: Any, stage: int) -> Any:
    """A kernel that does what this one does, and reads the clock before and after."""

    def within(*arguments):
        before = turn_to(stage)
        result = kernel(*arguments)
        turn_to(before)
        return result

    return (jit if kernel.targetoptions.get("_nrt", True) else borrowing)(within)


def timed_method(method: Callable[..., Any], stage: int) -> Callable[..., Any]:
    """The same for what Python calls; of a generator, what it does between its results."""

    def within(*arguments: Any, **named: Any) -> Any:
        before = turn_to(stage)
        try:
            result = method(*arguments, **named)
        finally:
            turn_to(before)
        return steps(result) if isinstance(result, Iterator) else result

    def steps(results: Iterator[Any]) -> Iterator[Any]:
        while True:
            before = turn_to(stage)
            try:
                each = next(results)
            except StopIteration:
                return
            finally:
                turn_to(before)
            yield each

    return within


def instrument_kernels() -> list[str]:
    """Put the clock round the kernels, wherever they were imported; returns the stages of which none is found."""
    found_of = dict.fromkeys((*KERNELS, *ROOTS), False)
    for replace, stage, names in [
        *((timed, *each) for each in KERNELS.items()), *((timed_method, *each) for each in ROOTS.items())
    ]:  # fmt: skip
        for name in names:
            place, _, own = name.rpartition(".")
            try:
                kernel = getattr(importlib.import_module(place), own)
            except (ImportError, AttributeError):
                continue
            found_of[stage] = True
            replacement = replace(kernel, STAGES.index(stage))
            for module in [each for key, each in sys.modules.items() if key.startswith("vibgym.")]:
                for found in [key for key, value in vars(module).items() if value is kernel]:
                    setattr(module, found, replacement)
    return [stage for stage, found in found_of.items() if not found and stage not in METHODS]


def instrument(env: Any) -> list[str]:
    """Put the clock round an environment's methods; returns the stages of which none is found."""
    missing = []
    for stage, paths in METHODS.items():
        found = False
        for path in paths:
            *owners, name = path.split(".")
            owner = env
            for each in owners:
                owner = getattr(owner, each, None)
            if hasattr(owner, name):
                setattr(owner, name, timed_method(getattr(owner, name), STAGES.index(stage)))
                found = True
        if not found:
            missing.append(stage)
    return missing


def shares(name: str, worlds: int, steps: int, **settings: Any) -> dict[str, Any]:
    """us a world and step of every stage of an environment, after a warm-up; and what reading the clock adds to a step."""
    env: Any = gym.make_vec(name, num_envs=worlds, **settings)
    missing = instrument(env)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(8)]
    env.reset(seed=0)
    for k in range(20):
        env.step(actions[k % 8])
    clock, best = _pinned.record, None
    for _ in range(ROUNDS):  # the quietest: another process only ever adds
        turn_to(0)
        clock.spent[:], clock.readings[:] = 0, 0
        for k in range(steps):
            env.step(actions[k % 8])
        turn_to(0)
        if best is None or clock.spent.sum() < best[0].sum():
            best = clock.spent.copy(), int(clock.readings[0])
    assert best is not None
    spent, readings = 1e-3 * best[0] / (worlds * steps), best[1] / (worlds * steps)
    return {"stages": dict(zip(STAGES, spent.tolist())), "clock": 1e6 * _one_reading() * readings, "missing": missing}


@borrowing
def _many(times):
    for _ in range(times):
        turn_to(0)


def _one_reading() -> float:
    """s."""
    _many(1)
    began = time.perf_counter()
    _many(100_000)
    return (time.perf_counter() - began) / 100_000


def main() -> None:
    """Reads what to measure, as JSON, from the command line, and prints what :func:`shares` finds."""
    importlib.import_module("vibgym.envs")
    missing = instrument_kernels()
    for line in sys.argv[1:]:
        print(
            json.dumps({**(found := shares(**json.loads(line))), "missing": [*found["missing"], *missing]}), flush=True
        )


if __name__ == "__main__":
    from studies.benchmarks import stages  # its records are found under this name

    stages.main()
