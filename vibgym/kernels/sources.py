"""The source files that a kernel depends on: its own and all that it imports, directly or indirectly.

numba's cache checks a kernel's own file only and does not detect that a kernel or constant of another file has changed. Imports
count if they are from the kernel's own package or from this one.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
from pathlib import Path

_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:(?: .*)?\n)+", re.MULTILINE)
"""Imports for type checkers, which do not run."""

_IMPORT = re.compile(r"^ *(?:from|import) ([\w.]+)(?: import (\([^)]*\)|.*))?", re.MULTILINE)


@functools.cache
def imported_files(file: str, module: str) -> tuple[Path, ...]:
    """Return a module's file and all files that it imports, directly or indirectly, sorted."""
    own, roots = Path(file), _roots(file, module)
    found, todo = {own}, [own]
    while todo:
        for imported, names in _IMPORT.findall(_TYPES.sub("", todo.pop().read_text(encoding="utf-8"))):
            first = imported.partition(".")[0]
            if first not in roots:
                continue
            for each in (imported, *(f"{imported}.{one}" for one in re.findall(r"\w+", names))):
                path = roots[first].joinpath(*each.split("."))
                new = {path.with_suffix(".py"), path / "__init__.py"} - found
                todo += [one for one in new if one.is_file()]
                found |= new
    return tuple(path for path in sorted(found) if path.is_file())


def _roots(file: str, module: str) -> dict[str, Path]:
    """Return the folders of this package and of a module's, by the package's name."""
    own, name = Path(file), module.partition(".")[0]
    depth = module.count(".") + (own.name == "__init__.py")
    return {__name__.partition(".")[0]: Path(__file__).parents[__name__.count(".")], name: own.parents[depth]}


_stamps: dict[Path, tuple[int, int]] = {}
"""Time and size of files when the first module of their package was imported. Nothing compares them with a clock: those of
image builds and shared folders may be ahead of it."""


@functools.cache
def note(file: str, module: str) -> None:
    """Note the files that a module may depend on, while it is imported."""
    if Path(file).is_file():  # not of text that was executed
        for name, folder in _roots(file, module).items():
            _note_package(folder / name)
        _note_file(Path(file))


@functools.cache
def _note_package(package: Path) -> None:
    for folder, subfolders, names in os.walk(package):
        subfolders[:] = [each for each in subfolders if each != "__pycache__"]
        for name in names:
            if name.endswith(".py"):
                _note_file(Path(folder, name))


def _note_file(path: Path) -> None:
    if path not in _stamps and path.is_file():
        _stamps[path] = _stamp(path)


def _stamp(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_mtime_ns, found.st_size


def unchanged(file: str, module: str) -> bool:
    """Return whether the files that a module depends on are those that were imported."""
    return all(_stamps.get(path) == _stamp(path) for path in imported_files(file, module))


@functools.cache
def sources(file: str, module: str) -> str:
    """Return a digest of the files that a module depends on."""
    digest = hashlib.sha256()
    for path in imported_files(file, module):
        digest.update(path.read_bytes())
    return digest.hexdigest()
