"""Environments whose parts have shapes drawn from a split of the library for each episode (:mod:`vibgym.scene.library`).

Parts ``{"shape": "drawn"}`` get the shape that a reset draws. A single environment keeps a core for every shape that it has
met. A native batch has fixed shapes (``shapes=``), since all of its worlds share one scene.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from pydantic import Field

from vibgym import checks
from vibgym.envs.actions import new_action
from vibgym.envs.options import Options
from vibgym.scene.library import largest_dimension, scaled, shapes
from vibgym.scene.part_settings import PartSettings
from vibgym.scene.parts import Part, part_from
from vibgym.scene.surface import Surface, surface_from
from vibgym.settings import Length, read

DRAWN = "drawn"

MOST_DRAWN = 8
"""Most different shapes of an episode."""


class DrawnPart(PartSettings):
    """A part whose shape is drawn. Properties that are given replace those of the drawn part."""

    shape: Literal["drawn"]
    """Name of the shape."""

    which: int = Field(default=0, ge=0, lt=MOST_DRAWN)
    """Number of the shape: parts with equal numbers have the same shape, others different ones."""

    size: Length | None = Field(default=None, gt=0.0)
    """Largest dimension; None: that of the drawn part."""

    friction: float = Field(default=0.0, ge=0.0)
    """Coefficient of sliding friction; by default that of the drawn part."""

    def part(self, drawn: Part) -> Part:
        """Return the part with a drawn shape."""
        given = {"friction": drawn.friction, "name": drawn.name}
        own = self.model_fields_set & set(PartSettings.model_fields)
        given |= {name: value for name in own if (value := getattr(self, name)) is not None}
        factor = 1.0 if self.size is None else self.size / largest_dimension(drawn.outline)
        if drawn.symmetry == 0:
            return Part.disc(factor * math.sqrt(drawn.area / math.pi), **given)
        outline = drawn.outline if self.size is None else scaled(drawn.outline, self.size)
        return Part.polygon(outline, **given)


class DrawnShapes:
    """Draws the shapes of an episode from a split.

    Args:
        options: of the environment, with a split.
        surface: the table.

    Attributes:
        library: parts of the split.
        draws: uniform numbers of an episode, one for each different shape.

    Raises:
        ValueError: an unknown split, no drawn part, invalid shapes, or an action whose size depends on the part.
    """

    def __init__(self, options: Options, surface: Surface) -> None:
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
            given, allowed = options.shapes, f"a list of {self.draws} different whole numbers from 0 to {most}"
            if not checks.listed(given) or len(given) != self.draws or len(set(given)) != self.draws:
                raise checks.refuse("shapes", given, allowed)
            self.shapes = tuple(checks.count(f"shapes[{k}]", n, least=0, most=most) for k, n in enumerate(given))
        elif len(set(self._action_shapes(options.action, surface))) > 1:
            raise checks.conflict(
                f"the size of action {options.action!r} depends on the part: with drawn shapes use 'velocity' or another one"
            )

    def _action_shapes(self, action: Any, surface: Surface) -> Iterator[tuple[int, ...]]:
        """Yield the shape of an action for every shape of the library."""
        for k in range(len(self.library)):
            yield new_action(action, surface, self.parts([k] * self.draws)).shape

    def parts(self, chosen: Sequence[int]) -> list[Part]:
        """Return the parts of an episode with these shapes, indices of the library."""
        return [
            part.part(self.library[chosen[part.which]]) if isinstance(part, DrawnPart) else part for part in self._parts
        ]

    def draw(self, uniform: np.ndarray) -> tuple[int, ...]:
        """Return different indices of the library from ``uniform`` (draws,) in [0, 1)."""
        left = list(range(len(self.library)))
        return tuple(left.pop(int(u * len(left))) for u in uniform.tolist())

    def fixed(self, options: Options, chosen: Sequence[int]) -> Options:
        """Return the options of an environment with these shapes."""
        return options.model_copy(update={"parts": self.parts(chosen), "shapes": tuple(chosen)})


def _drawn_part(part: Any, where: str) -> DrawnPart | Part:
    if isinstance(part, Mapping) and part.get("shape") == DRAWN:
        return read(DrawnPart, {name: each for name, each in part.items() if each is not None}, where)
    return part_from(part, where)


def drawn_shapes(task: str, arguments: Mapping[str, Any]) -> DrawnShapes | None:
    """Return what draws the shapes of an environment's episodes; None if its scene is the same in all episodes.

    Args:
        task: id of a registered environment, or the name of a task.
        arguments: of the environment, as for ``gym.make``; those that are no options are ignored.
    """
    spec = gym.registry.get(task)
    given = {"task": task, **({} if spec is None else spec.kwargs), **arguments}
    if given.get("split") is None or given.get("shapes") is not None:
        return None
    options = Options.of(given["task"], {name: given[name] for name in Options.names() if name in given})
    return DrawnShapes(options, surface_from(options.surface))


def seeds_by_shapes(drawn: DrawnShapes, seeds: Sequence[int]) -> dict[tuple[int, ...], list[int]]:
    """Return the indices of the seeds whose resets draw the same shapes, by shapes."""
    found: dict[tuple[int, ...], list[int]] = {}
    for k, seed in enumerate(seeds):
        chosen = drawn.draw(seeding.np_random(seed)[0].random(drawn.draws))
        found.setdefault(chosen, []).append(k)
    return dict(sorted(found.items()))


def fixed_scenes(drawn: DrawnShapes) -> list[dict[str, Any]]:
    """Return arguments of environments with fixed shapes that together have each shape of the split once as the first."""
    count = len(drawn.library)
    return [{"shapes": [(k + n * (count // drawn.draws)) % count for n in range(drawn.draws)]} for k in range(count)]
