"""Networks in NumPy, float32, as they act, and the shapes of their inputs. :mod:`agents.networks` trains them in torch.

Tensors have torch's names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

LOG_STD_RANGE = (-5.0, 0.5)
"""Range of the logarithmic standard deviation of exploration, which depends on the observation."""

FLOOR = "log_std_floor"
"""Name of the tensor with the size of actions below which exploration does not shrink with them (``noise_floor``)."""

NEIGHBOUR = "_there"
"""End of the name of the first column of a neighbour's block in ``env.unwrapped.parts_layout``."""

BASE = "base"
"""Name of the columns with the action of a base policy, see :mod:`.residual`."""

CELL = 3
"""Pixels along an edge of the squares that ``pixels`` networks convolve; an element has a multiple of it."""

SCALES = (0.25, 0.05, 0.01)
"""m, units of displacements in ``pixels`` networks, before tanh."""

MIN_MASS = 1e-6
"""Added to masses, so that the centroid of an empty image is defined; a full square has a mass of about 1."""

MAX_STANDARDIZED = 5.0
"""Largest magnitude of standardized inputs."""

ABSENT = np.float32(-1e9)  # logit of an absent neighbour

Tensors = Mapping[str, np.ndarray]


class Shape(NamedTuple):
    """Columns of a row of ``observation="parts"``, and values of a part's action.

    The last ``neighbours * width`` columns of a row belong to the neighbours.
    """

    columns: int  # of a row
    neighbours: int
    width: int  # columns of a neighbour
    action: int  # values of a part's action
    side: int = 0  # elements along the edge of the patch that an action drives; 0: not an action of elements
    place: int = -1  # first of the two columns "element", the centre's position in its element; -1: not read

    @property
    def own(self) -> int:
        """Columns of the part itself."""
        return self.columns - self.neighbours * self.width

    @property
    def has_elements(self) -> bool:
        """Whether the ``elements`` network supports it: the action is of elements, and their positions are known."""
        return self.side > 0 and self.place >= 0

    @classmethod
    def of(cls, layout: Sequence[Any], action: int, side: int = 0) -> Shape:
        """Return the shape for an environment's ``parts_layout``."""
        columns = sum(row.width for row in layout)
        blocks = [row.start for row in layout if row.name.endswith(NEIGHBOUR)]
        place = next((row.start for row in layout if row.name == "element"), -1)
        width = (columns - blocks[0]) // len(blocks) if blocks else 0
        return cls(columns, len(blocks), width, action, side, place)


class ImageShape(NamedTuple):
    """Planes of pixels that are one row of a network's input, and values of the part's action."""

    planes: int  # the part in the last images, newest first, and its goal
    height: int
    width: int
    pixel: float  # edge, m
    action: int
    side: int = 0  # as in Shape
    neighbours: int = 0
    has_elements = False

    @property
    def columns(self) -> int:
        """Values of a row."""
        return self.planes * self.height * self.width

    own = columns


class Squares(NamedTuple):
    """Squares of :data:`CELL` x :data:`CELL` pixels that are not empty, in order."""

    pixels: np.ndarray  # (squares, CELL * CELL) float32, 0 to 1, upper row first
    plane: np.ndarray  # (squares,) int64, counted over all rows
    x: np.ndarray  # (squares,) float32 m, to the right from the middle of the first square
    y: np.ndarray  # (squares,) float32 m, upwards, so at most 0


def occupied(rows: np.ndarray, shape: ImageShape) -> Squares:
    """Return the squares of rows (..., columns) that are not empty; images of parts are mostly empty."""
    wide, high = shape.width // CELL, shape.height // CELL
    lines = rows.reshape(-1, CELL, wide * CELL)
    any_row = lines.max(axis=1)
    filled = any_row[:, 0::CELL] > 0
    for column in range(1, CELL):
        filled |= any_row[:, column::CELL] > 0
    line, column = np.divmod(np.flatnonzero(filled), wide)
    plane, row = np.divmod(line, high)
    pixels = lines.reshape(-1, CELL, wide, CELL)[line, :, column].reshape(-1, CELL**2)
    edge = np.float32(shape.pixel * CELL)
    scaled = pixels.astype(np.float32) * np.float32(1.0 / 255.0)
    return Squares(scaled, plane, edge * column.astype(np.float32), -edge * row.astype(np.float32))


def offsets(place: np.ndarray, side: int) -> np.ndarray:
    """Return the centres of a patch's elements relative to the part's centre, in elements: (..., side, 2), x and y.

    Args:
        place: (..., 2) position of the part's centre in its element, -1 to 1.
        side: elements along an edge of the patch (:class:`vibgym.envs.Patch`).
    """
    within = 0.5 * (place + 1.0)
    first = np.floor(within + (0.5 - 0.5 * side))
    return (first + 0.5 - within)[..., None, :] + np.arange(side, dtype=place.dtype)[:, None]


def _relu(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, 0.0, dtype=np.float32)


ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {"tanh": np.tanh, "relu": _relu}


def linear(tensors: Tensors, name: str, x: np.ndarray) -> np.ndarray:
    """Apply a linear layer."""
    return x @ tensors[f"{name}.weight"].T + tensors[f"{name}.bias"]


def hidden(tensors: Tensors, name: str, activation: str, x: np.ndarray) -> np.ndarray:
    """Apply the hidden layers ``name.0``, ``name.2``, ...; torch counts the activations between them."""
    layer = 0
    while f"{name}.{layer}.weight" in tensors:
        x = ACTIVATIONS[activation](linear(tensors, f"{name}.{layer}", x))
        layer += 2
    return x


