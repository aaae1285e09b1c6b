"""Work side by side changes nothing but the times."""

import re

import numpy as np
import pytest

from agents import evaluation
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
    assert pictures[0] == pictures[1] and len(pictures[0]) == 8
