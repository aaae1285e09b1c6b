"""Snapshots: copies of live arrays, validated before they are restored."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from vibgym import checks


def copied(live: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return copies of live arrays."""
    return {name: values.copy() for name, values in live.items()}


def check_keys(argument: str, state: Any, names: tuple[str, ...]) -> None:
    """Raise ValueError unless ``state`` is a mapping with exactly these keys."""
    if not isinstance(state, Mapping) or set(state) != set(names):
        got = sorted(map(str, state)) if isinstance(state, Mapping) else state
        raise checks.refuse(argument, got, f"a mapping with exactly the keys {', '.join(names) or '(none)'}")


def restored(argument: str, live: Mapping[str, np.ndarray], state: Any) -> dict[str, np.ndarray]:
    """Return the arrays of ``state``, validated against the live ones: keys, shapes, types, finite values.

    Raises:
        ValueError: an invalid snapshot; names the first fault.
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


def restore(live: Mapping[str, np.ndarray], values: Mapping[str, np.ndarray]) -> None:
    """Overwrite live arrays with those of :func:`restored`."""
    for name, mine in live.items():
        mine[...] = values[name]


def generator_state(generator: np.random.Generator) -> dict[str, Any]:
    """Return the state of a generator, as plain values."""
    return copy.deepcopy(dict(generator.bit_generator.state))


def generator_from(name: str, state: Any) -> np.random.Generator:
    """Return a generator with a state of :func:`generator_state`.

    Raises:
        ValueError: an invalid state.
    """
    generator = np.random.Generator(np.random.PCG64())
    try:
        generator.bit_generator.state = copy.deepcopy(state)
    except (TypeError, ValueError, LookupError, AttributeError, OverflowError, RecursionError):
        raise checks.refuse(name, state, "the state of a PCG64 generator, from get_state()") from None
    return generator


class Live:
    """Base class of components whose live arrays are part of a snapshot."""

    SNAPSHOT: ClassVar[str]
    """Key in a snapshot."""

    def live(self) -> dict[str, np.ndarray]:
        """Return all live arrays."""
        return {}

    def get_state(self) -> dict[str, np.ndarray]:
        """Return copies of the live arrays."""
        return copied(self.live())

    def check_state(self, state: Any) -> dict[str, np.ndarray]:
        """Return validated arrays of a snapshot, for :meth:`set_state`."""
        return restored(f"state[{self.SNAPSHOT!r}]", self.live(), state)

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Restore a validated state."""
        restore(self.live(), state)
