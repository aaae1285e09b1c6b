"""Compiled kernels on disk: the cache, and the bitcode in a wheel.

The version of a cached kernel contains a digest of its file and of all files that it imports (:mod:`vibgym.kernels.sources`).
Each cached file contains a digest of its content, since a crash or a full disk may truncate it, and the key of its kernel,
since two processes that add to an index at the same time may choose the same name. A file that fails a check is replaced.

A wheel contains the bitcode of all kernels that :mod:`vibgym.warm` compiles, one file each. The file's name contains a digest
of the sources, of the versions of Python, numba and llvmlite, of the platform and of the types of the arguments. One wheel
can therefore hold the kernels of several versions. A kernel without a file is compiled. A checkout has no files.
"""

from __future__ import annotations

import hashlib
import json
import logging
import pickle
import sys
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding as llvm
from numba.core import caching
from numba.core import config as numba_config
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from vibgym.kernels import options
from vibgym.kernels.libraries import LinkedLibrary, is_unit
from vibgym.kernels.sources import imported_files, sources, unchanged
from vibgym.kernels.vec8 import WIDTH

config: Any = numba_config

LOGGER = logging.getLogger("vibgym")

SHIPPED = Path(__file__).with_name("shipped")
"""Folder of the wheel's bitcode."""

VERSIONS = {
    "Python": f"{sys.version_info[0]}.{sys.version_info[1]}",
    "numba": numba.__version__,
    "llvmlite": llvmlite.__version__,
    "platform": llvm.get_process_triple(),
}

_collected_in: Path | None = None


def with_digest(content: Any) -> bytes:
    """Return the pickled content and its SHA-256 digest; numba itself unpickles without a check."""
    data = dumps(content)
    return data + hashlib.sha256(data).digest()


def checked(data: bytes) -> Any:
    """Return the content that :func:`with_digest` pickled; raise ValueError if the bytes do not match the digest."""
    size = len(data) - hashlib.sha256().digest_size
    if hashlib.sha256(data[:size]).digest() != data[size:]:
        raise ValueError("the content does not match its digest")
    return pickle.loads(data[:size])


_damaged: set[str] = set()


def _warn_about_damage(path: Any, error: Exception) -> None:
    """Warn about a damaged file: the first one only, since a full disk may truncate many."""
    if not _damaged:
        cause = " ".join(f"{type(error).__name__}: {error}".split())  # in one line
        LOGGER.warning("vibgym: damaged files of compiled kernels are written anew, the first %s (%s)", path, cause)
    _damaged.add(str(path))


def state_of(file: str, module: str) -> str:
    """Return a digest of a kernel's sources, and the width of registers if the kernel uses it.

    A kernel for one width would write beyond arrays made for another.
    """
    wide = Path(__file__).with_name("vec8.py") in imported_files(file, module)
    return sources(file, module) + (f" {WIDTH}" if wide else "")


# -- the wheel ---------------------------------------------------------------------------------------------------------


def collect(folder: Path) -> None:
    """From now on, write the bitcode of every kernel that is compiled or loaded to ``folder``, as wheels contain it."""
    global _collected_in
    folder.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256(json.dumps(VERSIONS).encode()).hexdigest()
    (folder / f"versions-{digest[:12]}.json").write_text(json.dumps(VERSIONS), encoding="utf-8")
    _collected_in = folder


def _collect_kernel(function: Any, payload: Any) -> None:
    """Write a kernel's bitcode and numba's metadata to the folder of :func:`collect`, if any."""
    if _collected_in is None or function.__closure__ is not None:
        return
    (name, _, bitcode, _, units), *more = payload
    more[5] = ""  # type annotations, which contain paths of the machine that builds the wheel
    (_collected_in / _file_name(function, more[2].args)).write_bytes(with_digest(((name, bitcode, units), *more)))


def _load_shipped(function: Any, arguments: Any, target_context: Any) -> Any:
    """Return a kernel compiled from the wheel's bitcode; None if there is none for these types of the arguments."""
    unsuitable = config.BOUNDSCHECK or config.DEBUGINFO_DEFAULT or function.__closure__ is not None
    if not options.BITCODE or unsuitable or not SHIPPED.is_dir():
        return None
    path = SHIPPED / _file_name(function, arguments)
    try:
        payload = checked(path.read_bytes())
        target_context.refresh()
        return _rebuild(target_context, payload)
    except FileNotFoundError:
        return None
    except Exception as error:  # a damaged pickle or module may raise anything
        _warn_about_damage(path, error)
        return None


def _file_name(function: Any, arguments: Any) -> str:
    state = state_of(function.__code__.co_filename, function.__module__)
    versions = tuple(VERSIONS.values())
    key = (*versions, state, function.__qualname__, function.__code__.co_firstlineno, tuple(arguments))
    return f"{function.__name__}-{hashlib.sha256(repr(key).encode()).hexdigest()[:20]}.bitcode"


