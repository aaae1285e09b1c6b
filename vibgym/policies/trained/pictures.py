"""From observations as images to the planes that a network of pixels reads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibgym import Part, Surface, checks
from vibgym.envs.actions import ACTIONS, actions_by_part
from vibgym.envs.observations import PIXELS
from vibgym.policies.trained.coding import Seen
from vibgym.policies.trained.networks.shape import Picture

FRAMES = 3
"""Images of the part that are kept: two tell how fast it is to within a rounded pixel, and a third makes that finer."""


class PictureCoding:
    """Turns images of one part and its goal into planes: the part in the last images, newest first, and the goal.

    What a network remembers of an episode is what it has seen before: the planes of the last step.

    Args:
        surface, parts: the scene.
        layout: not used; an image has no columns.
        action: the environment's ``action=``.
        turned, remembers: False; for rows alone.
        columns: what a network reads, ``[["part", frames], ["goal", 1]]``; None: :data:`FRAMES` frames.

    Attributes:
        shape: what a network has to know.
        columns: as the argument.

    Raises:
        ValueError: several parts, an action without a row for the part, or other columns.
    """

    observation = "image"
    dtype = np.uint8

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        layout: Sequence[Any],
        action: str,
        columns: Sequence[Sequence[Any]] | None = None,
        turned: bool = False,
        remembers: bool = False,
    ) -> None:
        self.surface, self.parts, self.action = surface, tuple(parts), action
        for name, value in (("turned", turned), ("remembers", remembers)):
            if value:
                raise checks.conflict(f"{name} is not supported by network 'pixels'")
        self.turned = self.remembers = False
        if len(parts) != 1:
            raise checks.conflict(f"network 'pixels' requires one part, got {len(parts)}")
        checks.choice("action", action, actions_by_part())
        size: int = ACTIONS.choose("action", action)(surface, self.parts).size
        self.columns = [["part", FRAMES], ["goal", 1]] if columns is None else [list(each) for each in columns]
        names = [each[0] for each in self.columns]
        if names != ["part", "goal"] or self.columns[1][1] != 1:
            raise checks.refuse("columns", columns, "[['part', frames], ['goal', 1]]")
        self.frames = checks.count("columns: frames", self.columns[0][1], most=16)
        height, width = surface.rows * PIXELS, surface.columns * PIXELS
        self.shape = Picture(self.frames + 1, height, width, surface.element_size / PIXELS, size)

    def see(self, observation: Any, before: Seen | None = None, start: np.ndarray | None = None) -> Seen:
        """Planes of the part and its goal; of one image a batch of one.

        Args:
            observation: (..., height, width, 3) uint8.
            before: what was seen at the last step; None: nothing.
            start: (worlds,) bool, where an episode has just begun: the part has been at rest.

        Raises:
            ValueError: no such images, or a memory of other worlds.
        """
        shape = self.shape
        size = (shape.height, shape.width)
        image = np.asarray(observation) if not isinstance(observation, dict) else np.asarray(None)
        image = image[None] if image.ndim == 3 else image
        if image.dtype != np.uint8 or image.ndim != 4 or image.shape[1:] != (*size, 3):
            got = f"{type(observation).__name__} of shape {image.shape} and type {image.dtype}"
            raise checks.refuse("observation", got, f"uint8 images (..., {shape.height}, {shape.width}, 3)")
        planes = np.empty((len(image), shape.planes, *size), dtype=np.uint8)
        planes[:, 0], planes[:, -1] = image[..., 0], image[..., 1]
        new = np.ones(len(image), dtype=bool)
        if before is not None:
            rows = before.rows if isinstance(before, Seen) else None
            if rows is None or rows.shape != (len(image), 1, shape.columns) or rows.dtype != self.dtype:
                allowed = f"None, or what was seen last in {len(image)} worlds: {shape.columns} uint8 in each"
                raise checks.refuse("state", before if rows is None else f"rows of shape {rows.shape}", allowed)
            planes[:, 1:-1] = rows.reshape(planes.shape)[:, :-2]
            new[:] = False if start is None else start
        planes[new, 1:-1] = planes[new, :1]
        return Seen(planes.reshape(len(image), 1, -1), np.ones((len(image), 1), dtype=np.float32))

    def to_rows(self, seen: Seen, of_parts: np.ndarray) -> np.ndarray:
        """The same: images are not turned."""
        return of_parts

    def touching(self, seen: Seen) -> np.ndarray:
        """Zeros: there are no other parts."""
        return np.zeros(seen.mask.shape, dtype=np.float32)

    def single(self, observation: Any) -> bool:
        """Whether it is one observation, and no batch."""
        return np.ndim(observation) == 3

    def actions(self, seen: Seen, of_parts: np.ndarray) -> np.ndarray:
        """The environment's actions (worlds, n) float32 of the part's (worlds, 1, size)."""
        return of_parts.reshape(len(of_parts), -1)
