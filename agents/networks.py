"""Networks in torch: actors and critics of parts, of elements and of images.

Their NumPy counterparts, which act without torch, are in :mod:`vibgym.policies.trained.networks`.

- ``parts``: one network for all parts reads a part's own columns and attends to its neighbours; the critic reads all parts.
- ``elements``: one small network for all elements. It has two branches (DeepONet, Lu et al. 2021): one turns a part's row into
  coefficients, the other the position of an element relative to the part's centre into basis functions; the phasor is their
  product. The same weights serve parts and surfaces of any size, and every action made of elements.
- ``pixels``: one convolution turns images into maps of mass, whose centres are positions to a fraction of a pixel: the spatial
  soft-argmax of Levine et al. (2016) with the masses themselves as weights (Nibali et al. 2018 compare such normalisations).
  Differences of positions are displacements, so that position and size of the surface do not matter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import nn

from vibgym import checks
from vibgym.policies.trained.networks import (
    ACTING,
    CELL,
    FLOOR,
    LOG_STD_RANGE,
    MAX_STANDARDIZED,
    MIN_MASS,
    SCALES,
    ImageShape,
    Shape,
    occupied,
)
from vibgym.policies.trained.symmetry import Symmetry
from vibgym.policies.trained.trained import CODINGS


class _Tanh(torch.autograd.Function):
    """Hyperbolic tangent to 2e-7 by the logistic function in place; torch's own takes two to three times as long."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        y = (x + x).sigmoid_().mul_(2.0).sub_(1.0)
        ctx.save_for_backward(y)
        return y

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        return torch.ops.aten.tanh_backward(grad, *ctx.saved_tensors)


class Tanh(nn.Module):
    """Hyperbolic tangent as a layer."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return the hyperbolic tangent of ``x``, to 2e-7."""
        result: Any = _Tanh.apply(x)
        return result


ACTIVATIONS = {"tanh": Tanh, "relu": nn.ReLU}


def hidden(inputs: int, widths: Sequence[int], activation: str) -> nn.Sequential:
    """Return fully connected layers with an activation after each, initialised orthogonally (Engstrom et al. 2020)."""
    layers: list[nn.Module] = []
    for width in widths:
        layers += [linear(inputs, width, 2.0**0.5), ACTIVATIONS[activation]()]
        inputs = width
    return nn.Sequential(*layers)


def linear(inputs: int, outputs: int, gain: float) -> nn.Linear:
    """Return a linear layer with orthogonal weights times ``gain`` and zero bias."""
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


class Attention(nn.Module):
    """One attention head over the neighbours of a part (scaled dot products, Vaswani et al. 2017).

    The query is computed from the part's own columns. Absent neighbours have no weight; without any the result is zero.

    Args:
        own: columns of the part itself.
        width: columns of a neighbour, the first of which is 1 if it is present.
        size: of the encodings.
    """

    def __init__(self, own: int, width: int, size: int) -> None:
        super().__init__()
        self.encode = linear(width, size, 2.0**0.5)
        self.key = linear(size, size, 1.0)
        self.query = linear(own, size, 1.0)
        self.scale = size**-0.5

    def forward(self, own: torch.Tensor, others: torch.Tensor) -> torch.Tensor:
        """Return (..., size) for ``own`` (..., own) and ``others`` (..., neighbours, width)."""
        # Neighbours come first, (neighbours, parts, ...): products of the encodings with queries then are contiguous.
        seen = others.reshape(-1, *others.shape[-2:]).transpose(0, 1)
        code = torch.baddbmm(self.encode.bias, seen, self.encode.weight.T.expand(len(seen), -1, -1)).relu_()
        # Key times query is encoding times (key weights transposed times query), which is computed once for all neighbours.
        # The key bias adds the same to all logits of a part, so softmax cancels it.
        through = self.key.weight.T * self.scale
        query = nn.functional.linear(own, through @ self.query.weight, through @ self.query.bias)
        there = seen[..., 0] > 0.5
        # Products of elements and sums: batched products of such small matrices take longer.
        logit = (code * query.reshape(-1, query.shape[-1])).sum(dim=-1).masked_fill(~there, -1e30)
        weight = torch.softmax(logit, dim=0) * there
        return (weight.unsqueeze(-1) * code).sum(dim=0).view(query.shape)


