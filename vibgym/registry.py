"""Registries: names used in settings, and the classes or functions they refer to."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Iterator, Mapping
from importlib import metadata
from typing import Any, Generic, TypeVar

from vibgym import checks
from vibgym.settings import read

Item = TypeVar("Item")


class Registry(Mapping[str, Item], Generic[Item]):
    """A mapping from names to classes or functions. Names can be added, not replaced.

    Looking up an unregistered name searches the entry points of installed packages; using it imports the plug-in.

    Args:
        what: kind of the items, such as ``"task"``; for error messages.
        items: built-in ones.
        group: group of entry points for plug-ins, such as ``"vibgym.models"``; None: no plug-ins.
    """

    def __init__(self, what: str, items: Mapping[str, Item], group: str | None = None) -> None:
        self.what = what
        self.group = group
        self._items = dict(items)

    def register(self, name: str, item: Item) -> None:
        """Add ``item`` under a new name.

        Raises:
            ValueError: ``name`` is not a word or is taken, or ``item`` cannot be called.
        """
        if not isinstance(name, str) or not name.replace("-", "_").isidentifier():
            raise checks.refuse(f"{self.what} name", name, "a word of letters, digits, '_' and '-'")
        if name in self:
            raise checks.refuse(f"{self.what} name", name, f"one that is not taken ({', '.join(self)})")
        if not callable(item):
            raise checks.refuse(self.what, item, f"a class or function that makes one for {name!r}")
        self._items[name] = item

    def choose(self, argument: str, name: object) -> Item:
        """Return the item ``name``, given as ``argument``.

        Raises:
            ValueError: unknown name, or a plug-in that cannot be imported.
        """
        return self[checks.choice(argument, name, self)]

    def make(self, argument: str, value: Any, *context: Any) -> Any:
        """Return ``item(*context, settings=...)`` for a name, or for a mapping with ``kind`` and settings.

        The settings are an instance of the item's ``Settings``, a :class:`vibgym.settings.BaseSettings`. An item without this
        attribute is called with the settings as keyword arguments.

        Raises:
            ValueError: an unknown name, or a bad setting; ``argument`` is the name of both in errors.
        """
        kind, settings = self.split(argument, value)
        item: Any = self[kind]
        if hasattr(item, "Settings"):
            values = read(item.Settings, settings, argument)
            if not item.Settings.model_fields and "settings" not in inspect.signature(item).parameters:
                return item(*context)  # a constructor of its own, of a class without settings
            return item(*context, settings=values)
        if (reason := checks.misfit(item, *context, **settings)) is not None:
            raise checks.conflict(f"{argument} {kind!r}: {reason}")
        return item(*context, **settings)

    def split(self, argument: str, value: Any) -> tuple[str, dict[str, Any]]:
        """Return the registered name and the settings of a name, or of a mapping with ``kind`` and settings."""
        if not isinstance(value, Mapping):
            return checks.choice(argument, value, self), {}
        if "kind" not in value:
            raise checks.missing(f"{argument}.kind", f"one of {', '.join(map(repr, self))}")
        settings = dict(value)
        return checks.choice(f"{argument}.kind", settings.pop("kind"), self), settings

    def __getitem__(self, name: str) -> Item:
        if name not in self._items:
            self._items[name] = _loaded(self.what, self._plugins()[name])
        return self._items[name]

    def __contains__(self, name: object) -> bool:
        return name in self._items or any(name == known for known in self)

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*self._items, *self._plugins())))

    def __len__(self) -> int:
        return len(dict.fromkeys((*self._items, *self._plugins())))

    def _plugins(self) -> Mapping[str, metadata.EntryPoint]:
        return {} if self.group is None else _entry_points(self.group)


@functools.cache
def _entry_points(group: str) -> dict[str, metadata.EntryPoint]:
    """Return the entry points of a group in all installed packages, by name."""
    return {point.name: point for point in metadata.entry_points(group=group)}


def _loaded(what: str, point: metadata.EntryPoint) -> Any:
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        raise checks.Refused(f"cannot load {what} {point.name!r} from {point.value!r}: {error}") from error
