"""Candidates for a scene: the models with their knobs, and the peers: SciPy's integrators, point sampling, MuJoCo.

A candidate is prepared for a scene once (which may raise) and then run any number of times from the start.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from studies.accuracy import mujoco_scene, point_sampling, scipy_peers
from studies.accuracy.scenes import Scene
from vibgym import checks
from vibgym.physics.core.drive import polar_drive
from vibgym.simulation.simulator import Simulator

NAMES = {"point_sampling": "point sampling", "LSODA": "SciPy LSODA", "DOP853": "SciPy DOP853", "mujoco": "MuJoCo"}
"""Name in settings -> name in reports."""


class Outcome(NamedTuple):
    """Result of a run over the scene's first worlds.

    Attributes:
        settled, pose: (worlds, 3) after the periods left out of the mean velocity, and at the end; not finite where the
            world has failed.
        fallen: (worlds,) bool.
        doubtful: (worlds,) bool, where the method itself reports that its result is not certified.
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

World = Callable[[int], tuple[np.ndarray, np.ndarray, float]]
"""Index of a world -> pose after the settling periods, pose at the end, and seconds."""


class Candidate(NamedTuple):
    """A method at one setting.

    Attributes:
        method: points of the same method form one curve.
        knobs: its setting.
        prepare: makes the run for a scene. Raises ValueError or ImportError where the method does not cover it.
        compiled: whether the first run may include compilation and is not timed.
        peer: whether it is not a model of ``vibgym``.
    """

    method: str
    knobs: Mapping[str, Any]
    prepare: Callable[[Scene], Runner]
    compiled: bool = True
    peer: bool = False

    @property
    def setting(self) -> str:
        """The knobs as text."""
        shown = (
            f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}" for name, value in self.knobs.items()
        )
        return ", ".join(shown) or "default"


def prepare_model(scene: Scene, model: str, knobs: Mapping[str, Any], threads: int = 1) -> Runner:
    """Return the run of a model on all worlds of a scene."""
    simulator = Simulator(scene.surface, scene.part, worlds=scene.worlds, model=model, threads=threads, **knobs)
    return prepare_simulator(scene, simulator)


def prepare_simulator(scene: Scene, simulator: Simulator) -> Runner:
    """Return the run of a scene on a simulator with as many worlds."""
    w = scene.surface.angular_frequency
    drives = [(polar_drive(each.amplitude, each.phase, w), each.periods) for each in scene.segments]

    def run() -> Outcome:
        simulator.reset(scene.pose[:, None], scene.velocity[:, None])
        settled, done, took = scene.pose, 0, 0.0
        for drive, periods in drives:
            began = time.perf_counter()
            simulator.advance_drive(drive, periods)
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
    """Return the name of the curve: each order of the averaged model has its own model error."""
    return f"averaged, order {knobs.get('order', 2)}" if model == "averaged" else model


def model_candidate(model: str, knobs: Mapping[str, Any]) -> Candidate:
    """Return a model of ``vibgym`` at one setting."""
    shown = {name: value for name, value in knobs.items() if name != "order"}
    return Candidate(curve_of(model, knobs), shown, lambda scene: prepare_model(scene, model, knobs))


def peer_candidate(peer: str, knobs: Mapping[str, Any], worlds: int) -> Candidate:
    """Return a peer at one setting.

    Args:
        peer: one of :data:`NAMES`.
        knobs: all of its knobs.
        worlds: largest number of a scene's worlds that it runs; point sampling always runs all.
    """

    def prepare(scene: Scene) -> Runner:
        if not scene.slides:
            why = "peer's equations have no static friction"
            if peer == "mujoco":
                why = "MuJoCo scene has one coefficient of friction"
            raise checks.refuse("scene", scene.name, f"scenes that always slide: this {why}")
        if peer == "point_sampling":
            return _sampled(scene, knobs)
        one = _mujoco(scene, knobs) if peer == "mujoco" else _scipy(scene, peer, knobs)
        return _each(one, min(worlds, scene.worlds))

    shown = {name: value for name, value in knobs.items() if value is not None}
    return Candidate(NAMES[peer], shown, prepare, compiled=peer == "point_sampling", peer=True)


def _sampled(scene: Scene, knobs: Mapping[str, Any]) -> Runner:
    # All segments at full size: the measured time includes checks and copies of arrays, which are cheap.
    def run() -> Outcome:
        pose, velocity, settled, done, took = scene.pose, scene.velocity, scene.pose, 0, 0.0
        for amplitude, phase, periods in scene.segments:
            given = np.nan_to_num(pose), np.nan_to_num(velocity), amplitude, phase, periods
            began = time.perf_counter()
            with np.errstate(all="ignore"):
                pose, velocity = point_sampling.simulate(scene.surface, scene.part, *given, **knobs)
            took += time.perf_counter() - began
            done += periods
            if done == scene.settle:
                settled = pose
        lost = ~np.isfinite(pose).all(axis=1)
        none = np.zeros(scene.worlds, dtype=bool)
        return Outcome(settled, pose, none, none, ("not finite",) * int(lost.sum()), took)

    return run


def _each(one: World, worlds: int) -> Runner:
    """Return a run of worlds one after the other; an error in a world counts as its failure."""

    def run() -> Outcome:
        settled, pose = np.full((worlds, 3), np.nan), np.full((worlds, 3), np.nan)
        trouble, took = [], 0.0
        for world in range(worlds):
            try:
                settled[world], pose[world], seconds = one(world)
                took += seconds
            except RuntimeError as error:
                trouble.append(" ".join(str(error).split()))
        none = np.zeros(worlds, dtype=bool)
        return Outcome(settled, pose, none, none, tuple(trouble), took if took else float("nan"))

    return run


def _scipy(scene: Scene, method: str, knobs: Mapping[str, Any]) -> World:
    def one(world: int) -> tuple[np.ndarray, np.ndarray, float]:
        pose, velocity, seconds, done = scene.pose[world], scene.velocity[world], 0.0, 0
        settled = pose
        for amplitude, phase, periods in scene.segments:
            given = pose, velocity, amplitude[world], phase[world], periods
            run = scipy_peers.integrate(scene.surface, scene.part, *given, method=method, **knobs)
            pose, velocity, seconds, done = run.pose[-1], run.velocity[-1], seconds + run.seconds, done + periods
            if done == scene.settle:
                settled = pose
        return settled, pose, seconds

    return one


def _mujoco(scene: Scene, knobs: Mapping[str, Any]) -> World:
    mujoco_scene.load_mujoco()
    if not scene.held:
        raise checks.refuse("scene", scene.name, "scenes whose drive is held: this MuJoCo scene takes one drive")
    drive = scene.segments[0]
    # Built once here, to raise errors of unsupported scenes.
    mujoco_scene.build(scene.surface, scene.part, scene.pose[0], reach=0.0, **knobs)

    def one(world: int) -> tuple[np.ndarray, np.ndarray, float]:
        start = scene.pose[world], scene.velocity[world]
        held = drive.amplitude[world], drive.phase[world], scene.periods
        run = mujoco_scene.simulate(scene.surface, scene.part, *start, *held, **knobs)
        return run.pose[scene.settle], run.pose[-1], run.seconds

    return one
