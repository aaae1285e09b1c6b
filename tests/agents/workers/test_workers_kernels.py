"""Kernels are compiled once a node, by whoever comes first."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from agents.workers import cluster

SMALL = """
from vibgym.kernels.jit import jit


@jit
def twice(x):
    return 2.0 * x
"""

WORKER = """
import os, sys, time
from pathlib import Path
from numba.core import event
from agents.workers import kernels
import small

class Listener(event.Listener):
    def on_start(self, event):
        Path(f"compiled-{os.getpid()}").touch()
    def on_end(self, event):
        pass

def warm(say):
    Path(f"warming-{os.getpid()}").touch()
    time.sleep(float(sys.argv[1]))  # the others come meanwhile
    small.twice(1.0)

kernels.warm = warm  # one small kernel in the place of all
Path(f"began-{os.getpid()}").touch()
with event.install_listener("numba:compile", Listener()):
    kernels.compiled()
    assert small.twice(3.0) == 6.0
"""


def started(folder, number, seconds):
    """Workers, all at once."""
    (folder / "small.py").write_text(SMALL)
    path = os.pathsep.join([str(folder), os.getcwd()])
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(folder / "cache"), "VIBGYM_CACHE": "1"}
    command = [sys.executable, "-c", WORKER, str(seconds)]
    return [subprocess.Popen(command, cwd=folder, env=environment) for _ in range(number)]


def of(folder, what):
    """Processes that have left this mark."""
    return [int(path.name.partition("-")[2]) for path in folder.glob(f"{what}-*")]


def test_workers_that_start_at_once_compile_once(tmp_path):
    workers = started(tmp_path, 3, 2.0)
    assert [each.wait(120) for each in workers] == [0, 0, 0]
    assert len(of(tmp_path, "began")) == 3
    assert of(tmp_path, "compiled") == of(tmp_path, "warming") and len(of(tmp_path, "warming")) == 1
    assert len(list((tmp_path / "cache").rglob("small.twice-*.nbc"))) == 1


def test_what_a_killed_worker_has_not_compiled_another_one_does(tmp_path):
    (first,) = started(tmp_path, 1, 600.0)
    deadline = time.monotonic() + 120.0
    while not of(tmp_path, "warming"):
        assert first.poll() is None and time.monotonic() < deadline
        time.sleep(0.05)
    first.send_signal(signal.SIGKILL)
    first.wait()
    (second,) = started(tmp_path, 1, 0.0)
    assert second.wait(120) == 0 and of(tmp_path, "compiled") == [second.pid]


def test_work_on_a_cluster_waits_for_the_kernels(monkeypatch, tmp_path):
    order: list[str] = []
    monkeypatch.chdir(os.getcwd())
    monkeypatch.setattr(cluster, "compiled", lambda: order.append("compiled"))
    cluster._in_directory(str(tmp_path), (), order.append, ("work",))
    assert order == ["compiled", "work"] and Path.cwd() == tmp_path.resolve()
