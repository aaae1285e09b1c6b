"""What is recorded: whose episodes, where, and what of them is kept."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import gymnasium as gym
from pydantic import Field, field_validator
from pydantic_core import PydanticCustomError

import vibgym  # noqa: F401 - registers the environments
from vibgym.config import Settings, load_yaml, parse

NAME = re.compile(r"([\w-]+/)*[\w-]+-v\d+")


class RecordSettings(Settings):
    """Episodes of one policy on one environment."""

    dataset: str  # Minari's name, such as "vibgym/align/pose-v0"
    task: str  # name of an environment of vibgym without version, such as "SortTwelve"
    policy: Any  # as evaluations take it
    environment: dict[str, Any] = {}
    observation: str = "state"  # what is kept; the policy reads its own
    episodes: int = Field(1000, ge=1, le=10_000_000)
    first_seed: int = Field(1_000_000, ge=0, le=2**31)  # episode k begins with this seed + k
    worlds: int = Field(250, ge=1, le=100_000)  # played at a time, of which nothing depends that plays without chance
    noise: float = Field(
        0.0, ge=0, le=2
    )  # standard deviation of what is added to actions, which are kept as they were done
    directory: str | None = None  # of the data sets; None: where Minari keeps them

    @property
    def environment_name(self) -> str:
        """Under which Gymnasium knows the environment."""
        return f"vibgym/{self.task}-v0"

    @field_validator("dataset")
    @classmethod
    def _named(cls, dataset: str) -> str:
        if not NAME.fullmatch(dataset):
            raise PydanticCustomError("dataset", "a name such as 'vibgym/align/pose-v0', with a version at its end")
        return dataset

    @field_validator("task")
    @classmethod
    def _known(cls, task: str) -> str:
        known = [spec.name for spec in gym.registry.values() if spec.namespace == "vibgym"]
        if task not in known:
            raise PydanticCustomError("task", ", ".join(map(repr, known)))  # type: ignore[arg-type]
        return task


def load_settings(path: Path) -> RecordSettings:
    """Read a file; the first fault is a one-line ValueError that names file and field."""
    return parse(RecordSettings, load_yaml(path), str(path))
