"""One data set and one trained agent for all tests."""

import shutil

import pytest

from agents.recording.record import RecordSettings, record
from tests.agents.training import helpers


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Directory with 200 episodes of the law "pose", a little disturbed, on Align, from seed 1000300."""
    directory = tmp_path_factory.mktemp("recorded")
    made = {"dataset": helpers.DATA, "task": "Align", "policy": helpers.POSE, "observation": "parts", "episodes": 200,
            "first_seed": 1_000_300, "noise": 0.1, "directory": str(directory)}  # fmt: skip
    record(RecordSettings.model_validate(made), quiet=True)
    return directory


@pytest.fixture(scope="session")
def agent(tmp_path_factory):
    """Directory of a whole run with the settings of :data:`helpers.SETTINGS`."""
    return helpers.trained(tmp_path_factory.mktemp("agent")).parent


@pytest.fixture
def copied(agent, tmp_path):
    """A copy of it that may be damaged."""
    return shutil.copytree(agent, tmp_path / "run")
