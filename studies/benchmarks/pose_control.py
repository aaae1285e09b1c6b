"""Pose errors at a goal for several hardware models and cameras: ``python -m studies.benchmarks.pose_control``.

Every case plays the same goals of Align for 15 s each. Output: median over the goals, 95 % quantile in brackets, and maximum of

- position and heading error: rms over the last 10 s,
- overshoot: largest distance beyond the goal along the straight line to it, relative to the initial distance,
- time until success in Align, hold included, and the same minus its lower bound (:class:`vibgym.bounds.TimeBound`),
- elements on: share of the last 10 s in which the command of any element is not zero (mean).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.table import quantity
from studies import common
from studies.kept import show
from vibgym.envs import VibgymVectorEnv
from vibgym.policies.measures import least_times
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import Episodes
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks import TASKS
from vibgym.tasks.base import HOLD_PERIODS
from vibgym.tasks.pose import Align

SECONDS, LAST = 15.0, 10.0
PARTS = ("aluminium_block", "steel_block")
POSE = {"kind": "pose", "estimator": "model"}
CAMERA = {"kind": "camera", "statistical": True, "estimator": "model"}


def machine(sensor: dict[str, Any] = POSE, randomize: dict[str, Any] | None = None, **hardware: Any) -> dict[str, Any]:
    """Return the settings of an environment with prototype actuators."""
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
    "camera, grey levels": machine({**CAMERA, "lines": "all"}),
    "camera, grey, half lines": machine(CAMERA),
    "camera, binary, half lines": machine({**CAMERA, "edge": "threshold"}),
}


class Stay(Align):
    """Align with episodes that continue at the goal."""

    def rules(self, periods: int) -> Any:
        return super().rules(periods)._replace(hold=2**62)


class Held(NamedTuple):
    """Outcomes, arrays (goals,)."""

    distance: np.ndarray  # m, rms over the last seconds
    turn: np.ndarray  # rad, likewise
    overshoot: np.ndarray  # relative to the initial distance
    time: np.ndarray  # s, to success; nan without
    above: np.ndarray  # s, above the bound; nan without success, or where none is known
    on: np.ndarray  # share of the last seconds


def hold(
    policy: Any, part: Any, seeds: Sequence[int], seconds: float = SECONDS, last: float = LAST, **machine: Any
) -> Held:
    """Bring a part to a goal for each seed, and hold it there; errors are those of the ``last`` s of ``seconds``."""
    if "Stay" not in TASKS:
        TASKS.register("Stay", Stay)
    machine = {"parts": [part], **machine}
    info = TaskInfo.of(VibgymVectorEnv("Align", num_envs=1, **machine), "Align")
    made = make_policy(policy, info)
    env = VibgymVectorEnv(
        "Stay", num_envs=len(seeds), action=made.action, observation=made.observation, autoreset_mode="Disabled",
        max_episode_steps=round(seconds / info.step_time), **machine,
    )  # fmt: skip
    episodes, task, tail = Episodes(made, env, seeds), env.task, round(last / env.step_time)
    bound, error, on = least_times(env), [env.truth.error[:, 0]], []
    for _ in episodes:
        on.append([env.phasors(world).any() for world in range(len(seeds))])
        error.append(env.truth.error[:, 0])
    env.close()
    path, heading = np.array(error)[..., :2], np.abs(np.array(error)[..., 2])
    distance, away = np.linalg.norm(path, axis=-1), np.linalg.norm(path[0], axis=-1)
    beyond = -(path * path[0]).sum(axis=-1) / away
    within = (distance <= task.position_tolerance) & (heading <= task.heading_tolerance)
    time = env.step_time * reached(within, HOLD_PERIODS)
    return Held(
        distance=np.sqrt((distance[-tail:] ** 2).mean(axis=0)),
        turn=np.sqrt((heading[-tail:] ** 2).mean(axis=0)),
        overshoot=np.maximum(beyond.max(axis=0), 0.0) / away,
        time=time,
        above=time - bound,
        on=np.array(on)[-tail:].mean(axis=0),
    )


def reached(within: np.ndarray, hold: int) -> np.ndarray:
    """Return the steps (goals,) until a part was within tolerances for ``hold`` consecutive steps; nan if never."""
    run, steps = np.zeros(within.shape[1], dtype=int), np.full(within.shape[1], np.nan)
    for k, now in enumerate(within[1:]):
        run = np.where(now, run + 1, 0)
        steps[np.isnan(steps) & (run == hold)] = k + 1
    return steps


def figures(values: np.ndarray, factor: float, digits: int) -> str:
    """Format median [95 %] maximum of the finite values."""
    known = factor * values[np.isfinite(values)]
    if not len(known):
        return "–"
    median, most, largest = np.quantile(known, (0.5, 0.95, 1.0))
    return f"{median:.{digits}f} [{most:.{digits}f}] {largest:.{digits}f}"


HEADS = (
    "prototype hardware", "part", "position, mm: median [95 %] largest", "heading, deg", "overshoot, % of the distance",
    "time, s", "above the bound, s", "reached", "elements on",
)  # fmt: skip


def row(held: Held) -> list[str]:
    """Return the cells of a case."""
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
    """Evaluate and print."""
    parser = common.parser(__doc__)
    parser.add_argument("--goals", type=int, default=200, help="per case and part")
    parser.add_argument("--seed", type=int, default=9_000_000)
    parser.add_argument("--parts", nargs="+", default=list(PARTS))
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--policy", type=common.policy, default={"kind": "local_field", "law": "pose"}, help="JSON")
    asked = parser.parse_args()
    lines, seeds = [], range(asked.seed, asked.seed + asked.goals)
    for case in asked.cases:
        for part in asked.parts:
            held = hold(asked.policy, part, seeds, **CASES[case])
            lines.append([case, part.replace("_", " "), *row(held)])
    show("pose-control", HEADS, lines, asked.keep)


if __name__ == "__main__":
    main()
