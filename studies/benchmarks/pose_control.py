"""How well the pose law holds a goal, on hardware and cameras of all sorts: ``python -m studies.benchmarks.pose_control``.

Every case plays the same goals of Align, for 15 s each whether or not they are reached. A part's error is the rms over the
last 10 s of its distance to the goal, and of its heading's; printed are the median over the goals, the 95 % quantile in
brackets, and the largest. Overshoot is the farthest that a part gets beyond its goal along the straight way there, as a
share of that way. Time is what passes until Align would call it a success, the hold included, above the lower bound on it
(:class:`vibgym.bounds.TimeBound`). Elements are on in steps whose command is not zero: the share of the last 10 s in which
any is.
"""

from __future__ import annotations

import json
import math
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.table import quantity
from studies.benchmarks import common
from studies.kept import show
from vibgym.envs import VibgymVectorEnv
from vibgym.policies.measures import least_times
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks import TASKS
from vibgym.tasks.base import HOLD_PERIODS
from vibgym.tasks.pose import Align

SECONDS, LAST = 15.0, 10.0
PARTS = ("aluminium_block", "steel_block")
POSE = {"kind": "pose", "estimator": "model"}


def machine(sensor: dict[str, Any] = POSE, randomize: dict[str, Any] | None = None, **hardware: Any) -> dict[str, Any]:
    """Settings of an environment with prototype actuators."""
    varied = {} if randomize is None else {"randomize": randomize}
    return {"actuators": {"kind": "prototype", **hardware}, "sensor": sensor, **varied}


CASES: dict[str, dict[str, Any]] = {
    "default": machine(),
    "half the noise": machine({**POSE, "noise": [0.5e-4, math.radians(0.1)]}),
    "no noise, no spread": machine({**POSE, "noise": 0.0}, gain_spread=0.0, phase_spread=0.0),
    "friction +-15 %": machine(randomize={"friction": [0.85, 1.15]}),
    "latency 2": machine(latency=2),
    "dead zone 0.15 mm": machine(dead_zone=1.5e-4),
    "incline up to 1 mrad": machine(randomize={"incline": [0.0, 1e-3]}),
    "10 % dead": machine(dead=0.1),
    "camera, grey levels": machine({"kind": "camera", "lines": "all", "estimator": "model"}),
    "camera, grey, half lines": machine({"kind": "camera", "estimator": "model"}),
    "camera, binary, half lines": machine({"kind": "camera", "edge": "threshold", "estimator": "model"}),
}


class Stay(Align):
    """Align whose episodes go on at the goal."""

    def rules(self, periods: int) -> Any:
        return super().rules(periods)._replace(hold=2**62)


class Held(NamedTuple):
    """What became of every goal, arrays (goals,)."""

    distance: np.ndarray  # m, rms over the last 10 s
    turn: np.ndarray  # rad, likewise
    overshoot: np.ndarray  # share of the way
    time: np.ndarray  # s, to success; nan without
    above: np.ndarray  # s, above the bound; nan without success, or where none is known
    on: np.ndarray  # share of the last 10 s


def hold(policy: Any, part: Any, goals: int, seed: int, seconds: float = SECONDS, **machine: Any) -> Held:
    """Bring a part to as many goals, and keep it there."""
    kept: dict[str, Any] = {"task": "Stay", "parts": [part], "max_episode_steps": 10**6, **machine}
    made = make_policy(policy, TaskInfo.of(VibgymVectorEnv(num_envs=1, **kept), "Align"))
    env = VibgymVectorEnv(num_envs=goals, action=made.action, observation=made.observation, **kept)
    task, step, base = env.unwrapped.task, env.step_time, env.unwrapped
    steps, last = round(seconds / step), round(LAST / step)
    seen, _ = env.reset(seed=seed)
    least = least_times(env.unwrapped)
    error, on, memory = np.empty((steps + 1, goals, 3)), np.empty((steps, goals), dtype=bool), None
    error[0] = base.truth.error[:, 0]
    for k in range(steps):
        action, memory = made.predict(seen, memory)
        seen, *_ = env.step(action)
        on[k] = [base.phasors(world).any() for world in range(goals)]
        error[k + 1] = base.truth.error[:, 0]
    way = np.linalg.norm(error[0, :, :2], axis=-1)
    distance, left = np.linalg.norm(error[..., :2], axis=-1), np.abs(error[..., 2])
    beyond = -(error[..., :2] * error[0, :, :2]).sum(axis=-1) / way
    within = (distance <= task.position_tolerance) & (left <= task.heading_tolerance)
    env.close()
    time = step * reached(within, HOLD_PERIODS)
    return Held(
        distance=np.sqrt((distance[-last:] ** 2).mean(axis=0)),
        turn=np.sqrt((left[-last:] ** 2).mean(axis=0)),
        overshoot=np.maximum(beyond.max(axis=0), 0.0) / way,
        time=time,
        above=time - least,
        on=on[-last:].mean(axis=0),
    )


def reached(within: np.ndarray, hold: int) -> np.ndarray:
    """Steps (goals,) until a part has been within its tolerances at the ends of so many in a row; nan if never."""
    run, steps = np.zeros(within.shape[1], dtype=int), np.full(within.shape[1], np.nan)
    for k, now in enumerate(within[1:]):
        run = np.where(now, run + 1, 0)
        steps[np.isnan(steps) & (run == hold)] = k + 1
    return steps


def figures(values: np.ndarray, factor: float, digits: int) -> str:
    """Median [95 %] largest, of those that are numbers."""
    known = factor * values[np.isfinite(values)]
    if not len(known):
        return "–"
    median, most, largest = np.quantile(known, (0.5, 0.95, 1.0))
    return f"{median:.{digits}f} [{most:.{digits}f}] {largest:.{digits}f}"


HEADS = (
    "prototype hardware",
    "part",
    "position, mm: median [95 %] largest",
    "heading, deg",
    "overshoot, % of the way",
    "time, s",
    "above the bound, s",
    "reached",
    "elements on",
)


def row(held: Held) -> list[str]:
    """What came of a case."""
    return [
        figures(held.distance, 1e3, 3),
        figures(held.turn, 180.0 / math.pi, 3),
        figures(held.overshoot, 100.0, 2),
        figures(held.time, 1.0, 2),
        figures(held.above, 1.0, 2),
        f"{np.isfinite(held.time).sum()} of {len(held.time)}",
        quantity(held.on.mean(), 100.0, 1, "%"),
    ]


def main() -> None:
    """Play, print, keep."""
    parser = common.parser(__doc__)
    parser.add_argument("--goals", type=int, default=200, help="of each case and part")
    parser.add_argument("--seed", type=int, default=9_000_000)
    parser.add_argument("--parts", nargs="+", default=list(PARTS))
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--policy", type=json.loads, default={"kind": "local_field", "law": "pose"}, help="JSON")
    parser.add_argument("--images", action="store_true", help="take cameras' images instead of their statistics")
    asked = parser.parse_args()
    TASKS.register("Stay", Stay)
    lines = []
    for case in asked.cases:
        settings = CASES[case]
        if settings["sensor"]["kind"] == "camera" and not asked.images:
            settings = {**settings, "sensor": {**settings["sensor"], "statistical": True}}
        for part in asked.parts:
            held = hold(asked.policy, part, asked.goals, asked.seed, **settings)
            lines.append([case, part.replace("_", " "), *row(held)])
    show("pose-control", HEADS, lines, asked.keep)


if __name__ == "__main__":
    main()
