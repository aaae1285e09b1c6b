"""Ranges of the seeds of episodes: training, selection, evaluation and held-out episodes share none."""

from __future__ import annotations

import numpy as np

from vibgym import checks

RANGES = {
    "own": range(100_000),  # tests and examples of users
    "evaluation": range(100_000, 300_000),  # published figures of policies
    "held_out": range(300_000, 400_000),  # scores of suites
    "selection": range(400_000, 1_000_000),  # choice of checkpoints and hyperparameters
    "recordings": range(1_000_000, 2**32),  # data sets, from which policies learn
    "training": range(2**32, 2**63),  # see training_seed
}
"""Seeds by name of the range; together every seed below 2**63."""

STREAM = 2**20
"""Seeds of a training stream."""


def range_of(seed: int) -> str:
    """Return the name of the range that contains a seed."""
    return next((name for name, seeds in RANGES.items() if seed in seeds), "no range")


def check_seeds(argument: str, first: int, count: int, *names: str) -> None:
    """Check that the seeds ``first`` to ``first + count - 1`` are in one range.

    Args:
        argument: name in the error.
        first: the first seed.
        count: number of seeds, at least 1.
        names: of the allowed ranges.

    Raises:
        ValueError: a seed is outside.
    """
    last = first + count - 1
    if not any(first in RANGES[name] and last in RANGES[name] for name in names):
        allowed = " or ".join(f"{RANGES[name].start} to {RANGES[name].stop - 1} ({name})" for name in names)
        got = f"{first} ({range_of(first)})" + (f" to {last} ({range_of(last)})" if count > 1 else "")
        raise checks.conflict(f"{argument}: seeds must be in {allowed}, got {got}")


def training_seed(run_seed: int, purpose: str = "") -> int:
    """Return the first seed of a training stream: world k has this seed plus k.

    Streams are blocks of :data:`STREAM` seeds, one of 2**42 by NumPy's ``SeedSequence``. Two streams are the
    same with probability 2e-13, else disjoint.

    Args:
        run_seed: of the training, >= 0.
        purpose: in the training, such as "imitation".

    Raises:
        ValueError: a negative or no whole number.
    """
    sequence = np.random.SeedSequence(checks.count("run_seed", run_seed, least=0), spawn_key=tuple(purpose.encode()))
    return RANGES["training"].start + STREAM * (int(sequence.generate_state(1, np.uint64)[0]) >> 22)
