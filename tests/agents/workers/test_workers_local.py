"""Work in processes of this machine."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from vibgym.simulation.threads import available_threads

WORK = """
import os, sys, time
from pathlib import Path
from agents.workers import side_by_side

def work(folder, number):
    (Path(folder) / f"{number}.pid").write_text(str(os.getpid()))
    time.sleep(120)

if __name__ == "__main__":
    with side_by_side(2, None) as submit:
        for future in [submit(work, sys.argv[1], number) for number in range(2)]:
            future.result()
"""


@pytest.fixture(autouse=True)
def _two_processors():
    if available_threads() < 2:
        pytest.skip("with one processor all work is done by whoever asks for it")


def runs(pid):
    """Whether there is such a process that has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_processes_end_with_whoever_asked_for_their_work(tmp_path):
    """Else the same command, begun again, finds what it is to write in use by them."""
    program = tmp_path / "work.py"
    program.write_text(WORK)
    path = os.pathsep.join([str(Path(__file__).parents[3]), os.environ.get("PYTHONPATH", "")])
    asking = subprocess.Popen([sys.executable, str(program), str(tmp_path)], env={**os.environ, "PYTHONPATH": path})
    deadline = time.monotonic() + 60
    while len(found := [each for each in tmp_path.glob("*.pid") if each.read_text()]) < 2:
        assert asking.poll() is None and time.monotonic() < deadline
        time.sleep(0.05)
    working = {int(each.read_text()) for each in found}
    assert len(working) == 2 and asking.pid not in working and all(map(runs, working))
    os.kill(asking.pid, signal.SIGKILL)
    asking.wait()
    deadline = time.monotonic() + 20
    while any(map(runs, working)):
        assert time.monotonic() < deadline, f"{working} work on"
        time.sleep(0.05)
