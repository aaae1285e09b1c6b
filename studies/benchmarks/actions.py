"""Time per step by action: ``python -m studies.benchmarks.actions``.

Steps of batches under uniform random actions, measured in turn, on one thread. Output: ratios to ``patch``, medians over the
rounds, and processor time per world and step. Random wrenches spin parts fast, so their steps include more simulation.
"""

from __future__ import annotations

import os
import time

import gymnasium as gym

import vibgym  # noqa: F401 - registers the environments
from studies.benchmarks import common
from studies.kept import show

STEPS, WARM = 8, 3
SCENES = (("Rotate", 1024), ("Sort", 256), ("Swap", 64), ("Pack", 64))
ACTIONS = ("patch", "field", "wrench", "velocity", "target")


def main() -> None:
    """Measure every scene."""
    parser = common.parser(__doc__)
    parser.add_argument("--rounds", type=int, default=15, help=f"after {WARM} rounds without measurement")
    asked = parser.parse_args()
    os.environ["VIBGYM_THREADS"] = "1"
    found = []
    for task, worlds in SCENES:
        envs = {name: gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, action=name) for name in ACTIONS}
        found.append(common.step_costs(envs, STEPS, asked.rounds, WARM, time.thread_time))
    lines = [[f"`{name}`", *(each[name] for each in found)] for name in ACTIONS]
    show("action-cost", ("action", *(f"{task}, {worlds} worlds" for task, worlds in SCENES)), lines, asked.keep)


if __name__ == "__main__":
    main()
