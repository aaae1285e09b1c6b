"""Does any policy beat a bound?  ``python -m studies.benchmarks.bound [episodes] [task ...]``, 10 000 episodes by default.

As many episodes of every policy on every task, on ideal and on prototype hardware, with seeds that no training and no report
uses. Printed are the median of time over bound, the smallest, how many steps the fastest episode took above its bound, and how
many beat it: the command fails if there is one. Of parts that come and go it is good parts a minute over the most that are
possible: the median, the largest, and how many are more. The bounds themselves are derived in docs/bound.md.
"""

from __future__ import annotations

import sys

import gymnasium as gym
import numpy as np

import vibgym  # noqa: F401 - registers the environments
from studies.benchmarks import common
from vibgym import checks
from vibgym.policies.measures import Measures
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo

FIRST, BATCH = 8_000_000, 500
POLICIES = ("local_field", "vibgym/policies/trained/shipped/{task}.json")
OPEN = {
    "Feed": "lanes", "FeedHeaps": "lanes", "Swap": "lanes", "SwapCrowded": "lanes", "Pack": "two_phases",
    "PackFull": "two_phases", "Push": "push", "PushAny": "push",
}  # fmt: skip
"""Tasks whose best policy is not known, and a good one of each."""


def measure_rates(task: str, hardware: str, policy: str, episodes: int) -> int:
    """Print one line of a task whose parts come and go; return how many episodes beat the bound."""
    shares = []
    for first in range(0, episodes, BATCH):
        seeds = range(FIRST + first, FIRST + min(first + BATCH, episodes))
        shares.append(rollout(policy, task, seeds=seeds, keep=Measures, **common.HARDWARE[hardware]).rate_over_bound)
    share = np.concatenate(shares)
    beaten = int((share > 1.0).sum())
    print(
        f"{task:<10} {hardware:<10} {policy:<12} {episodes:6d} episodes   rate / bound: median {np.median(share):.3f}, "
        f"most {share.max():.3f}   beaten by {beaten}",
        flush=True,
    )
    return beaten


def measure(task: str, hardware: str, content: str, episodes: int) -> int:
    """Print one line; return how many episodes beat the bound."""
    settings = common.HARDWARE[hardware]
    env = gym.make_vec(f"vibgym/{task}-v0", num_envs=1, **settings)
    policy = make_policy(content.replace("{task}", task.lower()), TaskInfo.of(env, task))
    env.close()
    multiples, over = [], []
    for first in range(0, episodes, BATCH):
        seeds = range(FIRST + first, FIRST + min(first + BATCH, episodes))
        found = rollout(policy, task, seeds=seeds, keep=Measures, **settings)
        success = found.success
        multiples.append(found.time_over_bound[success])
        over.append(np.rint((found.time_to_goal - found.bound)[success] / found.step_time))
    multiple, steps = np.concatenate(multiples), np.concatenate(over)
    beaten = int((steps < 0).sum())
    name = content if content.isidentifier() else "learned"
    print(
        f"{task:<10} {hardware:<10} {name:<12} {len(steps):6d} of {episodes} succeed   time / bound: median "
        f"{np.median(multiple):.3f}, least {multiple.min():.3f}   steps above it: median {np.median(steps):.0f}, "
        f"least {steps.min():.0f}   beaten by {beaten}",
        flush=True,
    )
    return beaten


def main(arguments: list[str]) -> int:
    """Measure every task, hardware and policy."""
    numbers = [each for each in arguments if each.isdigit()]
    episodes = checks.count("episodes", int(numbers[0]) if numbers else 10_000)
    known = ("Transport", "Align", "Rotate", *OPEN)
    tasks = [checks.choice("task", each, known) for each in arguments if not each.isdigit()] or known
    beaten = 0
    for task in tasks:
        for hardware in common.HARDWARE:
            for policy in POLICIES if task not in OPEN else (OPEN[task],):
                judge = measure_rates if task.startswith("Feed") else measure
                beaten += judge(task, hardware, policy, episodes)
    return min(beaten, 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
