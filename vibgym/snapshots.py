"""Snapshots: copies of live arrays, checked before they take the arrays' place again."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, ClassVar

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


def put_back(live: Mapping[str, np.ndarray], values: Mapping[str, np.ndarray]) -> None:
    """Overwrite live arrays with those that :func:`restored` gave."""
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
        raise checks.refuse(name, state, "the state of a PCG64 generator, as get_state() gave it") from None
    return generator


class Live:
    """Base of what is part of a snapshot by its live arrays."""

    SNAPSHOT: ClassVar[str]
    """Key of a snapshot under which they stand."""

    def live(self) -> dict[str, np.ndarray]:
        """All live arrays of a snapshot."""
        return {}

    def get_state(self) -> dict[str, np.ndarray]:
        """Everything needed to go on bit for bit."""
        return copied(self.live())

    def check_state(self, state: Any) -> dict[str, np.ndarray]:
        """What :meth:`get_state` gave, checked; for :meth:`set_state`."""
        return restored(f"state[{self.SNAPSHOT!r}]", self.live(), state)

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from a checked state."""
        put_back(self.live(), state)
