"""Fast kernels with autograd functions: tanh, and attention over a few neighbours.

Torch's tanh takes six times as long. Its batched products of small matrices, a part's query with its five encodings, took a
third of an update of Sort. Rows are independent, so results do not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import nn

from vibgym.kernels.jit import jit
from vibgym.simulation.threads import share

ZERO, ONE, TWO, QUARTER = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(0.25)

LARGEST = np.float32(9.0)
"""From here on tanh is 1 in float32."""


@jit
def _tanh(x: np.ndarray, y: np.ndarray) -> None:
    """Compute ``y = tanh(x)`` of flat arrays to 2e-7: Lambert's continued fraction at x / 4, doubled twice. NaN stays NaN."""
    for k in range(len(x)):
        u = x[k]
        u = QUARTER * (LARGEST if u > LARGEST else (-LARGEST if u < -LARGEST else u))
        s = u * u
        above = u * (np.float32(135135.0) + s * (np.float32(17325.0) + s * (np.float32(378.0) + s)))
        below = np.float32(135135.0) + s * (np.float32(62370.0) + s * (np.float32(3150.0) + s * np.float32(28.0)))
        t = above / below
        t = TWO * t / (ONE + t * t)
        y[k] = TWO * t / (ONE + t * t)


@jit
def _attend(code: np.ndarray, there: np.ndarray, sought: np.ndarray, weight: np.ndarray, out: np.ndarray) -> None:
    """Compute means ``out`` (parts, size) of rectified encodings, weighted by the softmax of their products with the queries.

    Args:
        code: (parts, neighbours, size) encodings, not yet rectified.
        there: (parts, neighbours) bool; without any the mean is zero.
        sought: (parts, size) queries.
        weight: (parts, neighbours) result: softmax, 0 for absent neighbours.
        out: result.
    """
    parts, count, size = code.shape
    for part in range(parts):
        most = -np.float32(np.inf)
        for k in range(count):
            if there[part, k]:
                logit = ZERO
                for c in range(size):
                    logit += max(code[part, k, c], ZERO) * sought[part, c]
                weight[part, k] = logit
                most = max(most, logit)
        total = ZERO
        for k in range(count):
            weight[part, k] = np.exp(weight[part, k] - most) if there[part, k] else ZERO
            total += weight[part, k]
        for c in range(size):
            out[part, c] = ZERO
        for k in range(count):
            if there[part, k]:
                weight[part, k] /= total
                share = weight[part, k]
                for c in range(size):
                    out[part, c] += share * max(code[part, k, c], ZERO)


@jit(allocates=True)
def _attend_backward(
    code: np.ndarray,
    sought: np.ndarray,
    weight: np.ndarray,
    grad: np.ndarray,
    of_code: np.ndarray,
    of_sought: np.ndarray,
) -> None:
    """Compute ``of_code`` and ``of_sought`` from the gradient ``grad`` (parts, size) of :func:`_attend`'s means."""
    parts, count, size = code.shape
    dot = np.empty(count, dtype=np.float32)
    for part in range(parts):
        mean = ZERO
        for k in range(count):
            total = ZERO
            for c in range(size):
                total += max(code[part, k, c], ZERO) * grad[part, c]
            dot[k] = total
            mean += weight[part, k] * total
        for c in range(size):
            of_sought[part, c] = ZERO
        for k in range(count):
            share = weight[part, k]
            of_logit = share * (dot[k] - mean)
            for c in range(size):
                value = code[part, k, c]
                of_sought[part, c] += of_logit * max(value, ZERO)
                of_code[part, k, c] = share * grad[part, c] + of_logit * sought[part, c] if value > ZERO else ZERO


LEAST = 1 << 16
"""Values below which a second thread costs more than it saves."""


def _shared(kernel: Callable[..., None], *tensors: torch.Tensor) -> None:
    """Call ``kernel`` with the tensors as arrays; torch's number of threads share their rows."""
    arrays = [each.detach().numpy() for each in tensors]
    threads = min(torch.get_num_threads(), arrays[0].size // LEAST)
    share(lambda first, last: kernel(*(each[first:last] for each in arrays)), len(arrays[0]), threads)


class _Tanh(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        x = x.contiguous()
        y = torch.empty_like(x)
        _shared(_tanh, x.view(-1), y.view(-1))
        ctx.save_for_backward(y)
        return y

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        return torch.ops.aten.tanh_backward(grad, *ctx.saved_tensors)


class _Attend(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, code: torch.Tensor, there: torch.Tensor, sought: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        code, sought = code.contiguous(), sought.contiguous()
        weight, mean = torch.empty(there.shape), torch.empty_like(sought)
        _shared(_attend, code, there.contiguous(), sought, weight, mean)
        ctx.save_for_backward(code, sought, weight)
        return mean

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> tuple[torch.Tensor, None, torch.Tensor]:  # type: ignore[override]
        code, sought, weight = ctx.saved_tensors
        of_code, of_sought = torch.empty_like(code), torch.empty_like(sought)
        _shared(_attend_backward, code, sought, weight, grad.contiguous(), of_code, of_sought)
        return of_code, None, of_sought


def tanh(x: torch.Tensor) -> torch.Tensor:
    """Return the hyperbolic tangent in float32, to 2e-7."""
    result: Any = _Tanh.apply(x.float())
    return result


def attend(code: torch.Tensor, there: torch.Tensor, sought: torch.Tensor) -> torch.Tensor:
    """Return means (..., size) of rectified encodings, weighted by the softmax of their products with the queries.

    Args:
        code: (..., neighbours, size), not yet rectified.
        there: (..., neighbours) bool; without any neighbour the mean is zero.
        sought: (..., size) queries.
    """
    flat = code.reshape(-1, *code.shape[-2:]), there.reshape(-1, there.shape[-1]), sought.reshape(-1, sought.shape[-1])
    mean: Any = _Attend.apply(*(each if each.dtype == torch.bool else each.float() for each in flat))
    return mean.view(sought.shape)


class Tanh(nn.Module):
    """:func:`tanh` as a layer."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return :func:`tanh` of ``x``."""
        return tanh(x)
