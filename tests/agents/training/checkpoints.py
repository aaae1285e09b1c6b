"""Contents of checkpoints."""

import numpy as np

from agents import checkpoint


def flat(tree, name=""):
    """Return the values of nested mappings and lists by name."""
    if not isinstance(tree, dict | list):
        return {name: np.asarray(tree)}
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree)
    return {key: value for part, each in pairs for key, value in flat(each, f"{name}.{part}").items()}


def same(one, two):
    """Return whether the checkpoints of two runs are equal bit for bit."""
    first, second = (flat(checkpoint.load(run)) for run in (one, two))
    return first.keys() == second.keys() and all(
        np.array_equal(first[name], second[name], equal_nan=first[name].dtype.kind == "f") for name in first
    )
