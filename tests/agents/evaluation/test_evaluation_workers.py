"""Work side by side changes nothing but the times."""

import multiprocessing
import os
import re
import signal
import time

import numpy as np
import pytest
from joblib.externals.loky.process_executor import BrokenProcessPool

from agents import evaluation
from agents.workers import side_by_side, usable
from agents.workers.local import LIBRARIES, TRIES
from tests.agents.evaluation.conftest import Pusher


def evaluated(directory, processes):
    """Results and the texts of the files."""
    settings = evaluation.settings_from(
        {
            "tasks": ["Rotate", "Sort"],
            "policies": ["random", {"name": "pusher", "policy": Pusher(), "tasks": ["Rotate"]}],
            "episodes": 3,
            "first_seed": 9,
            "resamples": 100,
            "processes": processes,
            "effects": {
                "task": "Rotate",
                "policies": ["random", "pusher"],
                "cases": {"none": {}, "noise": {"sensor": "pose"}},
            },
            "output": str(directory / "report"),
        }
    )
    found = evaluation.evaluate(evaluation.prepare(settings), quiet=True)
    page = evaluation.write(found, quiet=True)
    return found, {path.name: path.read_text(encoding="utf-8") for path in page.parent.iterdir()}


@pytest.fixture
def two(monkeypatch):
    """Two processors at least."""
    monkeypatch.setattr("agents.workers.local.available_threads", lambda: 2)
    monkeypatch.setattr("agents.parallel.available_threads", lambda: 2)


def test_same_files_with_one_process_and_two(tmp_path, two):
    (one, one_files), (other, other_files) = (evaluated(tmp_path / str(n), n) for n in (1, 2))
    assert list(one.rollouts) == list(other.rollouts)
    for pair, rollout in one.rollouts.items():
        for name, value in vars(rollout).items():
            if isinstance(value, np.ndarray):
                np.testing.assert_array_equal(value, getattr(other.rollouts[pair], name))
    assert one_files["episodes.csv"] == other_files["episodes.csv"]
    pictures = [re.findall(r"data:image/[^\"]*", files["report.html"]) for files in (one_files, other_files)]
    assert pictures[0] == pictures[1] and len(pictures[0]) > 3 * 3


def share_of_processors():
    """In a process of its own."""
    return os.getpid(), os.environ["OMP_NUM_THREADS"]


def test_processes_are_others_and_share_the_processors(two):
    before = {name: os.environ.get(name) for name in LIBRARIES}
    with side_by_side(2) as submit:
        pid, threads = submit(share_of_processors).result()
    assert pid != os.getpid() and threads == "1"
    assert {name: os.environ.get(name) for name in LIBRARIES} == before


def test_one_process_is_this_one(monkeypatch):
    with side_by_side(1) as submit:
        assert submit(os.getpid).result() == os.getpid()
    monkeypatch.setattr("agents.workers.local.available_threads", lambda: 1)
    assert usable(2) == 1  # falls back where there is one processor


def fails(*arguments):
    raise ArithmeticError(*arguments)


def test_an_interruption_leaves_no_process_behind(two):
    began = time.perf_counter()
    with pytest.raises(KeyboardInterrupt), side_by_side(2) as submit:
        submit(time.sleep, 60.0)
        submit(os.getpid).result()  # by now they are up
        raise KeyboardInterrupt
    assert not multiprocessing.active_children() and time.perf_counter() - began < 30.0


def test_failures_come_back(two):
    for processes in (1, 2):
        with pytest.raises(ArithmeticError, match="said there"), side_by_side(processes) as submit:
            submit(fails, "said there").result()


def dies_once(path):
    """Kills its own process the first time."""
    if not path.exists():
        path.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def dies(path):
    """Always, and counts."""
    with path.open("a") as file:
        file.write("x")
    os.kill(os.getpid(), signal.SIGKILL)


def test_killed_processes_cost_a_retry(two, tmp_path):
    with side_by_side(2) as submit:
        asked = [submit(dies_once, tmp_path / str(k)) for k in range(3)] + [submit(abs, -k) for k in range(5)]
        assert [each.result() for each in asked] == ["done"] * 3 + list(range(5))


def test_what_kills_every_process_ends_with_an_error(two, tmp_path):
    with pytest.raises(BrokenProcessPool), side_by_side(2) as submit:
        submit(dies, tmp_path / "tries").result()
    assert (tmp_path / "tries").read_text() == "x" * TRIES
