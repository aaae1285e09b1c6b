"""What a file of kernels depends on: itself and all that it imports, directly or not, from its own package and from this one.

numba caches a kernel by the file that holds it and does not notice when a kernel or a constant of another file has changed: it
would go on with the old physics.
"""

from __future__ import annotations

import functools
import hashlib
import re
from pathlib import Path

_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:(?: .*)?\n)+", re.MULTILINE)
"""What only the type checker reads: nothing runs by it, and ``vibgym/__init__.py`` names half the package so."""

_IMPORT = re.compile(r"^ *(?:from|import) ([\w.]+)(?: import (\([^)]*\)|.*))?", re.MULTILINE)


@functools.cache
def _imported(file: str, module: str) -> tuple[Path, ...]:
    """A module's file and all files that it imports, directly or not, from its own package and from this one."""
    own, name = Path(file), module.partition(".")[0]
    depth = module.count(".") + (own.name == "__init__.py")
    roots = {__name__.partition(".")[0]: Path(__file__).parents[__name__.count(".")], name: own.parents[depth]}
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


@functools.cache
def sources(file: str, module: str) -> str:
    """Digest of what :func:`_imported` finds."""
    digest = hashlib.sha256()
    for path in _imported(file, module):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@functools.cache
def last_edit(file: str, module: str) -> float:
    """When the youngest of these files was written."""
    return max(path.stat().st_mtime for path in _imported(file, module))


def depends_on(file: str, module: str, name: str) -> bool:
    """Whether it imports a file of this folder, directly or not."""
    return Path(__file__).with_name(name) in _imported(file, module)
