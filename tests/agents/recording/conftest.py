"""Recordings of a few episodes."""

import minari
import pytest

from agents.recording.record import RecordSettings, record
from vibgym.datasets import kept_in

NAME = "vibgym/align/pose-v0"
GIVEN = {
    "dataset": NAME, "task": "Align", "policy": {"kind": "pose", "action": "wrench"}, "observation": "parts",
    "episodes": 2, "worlds": 2, "first_seed": 1_000_007,
}  # fmt: skip


@pytest.fixture
def settings_of(tmp_path):
    """Settings with changes, for data sets in ``tmp_path``."""
    return lambda **changes: RecordSettings.model_validate({**GIVEN, "directory": str(tmp_path), **changes})


@pytest.fixture
def recorded(settings_of):
    """Record with changed settings, and load what Minari reads."""

    def recorded(**changes):
        settings = settings_of(**changes)
        record(settings, quiet=True)
        with kept_in(settings.directory):
            return minari.load_dataset(settings.dataset)

    return recorded
