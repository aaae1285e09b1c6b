"""Settings of a search for sensorless schedules."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator

from vibgym import Surface, checks
from vibgym.config import load_yaml
from vibgym.settings import BaseSettings, read

Seed = Annotated[int, Field(ge=0, lt=2**63)]


class SensorlessSettings(BaseSettings):
    """Settings of the searches, one per part, hardware model and seed, and of the evaluation."""

    parts: tuple[Literal["aluminium_block", "steel_block"], ...] = Field(
        default=("aluminium_block", "steel_block"), min_length=1
    )

    goal: tuple[float, float, float] = (0.416, 0.104, 0.0)
    """Pose: m, m, rad."""

    seconds: float = Field(default=4.0, gt=0, le=100)
    """Longest duration of a schedule."""

    segments: int = Field(default=3, ge=1, le=20)
    """Of a schedule."""

    hardware: tuple[Literal["ideal", "prototype"], ...] = Field(default=("ideal", "prototype"), min_length=1)
    """Models on which schedules are searched."""

    friction: tuple[float, float] = (0.9, 1.1)
    """Range of the factor on friction, drawn for every start."""

    model: Literal["averaged", "planar"] = "averaged"
    """Of the search; the evaluation uses "planar"."""

    periods: int = Field(default=4, ge=1, le=1000)
    """Of a step of the search; fields change only between steps."""

    starts: int = Field(default=32, ge=2, le=100_000)
    """Per schedule."""

    population: int = Field(default=14, ge=4, le=10_000)
    """Schedules of a generation."""

    generations: int = Field(default=200, ge=1, le=1_000_000)
    """Of a search."""

    sigma: float = Field(default=0.2, gt=0, le=10)
    """Initial standard deviation of the search."""

    seeds: tuple[Seed, ...] = Field(default=(1, 2, 3), min_length=1)
    """One search each."""

    evaluated: int = Field(default=1000, ge=1, le=1_000_000)
    """Starts of the evaluation."""

    threads: int = Field(default=1, ge=1, le=4096)
    """Per process."""

    processes: int = Field(default=2, ge=1, le=1024)
    """Each with one part and hardware model at a time."""

    @field_validator("parts", "seeds")
    @classmethod
    def _different(cls, values: tuple[str | int, ...]) -> tuple[str | int, ...]:
        if len(set(values)) < len(values):
            raise checks.conflict(f"requires different values, got {list(values)}")
        return values

    @field_validator("goal")
    @classmethod
    def _on_surface(cls, goal: tuple[float, float, float]) -> tuple[float, float, float]:
        surface = Surface()
        checks.number("x", goal[0], least=0.0, most=surface.width)
        checks.number("y", goal[1], least=0.0, most=surface.depth)
        checks.number("heading", goal[2], least=-math.pi, most=math.pi)
        return goal

    @field_validator("friction")
    @classmethod
    def _ordered(cls, friction: tuple[float, float]) -> tuple[float, float]:
        return checks.interval("friction", friction, 0.01, 100.0)


def load_settings(path: Path) -> SensorlessSettings:
    """Read a configuration file; raise a one-line ValueError that names file and field of the first error."""
    return read(SensorlessSettings, load_yaml(path), str(path))
