"""Rows of layers, in torch."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn

from agents.training.networks.functions import Tanh, attend

ACTIVATIONS = {"tanh": Tanh, "relu": nn.ReLU}


def hidden(inputs: int, widths: Sequence[int], activation: str) -> nn.Sequential:
    """Fully connected layers with an activation after each, orthogonal as PPO likes them (Engstrom et al. 2020)."""
    layers: list[nn.Module] = []
    for width in widths:
        layers += [linear(inputs, width, 2.0**0.5), ACTIVATIONS[activation]()]
        inputs = width
    return nn.Sequential(*layers)


def linear(inputs: int, outputs: int, gain: float, kind: type[nn.Linear] = nn.Linear) -> nn.Linear:
    """A linear layer with orthogonal weights times ``gain``, and no bias at the start."""
    layer = kind(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


class Head(nn.Linear):
    """A last layer, which stays in float32 where torch casts the others.

    Exploration is a few hundredths of an action, and so are the roundings of an action in bfloat16.
    """

    def forward(self, input: torch.Tensor) -> torch.Tensor:
        """(..., outputs) float32."""
        if not torch.is_autocast_enabled("cpu"):
            return super().forward(input)
        with torch.autocast("cpu", enabled=False):
            return super().forward(input.float())


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
        flat = others.reshape(-1, others.shape[-1])
        # In this order of memory the weights' gradient, a product of two tall matrices, takes half the time.
        code = torch.addmm(self.encode.bias, flat, self.encode.weight.T.contiguous())
        return attend(code.view(*others.shape[:-1], -1), others[..., 0] > 0.5, self._sought(own))

    def _sought(self, own: torch.Tensor) -> torch.Tensor:
        """(..., size) whose products with encodings are the logits, but for a number that all neighbours of a part share.

        Products of keys and queries are those of encodings and queries that have been through the keys' weights, of which there
        is one for all neighbours; the keys' bias adds the same to all, which exponentials' shares do not notice.
        """
        through = self.key.weight.T * self.scale
        return nn.functional.linear(own, through @ self.query.weight, through @ self.query.bias)
