"""One small network for every element: its phasor from where it lies under the part, and from what the part is to do.

The network has two branches (DeepONet, Lu et al. 2021): one turns a part's row into a few coefficients, the other the place of
an element relative to the part's centre into as many basis functions, and the phasor is their product. So the same weights
serve parts and surfaces of any size, and every action that is made of elements.
"""

from __future__ import annotations

import torch
from torch import nn

from agents.training.networks.functions import tanh
from agents.training.networks.layers import Head, hidden, linear
from agents.training.networks.parts import LOG_STD_RANGE, Eyes
from vibgym.policies.trained.networks.shape import Shape

BASIS = 32
"""Basis functions of an element's place."""


class ElementsActor(nn.Module):
    """Mean and logarithmic standard deviation of the phasors of the elements around every part; see the module.

    Exploration has one standard deviation a part.

    Args: see :class:`agents.training.networks.parts.PartsActor`.
    """

    kind = "elements"

    def __init__(self, shape: Shape, net: list[int], activation: str, attention: int, log_std: float) -> None:
        super().__init__()
        self.shape = shape
        self.eyes = Eyes(shape, attention)
        self.hidden = hidden(self.eyes.size, net, activation)
        self.coefficients = linear(net[-1], 2 * BASIS, 0.1, Head)
        self.places = linear(4, BASIS, 1.0)
        self.log_std = linear(net[-1], 1, 0.01, Head)
        nn.init.constant_(self.log_std.bias, log_std)

    def forward(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and log std (..., side * side * 2) of rows (..., columns)."""
        side, place = self.shape.side, self.shape.place
        seen = self.hidden(self.eyes(rows))
        coefficients = self.coefficients(seen).unflatten(-1, (BASIS, 2))
        basis = tanh(self.places(elements_about(rows[..., place : place + 2], side)))
        mean = (basis @ coefficients).float().flatten(-2) / BASIS**0.5
        log_std = self.log_std(seen).clamp(*LOG_STD_RANGE)
        return mean, log_std.expand(*mean.shape)


def elements_about(place: torch.Tensor, side: int) -> torch.Tensor:
    """What the branch of places sees of the elements of a patch (..., side * side, 4), rows first: x, y and their squares.

    Args:
        place: (..., 2) where the part's centre lies in its element, see :func:`vibgym.policies.trained.networks.shape.offsets`.
    """
    within = 0.5 * (place + 1.0)
    first = torch.floor(within + (0.5 - 0.5 * side))
    steps = torch.arange(side, dtype=place.dtype)
    x, y = ((first + 0.5 - within)[..., k : k + 1] + steps for k in range(2))  # (..., side)
    shape = (*place.shape[:-1], side, side)
    x, y = x.unsqueeze(-2).expand(shape).flatten(-2), y.unsqueeze(-1).expand(shape).flatten(-2)
    return torch.stack([x, y, x * x, y * y], dim=-1)
