"""Time per step with hardware models: ``python -m studies.benchmarks.hardware``.

Steps of batches with ideal hardware, with prototype actuators and the pose sensor, and with each estimator, measured in turn.
Output: ratios to ideal hardware, medians over the rounds, and time per world and step. The model estimator may take the time of
one more simulation, at most one more step.
"""

from __future__ import annotations

import gymnasium as gym

import vibgym  # noqa: F401 - registers the environments
from studies.benchmarks import common
from studies.kept import show

STEPS, WARM = 20, 2
SCENES = (("Rotate", "element", 1024), ("Rotate", "patch", 1024), ("Sort", "patch", 128))
MACHINES = {
    "ideal": {},
    "prototype actuators": {"actuators": "prototype"},
    "prototype actuators, pose sensor": {"actuators": "prototype", "sensor": "pose"},
    "and Kalman estimator": {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "kalman"}},
    "and model estimator": {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}},
    "ideal actuators, statistical camera": {"sensor": {"kind": "camera", "statistical": True}},
}
TARGETS = {
    "prototype actuators, pose sensor": "1.33 x",
    "and model estimator": "one more simulation",
    "ideal actuators, statistical camera": "1.10 x",
}
"""For Rotate."""


def measure(task: str, action: str, worlds: int, rounds: int) -> dict[str, str]:
    """Return ratio, and us per world and step, of each hardware model in a scene."""
    envs = {
        name: gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, action=action, **settings)
        for name, settings in MACHINES.items()
    }
    return common.step_costs(envs, STEPS, rounds, WARM)


def main() -> None:
    """Measure every scene."""
    parser = common.parser(__doc__)
    parser.add_argument("--rounds", type=int, default=13, help=f"after {WARM} rounds without measurement")
    asked = parser.parse_args()
    found = [measure(*scene, asked.rounds) for scene in SCENES]
    scenes = [f"{task}, `{action}`, {worlds} worlds" for task, action, worlds in SCENES]
    lines = [[name, *(each[name] for each in found), TARGETS.get(name, "")] for name in MACHINES]
    show("hardware-cost", ("a step", *scenes, "target for Rotate"), lines, asked.keep)


if __name__ == "__main__":
    main()
