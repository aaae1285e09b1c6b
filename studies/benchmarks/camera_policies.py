"""Compare policies with the camera and with its statistical model: ``python -m studies.benchmarks.camera_policies``.

Every policy plays the same seeds on prototype actuators with the model estimator, with camera images, with the statistical
sensor, and with the pose sensor for comparison. The first two are compared by paired differences in success, in time to goal
where both succeed, and in the final errors; a difference is significant if its 95 % interval excludes zero.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.statistics import Interval, bootstrap, mean_difference, quartiles, success_difference
from agents.evaluation.table import quantity
from studies.benchmarks import common
from studies.kept import show
from vibgym.policies.rollout import Outcomes, rollout
from vibgym.seeds import RANGES

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


def played(task: str, policy: Any, sensor: dict[str, Any], seeds: range) -> Outcomes:
    """Return the outcomes of a policy with a sensor."""
    return rollout(policy, task, seeds=seeds, actuators="prototype", sensor={**sensor, "estimator": "model"})


def short(found: Outcomes) -> str:
    """Format success and median time."""
    return f"{quantity(found.success.mean(), 100.0, 1, '%')} ({quantity(quartiles(found.time_to_goal).median, 1.0, 2, 's')})"


class Difference(NamedTuple):
    """Mean of camera minus statistical model on the same seeds; nan without data."""

    mean: float
    interval: Interval | None

    @property
    def significant(self) -> bool:
        """Whether the interval excludes zero."""
        return self.interval is not None and not self.interval.low <= 0.0 <= self.interval.high


def differences(camera: Outcomes, model: Outcomes) -> list[Difference]:
    """Return a difference for each of :data:`QUANTITIES`."""
    success = success_difference(camera.success[None], model.success[None], LEVEL, RESAMPLES)
    time = mean_difference((camera.time_to_goal - model.time_to_goal)[None], LEVEL, RESAMPLES)
    return [
        Difference(success.value, success.interval),
        Difference(time.value, time.interval),
        paired(camera.position_error, model.position_error),
        paired(camera.heading_error, model.heading_error),
    ]


def paired(first: np.ndarray, second: np.ndarray) -> Difference:
    """Return the difference of values that are finite in both."""
    difference = (first - second)[np.isfinite(first) & np.isfinite(second)]
    if len(difference) < 2 or np.ptp(difference) == 0.0:
        return Difference(float("nan"), None)
    return Difference(float(difference.mean()), bootstrap(difference, LEVEL, RESAMPLES))


def largest(found: list[Difference], factor: float, digits: int, unit: str) -> str:
    """Format the largest magnitude of the means."""
    return f"{max(abs(factor * each.mean) for each in found):.{digits}f} {unit}" if found else "–"


def summary(found: list[list[Difference]]) -> list[list[str]]:
    """Return a row per quantity, over all policies and cameras."""
    lines = []
    for (name, units), each in zip(QUANTITIES.items(), zip(*found, strict=True), strict=True):
        known = [one for one in each if np.isfinite(one.mean)]
        significant = [one for one in known if one.significant]
        lines.append(
            [name, str(len(known)), largest(known, *units), str(len(significant)), largest(significant, *units)]
        )
    return lines


def main() -> None:
    """Evaluate and print."""
    parser = common.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=200, help="per policy and sensor")
    parser.add_argument("--tasks", nargs="+", default=list(POLICIES), choices=list(POLICIES))
    parser.add_argument("--cameras", nargs="+", default=list(CAMERAS), choices=list(CAMERAS))
    asked = parser.parse_args()
    seeds = RANGES["evaluation"][: asked.episodes]
    lines, found = [], []
    for task in asked.tasks:
        for name, policy in POLICIES[task].items():
            line = [task, name, short(played(task, policy, {"kind": "pose"}, seeds))]
            for camera in asked.cameras:
                settings = {"kind": "camera", **CAMERAS[camera]}
                images = played(task, policy, settings, seeds)
                model = played(task, policy, {**settings, "statistical": True}, seeds)
                line += [short(images), short(model)]
                found.append(differences(images, model))
            lines.append(line)
    columns = [head for camera in asked.cameras for head in (f"camera, {camera}", "its statistics")]
    show("camera-policies", ("task", "policy", "pose sensor", *columns), lines, asked.keep)
    heads = ("camera minus its statistics", "compared", "largest mean difference", "significant", "largest of these")
    show("camera-policies-differences", heads, summary(found), asked.keep)


if __name__ == "__main__":
    main()
