"""What the real machine costs a step: ``python -m studies.benchmarks.hardware``.

Steps of batches with ideal hardware, with prototype actuators and the pose sensor, and with each estimator on top, measured in
turn; ratios are to ideal hardware, medians over the rounds. The model estimator may cost one more simulation, which is at most
one more step.
"""

from __future__ import annotations

import statistics
import time

import gymnasium as gym

import vibgym  # noqa: F401 - registers the environments

ROUNDS, STEPS = 15, 20
SCENES = (("Rotate", "element", 1024), ("Rotate", "patch", 1024), ("Sort", "patch", 128))
MACHINES = {
    "ideal": {},
    "prototype actuators": {"actuators": "prototype"},
    "prototype actuators, pose sensor": {"actuators": "prototype", "sensor": "pose"},
    "  and Kalman estimator": {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "kalman"}},
    "  and model estimator": {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}},
    "ideal actuators, statistical camera": {"sensor": {"kind": "camera", "statistical": True}},
}


def measure(task: str, action: str, worlds: int) -> None:
    """Print the ratios of one scene."""
    envs = {
        name: gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, action=action, **settings)
        for name, settings in MACHINES.items()
    }
    for env in envs.values():
        env.reset(seed=0)
    space = envs["ideal"].action_space
    space.seed(0)
    actions = [space.sample() for _ in range(4)]
    took: dict[str, list[float]] = {name: [] for name in envs}
    for _ in range(ROUNDS):
        for name, env in envs.items():
            began = time.perf_counter()
            for k in range(STEPS):
                env.step(actions[k % 4])
            took[name].append(time.perf_counter() - began)
    print(f"{task}, {action}, {worlds} worlds")
    for name, times in took.items():
        ratios = [each / ideal for each, ideal in zip(times[2:], took["ideal"][2:], strict=True)]
        one = 1e6 * statistics.median(times[2:]) / STEPS / worlds
        print(f"  {name:<38} {one:8.2f} us a world and step   {statistics.median(ratios):5.2f} x ideal")


def main() -> None:
    """Measure every scene."""
    for scene in SCENES:
        measure(*scene)


if __name__ == "__main__":
    main()
