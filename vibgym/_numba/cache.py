"""Where compiled kernels are kept.

The version of a cached kernel holds a digest of its file and of all that it imports (:mod:`vibgym._numba.sources`). A file of
the cache also holds a digest of its own content: one that a crash or a full disk has cut short is not loaded but written anew.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile

LOGGER = logging.getLogger("vibgym")


class Files(IndexDataCacheFile):
    """A kernel's files in the cache, each with a digest of its content: numba would trust whatever it can unpickle.

    Damaged ones count as missing, and are then written anew.
    """

    _index_path: str
    _source_stamp: Any
    _version: str

    def load(self, key: Any) -> Any:
        """The kernel's code; None: not there."""
        try:
            return super().load(key)
        except OSError:
            raise
        except Exception as error:  # of a damaged pickle, anything
            _warn_about_damage(self._index_path, f"{type(error).__name__}: {error}")
            return None

    def _dump(self, obj: Any) -> bytes:
        data: bytes = super()._dump(obj)  # type: ignore[misc]
        return hashlib.sha256(data).digest() + data

    def _load_index(self) -> Any:
        try:
            with open(self._index_path, "rb") as file:
                if pickle.load(file) != self._version:
                    return {}
                stamp, overloads = _undamaged(file.read())
        except FileNotFoundError:
            return {}
        except OSError:
            raise
        except Exception as error:
            _warn_about_damage(self._index_path, f"{type(error).__name__}: {error}")
            return {}
        return overloads if stamp == self._source_stamp else {}

    def _load_data(self, name: str) -> Any:
        return _undamaged(Path(self._index_path).with_name(name).read_bytes())


def _undamaged(data: bytes) -> Any:
    size = hashlib.sha256().digest_size
    if hashlib.sha256(data[size:]).digest() != data[:size]:
        raise ValueError("the content does not match its digest")
    return pickle.loads(data[size:])


_damaged: set[str] = set()


def _warn_about_damage(path: str, reason: str) -> None:
    if not _damaged:  # one line, however many files a full disk has cut short
        LOGGER.warning("vibgym: damaged files of compiled kernels are written anew, the first %s (%s)", path, reason)
    _damaged.add(path)
