"""Generators as part of a snapshot."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from vibgym import checks


def state_of(generator: np.random.Generator) -> dict[str, Any]:
    """The generator's state, as plain values."""
    return copy.deepcopy(dict(generator.bit_generator.state))


def generator_from(name: str, state: Any) -> np.random.Generator:
    """A generator that goes on from a state.

    Raises:
        ValueError: no such state.
    """
    generator = np.random.Generator(np.random.PCG64())
    try:
        generator.bit_generator.state = copy.deepcopy(state)
    except (TypeError, ValueError, LookupError, AttributeError, OverflowError, RecursionError):
        raise checks.refuse(name, state, "the state of a PCG64 generator, as get_state() gave it") from None
    return generator
