"""One run at a time in a directory, and none that a dead one keeps out."""

from __future__ import annotations

import errno
import fcntl
import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor

import pytest

from agents import locks
from agents.locks import FILE, one_run

FORK = multiprocessing.get_context("fork")


def hold(directory, ready):
    with one_run(directory):
        ready.set()
        time.sleep(60)


def test_a_second_run_is_refused_by_name_until_the_first_is_killed(tmp_path):
    ready = FORK.Event()
    first = FORK.Process(target=hold, args=(tmp_path, ready), daemon=True)
    first.start()
    assert ready.wait(30)
    with pytest.raises(ValueError, match=f"^output .*process {first.pid} .*"), one_run(tmp_path):
        pass
    with one_run(tmp_path, file="other.lock"):  # what is kept by another name
        pass
    first.kill()
    first.join()
    assert (tmp_path / FILE).exists()
    with one_run(tmp_path):
        assert f"process {os.getpid()} " in (tmp_path / FILE).read_text()
    assert os.listdir(tmp_path) == []


def test_the_lock_goes_with_the_block_however_it_ends(tmp_path):
    with pytest.raises(KeyboardInterrupt), one_run(tmp_path):
        with pytest.raises(ValueError, match=f"process {os.getpid()}"), one_run(tmp_path):
            pass
        raise KeyboardInterrupt
    with one_run(tmp_path):
        pass
    assert os.listdir(tmp_path) == []


def count_up(directory, counter):
    for _ in range(30):
        with one_run(directory):
            count = int(counter.read_text())
            time.sleep(0.0005)
            counter.write_text(str(count + 1))


def test_never_two_at_once(tmp_path, monkeypatch):
    """Each of many runs reads the counter that the last one wrote."""
    monkeypatch.setattr(locks, "PATIENCE", 20.0)
    directory, counter = tmp_path / "held", tmp_path / "counter"
    directory.mkdir()
    counter.write_text("0")
    with ProcessPoolExecutor(4, FORK) as pool:
        for run in [pool.submit(count_up, directory, counter) for _ in range(4)]:
            run.result()
    assert counter.read_text() == "120" and os.listdir(directory) == []


def test_what_cannot_be_locked_is_refused(tmp_path, monkeypatch):
    """A folder in the place of the file, and a file system without locks."""
    (tmp_path / FILE).mkdir()
    with pytest.raises(ValueError, match="output"), one_run(tmp_path):
        pass

    def none(handle: int, how: int) -> None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))

    monkeypatch.setattr(fcntl, "flock", none)
    with pytest.raises(ValueError, match="output"), one_run(tmp_path, file="other.lock"):
        pass
