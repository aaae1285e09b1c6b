"""Snapshots: copies of live arrays, checked before they take the arrays' place again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vibgym import checks


def copied(live: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Copies of live arrays."""
    return {name: values.copy() for name, values in live.items()}


def check_keys(argument: str, state: Any, names: tuple[str, ...]) -> None:
    """Refuse what is not a mapping with exactly these keys."""
    if not isinstance(state, Mapping) or set(state) != set(names):
        got = sorted(map(str, state)) if isinstance(state, Mapping) else state
        raise checks.refuse(argument, got, f"a mapping with exactly the keys {', '.join(names) or '(none)'}")


def restored(argument: str, live: Mapping[str, np.ndarray], state: Any) -> dict[str, np.ndarray]:
    """The arrays of ``state``, checked against the live ones: keys, shapes, types; all numbers finite.

    Raises:
        ValueError: names the first fault.
    """
    check_keys(argument, state, tuple(live))
    result = {}
    for name, mine in live.items():
        where = f"{argument}[{name!r}]"
        try:
            values = np.asarray(state[name])
        except (TypeError, ValueError, RecursionError):
            raise checks.refuse(where, state[name], f"an array of shape {mine.shape}") from None
        if values.shape != mine.shape or values.dtype.kind not in "biuf":
            raise checks.refuse(where, f"array of shape {values.shape} and type {values.dtype}", f"shape {mine.shape}")
        result[name] = checks.array(where, values, mine.shape, dtype=mine.dtype)
    return result
