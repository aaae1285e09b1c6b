"""What cached kernels depend on: environment variables, and the source files of a kernel.

numba's cache checks a kernel's own file only and does not detect that a kernel or constant of another file has changed. Here a
kernel depends on its own file and all that it imports, directly or indirectly, from its own package or from this one.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import re
from pathlib import Path

CACHE = os.environ.get("VIBGYM_CACHE", "1") != "0"
"""Whether compiled kernels are cached on disk."""

_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:(?: .*)?\n)+", re.MULTILINE)
"""Imports for type checkers, which do not run."""

_IMPORT = re.compile(r"^ *(?:from|import) ([\w.]+)(?: import (\([^)]*\)|.*))?", re.MULTILINE)


@functools.cache
def warn_about_cache(reason: str) -> None:
    """Warn that compiled kernels are not cached, once for each reason."""
    logging.getLogger("vibgym").warning(
        "vibgym: compiled kernels cannot be kept (%s) and are compiled anew by every process; set NUMBA_CACHE_DIR to a folder "
        "that may be written",
        reason,
    )


def imported_files(file: str, module: str) -> list[Path]:
    """Return a module's file and all files that it imports, directly or indirectly, sorted."""
    found, todo = {Path(file)}, [Path(file)]
    while todo:
        new = _imports(todo.pop(), _roots(file, module)) - found
        found |= new
        todo += new
    return sorted(found)


@functools.cache
def _imports(file: Path, roots: tuple[Path, ...]) -> frozenset[Path]:
    """Return the files of packages, given by their folders, that a file imports directly."""
    found: set[Path] = set()
    folders = {root.name: root.parent for root in roots}
    for imported, names in _IMPORT.findall(_TYPES.sub("", file.read_text(encoding="utf-8"))):
        if folder := folders.get(imported.partition(".")[0]):
            for each in (imported, *(f"{imported}.{one}" for one in re.findall(r"\w+", names))):
                path = folder.joinpath(*each.split("."))
                found |= {path.with_suffix(".py"), path / "__init__.py"}
    return frozenset(path for path in found if path.is_file())


@functools.cache
def _roots(file: str, module: str) -> tuple[Path, ...]:
    """Return the folders of this package and of a module's package."""
    depth = module.count(".") - (Path(file).name != "__init__.py")
    own = Path(file) if depth < 0 else Path(file).parents[depth]
    return Path(__file__).parents[1], own.with_suffix("")


_stamps: dict[Path, tuple[int, int]] = {}
"""Time and size of files when the first module of their package was imported. Nothing compares them with a clock: those of
image builds and shared folders may be ahead of it."""


@functools.cache
def note(file: str, module: str) -> None:
    """Note the files that a module may depend on, while it is imported."""
    if Path(file).is_file():  # not of text that was executed
        for root in _roots(file, module):
            _note_package(root)
        _stamps.setdefault(Path(file), _stamp(Path(file)))


@functools.cache
def _note_package(root: Path) -> None:
    for path in root.rglob("*.py"):
        _stamps.setdefault(path, _stamp(path))


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_mtime_ns, status.st_size


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
