"""Rows of layers, in torch."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn

ABSENT = -1e9
"""Logit of neighbours that are not there: below all that a network says of one."""

ACTIVATIONS = {"tanh": nn.Tanh, "relu": nn.ReLU}


def hidden(inputs: int, widths: Sequence[int], activation: str) -> nn.Sequential:
    """Fully connected layers with an activation after each, orthogonal as PPO likes them (Engstrom et al. 2020)."""
    layers: list[nn.Module] = []
    for width in widths:
        layers += [linear(inputs, width, 2.0**0.5), ACTIVATIONS[activation]()]
        inputs = width
    return nn.Sequential(*layers)


def linear(inputs: int, outputs: int, gain: float) -> nn.Linear:
    """A linear layer with orthogonal weights times ``gain``, and no bias at the start."""
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


class Attention(nn.Module):
    """What a part makes of the others near it: a mean of their encodings, weighted by how much each matters to it.

    One head of scaled dot products (Vaswani et al. 2017), whose query is made of the part's own columns. Absent neighbours have
    no weight; without any the result is zero.

    Args:
        own: columns of the part itself.
        width: columns of a neighbour, the first of which is 1 where there is one.
        size: of the encodings.
    """

    def __init__(self, own: int, width: int, size: int) -> None:
        super().__init__()
        self.encode = linear(width, size, 2.0**0.5)
        self.key = linear(size, size, 1.0)
        self.query = linear(own, size, 1.0)
        self.scale = size**-0.5

    def forward(self, own: torch.Tensor, others: torch.Tensor) -> torch.Tensor:
        """(..., size) of ``own`` (..., own) and ``others`` (..., neighbours, width)."""
        there = others[..., 0] > 0.5
        encoded = torch.relu(self.encode(others))
        logit = (self.key(encoded) @ self.query(own).unsqueeze(-1)).squeeze(-1) * self.scale
        logit = logit.masked_fill(~there, ABSENT)  # or their largest would leave nothing of those that are there
        weight = torch.exp(logit - logit.amax(dim=-1, keepdim=True)) * there
        weight = weight / (weight.sum(dim=-1, keepdim=True) + 1e-9)
        return (weight.unsqueeze(-2) @ encoded).squeeze(-2)
