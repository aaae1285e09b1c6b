"""Functions of tensors with gradients, whose work :mod:`agents.training.networks.kernels` does.

They compute in float32, whatever torch's autocasting makes of what surrounds them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import nn
from torch.amp import custom_bwd, custom_fwd

from agents.training.networks import kernels
from vibgym.simulation.threads import share

LEAST = 1 << 16
"""Numbers below which a second thread costs more than it saves."""


def _shared(kernel: Callable[..., None], *tensors: torch.Tensor) -> None:
    """Call ``kernel`` with the tensors as arrays; as many threads as torch has share their rows."""
    arrays = [each.detach().numpy() for each in tensors]
    threads = min(torch.get_num_threads(), arrays[0].size // LEAST)
    share(lambda first, last: kernel(*(each[first:last] for each in arrays)), len(arrays[0]), threads)


class _Tanh(torch.autograd.Function):
    @staticmethod
    @custom_fwd(device_type="cpu", cast_inputs=torch.float32)
    def forward(ctx: Any, x: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        x = x.contiguous()
        y = torch.empty_like(x)
        _shared(kernels.tanh, x.view(-1), y.view(-1))
        ctx.save_for_backward(y)
        return y

    @staticmethod
    @custom_bwd(device_type="cpu")
    def backward(ctx: Any, grad: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        return torch.ops.aten.tanh_backward(grad, *ctx.saved_tensors)


class _Attend(torch.autograd.Function):
    @staticmethod
    @custom_fwd(device_type="cpu", cast_inputs=torch.float32)
    def forward(ctx: Any, code: torch.Tensor, there: torch.Tensor, sought: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        code, sought = code.contiguous(), sought.contiguous()
        weight, mean = torch.empty(there.shape), torch.empty_like(sought)
        _shared(kernels.attend, code, there.contiguous(), sought, weight, mean)
        ctx.save_for_backward(code, sought, weight)
        return mean

    @staticmethod
    @custom_bwd(device_type="cpu")
    def backward(ctx: Any, grad: torch.Tensor) -> tuple[torch.Tensor, None, torch.Tensor]:  # type: ignore[override]
        code, sought, weight = ctx.saved_tensors
        of_code, of_sought = torch.empty_like(code), torch.empty_like(sought)
        _shared(kernels.attend_backward, code, sought, weight, grad.contiguous(), of_code, of_sought)
        return of_code, None, of_sought


def tanh(x: torch.Tensor) -> torch.Tensor:
    """Hyperbolic tangents of float32 numbers, to 2e-7."""
    result: Any = _Tanh.apply(x)
    return result


def attend(code: torch.Tensor, there: torch.Tensor, sought: torch.Tensor) -> torch.Tensor:
    """Means (..., size) of rectified encodings, weighted by the exponentials of their products with what is sought.

    Args:
        code: (..., neighbours, size) float32, not yet rectified.
        there: (..., neighbours) bool: absent neighbours have no weight; without any the mean is zero.
        sought: (..., size).
    """
    flat = code.reshape(-1, *code.shape[-2:]), there.reshape(-1, there.shape[-1]), sought.reshape(-1, sought.shape[-1])
    mean: Any = _Attend.apply(*flat)
    return mean.view(sought.shape)


class Tanh(nn.Module):
    """:func:`tanh` as a layer."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """The same shape."""
        return tanh(x)
