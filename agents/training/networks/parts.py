"""One network for all parts: own columns and attention over those near it; and a critic that sees all parts of its world."""

from __future__ import annotations

import torch
from torch import nn

from agents.training.networks.layers import Attention, Head, hidden, linear
from vibgym.policies.trained.networks.acting import FLOOR, LOG_STD_RANGE
from vibgym.policies.trained.networks.shape import Shape


class Eyes(nn.Module):
    """What hidden layers see of a row: its own columns, and what attention makes of its neighbours."""

    def __init__(self, shape: Shape, attention: int) -> None:
        super().__init__()
        self.shape = shape
        self.size = shape.own
        self.attention: Attention | None = None
        if shape.neighbours:
            self.attention = Attention(shape.own, shape.width, attention)
            self.size += attention

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """(..., size) of rows (..., columns)."""
        if self.attention is None:
            return rows
        own = rows[..., : self.shape.own]
        others = rows[..., self.shape.own :].unflatten(-1, (self.shape.neighbours, self.shape.width))
        return torch.cat([own, self.attention(own, others)], dim=-1)


class PartsActor(nn.Module):
    """Mean and logarithmic standard deviation of every part's action.

    Args:
        shape: of rows and actions.
        net: widths of the hidden layers.
        activation: of these, ``"tanh"`` or ``"relu"``.
        attention: size of the neighbours' encodings.
        log_std: at the start.
        floor: None, or the size of actions, of 0 to 1, at which exploration stops to shrink with them: standard deviations
            are then multiples of the action's own size. Parts on their way try much, and parts at rest, which the noise of
            others would never let rest, next to nothing.
    """

    kind = "parts"

    def __init__(
        self, shape: Shape, net: list[int], activation: str, attention: int, log_std: float, floor: float | None = None
    ) -> None:
        super().__init__()
        self.eyes = Eyes(shape, attention)
        self.hidden = hidden(self.eyes.size, net, activation)
        self.mean = linear(net[-1], shape.action, 0.01, Head)
        self.log_std = linear(net[-1], shape.action, 0.01, Head)
        nn.init.constant_(self.log_std.bias, log_std)
        self.register_buffer(FLOOR, None if floor is None else torch.tensor([floor]))

    def forward(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and log std (..., action) of rows (..., columns)."""
        seen = self.hidden(self.eyes(rows))
        mean, log_std = self.mean(seen), self.log_std(seen).clamp(*LOG_STD_RANGE)
        floor = getattr(self, FLOOR)
        if floor is None:
            return mean, log_std
        size = mean.detach().clamp(-1.0, 1.0).square().mean(dim=-1, keepdim=True).sqrt()
        return mean, log_std + torch.log(floor + size)


class PartsCritic(nn.Module):
    """Value of every part, from its own row and from all parts of its world together (a centralised critic).

    The others count by the mean of their encodings, so that their order and number do not matter (Zaheer et al. 2017).
    """

    def __init__(self, shape: Shape, net: list[int], activation: str, attention: int) -> None:
        super().__init__()
        self.eyes = Eyes(shape, attention)
        self.together = linear(shape.own, attention, 2.0**0.5) if shape.neighbours else None
        self.hidden = hidden(self.eyes.size + (attention if shape.neighbours else 0), net, activation)
        self.value = linear(net[-1], 1, 1.0, Head)
        self.own = shape.own

    def forward(self, rows: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """(..., parts) of rows (..., parts, columns); ``mask`` (..., parts) is 1 where there is a part."""
        seen = self.eyes(rows)
        if self.together is not None:
            here = mask.unsqueeze(-1)
            encoded = torch.relu(self.together(rows[..., : self.own])) * here
            mean = encoded.sum(dim=-2, keepdim=True) / here.sum(dim=-2, keepdim=True).clamp(min=1.0)
            seen = torch.cat([seen, mean.expand(*seen.shape[:-1], -1)], dim=-1)
        return self.value(self.hidden(seen)).squeeze(-1)