class RowEncoder(nn.Module):
    """Input of the hidden layers: the part's own columns, and attention over its neighbours.

    Attributes:
        mean, scale: None, or (columns,) of standardized rows without neighbours; a scale of 0: not known yet.
    """

    mean: torch.Tensor
    scale: torch.Tensor | None

    def __init__(self, shape: Shape, attention: int) -> None:
        super().__init__()
        self.shape = shape
        self.register_buffer("mean", None)
        self.register_buffer("scale", None)
        self.size = shape.own
        self.attention: Attention | None = None
        if shape.neighbours:
            self.attention = Attention(shape.own, shape.width, attention)
            self.size += attention

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return (..., size) for rows (..., columns)."""
        if self.scale is not None:
            return ((rows - self.mean) * self.scale).clamp(-MAX_STANDARDIZED, MAX_STANDARDIZED)
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
        floor: size of actions, 0 to 1, above which standard deviations are multiples of the action's size: parts at rest
            then explore little; None: standard deviations do not depend on the action.

    Attributes:
        symmetry: averages over equivalent scenes; None: no average.
    """

    encoder: Callable[..., Any] = RowEncoder
    symmetry: Symmetry | None = None

    def __init__(
        self, shape: Any, net: list[int], activation: str, attention: int, log_std: float, floor: float | None = None
    ) -> None:
        super().__init__()
        self.eyes = self.encoder(shape, attention)
        self.hidden = hidden(self.eyes.size, net, activation)
        self.mean = linear(net[-1], shape.action, 0.01)
        self.log_std = linear(net[-1], shape.action, 0.01)
        nn.init.constant_(self.log_std.bias, log_std)
        self.register_buffer(FLOOR, None if floor is None else torch.tensor([floor]))

    def forward(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mean and log std (..., action) for rows (..., columns)."""
        symmetry = self.symmetry
        if symmetry is None:
            return self._of(rows)
        mean, log_std = self._of(symmetry.rows(rows))
        return symmetry.mean(mean), symmetry.spread(log_std)

    def _of(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mean and log std of one scene."""
        code = self.hidden(self.eyes(rows))
        mean, log_std = self.mean(code), self.log_std(code).clamp(*LOG_STD_RANGE)
        floor = getattr(self, FLOOR)
        if floor is None:
            return mean, log_std
        size = mean.detach().clamp(-1.0, 1.0).square().mean(dim=-1, keepdim=True).sqrt()
        return mean, log_std + torch.log(floor + size)


class PartsCritic(nn.Module):
    """Value of every part, from its own row and from all parts of its world (a centralised critic).

    The critic reads the mean of the parts' encodings, which does not depend on their order (Zaheer et al. 2017).

    Attributes:
        symmetry: see :class:`PartsActor`.
    """

    encoder: Callable[..., Any] = RowEncoder
    symmetry: Symmetry | None = None

    def __init__(self, shape: Any, net: list[int], activation: str, attention: int) -> None:
        super().__init__()
        self.eyes = self.encoder(shape, attention)
        self.together = linear(shape.own, attention, 2.0**0.5) if shape.neighbours else None
        self.hidden = hidden(self.eyes.size + (attention if shape.neighbours else 0), net, activation)
        self.value = linear(net[-1], 1, 1.0)
        self.own = shape.own

    def forward(self, rows: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return values (..., parts) of rows (..., parts, columns); ``mask`` (..., parts) is 1 where there is a part."""
        if self.symmetry is None:
            return self._of(rows, mask)
        scenes = self.symmetry.rows(rows).movedim(-2, -3)
        return self._of(scenes, mask.unsqueeze(-2).expand(scenes.shape[:-1])).mean(dim=-2)

    def _of(self, rows: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the values of one scene."""
        code = self.eyes(rows)
        if self.together is not None:
            here = mask.unsqueeze(-1)
            encoded = torch.relu(self.together(rows[..., : self.own])) * here
            mean = encoded.sum(dim=-2, keepdim=True) / here.sum(dim=-2, keepdim=True).clamp(min=1.0)
            code = torch.cat([code, mean.expand(*code.shape[:-1], -1)], dim=-1)
        return self.value(self.hidden(code)).squeeze(-1)


BASIS = 32
"""Basis functions of an element's position."""


class ElementsActor(nn.Module):
    """Mean and logarithmic standard deviation of the phasors of the elements around every part; see the module.

    Exploration has one standard deviation per part.

    Args: see :class:`PartsActor`.
    """

    def __init__(self, shape: Shape, net: list[int], activation: str, attention: int, log_std: float) -> None:
        super().__init__()
        self.shape = shape
        self.eyes = RowEncoder(shape, attention)
        self.hidden = hidden(self.eyes.size, net, activation)
        self.coefficients = linear(net[-1], 2 * BASIS, 0.1)
        self.places = linear(4, BASIS, 1.0)
        self.basis = Tanh()
        self.log_std = linear(net[-1], 1, 0.01)
        nn.init.constant_(self.log_std.bias, log_std)

    def forward(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mean and log std (..., side * side * 2) for rows (..., columns)."""
        side, place = self.shape.side, self.shape.place
        code = self.hidden(self.eyes(rows))
        coefficients = self.coefficients(code).unflatten(-1, (BASIS, 2))
        basis = self.basis(self.places(elements_about(rows[..., place : place + 2], side)))
        mean = (basis @ coefficients).flatten(-2) / BASIS**0.5
        log_std = self.log_std(code).clamp(*LOG_STD_RANGE)
        return mean, log_std.expand(*mean.shape)


def elements_about(place: torch.Tensor, side: int) -> torch.Tensor:
    """Return x, y and their squares (..., side * side, 4) of a patch's elements relative to the part, row by row.

    Args:
        place: (..., 2) position of the part's centre in its element (:func:`vibgym.policies.trained.networks.offsets`).
    """
    within = 0.5 * (place + 1.0)
    first = torch.floor(within + (0.5 - 0.5 * side))
    steps = torch.arange(side, dtype=place.dtype)
    x, y = ((first + 0.5 - within)[..., k : k + 1] + steps for k in range(2))  # (..., side)
    shape = (*place.shape[:-1], side, side)
    x, y = x.unsqueeze(-2).expand(shape).flatten(-2), y.unsqueeze(-1).expand(shape).flatten(-2)
    return torch.stack([x, y, x * x, y * y], dim=-1)


MAPS = 4
"""Maps of mass per plane, outputs of the convolution."""

DISPLACEMENTS = 6
"""Differences of centroids."""


class PixelEncoder(nn.Module):
    """Input of the hidden layers: displacements between centroids, coarse and fine. ``attention`` is not used: one part."""

    def __init__(self, shape: ImageShape, attention: int = 0) -> None:
        super().__init__()
        self.shape, self.size = shape, 2 * DISPLACEMENTS * len(SCALES)
        self.conv = nn.Linear(CELL**2, MAPS, bias=False)
        nn.init.uniform_(self.conv.weight, 0.5 / CELL**2, 1.5 / CELL**2)
        # Initially the displacement to the goal, and those of the part from image to image.
        mix = 0.3 * torch.randn(DISPLACEMENTS, shape.planes, MAPS) / math.sqrt(shape.planes * MAPS)
        mix[0, -1] += 1.0 / MAPS
        mix[0, 0] -= 1.0 / MAPS
        for age in range(min(shape.planes - 2, DISPLACEMENTS - 1)):
            mix[1 + age, age] += 1.0 / MAPS
            mix[1 + age, age + 1] -= 1.0 / MAPS
        self.mix = nn.Parameter(mix.flatten(1))

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return (..., size) for rows (..., columns), uint8."""
        planes = self.shape.planes
        pixels, plane, x, y = (torch.from_numpy(array) for array in occupied(rows.numpy(), self.shape))
        mass = torch.relu(self.conv(pixels)).unsqueeze(-1)  # (squares, maps, 1)
        moments = mass * torch.stack([torch.ones_like(x), x, y], dim=-1).unsqueeze(-2)
        sums = torch.zeros(rows[..., 0].numel() * planes, MAPS, 3).index_add(0, plane, moments)
        place = (sums[..., 1:] / (sums[..., :1] + MIN_MASS)).reshape(*rows.shape[:-1], planes * MAPS, 2)
        displacement = (self.mix - self.mix.mean(dim=1, keepdim=True)) @ place
        return torch.cat([torch.tanh(displacement * (1.0 / scale)) for scale in SCALES], dim=-1).flatten(-2)


class PixelsActor(PartsActor):
    """Mean and logarithmic standard deviation of the part's action; see the module."""

    encoder = PixelEncoder


class PixelsCritic(PartsCritic):
    """Value of the part."""

    encoder = PixelEncoder


NETWORKS: dict[str, tuple[Any, Any]] = {
    "parts": (PartsActor, PartsCritic),
    "joint": (PartsActor, PartsCritic),
    "elements": (ElementsActor, PartsCritic),
    "pixels": (PixelsActor, PixelsCritic),
}
"""Actor and critic by name."""


def register_network(name: str, actor: Any, critic: Any, acting: Callable[..., Any], like: str = "parts") -> None:
    """Add a user-defined network, for ``network: name`` in training files.

    Args:
        name: of the network.
        actor: torch module ``actor(shape, net, activation, attention, log_std)``; called with rows (..., columns) it returns
            mean and logarithmic standard deviation (..., action).
        critic: torch module ``critic(shape, net, activation, attention)``; called with rows (..., parts, columns) and mask
            (..., parts) it returns values (..., parts).
        acting: the actor in NumPy: ``acting(tensors, shape, activation, rows)`` returns mean and log std; ``tensors`` are the
            actor's by torch's names.
        like: built-in network whose inputs it reads, ``"parts"`` or ``"pixels"``.

    Raises:
        ValueError: the name is taken.
    """
    if name in NETWORKS:
        raise checks.refuse("network", name, f"a new name, not one of {', '.join(NETWORKS)}")
    NETWORKS[name] = actor, critic
    ACTING[name] = acting
    CODINGS[name] = CODINGS[like]


def trained_tensors(module: nn.Module) -> dict[str, np.ndarray]:
    """Return a module's weights as NumPy arrays under torch's names."""
    return {name: value.detach().cpu().numpy() for name, value in module.state_dict().items()}
