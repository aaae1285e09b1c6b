"""Where compiled kernels are kept, and where others come from that need not be compiled.

The version of a cached kernel holds a digest of its file and of all that it imports (:mod:`vibgym.kernels.sources`). A file of
the cache also holds a digest of its own content: one that a crash or a full disk has cut short is not loaded but written anew.
It says as well what it is for: of two processes that add to an index at once, one may write where the other's entry points.
"""

from __future__ import annotations

import logging
import pickle
from pathlib import Path
from typing import Any

from numba.core import caching
from numba.core.compiler import CompileResult

from vibgym.kernels import options, shipped
from vibgym.kernels.libraries import Whole
from vibgym.kernels.sources import last_edit

LOGGER = logging.getLogger("vibgym")


class Cache(caching._Cache):
    """A kernel's: what is kept, else what came with the wheel, which is kept once it is made ready for this processor.

    Args:
        function: the kernel.
        imported: when Python read its file, and those that it imports.
    """

    def __init__(self, function: Any, imported: float) -> None:
        self._function = function
        self._kept: Any = caching.NullCache()
        place = function.__code__.co_filename, function.__module__
        # What is compiled may be older than what the digest of the sources tells of.
        self._current = last_edit(*place) <= imported
        if options.CACHE:
            try:
                self._kept = _Kept(function)
            except RuntimeError:  # numba has found no folder that it may write to
                options.warn_about_cache("no folder that may be written")
        if not self._current:
            self._kept.disable()

    @property
    def cache_path(self) -> Any:
        return self._kept.cache_path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel for arguments of these types; None: it has to be compiled."""
        try:
            found = self._kept.load_overload(sig, target_context)
        except OSError as error:
            found = self._lose(error)
        if found is not None:
            return found
        found = self._shipped(sig, target_context)
        if found is not None:
            self.save_overload(sig, found)
        return found

    def _shipped(self, sig: Any, target_context: Any) -> Any:
        payload = shipped.load(self._function, sig) if self._current and self._function.__closure__ is None else None
        if payload is None:
            return None
        target_context.refresh()
        try:
            return _rebuilt(target_context, payload)
        except Exception as error:  # of LLVM, or of a module that is not there
            shipped.report_damage(self._function, sig, error)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the kernel for arguments of these types."""
        try:
            self._kept.save_overload(sig, data)
        except OSError as error:  # a full disk, a folder that may not be written
            self._lose(error)

    def _lose(self, error: OSError) -> None:
        options.warn_about_cache(str(error))
        self.disable()

    def enable(self) -> None:
        self._kept.enable()

    def disable(self) -> None:
        self._kept.disable()

    def flush(self) -> None:
        self._kept.flush()


class _Result(caching.CompileResultCacheImpl):
    """What a kernel's file holds: numba's notes, machine code, and the bitcode that it was made of."""

    _function: Any

    def reduce(self, cres: Any) -> Any:
        payload = super().reduce(cres)
        if self._function.__closure__ is None:
            shipped.add(self._function, payload)
        return payload

    def rebuild(self, target_context: Any, reduced_data: Any) -> Any:
        if self._function.__closure__ is None:
            shipped.add(self._function, reduced_data)
        return _rebuilt(target_context, reduced_data)


class _Kept(caching.FunctionCache):
    """numba's own, with other files. numba has no public way to say what else a kernel depends on."""

    _impl_class = _Result

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._impl._function = function
        own: Any = Files(self._cache_path, self._impl.filename_base, self._cache_file._source_stamp)
        # The version is looked at before anything else is read, which may no longer be readable.
        own._version = f"{own._version} {shipped.state_of(function.__code__.co_filename, function.__module__)}"
        self._cache_file = own


class _Rebuilding:
    """A target context whose libraries are :class:`vibgym.kernels.libraries.Whole`."""

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def codegen(self) -> Any:
        return self

    def unserialize_library(self, state: Any) -> Any:
        """Of machine code, or of bitcode alone."""
        return (Whole.from_object if len(state) > 2 else Whole.from_bitcode)(self._context.codegen(), *state)


def _rebuilt(target_context: Any, payload: Any) -> Any:
    rebuilt: Any = CompileResult._rebuild(_Rebuilding(target_context), *payload)
    return rebuilt._replace(target_context=target_context)


class Files(caching.IndexDataCacheFile):
    """A kernel's files in the cache, each with a digest of its content, and with what it is for.

    Damaged ones count as missing, and are then written anew.
    """

    _index_path: str
    _source_stamp: Any
    _version: str

    def load(self, key: Any) -> Any:
        """The kernel's code; None: not there."""
        try:
            found = super().load(key)
        except OSError:
            raise
        except Exception as error:  # of a damaged pickle, anything
            _warn_about_damage(self._index_path, f"{type(error).__name__}: {error}")
            return None
        return found[1] if found is not None and found[0] == self._label(key) else None

    def save(self, key: Any, data: Any) -> None:
        """Keep the kernel's code."""
        super().save(key, (self._label(key), data))

    def _label(self, key: Any) -> str:
        return f"{self._version} {key}"

    def _dump(self, obj: Any) -> bytes:
        return shipped.stamped(obj)

    def _load_index(self) -> Any:
        try:
            with open(self._index_path, "rb") as file:
                if pickle.load(file) != self._version:
                    return {}
                stamp, overloads = shipped.undamaged(file.read())
        except FileNotFoundError:
            return {}
        except OSError:
            raise
        except Exception as error:
            _warn_about_damage(self._index_path, f"{type(error).__name__}: {error}")
            return {}
        return overloads if stamp == self._source_stamp else {}

    def _load_data(self, name: str) -> Any:
        return shipped.undamaged(Path(self._index_path).with_name(name).read_bytes())


_damaged: set[str] = set()


def _warn_about_damage(path: str, reason: str) -> None:
    if not _damaged:  # one line, however many files a full disk has cut short
        LOGGER.warning("vibgym: damaged files of compiled kernels are written anew, the first %s (%s)", path, reason)
    _damaged.add(path)
