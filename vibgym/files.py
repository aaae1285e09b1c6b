"""Writing files so that a killed program leaves either the old one or the new one, whole."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from vibgym import checks


def output_directory(path: Path, field: str = "output") -> Path:
    """Make sure that files can be written into ``path``.

    Args:
        path: the directory, created with its parents if needed.
        field: name of the setting, for the error.

    Raises:
        ValueError: it cannot be created or written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise checks.refuse(field, str(path), f"a directory that can be written to ({error.strerror})") from None
    return path


def write_atomically(path: Path, content: str | bytes) -> None:
    """Replace the file ``path`` by ``content`` (text as UTF-8) in one step.

    The content goes to a temporary file beside it, is flushed to the disk, and takes the name last.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes files for the owner alone; a report is to be read like any other file.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
