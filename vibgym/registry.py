"""Names that settings may use, and what stands behind them: the package's own, and a user's beside them."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from typing import Generic, TypeVar

from vibgym import checks

Item = TypeVar("Item")


class Registry(Mapping[str, Item], Generic[Item]):
    """A mapping from names to classes, to which more may be added and nothing is replaced.

    Args:
        what: the names are of, such as ``"task"``; for errors.
        items: to begin with.

    Attributes:
        taken: further names that may not be registered, because they mean something else where these are used.
    """

    def __init__(self, what: str, items: Mapping[str, Item]) -> None:
        self.what = what
        self._items = dict(items)
        self.taken: Container[str] = ()

    def register(self, name: str, item: Item) -> None:
        """Add ``item`` under a name of its own.

        Raises:
            ValueError: the name is not a word, or there already.
        """
        if not isinstance(name, str) or not name.replace("-", "_").isidentifier():
            raise checks.refuse(f"{self.what} name", name, "a word of letters, digits, '_' and '-'")
        if name in self or name in self.taken:
            raise checks.refuse(f"{self.what} name", name, f"one that is not taken ({', '.join(self)})")
        if not callable(item):
            raise checks.refuse(self.what, item, f"a class or function that makes one for {name!r}")
        self._items[name] = item

    def choose(self, argument: str, name: object) -> Item:
        """What stands behind ``name``, given as ``argument``.

        Raises:
            ValueError: there is no such name.
        """
        return self[checks.choice(argument, name, tuple(self))]

    def __getitem__(self, name: str) -> Item:
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)
