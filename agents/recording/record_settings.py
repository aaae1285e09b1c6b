"""Settings of recordings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pydantic import Field, field_validator
from pydantic_core import PydanticCustomError

from vibgym.config import Settings, load_yaml, parse
from vibgym.envs.vector import environment_id
from vibgym.seeds import RANGES

NAME = re.compile(r"([\w-]+/)*[\w-]+-v\d+")


class RecordSettings(Settings):
    """Episodes of one policy on one environment."""

    dataset: str  # Minari's name, such as "vibgym/align/pose-v0"
    task: str  # see vibgym.envs.vector.batch_of
    policy: Any  # as evaluations take it
    environment: dict[str, Any] = {}
    observation: str = "state"  # that is recorded; the policy has its own
    episodes: int = Field(1000, ge=1, le=10_000_000)
    first_seed: int = RANGES["recordings"].start  # episode k begins with this seed + k
    worlds: int = Field(250, ge=1, le=100_000)  # simulated together; no result depends on it
    noise: float = Field(0.0, ge=0, le=2)  # standard deviation, added to the actions that are executed and recorded
    directory: str | None = None  # of the data sets; None: that of Minari

    @field_validator("dataset")
    @classmethod
    def _named(cls, dataset: str) -> str:
        if not NAME.fullmatch(dataset):
            raise PydanticCustomError("dataset", "a name such as 'vibgym/align/pose-v0', with a version at its end")
        return dataset


def load_settings(path: Path) -> RecordSettings:
    """Return the settings of a YAML file; the first fault is a one-line ValueError that names file and field."""
    settings = parse(RecordSettings, load_yaml(path), str(path))
    environment_id(settings.task, f"{path}.task")
    return settings
