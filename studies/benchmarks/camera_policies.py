"""Whether policies score the same with the camera and with its statistics: ``python -m studies.benchmarks.camera_policies``.

Every policy runs the same episodes on prototype actuators, behind the model estimator, with the images of a camera, with the
statistical sensor that stands in for them, and with the pose sensor for comparison. What counts are paired differences of the
first two: in success, in the time to the goal where both succeed, and in the errors at the end; beyond chance are those
whose 95 % interval leaves zero out.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from agents.evaluation import statistics
from agents.evaluation.statistics import Interval, bootstrap, quartiles, success_interval
from agents.evaluation.table import quantity
from studies.benchmarks import common
from studies.kept import show
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
QUANTITIES = {
    "success": (100.0, 1, "%"),
    "time to the goal": (1.0, 4, "s"),
    "position error at the end": (1e3, 4, "mm"),
    "heading error at the end": (180.0 / math.pi, 4, "deg"),
}
"""Factor, digits and unit of each."""


def played(task: str, policy: Any, sensor: dict[str, Any], seeds: list[int]) -> Outcomes:
    """The episodes of one policy with one sensor."""
    environment = {"actuators": "prototype", "sensor": {**sensor, "estimator": "model"}}
    env = gym.make_vec(f"vibgym/{task}-v0", num_envs=1, **environment)
    made = make_policy(policy, TaskInfo.of(env, task), seeds[0])
    env.close()
    return rollout(made, task, seeds=seeds, **environment)


def cells(found: Outcomes) -> list[str]:
    """What came of it: with the interval of the success rate, and quartiles."""
    rate = success_interval(found.success, LEVEL, RESAMPLES)
    time = quartiles(found.time_to_goal)
    texts = [
        f"{100.0 * found.success.mean():.1f} % ({100.0 * rate.low:.1f} to {100.0 * rate.high:.1f} %)",
        f"{time.median:.2f} s ({time.lower:.2f} to {time.upper:.2f} s)",
    ]
    for values, factor, unit in ((found.position_error, 1e3, "mm"), (found.heading_error, 180.0 / math.pi, "deg")):
        error = quartiles(values)
        shown = f"{factor * error.median:.3f} {unit} ({factor * error.lower:.3f} to {factor * error.upper:.3f})"
        texts.append(shown if np.isfinite(error.median) else "–")
    return texts


def short(found: Outcomes) -> str:
    """Success and median time."""
    return f"{quantity(found.success.mean(), 100.0, 1, '%')} ({quantity(quartiles(found.time_to_goal).median, 1.0, 2, 's')})"


class Difference(NamedTuple):
    """What a camera scores more than its statistics, on the same seeds."""

    mean: float  # nan where there is nothing to compare
    interval: Interval | None

    @property
    def beyond_chance(self) -> bool:
        """Zero lies outside the interval."""
        return self.interval is not None and not self.interval.low <= 0.0 <= self.interval.high

    def text(self, factor: float, digits: int, unit: str) -> str:
        """With a star beyond chance."""
        if self.interval is None:
            return "–"
        mean, low, high = (
            f"{factor * each:+.{digits}f}" for each in (self.mean, self.interval.low, self.interval.high)
        )
        return f"{mean} {unit} ({low} to {high})" + (" *" if self.beyond_chance else "")


def differences(camera: Outcomes, twin: Outcomes) -> list[Difference]:
    """One for each of the quantities."""
    found = statistics.paired(camera, twin, LEVEL, RESAMPLES)
    return [
        Difference(found["success"].value, found["success"].interval),
        Difference(found["time"].value, found["time"].interval),
        paired(camera.position_error, twin.position_error),
        paired(camera.heading_error, twin.heading_error),
    ]


def largest(found: list[Difference], factor: float, digits: int, unit: str) -> str:
    """Of their means, either way."""
    return f"{max(abs(factor * each.mean) for each in found):.{digits}f} {unit}" if found else "–"


def summary(found: list[list[Difference]]) -> list[list[str]]:
    """Of all policies and cameras, a row for each quantity."""
    lines = []
    for (name, way), each in zip(QUANTITIES.items(), zip(*found, strict=True), strict=True):
        known = [one for one in each if np.isfinite(one.mean)]
        beyond = [one for one in known if one.beyond_chance]
        lines.append([name, str(len(known)), largest(known, *way), str(len(beyond)), largest(beyond, *way)])
    return lines


def paired(first: np.ndarray, second: np.ndarray) -> Difference:
    """Of values that both have."""
    difference = (first - second)[np.isfinite(first) & np.isfinite(second)]
    if len(difference) < 2 or np.ptp(difference) == 0.0:
        return Difference(float("nan"), None)
    return Difference(float(difference.mean()), bootstrap(difference, LEVEL, RESAMPLES))


def main() -> None:
    """Play all."""
    parser = common.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=200, help="of each policy with each sensor")
    parser.add_argument("--tasks", nargs="+", default=list(POLICIES), choices=list(POLICIES))
    parser.add_argument("--cameras", nargs="+", default=list(CAMERAS), choices=list(CAMERAS))
    asked = parser.parse_args()
    seeds = list(range(100_000, 100_000 + asked.episodes))
    lines, found = [], []
    for task in asked.tasks:
        for name, policy in POLICIES[task].items():
            posed = played(task, policy, {"kind": "pose"}, seeds)
            line, each = [task, name, short(posed)], [["pose sensor", *cells(posed)]]
            for camera in asked.cameras:
                settings = {"kind": "camera", **CAMERAS[camera]}
                images = played(task, policy, settings, seeds)
                twin = played(task, policy, {**settings, "statistical": True}, seeds)
                apart = differences(images, twin)
                texts = [one.text(*way) for one, way in zip(apart, QUANTITIES.values(), strict=True)]
                each += [
                    [f"camera, {camera}", *cells(images)],
                    ["its statistics", *cells(twin)],
                    ["difference", *texts],
                ]
                line += [short(images), short(twin)]
                found.append(apart)
            show("camera-policies-each", (f"{task}, {name}", *QUANTITIES), each)
            lines.append(line)
    columns = [head for camera in asked.cameras for head in (f"camera, {camera}", "its statistics")]
    show("camera-policies", ("task", "policy", "pose sensor", *columns), lines, asked.keep)
    heads = ("camera less its statistics", "compared", "largest mean difference", "beyond chance", "largest of these")
    show("camera-policies-differences", heads, summary(found), asked.keep)


if __name__ == "__main__":
    main()
