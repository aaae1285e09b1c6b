"""One run at a time in a directory, and none that a dead one keeps out."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import signal
import time
from collections.abc import Callable, Iterator

import pytest

from agents import locks
from agents.locks import FILE, one_run


@contextlib.contextmanager
def child(work: Callable[[], object]) -> Iterator[int]:
    """Another process that has done some work, and waits to be killed."""
    done, say = os.pipe()
    process = os.fork()
    if not process:
        try:
            work()
            os.write(say, b".")
            signal.pause()
        finally:
            os._exit(1)
    os.close(say)
    try:
        assert os.read(done, 1) == b"."
        yield process
    finally:
        os.close(done)
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)


def test_a_second_run_is_refused_by_name_until_the_first_is_killed(tmp_path):
    held = one_run(tmp_path)
    with child(held.__enter__) as process:
        with pytest.raises(ValueError, match="output") as caught:
            with one_run(tmp_path):
                pass
        assert "\n" not in str(caught.value)
        with one_run(tmp_path, file="other.lock"):  # what is kept by another name
            pass
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
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


def test_never_two_at_once(tmp_path, monkeypatch):
    """Each of many runs reads the counter that the last one wrote."""
    monkeypatch.setattr(locks, "PATIENCE", 20.0)
    directory, counter = tmp_path / "held", tmp_path / "counter"
    directory.mkdir()
    counter.write_text("0")

    def work() -> None:
        for _ in range(30):
            with one_run(directory):
                count = int(counter.read_text())
                time.sleep(0.0005)
                counter.write_text(str(count + 1))

    with contextlib.ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(child(lambda: None))  # so that numbers of processes differ
        processes = []
        for _ in range(4):
            process = os.fork()
            if not process:
                code = 1
                try:
                    work()
                    code = 0
                finally:
                    os._exit(code)
            processes.append(process)
        assert [os.waitpid(process, 0)[1] for process in processes] == [0] * 4
    assert counter.read_text() == "120" and os.listdir(directory) == []


def test_a_file_system_without_locks_is_refused(tmp_path, monkeypatch):
    def none(handle: int, how: int) -> None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))

    monkeypatch.setattr(fcntl, "flock", none)
    with pytest.raises(ValueError, match="output"), one_run(tmp_path):
        pass


def test_what_stands_in_the_locks_place_is_named(tmp_path):
    (tmp_path / FILE).mkdir()
    with pytest.raises(ValueError, match=r"output"), one_run(tmp_path):
        pass
