"""Parallel execution: the same results in processes and on Ray, errors, killed workers."""

import os
import signal
import subprocess
import sys
import time

import pytest

from agents import parallel
from vibgym import checks
from vibgym.simulation import threads


def square(number):
    return number**2, os.getcwd()


def fails(text):
    raise ArithmeticError(text)


def killed_once(mark):
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def killed():
    os.kill(os.getpid(), signal.SIGKILL)


def wait_in(directory):
    (directory / f"{os.getpid()}").touch()
    time.sleep(60)


def thread_limits():
    import torch  # not above: the workers of the other tests start without it

    return os.environ["OMP_NUM_THREADS"], torch.get_num_threads(), threads.available_threads()


@pytest.fixture
def two(monkeypatch):
    monkeypatch.setattr(parallel, "available_threads", lambda: 2)


@pytest.mark.parametrize("where", [{"workers": 1}, {"workers": 2}, {"ray": "local"}])
def test_results_keep_their_order_and_errors_are_raised(where, two):
    if "ray" in where:
        pytest.importorskip("ray")
    finished = []
    results = parallel.run(square, [(k,) for k in range(5)], **where, done=finished.append)
    assert results == [(k**2, os.getcwd()) for k in range(5)] and sum(finished) == 5
    with pytest.raises(ArithmeticError, match="reason"):
        parallel.run(fails, [("reason",)] * 3, **where)


def test_work_of_a_killed_process_starts_again(tmp_path, two, monkeypatch):
    results = parallel.run(killed_once, [(tmp_path / str(k),) for k in range(2)], workers=2)
    assert len(results) == 2 and os.getpid() not in results
    monkeypatch.setattr(parallel, "ATTEMPTS", 2)
    with pytest.raises(ConnectionError, match="killed 2 times"):
        parallel.run(killed, [()] * 2, workers=2)


def test_workers_exit_when_their_parent_is_killed(tmp_path):
    code = (
        "import sys; from pathlib import Path; from agents import parallel; from tests.agents.test_parallel import wait_in;"
        "parallel.available_threads = lambda: 2; parallel.run(wait_in, [(Path(sys.argv[1]),)] * 2, workers=2)"
    )
    parent = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)])
    while len(os.listdir(tmp_path)) < 2:
        assert parent.poll() is None
        time.sleep(0.1)
    parent.kill()
    parent.wait()
    while any(os.path.exists(f"/proc/{process}/fd/0") for process in os.listdir(tmp_path)):  # a zombie has no files
        time.sleep(0.1)


def test_processors_are_shared(two):
    assert parallel.run(thread_limits, [()] * 2, workers=2) == [("1", 1, 1)] * 2


@pytest.mark.parametrize("address", ["127.0.0.1:1", "nowhere", "host:port", "127.0.0.1:99999"])
def test_unreachable_clusters_are_refused(address):
    pytest.importorskip("ray")
    with pytest.raises(checks.Refused, match="--ray"):
        parallel.run(square, [(1,)], ray=address)
