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
    before = {each: f"old {each}" for each in stood}
    for each, text in before.items():
        (tmp_path / each).write_text(text)
    monkeypatch.setattr(module, name, failing(getattr(module, name), number, error))
    with pytest.raises(WriteError if error is FULL else KeyboardInterrupt) as caught:
        write_together(contents(tmp_path, "new"))
    assert {each.name: each.read_text() for each in tmp_path.iterdir()} == before
    assert error is not FULL or ("No space left" in str(caught.value) and str(tmp_path) in str(caught.value))
    monkeypatch.undo()
    write_together(contents(tmp_path, "new"))
    assert {each.name: each.read_text() for each in tmp_path.iterdir()} == {each: f"new {each}" for each in NAMES}


def test_a_directory_at_a_files_path_prevents_all_writes(tmp_path):
    (tmp_path / "c.html").mkdir()
    with pytest.raises(WriteError, match="c.html"):
        write_together(contents(tmp_path, "new"))
    assert [each.name for each in tmp_path.iterdir()] == ["c.html"]


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
    for each in temporary:
        os.utime(each, (time.time() - 1.1 * 86_400,) * 2)
    (tmp_path / ".vibgym.lock").write_text("")
    os.utime(tmp_path / ".vibgym.lock", (0, 0))
    output_directory(tmp_path)
    expected = {each: f"old {each}" for each in NAMES} | {".vibgym.lock": ""}
    assert {each.name: each.read_text() for each in tmp_path.iterdir()} == expected


def in_place(path: Path) -> Path:
    path.write_text("")
    return path


BAD_DIRECTORIES: dict[str, tuple[Callable[[Path], Path], str]] = {
    "a file": (lambda path: in_place(path / "file"), "File exists"),
    "below a file": (lambda path: in_place(path / "file") / "below" / "it", "Not a directory"),
    "overlong name": (lambda path: path / ("x" * 300), "File name too long"),
    "overlong path": (lambda path: path / "/".join(["x" * 200] * 30), "File name too long"),
    "nearly overlong path": (lambda path: Path(os.path.relpath(path)) / long(path), "File name too long"),
    "NUL": (lambda path: path / "a\0b", "null"),
    "no text": (lambda path: path / "a\ud800b", "surrogates"),
}
if sys.platform == "linux":
    BAD_DIRECTORIES |= {
        "of the system": (lambda path: Path("/proc/self/vibgym"), "No such file"),
        "no place for files": (lambda path: Path("/proc/self"), "No such file"),
    }


def long(path: Path) -> Path:
    """Return a directory with nearly the longest possible path."""
    room = 4095 - 60 - len(os.path.relpath(path))
    return Path(*(["y" * 199] * (room // 200)), "y" * max(room % 200 - 1, 1))


@posix
@pytest.mark.parametrize("case", BAD_DIRECTORIES)
def test_bad_directories_are_refused_in_one_line(tmp_path, case):
    make, words = BAD_DIRECTORIES[case]
    with pytest.raises(ValueError, match="output") as caught:
        output_directory(make(tmp_path))
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


@posix
@pytest.mark.parametrize("case", [*BAD_DIRECTORIES, "a directory", "a device", "an overlong file"])
def test_bad_places_of_files_are_refused_in_one_line(tmp_path, case):
    own = {"a directory": tmp_path, "a device": Path("/dev/null"), "an overlong file": tmp_path / ("x" * 300)}
    path = own[case] if case in own else BAD_DIRECTORIES[case][0](tmp_path) / "a.gif"
    with pytest.raises(ValueError, match="--gif") as caught:
        output_files([path], "--gif")
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


def test_good_places_stay_as_they_are(tmp_path):
    (tmp_path / "a.gif").write_text("old")
    output_files([tmp_path / "a.gif", tmp_path / "new" / "b.gif"], "--gif")
    assert (tmp_path / "a.gif").read_text() == "old" and os.listdir(tmp_path / "new") == []


@pytest.mark.parametrize("text", ["=1+1", "+cmd", "-2 fast", "@SUM(A1)", "\t=1", "\r=1", '=HYPERLINK("x")'])
def test_csv_text_is_not_a_formula(text):
    (row,) = csv.DictReader(io.StringIO(csv_text([{"policy": text, "score": -1.5}]), newline=""))
    assert row == {"policy": f"'{text}", "score": "-1.5"}


def test_numbers_stay_numbers_and_harmless_text_stays(tmp_path):
    rows = [
        {"a": -1, "b": np.float64(-2e-9), "c": math.nan, "d": None, "e": True, "f": "a-b = c", "g": -math.inf, "h": ""}
    ]
    assert csv_text(rows).splitlines() == ["a,b,c,d,e,f,g,h", "-1,-2e-09,,,True,a-b = c,,"]
