"""Candidates for a scene: the models with their knobs. What they all look like to the measurement.

A candidate is prepared for a scene once (which may refuse it) and then run any number of times, always from the start.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from studies.accuracy.scenes import Scene
from vibgym.physics.core.drive import polar_drive
from vibgym.simulation.simulator import Simulator


class Outcome(NamedTuple):
    """What a run did to the scene's first worlds.

    Attributes:
        settled, pose: (worlds, 3) after the periods left out of the mean velocity, and at the end; not finite where the
            world has failed.
        fallen: (worlds,) bool.
        doubtful: (worlds,) bool, where the method itself says that it does not vouch for the result.
        trouble: messages of worlds that failed.
        seconds: wall time of the run alone, on one thread.
    """

    settled: np.ndarray
    pose: np.ndarray
    fallen: np.ndarray
    doubtful: np.ndarray
    trouble: tuple[str, ...]
    seconds: float


Runner = Callable[[], Outcome]


@dataclass(frozen=True)
class Candidate:
    """A method at one setting.

    Attributes:
        method: points of the same method form one curve.
        knobs: its setting.
        prepare: makes the run for a scene. Raises ValueError or ImportError where the method does not cover it.
        compiled: whether the first run may compile and is no measure of cost.
        peer: whether it is none of the models of ``vibgym``.
    """

    method: str
    knobs: Mapping[str, Any]
    prepare: Callable[[Scene], Runner] = field(compare=False)
    compiled: bool = True
    peer: bool = False

    @property
    def setting(self) -> str:
        """The knobs in words."""
        return ", ".join(f"{name}={_short(value)}" for name, value in self.knobs.items()) or "as it comes"


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def prepare_model(scene: Scene, model: str, knobs: Mapping[str, Any], threads: int = 1) -> Runner:
    """A simulator on all worlds of a scene."""
    simulator = Simulator(scene.surface, scene.part, worlds=scene.worlds, model=model, threads=threads, **knobs)
    return prepare_simulator(scene, simulator)


def prepare_simulator(scene: Scene, simulator: Simulator) -> Runner:
    """The run of a scene on a simulator that has as many worlds."""
    w = scene.surface.angular_frequency
    drives = [(polar_drive(each.amplitude, each.phase, w), each.periods) for each in scene.segments]

    def run() -> Outcome:
        simulator.reset(scene.pose[:, None], scene.velocity[:, None])
        settled, done, took = scene.pose, 0, 0.0
        for drive, periods in drives:
            began = time.perf_counter()
            simulator.run(drive, periods)
            took += time.perf_counter() - began
            done += periods
            if done == scene.settle:
                settled = simulator.pose[:, 0]
        diverged = simulator.diverged
        pose = np.where(diverged[:, None], np.nan, simulator.pose[:, 0])
        trouble = ("diverged",) * int(diverged.sum())
        return Outcome(settled, pose, simulator.fallen[:, 0], simulator.doubtful[:, 0], trouble, took)

    return run


def curve_of(model: str, knobs: Mapping[str, Any]) -> str:
    """Name of the curve: each order of the averaged model has a model error of its own."""
    return f"averaged, order {knobs.get('order', 2)}" if model == "averaged" else model


def model_candidate(model: str, knobs: Mapping[str, Any]) -> Candidate:
    """One of the models of ``vibgym``."""
    shown = {name: value for name, value in knobs.items() if name != "order"}
    return Candidate(curve_of(model, knobs), shown, lambda scene: prepare_model(scene, model, knobs))
