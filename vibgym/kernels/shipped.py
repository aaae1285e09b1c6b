"""Kernels that come with the wheel: bitcode of all that :mod:`vibgym.warm` compiles, made when the wheel was built.

Each is a file of its own, named after the kernel and a digest of all that it depends on: the sources, the versions of Python,
numba and llvmlite, the platform and the types of its arguments. What has no file is compiled. So one wheel may hold the
kernels of several versions, and is of no harm to any other. In a checkout there are none.
"""

from __future__ import annotations

import functools
import hashlib
import json
import pickle
import sys
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding as llvm
from numba.core import config as numba_config
from numba.core.serialize import dumps

from vibgym.kernels.sources import depends_on, sources
from vibgym.kernels.vec8 import WIDTH

config: Any = numba_config

FOLDER = Path(__file__).with_name("shipped")

VERSIONS = {
    "Python": f"{sys.version_info[0]}.{sys.version_info[1]}",
    "numba": numba.__version__,
    "llvmlite": llvmlite.__version__,
    "platform": llvm.get_process_triple(),
}

_collected_in: Path | None = None

_damaged: list[str] = []


def stamped(content: Any) -> bytes:
    """Return the pickled content after its SHA-256 digest: numba itself unpickles without a check."""
    data = dumps(content)
    return hashlib.sha256(data).digest() + data


def undamaged(data: bytes) -> Any:
    """What :func:`stamped` has made of it; ValueError where bytes are missing or others."""
    size = hashlib.sha256().digest_size
    if hashlib.sha256(data[size:]).digest() != data[:size]:
        raise ValueError("the content does not match its digest")
    return pickle.loads(data[size:])


def collect(folder: Path) -> None:
    """From now on, write what is compiled, or loaded, to this folder, as wheels hold it."""
    global _collected_in
    folder.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256(json.dumps(VERSIONS).encode()).hexdigest()
    (folder / f"versions-{digest[:12]}.json").write_text(json.dumps(VERSIONS), encoding="utf-8")
    _collected_in = folder


def add(function: Any, payload: Any) -> None:
    """A kernel's code and what numba needs besides; does nothing unless code is collected."""
    if _collected_in is None:
        return
    (name, _, bitcode, _), *more = payload
    more[5] = ""  # numba's notes on types name files of the machine that builds the wheel
    (_collected_in / _name(function, more[2].args)).write_bytes(stamped(((name, bitcode), *more)))


def load(function: Any, arguments: Any) -> Any:
    """What :func:`add` was given, its code as name and bitcode; None: it has to be compiled."""
    if config.BOUNDSCHECK or config.DEBUGINFO_DEFAULT or not FOLDER.is_dir():
        return None
    path = FOLDER / _name(function, arguments)
    try:
        return undamaged(path.read_bytes())
    except FileNotFoundError:
        return None
    except Exception as error:  # of a damaged pickle, anything
        report_damage(function, arguments, error)
        return None


def report_damage(function: Any, arguments: Any, error: Exception) -> None:
    """Record that a kernel's file cannot be used, for the message about the compilation that replaces it."""
    cause = " ".join(f"{type(error).__name__}: {error}".split())  # in one line
    _damaged.append(f"{FOLDER / _name(function, arguments)} is damaged ({cause})")


def reason() -> str:
    """Return why kernels are compiled although the wheel contains them, as the start of a sentence; "" without such."""
    if _damaged:
        return _damaged[0]
    shipped = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(FOLDER.glob("versions-*.json"))]
    if not shipped or VERSIONS in shipped:
        return ""
    nearest = max(shipped, key=lambda each: sum(each.get(name) == own for name, own in VERSIONS.items()))
    differs = [name for name, own in VERSIONS.items() if nearest.get(name) != own]
    theirs, ours = (", ".join(f"{name} {each.get(name)}" for name in differs) for each in (nearest, VERSIONS))
    return f"precompiled kernels target {theirs}, this is {ours}"


def state_of(file: str, module: str) -> str:
    """Digest of a kernel's sources, and the registers' width where that counts: a kernel for one width that was given arrays
    for another would write beyond them."""
    width = f" {WIDTH}" if depends_on(file, module, "vec8.py") else ""
    return sources(file, module) + width


def _name(function: Any, arguments: Any) -> str:
    """Return the name of a kernel's file."""
    place = function.__code__.co_filename, function.__module__
    key = (*_own(), state_of(*place), function.__qualname__, function.__code__.co_firstlineno, tuple(arguments))
    return f"{function.__name__}-{hashlib.sha256(repr(key).encode()).hexdigest()[:20]}.bitcode"


@functools.cache
def _own() -> tuple[str, ...]:
    return tuple(VERSIONS.values())
