"""What the policy tests share."""

from typing import Any

import numpy as np

from agents.evaluation import rollout
from agents.policy import Situation
from vibgym import Surface
from vibgym.config import part_from

TASKS = ("Transport", "Align", "Rotate")
FRESH = range(7_000_000, 7_000_100)  # seeds that no training and no report uses


def situation(task: str = "Align") -> Situation:
    """The prototype with its default part."""
    return Situation(task, Surface(), part_from("aluminium_block"))


def successes(policy: Any, task: str) -> int:
    """Of 100 fresh seeds."""
    result = rollout.run(policy, task, list(FRESH), {}, quiet=True)
    assert len(result.success) == 100
    return int(np.sum(result.success))