def attend(tensors: Tensors, name: str, own: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Apply :class:`agents.networks.Attention`."""
    there = others[..., 0] > 0.5
    encoded = _relu(linear(tensors, f"{name}.encode", others))
    key, query = linear(tensors, f"{name}.key", encoded), linear(tensors, f"{name}.query", own)
    logit = (key * query[..., None, :]).sum(axis=-1) * np.float32(encoded.shape[-1] ** -0.5)
    logit = np.where(there, logit, ABSENT)
    weight = np.exp(logit - logit.max(axis=-1, keepdims=True)) * there
    weight = weight / (weight.sum(axis=-1, keepdims=True) + np.float32(1e-9))
    return (weight[..., None] * encoded).sum(axis=-2)


def encode(tensors: Tensors, shape: Shape, rows: np.ndarray) -> np.ndarray:
    """Apply :class:`agents.networks.RowEncoder`."""
    if not shape.neighbours:
        if "eyes.scale" not in tensors:
            return rows
        return np.clip(
            (rows - tensors["eyes.mean"]) * tensors["eyes.scale"], -MAX_STANDARDIZED, MAX_STANDARDIZED, dtype=np.float32
        )
    own = rows[..., : shape.own]
    others = rows[..., shape.own :].reshape(*rows.shape[:-1], shape.neighbours, shape.width)
    return np.concatenate([own, attend(tensors, "eyes.attention", own, others)], axis=-1)


def parts(tensors: Tensors, shape: Shape, activation: str, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and log std of :class:`agents.networks.PartsActor`."""
    code = hidden(tensors, "hidden", activation, encode(tensors, shape, rows))
    mean, log_std = linear(tensors, "mean", code), np.clip(linear(tensors, "log_std", code), *LOG_STD_RANGE)
    if FLOOR in tensors:
        size = np.sqrt(np.square(np.clip(mean, -1.0, 1.0)).mean(axis=-1, keepdims=True))
        log_std = log_std + np.log(tensors[FLOOR] + size)
    return mean, log_std


def elements(tensors: Tensors, shape: Shape, activation: str, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and log std of :class:`agents.networks.ElementsActor`."""
    code = hidden(tensors, "hidden", activation, encode(tensors, shape, rows))
    coefficients = linear(tensors, "coefficients", code)
    coefficients = coefficients.reshape(*coefficients.shape[:-1], -1, 2)
    about = offsets(rows[..., shape.place : shape.place + 2], shape.side)  # (..., side, 2)
    full = (*rows.shape[:-1], shape.side, shape.side)
    x = np.broadcast_to(about[..., None, :, 0], full).reshape(*rows.shape[:-1], -1)
    y = np.broadcast_to(about[..., :, None, 1], full).reshape(*rows.shape[:-1], -1)
    basis = np.tanh(linear(tensors, "places", np.stack([x, y, x * x, y * y], axis=-1)))
    mean = (basis @ coefficients).reshape(*rows.shape[:-1], -1) / np.float32(basis.shape[-1] ** 0.5)
    log_std = np.clip(linear(tensors, "log_std", code), *LOG_STD_RANGE)
    return mean, np.broadcast_to(log_std, mean.shape)


def encode_pixels(tensors: Tensors, shape: ImageShape, rows: np.ndarray) -> np.ndarray:
    """Apply :class:`agents.networks.PixelEncoder`."""
    squares = occupied(rows, shape)
    mass = _relu(squares.pixels @ tensors["eyes.conv.weight"].T)
    moments = np.stack([mass, mass * squares.x[:, None], mass * squares.y[:, None]], axis=-1)
    planes = rows.size // shape.columns * shape.planes
    first = np.searchsorted(squares.plane, np.arange(planes + 1))
    # reduceat returns one square for an empty plane, and needs a square after the last plane.
    sums = np.add.reduceat(np.concatenate([moments, np.zeros((1, *moments.shape[1:]), np.float32)]), first[:-1])
    sums[first[1:] == first[:-1]] = 0.0
    place = sums[..., 1:] / (sums[..., :1] + np.float32(MIN_MASS))
    place = place.reshape(*rows.shape[:-1], -1, 2)
    mix = tensors["eyes.mix"]
    displacement = (mix - mix.mean(axis=1, keepdims=True)) @ place
    codes = np.concatenate([np.tanh(displacement * np.float32(1.0 / scale)) for scale in SCALES], axis=-1)
    return codes.reshape(*rows.shape[:-1], -1)


def pixels(tensors: Tensors, shape: ImageShape, activation: str, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and log std of :class:`agents.networks.PixelsActor`."""
    code = hidden(tensors, "hidden", activation, encode_pixels(tensors, shape, rows))
    return linear(tensors, "mean", code), np.clip(linear(tensors, "log_std", code), *LOG_STD_RANGE)


ENCODERS: dict[str, Callable[[Tensors, Any, np.ndarray], np.ndarray]] = {
    "parts": encode,
    "joint": encode,
    "pixels": encode_pixels,
}
"""Inputs of the hidden layers by the name of a network, from tensors, shape and rows."""

Acting = Callable[[Tensors, Any, str, np.ndarray], tuple[np.ndarray, np.ndarray]]

ACTING: dict[str, Acting] = {
    "parts": parts,
    "joint": parts,
    "elements": elements,
    "pixels": pixels,
}
"""Mean and log std of actions by the name of a network, from tensors, shape, activation and rows."""
