"""Atomic writes, temporary files of killed runs, and invalid paths."""

from __future__ import annotations

import csv
import errno
import io
import math
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from vibgym.files import WriteError, csv_text, output_directory, output_files, write_together

NAMES = ("a.csv", "b.json", "c.html")

posix = pytest.mark.skipif(sys.platform == "win32", reason="processes and paths of POSIX")


def contents(directory: Path, text: str) -> dict[Path, str | bytes]:
    return {directory / name: f"{text} {name}" for name in NAMES}


def failing(call: Callable, number: int, error: BaseException) -> Callable:
    """Return the function with an error at its n-th call."""
    calls = []

    def fails(*arguments: object, **named: object) -> object:
        calls.append(arguments)
        if len(calls) == number:
            raise error
        return call(*arguments, **named)

    return fails


FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("error", [FULL, KeyboardInterrupt()], ids=["full disk", "interrupt"])
@pytest.mark.parametrize("number", [1, 3])
@pytest.mark.parametrize("module, name", [(os, "fsync"), (shutil, "copy2"), (os, "replace")])
@pytest.mark.parametrize("stood", [(), NAMES[:2], NAMES])
def test_all_files_are_new_or_none(tmp_path, monkeypatch, module, name, number, stood, error):
    before = {other: f"old {other}" for other in stood}
    for other, text in before.items():
        (tmp_path / other).write_text(text)
    monkeypatch.setattr(module, name, failing(getattr(module, name), number, error))
    with pytest.raises(WriteError if error is FULL else KeyboardInterrupt) as caught:
        write_together(contents(tmp_path, "new"))
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == before
    assert error is not FULL or ("No space left" in str(caught.value) and str(tmp_path) in str(caught.value))
    monkeypatch.undo()
    write_together(contents(tmp_path, "new"))
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {file: f"new {file}" for file in NAMES}


def test_a_directory_at_a_files_path_prevents_all_writes(tmp_path):
    (tmp_path / "c.html").mkdir()
    with pytest.raises(WriteError, match="c.html"):
        write_together(contents(tmp_path, "new"))
    assert [path.name for path in tmp_path.iterdir()] == ["c.html"]


def killed_while_writing(directory: Path, number: int) -> None:
    """Kill a process that writes into the directory as it renames."""
    process = os.fork()
    if not process:
        os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)  # type: ignore[assignment]
        try:
            write_together(dict(list(contents(directory, "new").items())[:number]))
        finally:
            os._exit(1)
    assert os.waitpid(process, 0)[1] == signal.SIGKILL


@posix
@pytest.mark.parametrize("number", [1, 3])
def test_a_killed_run_leaves_old_files_and_temporary_ones_that_are_removed_after_a_day(tmp_path, number):
    write_together(contents(tmp_path, "old"))
    killed_while_writing(tmp_path, number)
    temporary = set(tmp_path.glob(".vibgym-*.tmp"))
    assert len(temporary) >= number
    output_directory(tmp_path)
    assert temporary < set(tmp_path.iterdir())  # another run may be writing
    for path in temporary:
        os.utime(path, (time.time() - 1.1 * 86_400,) * 2)
    (tmp_path / ".vibgym.lock").write_text("")
    os.utime(tmp_path / ".vibgym.lock", (0, 0))
    output_directory(tmp_path)
    expected = {name: f"old {name}" for name in NAMES} | {".vibgym.lock": ""}
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == expected


def file_in(path: Path) -> Path:
    (path / "file").write_text("")
    return path / "file"


def long(path: Path) -> Path:
    """Return a directory with nearly the longest possible path."""
    room = 4095 - 60 - len(os.path.relpath(path))
    return Path(os.path.relpath(path), *(["y" * 199] * (room // 200)), "y" * max(room % 200 - 1, 1))


BAD_DIRECTORIES: dict[str, Callable[[Path], Path]] = {
    "a file": file_in,
    "below a file": lambda path: file_in(path) / "below" / "it",
    "overlong name": lambda path: path / ("x" * 300),
    "overlong path": lambda path: path / "/".join(["x" * 200] * 30),
    "nearly overlong path": long,
    "NUL": lambda path: path / "a\0b",
    "no text": lambda path: path / "a\ud800b",
}
if sys.platform == "linux":
    BAD_DIRECTORIES |= {
        "of the system": lambda path: Path("/proc/self/vibgym"),
        "no place for files": lambda path: Path("/proc/self"),
    }


@posix
@pytest.mark.parametrize("case", BAD_DIRECTORIES)
def test_bad_directories_are_refused_in_one_line(tmp_path, case):
    directory = BAD_DIRECTORIES[case](tmp_path)
    for refuse, name in (
        (lambda: output_directory(directory), "output"),
        (lambda: output_files([directory / "a.gif"], "--gif"), "--gif"),
    ):
        with pytest.raises(ValueError, match=name) as error:
            refuse()
        assert "\n" not in str(error.value) and len(str(error.value)) < 300


@posix
def test_bad_paths_of_files_are_refused_and_good_ones_unchanged(tmp_path):
    for bad in (tmp_path, Path("/dev/null"), tmp_path / ("x" * 300)):
        with pytest.raises(ValueError, match="--gif"):
            output_files([bad], "--gif")
    (tmp_path / "a.gif").write_text("old")
    output_files([tmp_path / "a.gif", tmp_path / "new" / "b.gif"], "--gif")
    assert (tmp_path / "a.gif").read_text() == "old" and os.listdir(tmp_path / "new") == []


def test_csv_text_is_not_a_formula_and_numbers_stay_numbers():
    for text in ("=1+1", "+cmd", "-2 fast", "@SUM(A1)", "\t=1", "\r=1", '=HYPERLINK("x")'):
        (row,) = csv.DictReader(io.StringIO(csv_text([{"policy": text, "score": -1.5}]), newline=""))
        assert row == {"policy": f"'{text}", "score": "-1.5"}
    row = {"a": -1, "b": np.float64(-2e-9), "c": math.nan, "d": None, "e": True, "f": "a-b = c", "g": -math.inf}
    assert csv_text([row]).splitlines() == ["a,b,c,d,e,f,g", "-1,-2e-09,,,True,a-b = c,"]
