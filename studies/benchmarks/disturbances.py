"""Controllers with and without disturbance observer: ``python -m studies.benchmarks.disturbances [--episodes 200] [--keep]``.

Cases: rigid parts in the tilting model, on elements whose friction is 0.75 to 1.25 of its nominal value, with a tilt of 3 deg
every four seconds (``disturbed``); and flat parts on a table inclined by 20 mrad. Output: success, and mean time to success.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from studies import kept
from studies.benchmarks import common
from vibgym.policies.rollout import rollout
from vibgym.seeds import RANGES

OBSERVERS = ("none", "disturbance")

CASES: dict[str, dict[str, Any]] = {
    "disturbed, patches": {
        "model": "tilting",
        "randomize": {"patches": [0.75, 1.25], "disturbance": {"rate": 0.25, "tilt_deg": 3.0}},
    },
    "inclined": {"randomize": {"incline": [0.02, 0.02]}},
}
POLICIES = ("lqr", "pid", "local_field", "pose")


def main() -> None:
    """Print a row for every hardware, case, task and controller."""
    parser = common.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=200, help="per cell")
    parser.add_argument("--hardware", nargs="+", choices=list(common.HARDWARE), default=list(common.HARDWARE))
    parser.add_argument("--tasks", nargs="+", default=["Align", "Transport", "Rotate"])
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    asked = parser.parse_args()
    rows = []
    for hardware in asked.hardware:
        for case in asked.cases:
            for task in asked.tasks:
                for kind in POLICIES:
                    cells = []
                    for observer in OBSERVERS:
                        seeds = RANGES["held_out"][: asked.episodes]
                        settings = {**common.HARDWARE[hardware], **CASES[case]}
                        found = rollout({"kind": kind, "observer": observer}, task, seeds=seeds, **settings)
                        time = f"{found.time_to_goal[found.success].mean():.2f} s" if found.success.any() else "–"
                        cells.append(f"{100.0 * np.mean(found.success):.1f} %, {time}")
                    rows.append([hardware, case, task, kind, *cells])
                    print(*rows[-1], sep=" | ", flush=True)
    heads = ["hardware", "case", "task", "controller", *(f"observer: {each}" for each in OBSERVERS)]
    kept.show("disturbances", heads, rows, asked.keep)


if __name__ == "__main__":
    main()
