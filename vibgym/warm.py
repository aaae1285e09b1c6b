"""Compile all kernels of environments and simulators ahead of time, for container images and clusters.

Each scene runs its first step in one of several processes, which share the cache.
"""

from __future__ import annotations

import contextlib
import importlib.util
import logging
import multiprocessing
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from typing import Any

import gymnasium
import numpy as np

from vibgym import Part, Simulator, Surface, make_policy
from vibgym.actuators import DataSheet
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.bounds import TimeBound
from vibgym.envs import Velocity
from vibgym.envs.actions import all_finite
from vibgym.physics.core.drive import all_phasors, polar_drive
from vibgym.policies import TaskInfo, rollout
from vibgym.registry import Registry
from vibgym.simulation.threads import available_threads

BLOCKS = [Part.rectangle(0.05, 0.04, friction=0.6), Part.disc(0.02, friction=0.6)]


def environment(name: str = "vibgym/Align-v0", **settings: Any) -> None:
    """Run a step of an environment. The simulator has the same kernels for all actions (:mod:`vibgym.physics.core.drive`)."""
    made = gymnasium.make(name, **settings)
    made.reset(seed=0)
    made.step(made.action_space.sample())
    made.close()


def observation(name: str, kind: str) -> None:
    """Run a step with an observation, if the task supports it."""
    with contextlib.suppress(ValueError):
        environment(name, observation=kind)


HARDWARE: dict[str, dict[str, Any]] = {
    "prototype actuators, pose sensor": {"actuators": "prototype", "sensor": "pose"},
    "model estimator": {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}},
    "Kalman estimator": {"sensor": {"kind": "pose", "estimator": "kalman"}},
}


def simulator(**settings: object) -> None:
    """Run a period of a simulator."""
    made = Simulator(Surface(), **settings)  # type: ignore[arg-type]
    made.advance(0.0, 0.0)


def contacts(**settings: Any) -> None:
    """Run a period with contacts of parts and a wall."""
    made = Simulator(Surface(), BLOCKS, walls=["left"], **settings)
    made.reset([[[0.025, 0.1, 0.0], [0.07, 0.1, 0.0]]], [[[-0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]])
    made.advance(0.0, 0.0)


def disturbances() -> None:
    """Compile impulse disturbances and the tipping margin."""
    environment(randomize={"disturbance": {"rate": 1.0, "tilt": 0.02}})
    Simulator(Surface(), BLOCKS[0]).tipping_margin.sum()


def allocation() -> None:
    """Compute pushes for an acceleration and back, and the accelerations that an action means."""
    friction, one = FrictionalInverse(Surface(), BLOCKS[0]), np.zeros((1, 1, 3))
    friction.push(one, one)
    friction.acceleration(one, one)
    action = Velocity(Surface(), BLOCKS[:1])
    action.resolve_limits(DataSheet(Surface().lift_off_amplitude), 1)
    action.acceleration(one, one, one)


def bounds() -> None:
    """Compute lower bounds of times to goals."""
    bound = TimeBound(Surface(), BLOCKS[0], position_tolerance=2e-3, heading_tolerance=0.1)
    bound.steps([0.2, 0.1, 0.0], [0.6, 0.1, 1.0])


def policies() -> None:
    """Run a step of each classical policy, if the extra ``policies`` is installed."""
    if importlib.util.find_spec("scipy") is None:
        return
    for task, names in {"Align": ("pose",), "Sort": ("planner", "pose"), "Pack": ("two_phases",)}.items():
        made = gymnasium.make_vec(f"vibgym/{task}-v0", num_envs=2)
        for name in names:
            policy = make_policy(name, TaskInfo.of(made))
            wanted = gymnasium.make_vec(
                f"vibgym/{task}-v0", num_envs=2, action=policy.action, observation=policy.observation
            )
            seen, _ = wanted.reset(seed=0)
            policy.predict(seen, None, np.ones(2, bool))
            wanted.close()
        made.close()
    # With prototype actuators, controllers identify the response of the elements.
    rollout("pose", "vibgym/Align-v0", seeds=[0], actuators="prototype", max_episode_periods=25)


def many_worlds() -> None:
    """Compile the check of the actions of a batch."""
    all_finite(np.zeros((1, 1), np.float32))


def phasors() -> None:
    """Compute the phasors that viewers draw."""
    still = np.zeros((1, 1, 1))
    all_phasors(polar_drive(still, still, 1.0), np.zeros((1, 1, 1, 2)), 0)


PLUGINS: Registry[Callable[[], None]] = Registry("warm", {"disturbances": disturbances}, "vibgym.warm")
"""Further functions that compile kernels, by name: those of plug-ins."""


def jobs() -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield the scenes to compile, by name."""
    yield "planar model", partial(simulator, parts=BLOCKS[0])
    yield "averaged model", partial(simulator, parts=BLOCKS[0], model="averaged")
    yield "contacts", contacts
    yield "fast contacts", partial(contacts, contacts="fast")
    yield "contacts by pymunk", partial(contacts, contacts="pymunk")
    yield from PLUGINS.items()
    yield "allocation", allocation
    yield "bounds", bounds
    for action in ("patch", "wrench"):
        yield f"{action} action", partial(environment, action=action)
    yield "viewers", phasors
    yield "many worlds", many_worlds
    yield "policies", policies
    specs = (spec for spec in gymnasium.registry.values() if spec.namespace == "vibgym")
    # Ids with drawn shapes have the kernels of their task.
    for name in sorted(spec.id for spec in specs if "split" not in spec.kwargs):
        for kind in ("state", "parts", "goal", "image"):
            yield f"{name}, {kind}", partial(observation, name, kind)
    for name, settings in HARDWARE.items():
        yield name, partial(environment, **settings)


def run_scene(name: str) -> float:
    """Run a scene; returns the seconds taken."""
    logging.getLogger("vibgym").setLevel(logging.ERROR)  # no line about compilation from each process
    started = time.perf_counter()
    dict(jobs())[name]()
    return time.perf_counter() - started


def warm(report: Callable[[str], None]) -> float:
    """Compile everything on all processors; returns the seconds taken.

    ``report`` is called with scenes that took over 0.5 s.
    """
    began = time.perf_counter()
    with ProcessPoolExecutor(available_threads(), multiprocessing.get_context("spawn")) as pool:
        names = {pool.submit(run_scene, name): name for name, _ in jobs()}
        for done in as_completed(names):
            if (took := done.result()) > 0.5:
                report(f"{took:6.1f} s  {names[done]}")
    return time.perf_counter() - began
