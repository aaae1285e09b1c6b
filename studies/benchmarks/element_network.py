"""Evaluate element networks on surfaces of other sizes: ``python -m studies.benchmarks.element_network``.

All elements share a network, so a policy trained on 8 x 8 elements runs on any surface. Every training in ``results/policies``
plays Align on new seeds: success with its 95 % interval, median time to goal, and median time over the bound.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from agents.evaluation.statistics import success_interval
from studies.benchmarks import common
from vibgym.policies.measures import Measures
from vibgym.policies.rollout import rollout
from vibgym.policies.trained.storage import load_set
from vibgym.policies.trained.trained import KIND, VERSION
from vibgym.seeds import RANGES

SURFACES = ((8, 8), (8, 32), (16, 64))


def main() -> None:
    """Evaluate and print."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--policies", type=Path, nargs="+", help="default: all element networks in results/policies")
    asked = parser.parse_args()
    found = sorted(
        path for kind in ("phasor", "element") for path in Path("results/policies").glob(f"align-{kind}-seed-*.json")
    )
    seeds = RANGES["held_out"][: asked.episodes]
    for path in asked.policies or found:
        action = load_set(path, KIND, VERSION)[1]["action"]
        for rows, columns in SURFACES:
            scene = {"action": action, "surface": {"rows": rows, "columns": columns}}
            played = rollout(str(path), "Align", seeds=seeds, keep=Measures, **scene)
            interval = success_interval(played.success, 0.95, 2000)
            print(
                f"{path.stem:<24}{rows:3d} x {columns:<3d}{100 * played.success.mean():6.1f} % of {asked.episodes} "
                f"({100 * interval.low:.1f} to {100 * interval.high:.1f} %)   {np.nanmedian(played.time_to_goal):.2f} s   "
                f"{np.nanmedian(played.time_over_bound):.2f} x the bound",
                flush=True,
            )


if __name__ == "__main__":
    main()
