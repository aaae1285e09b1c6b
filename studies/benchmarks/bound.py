"""Compare policies with their time bounds: ``python -m studies.benchmarks.bound [--episodes N] [TASK ...]``.

Every policy plays the same seeds, unused in training and reports, on ideal and on prototype hardware. Output: median and
smallest time over bound, steps above the bound, and number of episodes below it; for Feed, good parts per minute over the upper
bound. The command fails if an episode beats its bound. See docs/bound.md for the bounds.
"""

from __future__ import annotations

import sys

import numpy as np

from studies.benchmarks import common
from vibgym import checks
from vibgym.policies.measures import MeasuredOutcomes, Measures
from vibgym.policies.rollout import rollout

FIRST, BATCH = 8_000_000, 500
POLICIES = ("local_field", "vibgym/policies/trained/shipped/{task}.json")
MULTIPART = {
    "Feed": "lanes", "FeedHeaps": "lanes", "Swap": "lanes", "SwapCrowded": "lanes", "Pack": "two_phases",
    "PackFull": "two_phases", "Push": "push", "PushAny": "push",
}  # fmt: skip
"""Tasks without a known optimal policy, and a policy of each."""

TASKS = ("Transport", "Align", "Rotate", *MULTIPART)


def measure(task: str, hardware: str, policy: str, episodes: int) -> int:
    """Print a line; return the number of episodes that beat the bound."""
    found: list[MeasuredOutcomes] = []
    for first in range(0, episodes, BATCH):
        seeds = range(FIRST + first, FIRST + min(first + BATCH, episodes))
        path = policy.replace("{task}", task.lower())
        found.append(rollout(path, task, seeds=seeds, keep=Measures, **common.HARDWARE[hardware]))
    if task.startswith("Feed"):
        share = np.concatenate([each.rate_over_bound for each in found])
        beaten = int((share > 1.0).sum())
        text = f"{episodes:6d} episodes   rate / bound: median {np.median(share):.3f}, largest {share.max():.3f}"
    else:
        multiple = np.concatenate([each.time_over_bound[each.success] for each in found])
        above = [np.rint((each.time_to_goal - each.bound)[each.success] / each.step_time) for each in found]
        steps = np.concatenate(above)
        beaten = int((steps < 0).sum())
        text = (
            f"{len(steps):6d} of {episodes} succeed   time / bound: median {np.median(multiple):.3f}, "
            f"smallest {multiple.min():.3f}   steps above it: median {np.median(steps):.0f}, smallest {steps.min():.0f}"
        )
    name = policy if policy.isidentifier() else "learned"
    print(f"{task:<10} {hardware:<10} {name:<12} {text}   beaten by {beaten}", flush=True)
    return beaten


def main() -> int:
    """Measure every task, hardware model and policy."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("tasks", nargs="*", default=TASKS, metavar="TASK")
    parser.add_argument("--episodes", type=int, default=10_000)
    asked = parser.parse_args()
    episodes, beaten = checks.count("episodes", asked.episodes), 0
    for task in [checks.choice("task", each, TASKS) for each in asked.tasks]:
        for hardware in common.HARDWARE:
            for policy in POLICIES if task not in MULTIPART else (MULTIPART[task],):
                beaten += measure(task, hardware, policy, episodes)
    return min(beaten, 1)


if __name__ == "__main__":
    sys.exit(main())
