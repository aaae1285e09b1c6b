"""A small network of images: one convolution, the places of what it finds, and how these lie to each other.

The convolution turns every plane, the part in the last images and the goal, into a few maps of mass, which is never negative.
Its squares lie side by side, and empty ones have no mass, so that only the few that are not empty need to be computed.
The centre of mass of each map is a place to within a fraction of a pixel: the spatial soft-argmax of Levine et al. (2016) with
the masses themselves as weights (Nibali et al. 2018 compare such normalisations), since exponentials of a coarse grid would
round to its cells. Differences of places, learned combinations whose weights add up to zero, are ways and displacements; what
follows are hidden layers. So it does not matter where on the surface, or on how large a one, all this happens, and neither does
how large the part is.
"""

from __future__ import annotations

import math

import torch
from torch import nn

from agents.training.networks.layers import Head, hidden, linear
from agents.training.networks.parts import LOG_STD_RANGE
from vibgym.policies.trained.networks.shape import CELL, LEAST_MASS, WAY_SCALES, Picture, occupied

MAPS = 4
"""Of mass, that the convolution makes of every plane."""

WAYS = 6
"""Differences of places."""


class PixelsEyes(nn.Module):
    """What hidden layers see of a row of pixels: ways (m), coarse and fine."""

    def __init__(self, shape: Picture) -> None:
        super().__init__()
        self.shape, self.size = shape, 2 * WAYS * len(WAY_SCALES)
        self.conv = nn.Linear(CELL**2, MAPS, bias=False)
        nn.init.uniform_(self.conv.weight, 0.5 / CELL**2, 1.5 / CELL**2)
        # To begin with: the way to the goal, and how far the part has come from image to image.
        mix = 0.3 * torch.randn(WAYS, shape.planes, MAPS) / math.sqrt(shape.planes * MAPS)
        mix[0, -1] += 1.0 / MAPS
        mix[0, 0] -= 1.0 / MAPS
        for age in range(min(shape.planes - 2, WAYS - 1)):
            mix[1 + age, age] += 1.0 / MAPS
            mix[1 + age, age + 1] -= 1.0 / MAPS
        self.mix = nn.Parameter(mix.flatten(1))

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """(..., size) of rows (..., columns), uint8."""
        planes = self.shape.planes
        pixels, plane, x, y = (torch.from_numpy(each) for each in occupied(rows.numpy(), self.shape))
        mass = torch.relu(self.conv(pixels)).unsqueeze(-1)  # (squares, maps, 1)
        moments = mass * torch.stack([torch.ones_like(x), x, y], dim=-1).unsqueeze(-2)
        sums = torch.zeros(rows[..., 0].numel() * planes, MAPS, 3).index_add(0, plane, moments)
        place = (sums[..., 1:] / (sums[..., :1] + LEAST_MASS)).reshape(*rows.shape[:-1], planes * MAPS, 2)
        way = (self.mix - self.mix.mean(dim=1, keepdim=True)) @ place
        return torch.cat([torch.tanh(way * (1.0 / scale)) for scale in WAY_SCALES], dim=-1).flatten(-2)


class PixelsActor(nn.Module):
    """Mean and logarithmic standard deviation of the part's action; see the module.

    Args:
        shape: of planes and actions.
        net: widths of the hidden layers.
        activation: of these, ``"tanh"`` or ``"relu"``.
        attention: not used, there is one part.
        log_std: at the start.
    """

    kind = "pixels"

    def __init__(self, shape: Picture, net: list[int], activation: str, attention: int, log_std: float) -> None:
        super().__init__()
        self.eyes = PixelsEyes(shape)
        self.hidden = hidden(self.eyes.size, net, activation)
        self.mean = linear(net[-1], shape.action, 0.01, Head)
        self.log_std = linear(net[-1], shape.action, 0.01, Head)
        nn.init.constant_(self.log_std.bias, log_std)

    def forward(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and log std (..., action) of rows (..., columns)."""
        seen = self.hidden(self.eyes(rows))
        return self.mean(seen), self.log_std(seen).clamp(*LOG_STD_RANGE)


class PixelsCritic(nn.Module):
    """Value of what is seen."""

    def __init__(self, shape: Picture, net: list[int], activation: str, attention: int) -> None:
        super().__init__()
        self.eyes = PixelsEyes(shape)
        self.hidden = hidden(self.eyes.size, net, activation)
        self.value = linear(net[-1], 1, 1.0, Head)

    def forward(self, rows: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """(..., parts) of rows (..., parts, columns)."""
        return self.value(self.hidden(self.eyes(rows))).squeeze(-1)
