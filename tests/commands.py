"""Helpers for tests of commands: one-line errors, settings files, tables, a full disk."""

import csv
import errno
import os

import yaml


def refusal(capsys, main, *arguments):
    """Return the one line on stderr of a command that refuses its input."""
    capsys.readouterr()
    assert main([*map(str, arguments), "--quiet"]) == 2
    return said_in_one_line(capsys)


def said_in_one_line(capsys):
    """Return the error of a failed command, which is its only output."""
    caught = capsys.readouterr()
    assert caught.out == "" and caught.err.count("\n") == 1 and "Traceback" not in caught.err
    return caught.err


def saved(directory, content, **changes):
    """Write a settings file with output directory ``out`` next to it; settings of None are omitted."""
    path = directory / "mine.yaml"
    content = {**content, "output": str(directory / "out"), **changes}
    path.write_text(yaml.safe_dump({key: value for key, value in content.items() if value is not None}))
    return path


def rows_of(path):
    """Return the rows of a CSV file."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def file_at(path):
    path.write_text("mine")
    return path


def folder_at(path):
    path.mkdir(parents=True)
    return path


def files_in(folder, which="**/*"):
    """Return the contents of the files of a folder, without locks."""
    return {str(path): path.read_bytes() for path in folder.glob(which) if path.is_file() and ".lock" not in path.name}


def fill_the_disk(monkeypatch, room=0):
    """Make writing fail after ``room`` more files."""
    flush, calls = os.fsync, []

    def full(handle):
        calls.append(handle)
        if len(calls) > room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush(handle)

    monkeypatch.setattr(os, "fsync", full)
