"""The networks' acting halves in NumPy, float32: what torch trains, without torch. Tensors have the names torch gives them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from vibgym.policies.trained.networks.shape import LEAST_MASS, WAY_SCALES, Picture, Shape, occupied, offsets

LOG_STD_RANGE = (-5.0, 0.5)
"""Of the exploration's standard deviation, a number of each action that depends on what the part sees."""
FLOOR = "log_std_floor"
"""Tensor with the size of actions below which exploration does not shrink with them; without it, it never does."""

ABSENT = np.float32(-1e9)  # as in agents.networks

Tensors = Mapping[str, np.ndarray]


def _relu(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, 0.0, dtype=np.float32)


ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {"tanh": np.tanh, "relu": _relu}


def linear(tensors: Tensors, name: str, x: np.ndarray) -> np.ndarray:
    """A linear layer."""
    return x @ tensors[f"{name}.weight"].T + tensors[f"{name}.bias"]


def hidden(tensors: Tensors, name: str, activation: str, x: np.ndarray) -> np.ndarray:
    """Hidden layers ``name.0``, ``name.2``, ...: torch counts the activations between them."""
    layer = 0
    while f"{name}.{layer}.weight" in tensors:
        x = ACTIVATIONS[activation](linear(tensors, f"{name}.{layer}", x))
        layer += 2
    return x


def attend(tensors: Tensors, name: str, own: np.ndarray, others: np.ndarray) -> np.ndarray:
    """See :class:`agents.networks.Attention`."""
    there = others[..., 0] > 0.5
    encoded = _relu(linear(tensors, f"{name}.encode", others))
    key, query = linear(tensors, f"{name}.key", encoded), linear(tensors, f"{name}.query", own)
    logit = (key * query[..., None, :]).sum(axis=-1) * np.float32(encoded.shape[-1] ** -0.5)
    logit = np.where(there, logit, ABSENT)
    weight = np.exp(logit - logit.max(axis=-1, keepdims=True)) * there
    weight = weight / (weight.sum(axis=-1, keepdims=True) + np.float32(1e-9))
    return (weight[..., None] * encoded).sum(axis=-2)


def look(tensors: Tensors, shape: Shape, rows: np.ndarray) -> np.ndarray:
    """See :class:`agents.networks.Eyes`."""
    if not shape.neighbours:
        return rows
    own = rows[..., : shape.own]
    others = rows[..., shape.own :].reshape(*rows.shape[:-1], shape.neighbours, shape.width)
    return np.concatenate([own, attend(tensors, "eyes.attention", own, others)], axis=-1)


def parts(tensors: Tensors, shape: Shape, activation: str, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and log std, see :class:`agents.networks.PartsActor`."""
    seen = hidden(tensors, "hidden", activation, look(tensors, shape, rows))
    mean, log_std = linear(tensors, "mean", seen), np.clip(linear(tensors, "log_std", seen), *LOG_STD_RANGE)
    if FLOOR in tensors:
        size = np.sqrt(np.square(np.clip(mean, -1.0, 1.0)).mean(axis=-1, keepdims=True))
        log_std = log_std + np.log(tensors[FLOOR] + size)
    return mean, log_std


def elements(tensors: Tensors, shape: Shape, activation: str, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and log std, see :class:`agents.networks.ElementsActor`."""
    seen = hidden(tensors, "hidden", activation, look(tensors, shape, rows))
    coefficients = linear(tensors, "coefficients", seen)
    coefficients = coefficients.reshape(*coefficients.shape[:-1], -1, 2)
    about = offsets(rows[..., shape.place : shape.place + 2], shape.side)  # (..., side, 2)
    full = (*rows.shape[:-1], shape.side, shape.side)
    x = np.broadcast_to(about[..., None, :, 0], full).reshape(*rows.shape[:-1], -1)
    y = np.broadcast_to(about[..., :, None, 1], full).reshape(*rows.shape[:-1], -1)
    place = np.stack([x, y, x * x, y * y], axis=-1)
    basis = np.tanh(linear(tensors, "places", place))
    mean = (basis @ coefficients).reshape(*rows.shape[:-1], -1) / np.float32(basis.shape[-1] ** 0.5)
    log_std = np.clip(linear(tensors, "log_std", seen), *LOG_STD_RANGE)
    return mean, np.broadcast_to(log_std, mean.shape)


def pixels(tensors: Tensors, shape: Picture, activation: str, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and log std, see :class:`agents.networks.PixelsActor`."""
    squares = occupied(rows, shape)
    mass = _relu(squares.pixels @ tensors["eyes.conv.weight"].T)
    moments = np.stack([mass, mass * squares.x[:, None], mass * squares.y[:, None]], axis=-1)
    planes = rows.size // shape.columns * shape.planes
    first = np.searchsorted(squares.plane, np.arange(planes + 1))
    # reduceat takes what is empty for one square, and wants one at the end.
    sums = np.add.reduceat(np.concatenate([moments, np.zeros((1, *moments.shape[1:]), np.float32)]), first[:-1])
    sums[first[1:] == first[:-1]] = 0.0
    place = sums[..., 1:] / (sums[..., :1] + np.float32(LEAST_MASS))
    place = place.reshape(*rows.shape[:-1], -1, 2)
    mix = tensors["eyes.mix"]
    way = (mix - mix.mean(axis=1, keepdims=True)) @ place
    codes = np.concatenate([np.tanh(way * np.float32(1.0 / scale)) for scale in WAY_SCALES], axis=-1)
    seen = hidden(tensors, "hidden", activation, codes.reshape(*rows.shape[:-1], -1))
    return linear(tensors, "mean", seen), np.clip(linear(tensors, "log_std", seen), *LOG_STD_RANGE)


ACTING: Mapping[str, Callable[[Tensors, Any, str, np.ndarray], tuple[np.ndarray, np.ndarray]]] = {
    "parts": parts,
    "elements": elements,
    "pixels": pixels,
}
"""Acting by the kind of a network."""
