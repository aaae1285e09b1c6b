"""Writing files so that a killed program or a full disk leaves either the old ones or the new ones, whole."""

from __future__ import annotations

import contextlib
import csv
import hashlib
import math
import os
import re
import secrets
import shutil
import socket
import stat
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from vibgym import checks

HOST = hashlib.sha256(socket.gethostname().encode()).hexdigest()[:8]

TEMPORARY = re.compile(r"\.vibgym-([0-9a-f]{8})-([0-9]{1,10})-[0-9a-f]{16}\.tmp")
"""Names of our temporary files: host, process, and a random number."""

LONGEST_NAME = 128
"""Of what is written into an output directory, generously: TensorBoard names its files by time, host and process."""

DAY = 86_400.0

_in_work: set[str] = set()
"""Temporary files that this process is writing."""


class WriteError(OSError):
    """Files could not be written; those that stood there before are whole, and no new one stands beside them."""


def output_directory(path: Path, field: str = "output") -> Path:
    """Make sure that files can be written into ``path``, and remove what killed runs have left there.

    Args:
        path: the directory, created with its parents if needed.
        field: name of the setting, for the error.

    Raises:
        ValueError: it cannot be created or written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        sweep(path)
        _write_temporary(path, b"").unlink()
        with contextlib.suppress(FileNotFoundError):
            os.lstat(path / ("x" * LONGEST_NAME))
    except (OSError, ValueError) as error:  # ValueError: names that no file system takes, such as one with a NUL
        raise checks.refuse(field, str(path), f"a directory that can be written to ({reason(error)})") from None
    return path


def output_files(paths: Iterable[Path], field: str) -> None:
    """Make sure that files of these names can be written or replaced; creates their directories.

    Raises:
        ValueError: a directory cannot be written to, a name is none, or something that is no file stands in its place.
    """
    for path in paths:
        try:
            regular = stat.S_ISREG(path.stat().st_mode)
        except (FileNotFoundError, NotADirectoryError):
            regular = True
        except (OSError, ValueError) as error:
            raise checks.refuse(field, str(path), f"the path of a file that can be written ({reason(error)})") from None
        if not regular:
            raise checks.refuse(field, str(path), "the path of a file (what stands there is none)")
        output_directory(path.parent, field)


def write_atomically(path: Path, content: str | bytes) -> None:
    """Replace the file ``path`` by ``content``; :func:`write_together` of one file."""
    write_together({path: content})


def write_together(contents: Mapping[Path, str | bytes]) -> None:
    """Replace files by new contents (text as UTF-8), all of them or none.

    Every content goes to a temporary file beside its place and is flushed to the disk before the first one takes its name.
    Where one cannot, those that have get their old contents back. So only a process that is killed between two renames leaves a
    mixture, each file of it whole.

    Raises:
        WriteError: a file could not be written; all are as they were.
    """
    fresh: dict[Path, Path] = {}
    old: dict[Path, Path | None] = {}
    path = Path()
    try:
        for path, content in contents.items():
            fresh[path] = _write_temporary(path.parent, content.encode() if isinstance(content, str) else content)
        for path in contents if len(contents) > 1 else ():
            old[path] = _copy(path)
        for path, temporary in fresh.items():
            os.replace(temporary, path)
    except BaseException as error:
        renamed = [each for each, temporary in fresh.items() if not temporary.exists()]
        for each in renamed if len(renamed) < len(contents) else ():
            before = old.pop(each)
            each.unlink() if before is None else os.replace(before, each)
        if isinstance(error, OSError):
            raise WriteError(f"{path}: could not be written ({reason(error)}); all is as it was") from error
        raise
    finally:
        for each in (*fresh.values(), *old.values()):
            if each is not None:
                each.unlink(missing_ok=True)
                _in_work.discard(each.name)


def _temporary(directory: Path) -> Path:
    path = directory / f".vibgym-{HOST}-{os.getpid()}-{secrets.token_hex(8)}.tmp"
    _in_work.add(path.name)
    return path


def _write_temporary(directory: Path, data: bytes) -> Path:
    path = _temporary(directory)
    try:
        with path.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        path.unlink(missing_ok=True)
        _in_work.discard(path.name)
        raise
    return path


def _copy(path: Path) -> Path | None:
    """A copy of a file, or None if there is none to be copied."""
    copy = _temporary(path.parent)
    try:
        shutil.copy2(path, copy, follow_symlinks=False)
    except FileNotFoundError:
        _in_work.discard(copy.name)
        return None
    except BaseException:
        copy.unlink(missing_ok=True)
        _in_work.discard(copy.name)
        raise
    return copy


def sweep(directory: Path) -> None:
    """Remove the temporary files of processes that are gone.

    Another host's processes cannot be asked: their files go when they are a day old.
    """
    for entry in list(os.scandir(directory)):
        match = TEMPORARY.fullmatch(entry.name)
        if match is None:
            continue
        with contextlib.suppress(OSError):  # another run may sweep too
            aged = time.time() - entry.stat(follow_symlinks=False).st_mtime > DAY
            if aged or (match[1] == HOST and not _is_at_work(int(match[2]), entry.name)):
                os.unlink(entry.path)


def _is_at_work(process: int, name: str) -> bool:
    if process == os.getpid():  # or had the same number: in a container the first process always has
        return name in _in_work
    if os.name != "posix":  # signal 0 is no question elsewhere
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def reason(error: Exception) -> str:
    """Why the system refused, without the path."""
    return getattr(error, "strerror", None) or str(error)


def csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """CSV with a header; what does not apply, None or a number that is not finite, is empty.

    Spreadsheets take text that begins with ``=``, ``+``, ``-``, ``@``, a tab or a carriage return for a formula: it gets an
    apostrophe in front. Numbers stay as they are.
    """
    lines: list[str] = []
    # A writer quotes the characters of its line's end, and a lone carriage return must be.
    sink: Any = SimpleNamespace(write=lines.append)
    writer = csv.writer(sink, lineterminator="\r\n")
    writer.writerow(rows[0])
    writer.writerows([_cell(row[key]) for key in rows[0]] for row in rows)
    return "".join(line.removesuffix("\r\n") + "\n" for line in lines)


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return f"'{value}" if value.startswith(("=", "+", "-", "@", "\t", "\r")) else value
    return "" if value is None or (isinstance(value, float) and not math.isfinite(value)) else value
