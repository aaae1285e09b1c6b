"""A user's own modules, whose tasks, rewards, laws, sensors and algorithms take part in a command."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence

from vibgym import checks

_imported: list[str] = []


def take_part(modules: Sequence[str], argument: str = "--import") -> None:
    """Import modules or packages, those in the current directory too; importing them is what registers things.

    Raises:
        ValueError: there is no such module, or importing it fails, as where it registers a name that is taken; names the module
            and the error.
    """
    if modules and os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    for name in modules:
        try:
            importlib.import_module(name)
        except Exception as error:
            kind = ValueError if isinstance(error, checks.Refused) else type(error)
            allowed = f"a module or package that can be imported ({kind.__name__}: {error})"
            raise checks.refuse(argument, name, allowed) from error
        if name not in _imported:
            _imported.append(name)


def taking_part() -> tuple[str, ...]:
    """What :func:`take_part` has imported, for processes that are started."""
    return tuple(_imported)
