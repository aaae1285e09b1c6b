"""Time per stage of an environment step: ``python -m studies.benchmarks.stages [ENVIRONMENT ...]``.

Each stage of a step (:mod:`vibgym.envs.step`) is wrapped by a clock. The time of a nested stage is subtracted from the
enclosing one, so that the shares add up; ``rest`` is the step outside all stages (resets, ``info``, Gymnasium). One thread.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from typing import Any

os.environ.setdefault("VIBGYM_THREADS", "1")  # stages of several threads would overlap

import gymnasium as gym

import vibgym  # noqa: F401 - registers the environments
from vibgym.envs.core import Core

ROUNDS, WARM, ACTIONS = 60, 20, 8


class StageClock:
    """Time (s) spent in each stage, without nested stages."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        self.readings = 0
        self._current, self._since = "rest", time.perf_counter()

    def switch(self, stage: str) -> str:
        """Attribute the time until now to the current stage and make ``stage`` current; return the previous one."""
        now, before = time.perf_counter(), self._current
        self.spent[before] = self.spent.get(before, 0.0) + now - self._since
        self._current, self._since = stage, now
        self.readings += 1
        return before

    def clear(self) -> None:
        """Set all times to zero."""
        self.switch("rest")
        self.spent, self.readings = {}, 0

    def timed(self, run: Callable[..., None]) -> Callable[..., None]:
        """Wrap a stage, named after its method."""
        stage = run.__name__.strip("_")

        def within(*arguments: Any) -> None:
            before = self.switch(stage)
            try:
                run(*arguments)
            finally:
                self.switch(before)

        return within


def instrumented(clock: StageClock, name: str, worlds: int, **settings: Any) -> Any:
    """Return a vector environment whose stages are timed."""
    listed = Core._list_stages
    Core._list_stages = lambda core: tuple(each._replace(run=clock.timed(each.run)) for each in listed(core))
    try:
        return gym.make_vec(name, num_envs=worlds, **settings)
    finally:
        Core._list_stages = listed


def shares(name: str, worlds: int, steps: int, **settings: Any) -> dict[str, Any]:
    """Return us per world and step of every stage, and of reading the clock: the fastest of :data:`ROUNDS` rounds."""
    clock = StageClock()
    env = instrumented(clock, name, worlds, **settings)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(ACTIONS)]
    env.reset(seed=0)
    for k in range(WARM):
        env.step(actions[k % ACTIONS])
    best: dict[str, float] = {}
    for _ in range(ROUNDS):
        clock.clear()
        for k in range(steps):
            env.step(actions[k % ACTIONS])
        clock.switch("rest")
        if not best or sum(clock.spent.values()) < sum(best.values()):
            best = dict(clock.spent)
    readings = clock.readings
    env.close()
    clock.clear()
    for _ in range(10_000):
        clock.switch("rest")
    unit = 1e6 / (worlds * steps)
    reading = sum(clock.spent.values()) / 10_000
    return {"stages": {stage: unit * spent for stage, spent in best.items()}, "clock": unit * reading * readings}


def main() -> None:
    """Print the stages of each environment; with ``--json``, one line of JSON per scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("environments", nargs="*", default=["Rotate", "Sort"], metavar="ENVIRONMENT")
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--steps", type=int, default=4, help="per round")
    parser.add_argument("--action", default="element")
    parser.add_argument("--json", action="append", default=[], help=argparse.SUPPRESS)  # arguments of shares()
    asked = parser.parse_args()
    for line in asked.json:
        print(json.dumps(shares(**json.loads(line))), flush=True)
    for name in () if asked.json else asked.environments:
        found = shares(f"vibgym/{name}-v0", asked.worlds, asked.steps, action=asked.action)
        total = sum(found["stages"].values())
        print(f"{name}, {asked.action}, {asked.worlds} worlds: {total:.2f} us a world and step")
        for stage, spent in sorted(found["stages"].items(), key=lambda each: -each[1]):
            print(f"  {stage:<22}{spent:8.3f} us {100.0 * spent / total:5.1f} %")
        print(f"  (reading the clock: {found['clock']:.3f} us of it)", flush=True)


if __name__ == "__main__":
    main()