def version_mismatch() -> str:
    """Return how this process differs from those that the wheel's kernels are for; "" if it does not, or without kernels."""
    shipped = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(SHIPPED.glob("versions-*.json"))]
    if not shipped or VERSIONS in shipped:
        return ""
    differing = [[name for name, own in VERSIONS.items() if each.get(name) != own] for each in shipped]
    names, nearest = min(zip(differing, shipped), key=lambda pair: len(pair[0]))
    theirs, ours = (", ".join(f"{name} {each.get(name)}" for name in names) for each in (nearest, VERSIONS))
    return f"precompiled kernels target {theirs}, this is {ours}"


# -- the cache ---------------------------------------------------------------------------------------------------------


class Cache(caching.FunctionCache):
    """Cache of one kernel: numba's, with :class:`_Files` on disk; a kernel that is not there comes from the wheel.

    Args:
        function: the kernel.
    """

    _cache_path: Any = None
    _enabled = False

    def __init__(self, function: Any) -> None:
        self._function = function
        place = function.__code__.co_filename, function.__module__
        if options.CACHE:
            try:
                super().__init__(function)
            except RuntimeError:  # numba has found no writable folder
                options.warn_about_cache("no folder that may be written")
            else:
                # No stamp: that of older numba is the file's time, which a checkout changes. The version has a digest.
                # The version is compared before anything else is read, which another version may not be able to unpickle.
                files: Any = _Files(self._cache_path, self._impl.filename_base, source_stamp="")
                files._version = f"{files._version} {state_of(*place)}"
                self._cache_file = files
        self._current = unchanged(*place)
        if not self._current:  # the kernel may be older than the files that the digest is of
            self.disable()

    def contains(self, arguments: Any, target_context: Any) -> bool:
        """Return whether the kernel for arguments of these types is in the cache."""
        if not self._enabled:
            return False
        try:
            key = self._index_key(arguments, target_context.codegen())
            name = self._cache_file._load_index().get(key)
        except OSError:
            return False
        return name is not None and Path(self._cache_file._data_path(name)).exists()

    def ships(self, arguments: Any) -> bool:
        """Return whether the wheel contains the kernel for arguments of these types."""
        return options.BITCODE and self._current and (SHIPPED / _file_name(self._function, arguments)).exists()

    @property
    def stores(self) -> bool:
        """Whether compiled kernels are kept on disk."""
        return self._enabled

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the kernel for arguments of these types; None if it has to be compiled."""
        found = None
        try:
            found = super().load_overload(sig, target_context)
        except OSError as error:
            self._disable_with_warning(error)
        if found is None and self._current:
            found = _load_shipped(self._function, sig, target_context)
            if found is not None:
                self.save_overload(sig, found)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the kernel for arguments of these types."""
        try:
            super().save_overload(sig, data)
        except OSError as error:  # a full disk, a folder that is not writable
            self._disable_with_warning(error)

    def _disable_with_warning(self, error: OSError) -> None:
        options.warn_about_cache(str(error))
        self.disable()


class _Result(caching.CompileResultCacheImpl):
    """Content of a kernel's file: numba's metadata, machine code, and the bitcode it was made from."""

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        self._function = py_func

    def reduce(self, cres: Any) -> Any:
        payload = super().reduce(cres)
        _collect_kernel(self._function, payload)
        return payload

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        _collect_kernel(self._function, payload)
        return _rebuild(target_context, payload)


Cache._impl_class = _Result


class _RebuildContext:
    """A target context that loads libraries as :class:`vibgym.kernels.libraries.LinkedLibrary`."""

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def codegen(self) -> Any:
        return self

    def unserialize_library(self, state: Any) -> Any:
        load = LinkedLibrary.from_object if len(state) > 3 else LinkedLibrary.from_bitcode
        return load(self._context.codegen(), *state)

    def get_executable(self, library: Any, fndesc: Any, env: Any) -> Any:
        """Return the function for Python; for a unit, which Python does not call, an object that identifies it."""
        return object() if is_unit(fndesc) else self._context.get_executable(library, fndesc, env)


def _rebuild(target_context: Any, payload: Any) -> Any:
    rebuilt: Any = CompileResult._rebuild(_RebuildContext(target_context), *payload)
    return rebuilt._replace(target_context=target_context)


class _Files(caching.IndexDataCacheFile):
    """A kernel's index and data files; damaged files, and data of another kernel, count as missing."""

    _index_path: str
    _version: str

    def load(self, key: Any) -> Any:
        """Return the kernel's code; None if it is missing."""
        label, found = super().load(key) or (None, None)
        return found if label == self._label(key) else None

    def save(self, key: Any, data: Any) -> None:
        """Store the kernel's code."""
        super().save(key, (self._label(key), data))

    def _label(self, key: Any) -> str:
        return f"{self._version} {key}"

    def _dump(self, obj: Any) -> bytes:
        return with_digest(obj)

    def _load_index(self) -> Any:
        try:
            return super()._load_index()
        except OSError:
            raise
        except Exception as error:  # a damaged pickle may raise anything
            _warn_about_damage(self._index_path, error)
            return {}

    def _load_data(self, name: str) -> Any:
        path = Path(self._index_path).with_name(name)
        try:
            return checked(path.read_bytes())
        except OSError:
            raise
        except Exception as error:
            _warn_about_damage(path, error)
            return None
