"""One run at a time in a directory."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from filelock import FileLock, Timeout

from vibgym import checks
from vibgym.files import reason

FILE = ".vibgym.lock"

PATIENCE = 0.2
"""s to wait for another run; above 0, since a lock file that is removed while it is opened is tried again."""


@contextlib.contextmanager
def one_run(directory: Path, field: str = "output", file: str = FILE) -> Iterator[None]:
    """Lock an existing directory for this run within a block.

    The operating system holds the lock and releases it when the process ends, so the file of a killed run locks nothing. The
    file names the process, its host and the time. On network file systems the lock holds between hosts where these support it
    (NFS since version 4, older ones with lockd); a file system without locks is refused.

    Args:
        directory: of the lock file.
        field: name of the setting, for the error.
        file: name of the lock file, to lock only a part of the directory.

    Raises:
        ValueError: another run uses the directory, or it cannot be locked.
    """
    path = directory / file
    lock = FileLock(path, fallback_to_soft=False, on_acquired=_sign)
    try:
        lock.acquire(timeout=PATIENCE, poll_interval=0.02)
    except OSError as error:
        why = f"in use by {_owner(path)}" if isinstance(error, Timeout) else f"{file} cannot be locked: {reason(error)}"
        raise checks.refuse(field, str(directory), f"a directory in which no other run is at work ({why})") from None
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # Windows removes it on release; a waiting process detects the removal
            path.unlink()
        lock.release()


def _sign(handle: int) -> None:
    since = datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    os.ftruncate(handle, 0)
    os.write(handle, f"process {os.getpid()} on host {socket.gethostname()} since {since}\n".encode())


def _owner(path: Path) -> str:
    text = ""
    with contextlib.suppress(OSError):  # where a lock also keeps others from reading
        text = " ".join(path.read_text(encoding="utf-8", errors="replace")[:200].split())
    return text or "another process"
