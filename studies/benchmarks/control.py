"""What control costs beside the simulation: ``python -m studies.benchmarks.control [--steps 100] [--only pose]``.

Every law, straight to the goals and under the planner, drives 256 worlds, and one, through whole episodes, one after the other,
so that all that episodes contain comes in: ways, last millimetres, rests. Timed in turn, in one process, are ``predict`` and
the simulator's step of the same worlds in the same state, one period of the planar or the contact model; what else a step
of an environment costs is left out. Printed are the ratio of the two in processor time, that of all threads, which other work
on the machine disturbs little, of all steps together and of the median step; and what ``predict`` takes a period: processor
time a world of 256, and time on the clock for one, median and 95 %.

It may be four simulated steps for 256 worlds, and 1 ms for one world. Below stands what the allocator takes, by the size of
what parts want.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import vibgym  # noqa: F401 - registers the environments
from studies.benchmarks import common
from vibgym import Simulator, Surface
from vibgym.allocation import Allocator
from vibgym.policies.classical.steering import LAWS
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.parts import Part

SURFACE = Surface()
WORLDS, MOST_RATIO, MOST_ALONE = 256, 4.0, 1e-3
SIZES = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
ROUNDS = 15


class Times(NamedTuple):
    """Of the steps of a batch, s each."""

    predict: np.ndarray
    simulate: np.ndarray


class Clock:
    """Adds up what calls take."""

    def __init__(self, call: Callable[..., Any], now: Callable[[], float]) -> None:
        self.call, self.now, self.spent = call, now, 0.0

    def __call__(self, *arguments: Any) -> Any:
        began = self.now()
        result = self.call(*arguments)
        self.spent += self.now() - began
        return result


class Course:
    """Worlds under a policy, one episode after the other."""

    def __init__(self, task: str, policy: dict[str, Any], hardware: dict[str, Any], worlds: int) -> None:
        self.env = gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, action="phasor", **hardware)
        self.now = time.process_time if worlds > 1 else time.perf_counter
        self.policy = make_policy(policy, TaskInfo.of(self.env, task))
        simulator = self.env.unwrapped.core.simulator  # type: ignore[attr-defined]
        self.clock = simulator.run = Clock(simulator.run, self.now)
        self.observation, _ = self.env.reset(seed=0)
        self.start, self.state = np.ones(worlds, dtype=bool), None

    def step(self) -> tuple[float, float]:
        """What ``predict`` and the simulator take, s."""
        began, self.clock.spent = self.now(), 0.0
        action, self.state = self.policy.predict(self.observation, self.state, self.start)
        took = self.now() - began
        self.observation, _, terminated, truncated, _ = self.env.step(action)
        self.start = terminated | truncated
        return took, self.clock.spent


def courses(task: str, policy: dict[str, Any], hardware: dict[str, Any], steps: int) -> tuple[Times, Times]:
    """What many worlds take, and one, step by step in turn."""
    both = [Course(task, policy, hardware, worlds) for worlds in (WORLDS, 1)]
    for _ in range(3):
        for course in both:
            course.step()
    took = np.array([[course.step() for course in both] for _ in range(steps)])
    for course in both:
        course.env.close()
    return Times(*took[:, 0].T), Times(*took[:, 1].T)


def controllers() -> Iterator[dict[str, Any]]:
    """Settings of all controllers that steer by a law."""
    for kind in ("local_field", "planner"):
        for law in LAWS:
            yield {"kind": kind, "law": law}


def control(steps: int, only: str) -> None:
    """Print a line for every controller."""
    print(f"{'':<44}{WORLDS} worlds: x simulated step (median)   us a world   one world: ms (95 %)")
    for task in ("Align", "Sort"):
        for name, hardware in common.HARDWARE.items():
            for policy in controllers():
                title = f"{task:<6}{name:<11}{policy['kind']:<14}{policy['law']:<12}"
                if only not in title:
                    continue
                many, one = courses(task, policy, hardware, steps)
                ratio = many.predict.sum() / many.simulate.sum()
                middle = np.median(many.predict / many.simulate)
                alone, late = np.quantile(one.predict, [0.5, 0.95])
                missed = " <-- too much" if ratio > MOST_RATIO or alone > MOST_ALONE else ""
                print(
                    f"{title} {ratio:20.2f} ({middle:.2f}) {1e6 * many.predict.mean() / WORLDS:18.1f} "
                    f"{1e3 * alone:16.2f} ({1e3 * late:.2f}){missed}",
                    flush=True,
                )


def allocation() -> None:
    """Print what pushes take compared with a simulated period, by their size."""
    block, generator = Part.rectangle(0.050, 0.035, friction=0.58), np.random.default_rng(0)
    sheet = TaskInfo.of(gym.make("vibgym/Align-v0", **common.HARDWARE["prototype"])).hardware
    border = np.array([0.1, 0.06, -np.pi])
    poses = generator.uniform(border, [SURFACE.width, SURFACE.depth, 0.0] - border, (WORLDS, 3))
    velocities = generator.uniform(-1.0, 1.0, (WORLDS, 3)) * [0.2, 0.2, 6.0]
    for worlds in (WORLDS, 1):
        pose = poses[:worlds, None]
        simulator = Simulator(SURFACE, block, worlds=worlds)
        simulator.reset(pose, velocities[:worlds, None])
        still = np.zeros((worlds, SURFACE.rows, SURFACE.columns))
        calls: dict[str, Callable[[], object]] = {"a simulated period": lambda: simulator.advance(still, still)}  # noqa: B023
        calls.update(wishes(block, sheet, pose, generator))
        print(f"\n{worlds} worlds, one part, us a world")
        for name, took in common.interleaved(calls, ROUNDS).items():
            print(f"  {name:<44}{1e6 * float(np.median(took)) / worlds:10.2f}")


def wishes(part: Part, sheet: Any, pose: np.ndarray, generator: np.random.Generator) -> dict[str, Callable[[], object]]:
    """Allocations for one part each, by the length of the push that is wanted, over that of full amplitude."""
    allocator, present = Allocator(SURFACE, [part], sheet), np.ones(pose.shape[:2], dtype=bool)
    direction = generator.normal(size=pose.shape)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return {
        f"allocation, push of {size} (least is {allocator.least:.2f})": lambda size=size: allocator.pushes(
            pose, present, size * direction
        )
        for size in SIZES
    }


if __name__ == "__main__":
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--steps", type=int, default=100, help="periods for each controller")
    parser.add_argument("--only", default="", help="lines that contain this")
    given = parser.parse_args()
    control(given.steps, given.only)
    if not given.only:
        allocation()
