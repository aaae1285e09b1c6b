"""Data sets to learn from."""

import shutil

import pytest

from agents.recording.record import RecordSettings, record


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Directory with 200 episodes of the law "pose", a little disturbed, on Align, from seed 1000300."""
    directory = tmp_path_factory.mktemp("recorded")
    made = {"dataset": "vibgym/align/pose-v0", "task": "Align", "policy": {"kind": "pose", "action": "wrench"},
            "observation": "parts", "episodes": 200, "first_seed": 1_000_300, "noise": 0.1,
            "directory": str(directory)}  # fmt: skip
    record(RecordSettings.model_validate(made), quiet=True)
    return directory


@pytest.fixture
def copied(recorded, tmp_path):
    """A copy that may be spoilt, and the data set in it."""
    directory = tmp_path / "data sets"
    shutil.copytree(recorded, directory)
    return directory, directory / "vibgym" / "align" / "pose-v0"
