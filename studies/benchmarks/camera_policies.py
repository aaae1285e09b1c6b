"""Whether policies score the same with the camera and with its statistics: ``python -m studies.benchmarks.camera_policies``.

Every policy runs the same episodes on prototype actuators, behind the model estimator, with the images of a camera, with the
statistical sensor that stands in for them, and with the pose sensor for comparison. What counts are paired differences of the
first two: in success, in the time to the goal where both succeed, and in the errors at the end.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import gymnasium as gym
import numpy as np

from agents.evaluation.resampling import Interval, bootstrap
from agents.evaluation.statistics import compare, quartiles, success_interval
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import Outcomes, rollout
from vibgym.policies.task_info import TaskInfo

LEVEL, RESAMPLES = 0.95, 9999

LEARNED = {"kind": "trained", "path": "vibgym/policies/trained/shipped/{task}.json"}
POLICIES = {
    "Transport": {"learned": LEARNED, "local_field": "local_field"},
    "Align": {"learned": LEARNED, "local_field": "local_field"},
    "Rotate": {"learned": LEARNED, "local_field": "local_field"},
    "Sort": {"planner": "planner"},
}
CAMERAS = {
    "half of the lines": {},
    "all lines": {"lines": "all"},
    "half of the lines, whole pixels": {"edge": "threshold"},
    "interlaced lines": {"lines": "interlaced"},
}


def played(task: str, policy: Any, sensor: dict[str, Any], seeds: list[int]) -> Outcomes:
    """The episodes of one policy with one sensor."""
    environment = {"actuators": "prototype", "sensor": {**sensor, "estimator": "model"}}
    env = gym.make_vec(f"vibgym/{task}-v0", num_envs=1, **environment)
    made = make_policy(policy, TaskInfo.of(env, task), seeds[0])
    env.close()
    return rollout(made, task, seeds=seeds, **environment)


def row(name: str, found: Outcomes) -> str:
    """What came of it."""
    rate = success_interval(found.success, LEVEL, RESAMPLES)
    time = quartiles(found.time_to_goal)
    texts = [
        f"{100.0 * found.success.mean():.1f} % ({100.0 * rate.low:.1f} to {100.0 * rate.high:.1f} %)",
        f"{time.median:.2f} s ({time.lower:.2f} to {time.upper:.2f} s)",
    ]
    for values, factor, unit in ((found.position_error, 1e3, "mm"), (found.heading_error, 180.0 / math.pi, "deg")):
        error = quartiles(values)
        shown = f"{factor * error.median:.3f} {unit} ({factor * error.lower:.3f} to {factor * error.upper:.3f})"
        texts.append(shown if np.isfinite(error.median) else "-")
    return f"| {name} | " + " | ".join(texts) + " |"


def differences(names: tuple[str, str], camera: Outcomes, twin: Outcomes) -> str:
    """What a camera scores more than its statistics, on the same seeds."""
    found = compare("", names, camera, twin, LEVEL, RESAMPLES)
    texts = [
        f"success {100.0 * found.success_difference:+.1f} % "
        f"({100.0 * found.success_interval.low:+.1f} to {100.0 * found.success_interval.high:+.1f} %)"
    ]
    columns = (
        ("time", found.time_difference, found.time_interval, 1.0, "s"),
        ("position", *paired(camera.position_error, twin.position_error), 1e3, "mm"),
        ("heading", *paired(camera.heading_error, twin.heading_error), 180.0 / math.pi, "deg"),
    )
    for name, mean, interval, factor, unit in columns:
        if interval is not None:
            star = "" if interval.low <= 0.0 <= interval.high else " *"
            low, high = factor * interval.low, factor * interval.high
            texts.append(f"{name} {factor * mean:+.4f} {unit} ({low:+.4f} to {high:+.4f}){star}")
    return "  camera - statistics: " + ", ".join(texts)


def paired(first: np.ndarray, second: np.ndarray) -> tuple[float, Interval | None]:
    """Mean of the paired differences and its interval; None where there is nothing to compare."""
    difference = (first - second)[np.isfinite(first) & np.isfinite(second)]
    if len(difference) < 2 or np.ptp(difference) == 0.0:
        return float("nan"), None
    return float(difference.mean()), bootstrap(difference, LEVEL, RESAMPLES)


def main() -> None:
    """Play and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=200, help="of each policy with each sensor")
    parser.add_argument("--tasks", nargs="+", default=list(POLICIES), choices=list(POLICIES))
    parser.add_argument("--cameras", nargs="+", default=list(CAMERAS), choices=list(CAMERAS))
    asked = parser.parse_args()
    seeds = list(range(100_000, 100_000 + asked.episodes))
    for task in asked.tasks:
        for name, policy in POLICIES[task].items():
            print(f"{task}, {name}", flush=True)
            print(row("pose sensor", played(task, policy, {"kind": "pose"}, seeds)), flush=True)
            for camera in asked.cameras:
                settings = {"kind": "camera", **CAMERAS[camera]}
                images = played(task, policy, settings, seeds)
                twin = played(task, policy, {**settings, "statistical": True}, seeds)
                print(row(f"camera, {camera}", images), row(f"statistics of it, {camera}", twin), sep="\n")
                print(differences(("camera", "statistics"), images, twin), flush=True)


if __name__ == "__main__":
    main()
