"""Settings that several algorithms have."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from vibgym.config import Settings

MOST_STEPS = 10**12

Rate = Annotated[float, Field(gt=0, le=1)]
Width = Annotated[int, Field(ge=1, le=4096)]
Widths = Annotated[list[Width], Field(min_length=1, max_length=8)]


class RateSettings(Settings):
    """A learning rate that falls linearly."""

    learning_rate: Rate = 1e-3
    final_learning_rate: Rate = 1e-4  # reached linearly at the end

    def rate(self, remaining: float) -> float:
        """Where this share of the training remains."""
        return self.final_learning_rate + remaining * (self.learning_rate - self.final_learning_rate)


class NetworkSettings(Settings):
    """The network of parts that acts, what it reads, and its critic."""

    network: Literal["parts", "elements", "pixels"] = "parts"
    activation: Literal["tanh", "relu"] = "tanh"
    net: Widths = [128, 128]
    critic_net: Widths = [64, 64]
    attention: Width = 32
    turned: bool = False  # rows are turned by quarter turns until their way leads to the right and up
    remembers: bool = False  # rows tell what a part was told at the last step
    blind: list[str] = Field([], max_length=100)  # names of columns that the network does not read
