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
"""Peer in settings -> name in reports."""


class Outcome(NamedTuple):
    """Result of a run over the scene's first worlds."""

    settled: np.ndarray  # (worlds, 3) pose after the periods left out of the mean velocity; not finite where it failed
    pose: np.ndarray  # (worlds, 3) at the end, likewise
    fallen: np.ndarray  # (worlds,) bool
    doubtful: np.ndarray  # (worlds,) bool, where the method itself reports that its result is not certified
    trouble: tuple[str, ...]  # messages of worlds that failed
    seconds: float  # wall time of the run alone, on one thread


Runner = Callable[[], Outcome]


class Candidate(NamedTuple):
    """A method at one setting."""

    method: str  # points of the same method form one curve
    knobs: Mapping[str, Any]  # its setting
    prepare: Callable[[Scene], Runner]
    """Makes the run for a scene. Raises ValueError or ImportError where the method does not cover it."""
    compiled: bool = True  # whether the first run may include compilation and is not timed
    peer: bool = False  # whether it is not a model of vibgym

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
    drives = [(polar_drive(amplitude, phase, w), periods) for amplitude, phase, periods in scene.segments]

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
        if peer == "mujoco":
            return _mujoco(scene, knobs, min(worlds, scene.worlds))
        if peer == "point_sampling":
            return _in_segments(scene, _sampled(scene, knobs), scene.worlds)
        return _in_segments(scene, _scipy(scene, peer, knobs), min(worlds, scene.worlds))

    shown = {name: value for name, value in knobs.items() if value is not None}
    return Candidate(NAMES[peer], shown, prepare, compiled=peer == "point_sampling", peer=True)


Advance = Callable[..., tuple[np.ndarray, np.ndarray, float, list[str]]]
"""Pose and velocity (worlds, 3), amplitude and phase of their elements and periods -> pose, velocity, seconds and messages."""


def _in_segments(scene: Scene, advance: Advance, worlds: int) -> Runner:
    """Return the run of a scene's first worlds, segment by segment; poses of worlds that fail are not finite."""

    def run() -> Outcome:
        pose, velocity = scene.pose[:worlds], scene.velocity[:worlds]
        settled, done, took, trouble = pose, 0, 0.0, []
        for amplitude, phase, periods in scene.segments:
            pose, velocity, seconds, messages = advance(pose, velocity, amplitude[:worlds], phase[:worlds], periods)
            done, took, trouble = done + periods, took + seconds, trouble + messages
            if done == scene.settle:
                settled = pose
        none = np.zeros(worlds, dtype=bool)
        return Outcome(settled, pose, none, none, tuple(trouble), took or float("nan"))

    return run


def _sampled(scene: Scene, knobs: Mapping[str, Any]) -> Advance:
    def advance(pose, velocity, amplitude, phase, periods):
        alive = np.isfinite(pose).all(axis=1)
        start = np.nan_to_num(pose), np.nan_to_num(velocity), amplitude, phase, periods
        began = time.perf_counter()
        with np.errstate(all="ignore"):
            pose, velocity = point_sampling.simulate(scene.surface, scene.part, *start, **knobs)
        seconds = time.perf_counter() - began
        pose[~alive] = np.nan
        lost = alive & ~np.isfinite(pose).all(axis=1)
        return pose, velocity, seconds, ["not finite"] * int(lost.sum())

    return advance


def _scipy(scene: Scene, method: str, knobs: Mapping[str, Any]) -> Advance:
    def advance(pose, velocity, amplitude, phase, periods):
        pose, velocity, seconds, messages = pose.copy(), velocity.copy(), 0.0, []
        for world in np.flatnonzero(np.isfinite(pose).all(axis=1)):
            start = pose[world], velocity[world], amplitude[world], phase[world], periods
            try:
                run = scipy_peers.integrate(scene.surface, scene.part, *start, method=method, **knobs)
            except RuntimeError as error:
                pose[world] = np.nan
                messages.append(" ".join(str(error).split()))
                continue
            pose[world], velocity[world] = run.pose[-1], run.velocity[-1]
            seconds += run.seconds
        return pose, velocity, seconds, messages

    return advance


def _mujoco(scene: Scene, knobs: Mapping[str, Any], worlds: int) -> Runner:
    mujoco_scene.load_mujoco()
    if not scene.held:
        raise checks.refuse("scene", scene.name, "scenes whose drive is held: this MuJoCo scene takes one drive")
    drive = scene.segments[0]
    # Built once here, to raise errors of unsupported scenes.
    mujoco_scene.build(scene.surface, scene.part, scene.pose[0], reach=0.0, **knobs)

    def run() -> Outcome:
        settled, pose = np.full((worlds, 3), np.nan), np.full((worlds, 3), np.nan)
        trouble, took = [], 0.0
        for world in range(worlds):
            start = scene.pose[world], scene.velocity[world]
            held = drive.amplitude[world], drive.phase[world], scene.periods
            try:
                motion = mujoco_scene.simulate(scene.surface, scene.part, *start, *held, **knobs)
            except RuntimeError as error:
                trouble.append(" ".join(str(error).split()))
                continue
            settled[world], pose[world] = motion.pose[scene.settle], motion.pose[-1]
            took += motion.seconds
        none = np.zeros(worlds, dtype=bool)
        return Outcome(settled, pose, none, none, tuple(trouble), took or float("nan"))

    return run
