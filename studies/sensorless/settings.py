"""Settings of a search for sensorless schedules."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator
from pydantic_core import PydanticCustomError

from vibgym import Surface, checks
from vibgym.config import Settings, load_yaml, parse
from vibgym.scene.parts import SHIPPED

Seed = Annotated[int, Field(ge=0, lt=2**63)]


class SensorlessSettings(Settings):
    """Settings of the searches, one per part, hardware model and seed, and of the evaluation."""

    parts: list[str] = Field(["aluminium_block", "steel_block"], min_length=1)
    goal: list[float] = Field([0.416, 0.104, 0.0], min_length=3, max_length=3)  # m, m, rad
    seconds: float = Field(4.0, gt=0, le=100)  # s, longest duration of a schedule
    segments: int = Field(3, ge=1, le=20)
    hardware: list[Literal["ideal", "prototype"]] = Field(
        ["ideal", "prototype"], min_length=1
    )  # models on which schedules are searched
    friction: list[float] = Field(
        [0.9, 1.1], min_length=2, max_length=2
    )  # range of the factor on friction, drawn for every start
    model: Literal["averaged", "planar"] = "averaged"  # of the search; the evaluation uses "planar"
    periods: int = Field(4, ge=1, le=1000)  # of a step of the search; fields change only between steps
    starts: int = Field(32, ge=2, le=100_000)  # per schedule
    population: int = Field(14, ge=4, le=10_000)
    generations: int = Field(200, ge=1, le=1_000_000)
    sigma: float = Field(0.2, gt=0, le=10)
    seeds: list[Seed] = Field([1, 2, 3], min_length=1)
    judged: int = Field(1000, ge=1, le=1_000_000)  # starts of the evaluation
    threads: int = Field(1, ge=1, le=4096)  # per process
    processes: int = Field(2, ge=1, le=1024)  # each with one part and hardware model at a time

    @property
    def friction_range(self) -> tuple[float, float]:
        """Return the lowest and highest factor on the part's friction."""
        return self.friction[0], self.friction[1]

    @field_validator("parts")
    @classmethod
    def _shipped(cls, parts: list[str]) -> list[str]:
        if not set(parts) <= set(SHIPPED) or len(set(parts)) < len(parts):
            raise PydanticCustomError("parts", "different names among " + ", ".join(map(repr, SHIPPED)))  # type: ignore[arg-type]
        return parts

    @field_validator("seeds")
    @classmethod
    def _different(cls, seeds: list[int]) -> list[int]:
        if len(set(seeds)) < len(seeds):
            raise PydanticCustomError("seeds", "different numbers")
        return seeds


def load_settings(path: Path) -> SensorlessSettings:
    """Read a configuration file; raise a one-line ValueError that names file and field of the first error."""
    settings = parse(SensorlessSettings, load_yaml(path), str(path))
    checks.interval(f"{path}.friction", settings.friction, 0.01, 100.0)
    surface = Surface()
    for name, value, most in (("x", settings.goal[0], surface.width), ("y", settings.goal[1], surface.depth)):
        checks.number(f"{path}.goal: {name}", value, least=0.0, most=most)
    checks.number(f"{path}.goal: heading", settings.goal[2], least=-math.pi, most=math.pi)
    return settings
