"""Where the time of contacts goes: ``python -m studies.benchmarks.contact_stages`` prints cycles by stage as microseconds.

Kernels of a stage are wrapped before anything is compiled: the wrapper reads the processor's cycle counter, so that the time
of a nested stage is subtracted from the enclosing one. All kernels are compiled for it, in about half a minute.
"""

from __future__ import annotations

import importlib
import inspect
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from studies import common
from studies.benchmarks import contacts
from studies.kept import show
from vibgym import Surface
from vibgym.fields import radial
from vibgym.kernels.jit import jit

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

CLOCK = np.zeros(2 + 1 + len(STAGES), np.int64)
"""Current stage (0: the rest), last reading, and cycles of each stage."""


def _switch(typing_context: Any, stage: Any) -> Any:
    """``switch(stage)`` in a kernel adds the cycles until now to the current stage and returns that stage."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        word = ir.IntType(64)
        current = builder.inttoptr(ir.Constant(word, CLOCK.ctypes.data), word.as_pointer())
        last, spent = (builder.gep(current, [ir.Constant(word, k)]) for k in (1, 2))
        counter = ir.FunctionType(word, [])
        now = builder.call(cgutils.get_or_insert_function(builder.module, counter, "llvm.readcyclecounter"), [])
        before = builder.load(current)
        sum_of = builder.gep(spent, [before])
        builder.store(builder.add(builder.load(sum_of), builder.sub(now, builder.load(last))), sum_of)
        builder.store(now, last)
        builder.store(values[0], current)
        return before

    return types.int64(types.int64), generate


switch: Any = intrinsic(_switch)


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


@jit
def begin(stage):
    """Make ``stage`` current."""
    switch(stage)


def measured(work: Callable[[], Any], units: float) -> list[float]:
    """Return microseconds of a unit of work: in all, of the rest, and of each stage; the fastest of several runs."""
    work()  # compiles
    best = [np.inf]
    for _ in range(7):
        CLOCK[:] = 0
        begin(0)
        CLOCK[2:], began = 0, time.thread_time()
        work()
        took = 1e6 * (time.thread_time() - began) / units
        begin(0)
        if took < best[0]:
            best = [took, *(took * CLOCK[2:] / CLOCK[2:].sum()).tolist()]
    return best


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
    os.environ["VIBGYM_THREADS"] = "1"
    instrument()
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
