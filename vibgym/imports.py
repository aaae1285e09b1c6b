"""User modules that register tasks, rewards, controllers, sensors or algorithms for a command (``--import``)."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence

from vibgym import checks

_imported: list[str] = []


def import_user_modules(modules: Sequence[str], argument: str = "--import") -> None:
    """Import modules or packages, also from the current directory.

    Raises:
        ValueError: a module does not exist or its import fails; names the module and the error.
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


def user_modules() -> tuple[str, ...]:
    """Return the modules imported by :func:`import_user_modules`, for worker processes."""
    return tuple(_imported)
