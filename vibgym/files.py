"""Atomic file writes: after a crash or with a full disk, files hold either the old or the new content."""

from __future__ import annotations

import contextlib
import csv
import math
import os
import secrets
import shutil
import stat
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from vibgym import checks

TEMPORARY = ".vibgym-*.tmp"
"""Pattern of the names of temporary files, with a random number."""

LONGEST_NAME = 128
"""Longest file name written to an output directory; TensorBoard uses time, host and process."""

DAY = 86_400.0


class WriteError(OSError):
    """Files could not be written; existing files are unchanged."""


def output_directory(path: Path, field: str = "output") -> Path:
    """Create a writable directory, and remove temporary files in it that are older than a day: those of killed runs.

    Args:
        path: directory; created with its parents.
        field: name of the setting, for errors.

    Raises:
        ValueError: the directory cannot be created or written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        sweep(path)
        _write_temporary(path, b"").unlink()
        with contextlib.suppress(FileNotFoundError):
            os.lstat(path / ("x" * LONGEST_NAME))
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise checks.refuse(field, str(path), f"a directory that can be written to ({reason(error)})") from None
    return path


def output_files(paths: Iterable[Path], field: str) -> None:
    """Check that files can be written or replaced; create their directories.

    Raises:
        ValueError: a directory cannot be written to, or a path is not that of a file.
    """
    for path in paths:
        try:
            regular = stat.S_ISREG(path.stat().st_mode)
        except (FileNotFoundError, NotADirectoryError):
            regular = True
        except (OSError, ValueError) as error:
            raise checks.refuse(field, str(path), f"the path of a writable file ({reason(error)})") from None
        if not regular:
            raise checks.refuse(field, str(path), "the path of a file, not of a directory or device")
        output_directory(path.parent, field)


def write_atomically(path: Path, content: str | bytes) -> None:
    """Replace one file, see :func:`write_together`."""
    write_together({path: content})


def write_together(contents: Mapping[Path, str | bytes]) -> None:
    """Replace the content of several files (text as UTF-8), all or none.

    Each content is written to a temporary file in the same directory and flushed to the disk before the first rename. If a
    rename fails, the files renamed before get their old content back. Only a process killed between two renames leaves old and
    new files together.

    Raises:
        WriteError: a file could not be written; all files are unchanged.
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
        renamed = [target for target, temporary in fresh.items() if not temporary.exists()]
        for target in renamed if len(renamed) < len(contents) else ():
            before = old.pop(target)
            target.unlink() if before is None else os.replace(before, target)
        if isinstance(error, OSError):
            raise WriteError(f"{path}: could not be written ({reason(error)}); existing files are unchanged") from error
        raise
    finally:
        for leftover in (*fresh.values(), *old.values()):
            if leftover is not None:
                leftover.unlink(missing_ok=True)


def _temporary(directory: Path) -> Path:
    return directory / f".vibgym-{secrets.token_hex(8)}.tmp"


def _write_temporary(directory: Path, data: bytes) -> Path:
    path = _temporary(directory)
    try:
        with path.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    return path


def _copy(path: Path) -> Path | None:
    """Copy a file; return the path of the copy, or None if the file does not exist."""
    copy = _temporary(path.parent)
    try:
        shutil.copy2(path, copy, follow_symlinks=False)
    except FileNotFoundError:
        return None
    except BaseException:
        copy.unlink(missing_ok=True)
        raise
    return copy


def sweep(directory: Path) -> None:
    """Remove temporary files that are older than a day."""
    for path in directory.glob(TEMPORARY):
        with contextlib.suppress(OSError):  # another run may remove them at the same time
            if time.time() - path.lstat().st_mtime > DAY:
                path.unlink()


def reason(error: Exception) -> str:
    """Return the reason for an operating system error, without the path."""
    return getattr(error, "strerror", None) or str(error)


def csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as CSV with a header; None and numbers that are not finite become empty cells.

    Text that a spreadsheet would read as a formula (``=``, ``+``, ``-``, ``@``, tab, carriage return) gets an apostrophe.
    """
    lines: list[str] = []
    # With this line end the writer also quotes lone carriage returns.
    sink: Any = SimpleNamespace(write=lines.append)
    writer = csv.writer(sink, lineterminator="\r\n")
    writer.writerow(rows[0])
    writer.writerows([_cell(row[key]) for key in rows[0]] for row in rows)
    return "".join(line.removesuffix("\r\n") + "\n" for line in lines)


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return f"'{value}" if value.startswith(("=", "+", "-", "@", "\t", "\r")) else value
    return "" if value is None or (isinstance(value, float) and not math.isfinite(value)) else value
