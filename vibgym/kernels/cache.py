"""What cached kernels depend on, and messages about compilation.

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

import numba

LOGGER = logging.getLogger("vibgym")

CACHE = os.environ.get("VIBGYM_CACHE", "1") != "0"
"""Whether compiled kernels are cached on disk."""

_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:(?: .*)?\n)+", re.MULTILINE)
"""Imports for type checkers, which do not run."""

_IMPORT = re.compile(r"^ *(?:from|import) ([\w.]+)(?: import (\([^)]*\)|.*))?", re.MULTILINE)


@functools.cache
def announce(folder: str | None) -> None:
    """Warn on stderr, once per process, that kernels are compiled, and about how long that takes.

    ``folder``: numba's default for compiled kernels; None: they are not kept.
    """
    kept = f"kept in {numba.config.CACHE_DIR or folder}" if folder else "not kept"  # type: ignore[attr-defined]
    # A warning, so that it appears without logging configuration and at level WARNING.
    LOGGER.warning(
        "vibgym: compiling kernels on first use, about 10 to 40 s of processor time (%s); python -m vibgym warm compiles all",
        kept,
    )


@functools.cache
def warn_about_cache(reason: str) -> None:
    """Warn that compiled kernels are not cached, once for each reason."""
    LOGGER.warning(
        "vibgym: compiled kernels cannot be kept (%s) and are compiled anew by every process; set NUMBA_CACHE_DIR to a folder "
        "that may be written",
        reason,
    )


def warn_about_damage(folder: str, error: Exception) -> None:
    """Warn that a damaged file of compiled kernels is replaced."""
    LOGGER.warning("vibgym: a damaged file of compiled kernels in %s is replaced (%r)", folder, error)


def imported_files(file: str, module: str) -> list[Path]:
    """Return a module's file and all files that it imports, directly or indirectly, sorted."""
    files, todo = {Path(file)}, [Path(file)]
    while todo:
        new = _imports(todo.pop(), _roots(file, module)) - files
        files |= new
        todo += new
    return sorted(files)


@functools.cache
def _imports(file: Path, roots: tuple[Path, ...]) -> frozenset[Path]:
    """Return the files of packages, given by their folders, that a file imports directly."""
    paths: set[Path] = set()
    folders = {root.name: root.parent for root in roots}
    for imported, names in _IMPORT.findall(_TYPES.sub("", file.read_text(encoding="utf-8"))):
        if folder := folders.get(imported.partition(".")[0]):
            for name in (imported, *(f"{imported}.{one}" for one in re.findall(r"\w+", names))):
                path = folder.joinpath(*name.split("."))
                paths |= {path.with_suffix(".py"), path / "__init__.py"}
    return frozenset(path for path in paths if path.is_file())


@functools.cache
def _roots(file: str, module: str) -> tuple[Path, ...]:
    """Return the folders of this package and of a module's package."""
    depth = module.count(".") - (Path(file).name != "__init__.py")
    own = Path(file) if depth < 0 else Path(file).parents[depth]
    return Path(__file__).parents[1], own.with_suffix("")


@functools.cache
def sources(file: str, module: str) -> str:
    """Return a digest of the files that a module depends on, as they are when it is first needed: while they are imported."""
    return hashlib.sha256(b"".join(map(_digest, imported_files(file, module)))).hexdigest()


@functools.cache
def _digest(file: Path) -> bytes:
    return hashlib.sha256(file.read_bytes()).digest()
