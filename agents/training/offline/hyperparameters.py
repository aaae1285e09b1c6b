"""Settings of learning from a data set."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from agents.training.hyperparameters import NetworkSettings, Rate, RateSettings


class OfflineSettings(NetworkSettings, RateSettings):
    """Learning from a data set alone, see :mod:`agents.training.offline.learner`; a step is an update from one minibatch."""

    dataset: str = Field(min_length=1)  # Minari's name, as ``python -m agents record`` gave it
    directory: str | None = None  # of the data sets; None: where Minari keeps them
    method: Literal["cloning", "iql"] = "cloning"
    batch_size: int = Field(1024, ge=2, le=10_000_000)  # parts
    floor: float = Field(1.0, gt=0, le=10)  # size of actions below which errors are not weighed by it any more
    # Of "iql" alone (Kostrikov, Nair & Levine 2021):
    gamma: float = Field(0.98, gt=0, lt=1)
    expectile: float = Field(0.8, gt=0.5, lt=1)  # of the values of actions that were done, which counts as a state's
    # Standard deviations of advantage that change a weight by a factor of e.
    temperature: float = Field(1.0, gt=0, le=100)
    tau: Rate = 0.01  # of the target network
