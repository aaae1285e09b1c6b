"""Environments whose parts have shapes drawn from a split of the library for each episode (:mod:`vibgym.scene.library`).

Parts ``{"shape": "drawn"}`` get the shape that a reset draws: one of the kinds of the scene (:mod:`vibgym.scene.kinds`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.envs.options import Options
from vibgym.scene.kinds import Kinds
from vibgym.scene.library import largest_dimension, scaled, shapes
from vibgym.scene.part_settings import PartSettings
from vibgym.scene.parts import Part, part_from
from vibgym.settings import Length, read

DRAWN = "drawn"

MAX_DRAWN = 8
"""Most different shapes of an episode."""


class DrawnPart(PartSettings):
    """A part whose shape is drawn. Properties that are given replace those of the drawn part."""

    shape: Literal["drawn"]
    """Name of the shape."""

    which: int = Field(default=0, ge=0, lt=MAX_DRAWN)
    """Number of the shape: parts with equal numbers have the same shape, others different ones."""

    size: Length | None = Field(default=None, gt=0.0)
    """Largest dimension; None: that of the drawn part."""

    friction: float = Field(default=0.0, ge=0.0)
    """Coefficient of sliding friction; by default that of the drawn part."""

    def part(self, drawn: Part) -> Part:
        """Return the part with a drawn shape."""
        properties = {"friction": drawn.friction, "name": drawn.name}
        own = self.model_fields_set & set(PartSettings.model_fields)
        properties |= {name: value for name in own if (value := getattr(self, name)) is not None}
        factor = 1.0 if self.size is None else self.size / largest_dimension(drawn.outline)
        if drawn.symmetry == 0:
            return Part.disc(factor * math.sqrt(drawn.area / math.pi), **properties)
        outline = drawn.outline if self.size is None else scaled(drawn.outline, self.size)
        return Part.polygon(outline, **properties)


class DrawnShapes:
    """Draws the shapes of an episode from a split.

    Args:
        options: of the environment, with a split.

    Attributes:
        library: parts of the split.
        draws: uniform numbers of an episode, one for each different shape.
        shapes: those that are given instead of drawn ones; None: drawn.

    Raises:
        ValueError: an unknown split, no drawn part, or invalid shapes.
    """

    def __init__(self, options: Options) -> None:
        assert options.split is not None
        self.library = shapes(options.split)
        self._parts = [_drawn_part(part, f"parts[{k}]") for k, part in enumerate(options.parts or [])]
        which = {part.which for part in self._parts if isinstance(part, DrawnPart)}
        if not which:
            raise checks.conflict('split requires a part with a drawn shape: parts=[{"shape": "drawn"}]')
        if which != set(range(len(which))):
            raise checks.refuse("which", sorted(which), "numbers of the drawn shapes from 0 on, without gaps")
        self.draws, most = len(which), len(self.library) - 1
        self.shapes: tuple[int, ...] | None = None
        if options.shapes is not None:
            numbers, allowed = options.shapes, f"a list of {self.draws} different whole numbers from 0 to {most}"
            if not checks.listed(numbers) or len(numbers) != self.draws or len(set(numbers)) != self.draws:
                raise checks.refuse("shapes", numbers, allowed)
            self.shapes = tuple(checks.count(f"shapes[{k}]", n, least=0, most=most) for k, n in enumerate(numbers))

    def parts(self, chosen: Sequence[int]) -> list[Part]:
        """Return the parts of an episode with these shapes, indices of the library."""
        return [
            part.part(self.library[chosen[part.which]]) if isinstance(part, DrawnPart) else part for part in self._parts
        ]

    def kinds(self, worlds: int) -> Kinds:
        """Return the kinds of parts that episodes may have, and those of the first shapes in each of ``worlds``."""
        every: list[Part] = []
        self._kind = np.zeros((len(self._parts), len(self.library)), dtype=np.int64)  # of a part by its shape
        blocks: dict[Any, int] = {}
        for k, part in enumerate(self._parts):
            drawn = isinstance(part, DrawnPart)
            key = repr(part.model_copy(update={"which": 0})) if isinstance(part, DrawnPart) else id(part)
            if key not in blocks:
                blocks[key] = len(every)
                every += [part.part(shape) for shape in self.library] if isinstance(part, DrawnPart) else [part]
            self._kind[k] = blocks[key] + (np.arange(len(self.library)) if drawn else 0)
        first = np.tile(np.arange(self.draws), (worlds, 1))
        return Kinds(every, self.kind_of(first), [sorted(set(options)) for options in self._kind.tolist()])

    def kind_of(self, chosen: np.ndarray) -> np.ndarray:
        """Return the kinds (n, parts) of parts with shapes (n, draws)."""
        which = [part.which if isinstance(part, DrawnPart) else 0 for part in self._parts]
        return self._kind[np.arange(len(which)), chosen[:, which]]

    def draw(self, uniform: np.ndarray) -> np.ndarray:
        """Return different indices of the library, (n, draws), from ``uniform`` (n, draws) in [0, 1)."""
        chosen = np.empty(uniform.shape, dtype=np.int64)
        for row, numbers in zip(chosen, uniform.tolist(), strict=True):
            left = list(range(len(self.library)))
            row[:] = [left.pop(int(u * len(left))) for u in numbers]
        return chosen

    def fixed(self, options: Options, chosen: Sequence[int]) -> Options:
        """Return the options of an environment with these shapes."""
        return options.model_copy(update={"parts": self.parts(chosen), "shapes": tuple(chosen)})


def _drawn_part(part: Any, where: str) -> DrawnPart | Part:
    if isinstance(part, Mapping) and part.get("shape") == DRAWN:
        return read(DrawnPart, {name: setting for name, setting in part.items() if setting is not None}, where)
    return part_from(part, where)


def drawn_shapes(task: str, arguments: Mapping[str, Any]) -> DrawnShapes | None:
    """Return what draws the shapes of an environment's episodes; None if its scene is the same in all episodes.

    Args:
        task: id of a registered environment, or the name of a task.
        arguments: of the environment, as for ``gym.make``; those that are no options are ignored.
    """
    spec = gym.registry.get(task)
    settings = {"task": task, **({} if spec is None else spec.kwargs), **arguments}
    if settings.get("split") is None or settings.get("shapes") is not None:
        return None
    return DrawnShapes(
        Options.of(settings["task"], {name: settings[name] for name in Options.names() if name in settings})
    )


def fixed_scenes(drawn: DrawnShapes) -> list[dict[str, Any]]:
    """Return arguments of environments with fixed shapes that together have each shape of the split once as the first."""
    count = len(drawn.library)
    return [{"shapes": [(k + n * (count // drawn.draws)) % count for n in range(drawn.draws)]} for k in range(count)]
