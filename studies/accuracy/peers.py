"""The peers as candidates: SciPy's integrators, point sampling, the MuJoCo scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from studies.accuracy import mujoco_scene, point_sampling, scipy_peers
from studies.accuracy.candidates import Candidate, Outcome, Runner
from studies.accuracy.scenes import Scene
from vibgym import checks

NAMES = {"point_sampling": "point sampling", "LSODA": "SciPy LSODA", "DOP853": "SciPy DOP853", "mujoco": "MuJoCo"}

World = Callable[[int], tuple[np.ndarray, np.ndarray, float]]
"""Index of a world -> pose after the settling periods, pose at the end, and seconds."""


def peer_candidate(peer: str, knobs: Mapping[str, Any], worlds: int) -> Candidate:
    """A peer at one setting.

    Args:
        peer: one of :data:`NAMES`.
        knobs: all of its knobs.
        worlds: how many of a scene's worlds it runs, at most; point sampling always runs all.
    """

    def prepare(scene: Scene) -> Runner:
        if not scene.slides:
            raise (
                checks.refuse(
                    "scene", scene.name, "scenes that always slide: this peer's equations have no static friction"
                )
                if peer != "mujoco"
                else checks.refuse(
                    "scene", scene.name, "scenes that always slide: this MuJoCo scene has one coefficient of friction"
                )
            )
        if peer == "point_sampling":
            return _sampled(scene, knobs)
        one = _mujoco(scene, knobs) if peer == "mujoco" else _scipy(scene, peer, knobs)
        return _each(one, min(worlds, scene.worlds))

    shown = {name: value for name, value in knobs.items() if value is not None}
    return Candidate(NAMES[peer], shown, prepare, compiled=peer == "point_sampling", peer=True)


def _sampled(scene: Scene, knobs: Mapping[str, Any]) -> Runner:
    # All segments at full size: the sampler checks and copies its arrays in the time that is measured, but that is small.
    def run() -> Outcome:
        pose, velocity, settled, done, took = scene.pose, scene.velocity, scene.pose, 0, 0.0
        for amplitude, phase, periods in scene.segments:
            began = time.perf_counter()
            with np.errstate(all="ignore"):
                pose, velocity = point_sampling.simulate(
                    scene.surface, scene.part, np.nan_to_num(pose), np.nan_to_num(velocity), amplitude, phase, periods,
                    **knobs,
                )  # fmt: skip
            took += time.perf_counter() - began
            done += periods
            if done == scene.settle:
                settled = pose
        lost = ~np.isfinite(pose).all(axis=1)
        none = np.zeros(scene.worlds, dtype=bool)
        return Outcome(settled, pose, none, none, ("not finite",) * int(lost.sum()), took)

    return run


def _each(one: World, worlds: int) -> Runner:
    """Worlds one after the other; what goes wrong in one is that world's failure."""

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
            run = scipy_peers.integrate(
                scene.surface,
                scene.part,
                pose,
                velocity,
                amplitude[world],
                phase[world],
                periods,
                method=method,
                **knobs,
            )
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
    # Build once: what it does not cover it says here.
    mujoco_scene.build(scene.surface, scene.part, scene.pose[0], reach=0.0, **knobs)

    def one(world: int) -> tuple[np.ndarray, np.ndarray, float]:
        run = mujoco_scene.simulate(
            scene.surface, scene.part, scene.pose[world], scene.velocity[world], drive.amplitude[world],
            drive.phase[world], scene.periods, **knobs,
        )  # fmt: skip
        return run.pose[scene.settle], run.pose[-1], run.seconds

    return one
