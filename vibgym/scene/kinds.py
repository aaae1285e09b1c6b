"""The parts of worlds as kinds: different parts, and which of them each world has."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from vibgym.scene.parts import Part, kinds_of


class Kinds(Sequence[Part]):
    """The kinds of parts of a scene, and the kind of each part in each world; a sequence of the first world's parts.

    Args:
        every: the kinds.
        kind: (worlds, parts) kind of each part of each world; one row where all worlds have the same parts.
        options: the kinds that each part may have; None: those of the first world.

    Attributes:
        every, options: as given.
        kind: (rows, parts) int64, live: :meth:`choose` changes it.
    """

    def __init__(self, every: Sequence[Part], kind: np.ndarray, options: Sequence[Sequence[int]] | None = None) -> None:
        self.every: tuple[Part, ...] = tuple(every)
        self.kind = np.ascontiguousarray(kind, dtype=np.int64)
        self.options = [[number] for number in self.kind[0].tolist()] if options is None else options
        self._fixed: list[Part] | None = None
        self._live = LiveArrays()

    @classmethod
    def of(cls, parts: Sequence[Part]) -> Kinds:
        """Return the kinds of parts that all worlds have; kinds are returned unchanged."""
        if isinstance(parts, Kinds):
            return parts
        every, index = kinds_of(parts, Part.same_as)
        kinds = cls(every, index[None])
        kinds._fixed = list(parts)
        return kinds

    @property
    def vary(self) -> bool:
        """Whether worlds may have different parts."""
        return self._fixed is None

    def __len__(self) -> int:
        return self.kind.shape[1]

    def __getitem__(self, part: Any) -> Any:
        return self.parts(0)[part]

    def __iter__(self) -> Iterator[Part]:
        return iter(self.parts(0))

    def parts(self, world: int) -> tuple[Part, ...]:
        """Return the parts of a world."""
        if self._fixed is not None:
            return tuple(self._fixed)
        return tuple(self.every[kind] for kind in self.kind[world].tolist())

    def some(self, worlds: np.ndarray) -> Kinds:
        """Return the present kinds of some worlds (index array); itself where all worlds have the same parts."""
        return Kinds(self.every, self.kind[worlds], self.options) if self.vary else self

    def changed(self, change: Callable[[Part], Part]) -> Kinds:
        """Return these kinds with other properties, of the same worlds: :meth:`choose` applies to both."""
        kinds = Kinds([change(part) for part in self.every], self.kind, self.options)
        kinds.kind, kinds._live = self.kind, self._live
        if self._fixed is not None:
            kinds._fixed = [change(part) for part in self._fixed]
        return kinds

    def values(self, value: Callable[[Part], Any], worlds: int | None = None) -> np.ndarray:
        """Return a live array (rows, parts, ...) of a property, a number or an array, of every part.

        Args:
            worlds: rows of the array; None: those of :attr:`kind`.
        """
        table = np.array([value(part) for part in self.every])
        live = table[self.kind]
        if worlds is not None and worlds != len(live):
            live = np.repeat(live, worlds, axis=0)
        if self.vary:
            self._live.add(table, live)
        return live

    def largest(self, value: Callable[[Part], float]) -> list[Part]:
        """Return for each part the kind with the largest value among those that it may have."""
        if self._fixed is not None:
            return list(self._fixed)
        return [max((self.every[kind] for kind in options), key=value) for options in self.options]

    def choose(self, worlds: Any, kind: np.ndarray) -> None:
        """Set the kinds (n, parts) of the parts of some worlds (index array)."""
        self.kind[worlds] = kind
        for table, live in self._live.entries():
            live[worlds] = table[kind]

    def rows(self, worlds: Any) -> Any:
        """Return the rows of live arrays for worlds (index array or slice): all, where all worlds have the same parts."""
        return worlds if self.vary else slice(None)


class LiveArrays:
    """Arrays of values of parts, as long as something else holds them, each with its values by kind."""

    def __init__(self) -> None:
        self._known: list[tuple[np.ndarray, weakref.ref[np.ndarray]]] = []

    def add(self, table: np.ndarray, live: np.ndarray) -> None:
        """Add an array."""
        self._known = [entry for entry in self._known if entry[1]() is not None]
        self._known.append((table, weakref.ref(live)))

    def entries(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return values by kind, and the array, of each."""
        return [(table, live) for table, known in self._known if (live := known()) is not None]

    def __getstate__(self) -> list[tuple[np.ndarray, np.ndarray]]:
        return self.entries()

    def __setstate__(self, state: list[tuple[np.ndarray, np.ndarray]]) -> None:
        self._known = [(table, weakref.ref(live)) for table, live in state]


def groups_of(kind: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the different rows of ``kind`` (n, parts), and the indices of the worlds that have each."""
    different, which = np.unique(kind, axis=0, return_inverse=True)
    return [(own, np.flatnonzero(which.reshape(-1) == k)) for k, own in enumerate(different)]
