"""Time of controllers relative to the simulation: ``python -m studies.benchmarks.control [--steps 100] [--only pose]``.

Every law, in the local field controller and under the planner, controls 256 worlds and one world. ``predict`` and the step of
the simulator are timed in turn; the rest of an environment step is excluded. Output: ratio of their processor times (all
threads), over all steps and of the median step; processor time of ``predict`` per world of 256; and its wall time for one
world, median and 95 %. Targets: at most four simulated steps for 256 worlds, and 1 ms for one world.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import vibgym  # noqa: F401 - registers the environments
from studies.benchmarks import common
from vibgym.policies.classical.law import laws
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo

WORLDS, MAX_RATIO, MAX_ALONE = 256, 4.0, 1e-3


class Times(NamedTuple):
    """Times of the steps of a batch, (steps,) s."""

    predict: np.ndarray
    simulate: np.ndarray


class Clock:
    """Callable that accumulates the time of its calls."""

    def __init__(self, call: Callable[..., Any], now: Callable[[], float]) -> None:
        self.call, self.now, self.spent = call, now, 0.0

    def __call__(self, *arguments: Any) -> Any:
        began = self.now()
        result = self.call(*arguments)
        self.spent += self.now() - began
        return result


class Batch:
    """Worlds with a policy."""

    def __init__(self, task: str, policy: dict[str, Any], hardware: dict[str, Any], worlds: int) -> None:
        self.env = gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, action="phasor", **hardware)
        self.now = time.process_time if worlds > 1 else time.perf_counter
        self.policy = make_policy(policy, TaskInfo.of(self.env, task))
        simulator = self.env.unwrapped.core.simulator  # type: ignore[attr-defined]
        self.clock = simulator.run = Clock(simulator.run, self.now)
        self.observation, _ = self.env.reset(seed=0)
        self.start, self.state = np.ones(worlds, dtype=bool), None

    def step(self) -> tuple[float, float]:
        """Advance a step; return the times of ``predict`` and of the simulator, s."""
        began, self.clock.spent = self.now(), 0.0
        action, self.state = self.policy.predict(self.observation, self.state, self.start)
        took = self.now() - began
        self.observation, _, terminated, truncated, _ = self.env.step(action)
        self.start = terminated | truncated
        return took, self.clock.spent


def measure(task: str, policy: dict[str, Any], hardware: dict[str, Any], steps: int) -> tuple[Times, Times]:
    """Return the times for many worlds and for one, measured in turn."""
    both = [Batch(task, policy, hardware, worlds) for worlds in (WORLDS, 1)]
    took = np.array([[batch.step() for batch in both] for _ in range(3 + steps)])[3:]
    for batch in both:
        batch.env.close()
    return Times(*took[:, 0].T), Times(*took[:, 1].T)


def main() -> None:
    """Print a line for every controller."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--steps", type=int, default=100, help="per controller")
    parser.add_argument("--only", default="", help="lines that contain this text")
    asked = parser.parse_args()
    print(f"{'':<44}{WORLDS} worlds: x simulated step (median)   us per world   one world: ms (95 %)")
    policies = [{"kind": kind, "law": law} for kind in ("local_field", "planner") for law in laws()]
    for task in ("Align", "Sort"):
        for name, hardware in common.HARDWARE.items():
            for policy in policies:
                title = f"{task:<6}{name:<11}{policy['kind']:<14}{policy['law']:<12}"
                if asked.only not in title:
                    continue
                many, one = measure(task, policy, hardware, asked.steps)
                ratio = many.predict.sum() / many.simulate.sum()
                middle = np.median(many.predict / many.simulate)
                alone, late = np.quantile(one.predict, [0.5, 0.95])
                missed = " <-- above target" if ratio > MAX_RATIO or alone > MAX_ALONE else ""
                print(
                    f"{title} {ratio:20.2f} ({middle:.2f}) {1e6 * many.predict.mean() / WORLDS:16.1f} "
                    f"{1e3 * alone:16.2f} ({1e3 * late:.2f}){missed}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
