"""Settings of recordings."""

from __future__ import annotations

import re
from pathlib import Path

from pydantic import Field, field_validator

from agents.training_settings import Arguments, Plain
from vibgym import checks
from vibgym.config import load_yaml
from vibgym.envs.vector import environment_id
from vibgym.seeds import RANGES
from vibgym.settings import BaseSettings, read

NAME = re.compile(r"([\w-]+/)*[\w-]+-v\d+")


class RecordSettings(BaseSettings):
    """Episodes of one policy on one environment."""

    dataset: str
    """Minari's name, such as "vibgym/align/pose-v0"."""

    task: str
    """See :func:`vibgym.envs.vector.batch_of`."""

    policy: Plain
    """As evaluations take it."""

    environment: Arguments = {}
    """Arguments of the environment."""

    observation: str = "state"
    """That is recorded; the policy has its own."""

    episodes: int = Field(default=1000, ge=1, le=10_000_000)
    """Number of episodes."""

    first_seed: int = RANGES["recordings"].start
    """Episode k begins with this seed + k."""

    worlds: int = Field(default=250, ge=1, le=100_000)
    """Simulated together; no result depends on it."""

    noise: float = Field(default=0.0, ge=0, le=2)
    """Standard deviation, added to the actions that are executed and recorded."""

    directory: str | None = None
    """Of the data sets; None: that of Minari."""

    @field_validator("dataset")
    @classmethod
    def _named(cls, dataset: str) -> str:
        if not NAME.fullmatch(dataset):
            raise checks.conflict(f"requires a name such as 'vibgym/align/pose-v0', with a version, got {dataset!r}")
        return dataset


def load_settings(path: Path) -> RecordSettings:
    """Return the settings of a YAML file; the first fault is a one-line ValueError that names file and field."""
    settings = read(RecordSettings, load_yaml(path), str(path))
    environment_id(settings.task, f"{path}.task")
    return settings
