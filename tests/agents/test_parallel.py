"""Parallel execution: the same results in processes and on Ray, errors, killed workers."""

import os
import signal
from pathlib import Path

import pytest
import torch

from agents import parallel
from vibgym import checks
from vibgym.simulation import threads


def square(number):
    return number**2, os.getcwd()


def fails(text):
    raise ArithmeticError(text)


def killed_once(mark: Path):
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def thread_limits():
    return os.environ["OMP_NUM_THREADS"], torch.get_num_threads(), threads.available_threads()


@pytest.fixture
def two(monkeypatch):
    monkeypatch.setattr(parallel, "available_threads", lambda: 2)


@pytest.mark.parametrize("workers", [1, 2])
def test_results_keep_their_order_and_errors_are_raised(workers, two):
    finished = []
    found = parallel.run(square, [(k,) for k in range(5)], workers=workers, done=finished.append)
    assert found == [(k**2, os.getcwd()) for k in range(5)] and sum(finished) == 5
    with pytest.raises(ArithmeticError, match="reason"):
        parallel.run(fails, [("reason",)] * 3, workers=workers)


def test_work_of_a_killed_process_starts_again(tmp_path, two):
    found = parallel.run(killed_once, [(tmp_path / str(k),) for k in range(2)], workers=2)
    assert len(found) == 2 and os.getpid() not in found


def test_processors_are_shared(two):
    assert parallel.run(thread_limits, [()] * 2, workers=2) == [("1", 1, 1)] * 2


def test_on_ray():
    pytest.importorskip("ray")
    finished = []
    found = parallel.run(square, [(k,) for k in range(4)], ray="local", workers=1, done=finished.append)
    assert found == [(k**2, os.getcwd()) for k in range(4)] and sum(finished) == 4
    with pytest.raises(ArithmeticError, match="reason"):
        parallel.run(fails, [("reason",)] * 2, ray="local")


@pytest.mark.parametrize("address", ["127.0.0.1:1", "nowhere", "host:port"])
def test_unreachable_clusters_are_refused(address):
    pytest.importorskip("ray")
    with pytest.raises(checks.Refused, match="--ray"):
        parallel.run(square, [(1,)], ray=address)
