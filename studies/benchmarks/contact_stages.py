"""Where the time of contacts goes: ``python -m studies.benchmarks.contact_stages`` prints microseconds by stage.

Kernels of a stage are wrapped before anything is compiled: the wrapper reads the clock, so that the time of a nested stage is
subtracted from the enclosing one. All kernels are compiled for it, in about half a minute. Linux.
"""

from __future__ import annotations

import ctypes
import importlib
import inspect
import os
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from studies import common
from studies.benchmarks import contacts
from studies.kept import show
from vibgym import Surface
from vibgym.fields import radial
from vibgym.kernels.jit import LINKED, MODE, REASON, jit
from vibgym.kernels.reference import Layout, Pinned

STAGES = {
    "cut": ("planar.stepper:cut_stale",),
    "friction": ("planar.stepper:apply_friction", "planar.stepper:friction_step"),
    "broad phase": (
        "contacts.broad_phase:find_pairs", "contacts.broad_phase:near_pairs", "contacts.certified.coupling:order_pairs",
    ),
    "islands": (
        "contacts.certified.period:find_touching", "contacts.certified.islands:begin_islands",
        "contacts.certified.islands:join_crossing_islands",
    ),
    "distance of hulls": ("contacts.hulls:hull_contact", "contacts.hulls:kept_contact"),
    "conservative advancement": ("contacts.certified.approach:conservative_step",),
    "contact points": ("contacts.certified.solver:find_contacts",),
    "impacts": ("contacts.certified.impact:resolve_impacts",),
    "solver": ("contacts.certified.solver:solve",),
    "load, store": (
        "contacts.certified.coupling:load_island", "planar.stepper:store_parts", "contacts.certified.period:copy_part",
    ),
}  # fmt: skip
"""Kernels of each stage, in modules of :mod:`vibgym.physics`."""


class Clock(NamedTuple):
    """Time by stage, ns; stage 0 is the rest."""

    time: np.ndarray  # (2,) s and ns, written by the operating system
    current: np.ndarray  # (3,) stage, when it began, and ns that a reading takes
    spent: np.ndarray  # (1 + stages,)


LAYOUT: Layout[Clock] = Layout("LAYOUT", __name__)
CLOCK = Pinned(LAYOUT, Clock(np.zeros(2, np.int64), np.zeros(3, np.int64), np.zeros(1 + len(STAGES), np.int64)))
clock_at, ADDRESS, TIME = LAYOUT.at, CLOCK.address, CLOCK.record.time.ctypes.data

read_time = ctypes.CDLL(None).clock_gettime
read_time.argtypes = ctypes.c_int, ctypes.c_int64
MONOTONIC = time.CLOCK_MONOTONIC


@jit
def switch(stage):
    """Add the time until now to the current stage, make ``stage`` current, and return the stage before."""
    clock = clock_at(ADDRESS)
    read_time(MONOTONIC, TIME)
    now, before = 1_000_000_000 * clock.time[0] + clock.time[1], clock.current[0]
    clock.spent[before] += now - clock.current[1] - clock.current[2]
    clock.current[0], clock.current[1] = stage, now
    return before


@jit
def switch_often(times):
    """Switch to the rest again and again."""
    for _ in range(times):
        switch(0)


def calibrate(times: int = 1_000_000) -> None:
    """Measure how long a reading takes."""
    spent, current = CLOCK.record.spent, CLOCK.record.current
    switch_often(1)
    spent[:] = current[2] = 0
    switch_often(times)
    current[2] = spent[0] // times


def timed(kernel: Any, stage: int) -> Any:
    """Return a kernel that switches to ``stage`` while it runs."""
    names = ", ".join(inspect.signature(kernel.py_func).parameters)
    text = (
        f"def {kernel.__name__}({names}):\n    before = switch({stage})\n    result = kernel({names})\n"
        "    switch(before)\n    return result\n"
    )
    space = {"switch": switch, "kernel": kernel}
    exec(text, space)
    return jit(space[kernel.__name__])


def instrument() -> None:
    """Wrap the kernels of all stages, wherever modules of the package use them, and use no stored kernels."""
    importlib.import_module("vibgym.simulation.contacts")  # all kernels of contacts, which Simulator imports late
    modules = [module for name, module in sys.modules.items() if name.startswith("vibgym.")]
    for stage, kernels in enumerate(STAGES.values(), 1):
        for path in kernels:
            where, name = path.split(":")
            kernel = getattr(importlib.import_module(f"vibgym.physics.{where}"), name)
            wrapped = timed(kernel, stage)
            for module in modules:
                if vars(module).get(name) is kernel:
                    setattr(module, name, wrapped)
    for module in modules:
        for value in vars(module).values():
            if hasattr(value, "py_func") and hasattr(value, "state"):
                value.state = ""


def measured(work: Callable[[], Any], units: float) -> list[float]:
    """Return microseconds of a unit of work: in all, of the rest, and of each stage; the fastest of several runs."""
    work()  # compiles
    spent, best = CLOCK.record.spent, np.full(1 + len(STAGES), np.inf)
    for _ in range(7):
        switch(0)
        spent[:] = 0
        work()
        switch(0)
        if spent.sum() < best.sum():
            best = spent.copy()
    return [1e-3 * float(ns) / units for ns in (best.sum(), *best)]


def crowded(action: str, steps: int = 8, worlds: int = 256) -> tuple[Callable[[], None], int]:
    """Return steps of ``SortCrowded`` under random actions, and their number."""
    env: Any = gym.make_vec("vibgym/SortCrowded-v0", num_envs=worlds, action=action)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(steps)]
    env.reset(seed=0)
    return lambda: [env.step(values) for values in actions] and None, steps * worlds


def main() -> None:
    """Measure the scenes."""
    keep = common.parser(__doc__).parse_args().keep
    if MODE != LINKED:  # other kernels may come from the cache with the kernels that they call
        raise SystemExit(f"contact_stages cannot wrap kernels: {REASON}")
    os.environ["VIBGYM_THREADS"] = "1"
    instrument()
    calibrate()
    drive = radial(0.416, 0.104).drive(Surface())
    scenes = {
        "two blocks driven together, a world and period": (
            lambda: contacts.driven_together(10), 12 * contacts.WORLDS,
        ),
        "heap of 12, a part and period": (
            lambda: contacts.together(0.074).advance(*drive, contacts.SECOND),
            contacts.SECOND * contacts.WORLDS * contacts.BLOCKS,
        ),
        **{f"`SortCrowded`, `{action}`, a world and step": crowded(action) for action in ("field", "element")},
    }  # fmt: skip
    lines = [[name, *(f"{us:.1f}" for us in measured(*scene))] for name, scene in scenes.items()]
    show("contact-stages", ("us", "all", "rest", *STAGES), lines, keep)


if __name__ == "__main__":
    main()
