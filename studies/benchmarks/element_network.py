"""The element networks on surfaces they were not trained on: ``python -m studies.benchmarks.element_network``.

The network is shared by all elements, so a policy trained on 8 x 8 elements runs on any surface unchanged. Align, fresh
seeds, every training seed in ``results/policies``: success with its 95 % interval, median time to goal, multiples of the bound.
"""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import numpy as np

import vibgym  # noqa: F401 - registers the environments
from agents.evaluation.statistics import success_interval
from studies.benchmarks import common
from vibgym.policies.measures import Measures
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.storage import load_set
from vibgym.policies.trained.trained import KIND, VERSION

SURFACES = ((8, 8), (8, 32), (16, 64))
FIRST_SEED = 300_000


def main() -> None:
    """Play and print."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--policies", type=Path, nargs="+", help="instead of all element networks in results/policies")
    asked = parser.parse_args()
    found = sorted(
        path for kind in ("phasor", "element") for path in Path("results/policies").glob(f"align-{kind}-seed-*.json")
    )
    for path in asked.policies or found:
        action = load_set(path, KIND, VERSION)[1]["action"]
        for rows, columns in SURFACES:
            scene = {"surface": {"rows": rows, "columns": columns}}
            env = gym.make_vec("vibgym/Align-v0", num_envs=1, action=action, **scene)
            policy = make_policy(str(path), TaskInfo.of(env))
            played = rollout(
                policy, "Align", seeds=range(FIRST_SEED, FIRST_SEED + asked.episodes), keep=Measures, **scene
            )
            interval = success_interval(played.success, 0.95, 2000)
            print(
                f"{path.stem:<24}{rows:3d} x {columns:<3d}{100 * played.success.mean():6.1f} % of {asked.episodes} "
                f"({100 * interval.low:.1f} to {100 * interval.high:.1f} %)   {np.nanmedian(played.time_to_goal):.2f} s   "
                f"{np.nanmedian(played.time_over_bound):.2f} x the bound",
                flush=True,
            )


if __name__ == "__main__":
    main()
