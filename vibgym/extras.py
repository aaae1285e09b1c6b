"""Says in one line which extra is missing, where a traceback would say which package."""

from __future__ import annotations

import importlib.util


class MissingExtra(ImportError):
    """A package that an extra brings is not installed. Notebooks show the line, and nothing else."""

    def _render_traceback_(self) -> list[str]:
        """What IPython prints for it."""
        return [str(self)]


def require(extra: str, *packages: str) -> None:
    """Go on only where what an extra brings is installed; nothing is imported.

    Args:
        extra: of vibgym, such as ``"learn"``.
        *packages: those of its packages that are needed, by the names that they are imported by.

    Raises:
        MissingExtra: one of them is not installed; the message names it and the command that installs the extra.
    """
    for package in packages:
        if not _found(package):
            raise MissingExtra(f"{package} is not installed: pip install 'vibgym[{extra}]'", name=package)


def missing(what: str, error: ModuleNotFoundError, extra: str) -> ModuleNotFoundError:
    """The error to raise instead of ``error``: what does not work without which package, and the command that installs it.

    Args:
        what: needs it.
        error: of the import.
        extra: of vibgym, that brings the package.
    """
    package = (error.name or "").partition(".")[0]
    text = f"{what} needs {package}, which is not installed: pip install 'vibgym[{extra}]'"
    return ModuleNotFoundError(text, name=package)


def _found(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except ModuleNotFoundError:  # of what the package lies in
        return False
