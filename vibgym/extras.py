"""Errors for missing optional dependencies, which name the extra to install."""

from __future__ import annotations

import importlib.util


class MissingExtra(ModuleNotFoundError):
    """A package of an extra is not installed. Notebooks show one line without a traceback."""

    def _render_traceback_(self) -> list[str]:
        """Return the lines that IPython prints."""
        return [str(self)]


def require(extra: str, *packages: str) -> None:
    """Check that packages of an extra are installed, without importing them.

    Args:
        extra: of vibgym, such as ``"learn"``.
        *packages: required packages, by import name.

    Raises:
        MissingExtra: a package is not installed; names it and the installation command.
    """
    for package in packages:
        if not _found(package):
            raise MissingExtra(f"{package} is not installed: pip install 'vibgym[{extra}]'", name=package)


def missing(what: str, error: ModuleNotFoundError, extra: str) -> ModuleNotFoundError:
    """Return an error that names a missing package and the command that installs it.

    Args:
        what: feature that needs the package, for the message.
        error: of the import.
        extra: of vibgym that provides the package.
    """
    package = (error.name or "").partition(".")[0]
    text = f"{what} needs {package}, which is not installed: pip install 'vibgym[{extra}]'"
    return ModuleNotFoundError(text, name=package)


def _found(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except ModuleNotFoundError:  # the parent package is missing
        return False
