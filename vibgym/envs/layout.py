"""Where the numbers of observations stand and what they mean, and how to read quantities from them.

What there is to tell of a part is in :mod:`vibgym.envs.features`. A task says which of these its parts have, and every part has
a block of them in the state observation, or a row in the observation by parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np

from vibgym.envs.features import FEATURES, NEIGHBOUR, NEIGHBOURS, PUSHED, ROW, Feature
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks import Task

OPTIONAL = ("kind", "arrived", "age", "sigma", "contact_normal", "contact_impulse")
"""In a row where they are in a block of the state observation."""

TURNS = ("turn", "turn_coarse", "turn_fine", "turn_finest")
MOTIONS = ("goal_velocity", "goal_spin", "way_ahead", "turn_ahead")
TURNING = ("goal_spin", "turn_ahead")


class Numbers(NamedTuple):
    """What some numbers mean: a row of ``env.unwrapped.observation_layout``, or of ``parts_layout``.

    Attributes:
        name: of the feature.
        part: whose it is; None for slots without a part, whose numbers are always 0, and in ``parts_layout``, which is the
            same for all.
        start, width: where its numbers stand.
        unit: of a number 1, in words.
        scale: (width,) the quantity, in SI units, that a number 1 stands for; for tanh its argument's.
        range: least and largest number.
        meaning: in words.
        coding: see :class:`vibgym.envs.features.Feature`.
    """

    name: str
    part: int | None
    start: int
    width: int
    unit: str
    scale: tuple[float, ...]
    range: tuple[float, float]
    meaning: str
    coding: str


class Layout:
    """The state observation of a scene: ``slots`` blocks of the same features, part p in block p.

    Args:
        surface, parts: the scene.
        features: names of features, see :data:`TABLE`.
        slots: number of blocks.

    Attributes:
        table: these features, in the order in which they stand in a block.
        block: numbers in a block.  size: of all blocks.
        rows: every number's meaning, in order.
    """

    TABLE: ClassVar[tuple[Feature, ...]] = FEATURES
    """All features that there are, in the order in which they stand in a block."""

    def __init__(self, surface: Surface, parts: Sequence[Part], features: Sequence[str], slots: int) -> None:
        self.surface, self.parts, self.features, self.slots = surface, tuple(parts), tuple(features), slots
        self.table = tuple(each for each in self.TABLE if each.name in self.features)
        starts = np.cumsum([0, *(each.width for each in self.table)]).tolist()
        self.block = starts[-1]
        self.size = slots * self.block
        self._block = tuple(
            Numbers(
                name=each.name,
                part=None,
                start=start,
                width=each.width,
                unit=each.unit,
                scale=each.scales(surface),
                range=(0.0 if each.coding == "flag" else -1.0, 1.0),
                meaning=each.meaning,
                coding=each.coding,
            )
            for each, start in zip(self.table, starts, strict=False)
        )
        self.rows = self._rows()

    def _rows(self) -> tuple[Numbers, ...]:
        own = (slot if slot < len(self.parts) else None for slot in range(self.slots))
        return tuple(
            each._replace(part=part, start=slot * self.block + each.start)
            for slot, part in enumerate(own)
            for each in self._block
        )

    def numbers(self, observation: np.ndarray, name: str) -> np.ndarray:
        """The numbers of a feature, (..., parts, width), as they stand in observations (..., size)."""
        row = self._row(name)
        return self._blocks(observation)[..., : len(self.parts), row.start : row.start + row.width]

    def _row(self, name: str) -> Numbers:
        return next(each for each in self._block if each.name == name)

    def _blocks(self, observation: np.ndarray) -> np.ndarray:
        """The blocks of observations, (..., slots, block)."""
        return observation.reshape(*observation.shape[:-1], self.slots, self.block)

    def quantity(self, observation: np.ndarray, name: str) -> np.ndarray:
        """The quantity behind a feature, (..., parts, width) in SI units: the coding undone.

        Args:
            observation: (..., size).
            name: of a linear or tanh feature, of ``"position"``, or of ``"heading"`` (rad, modulo the part's symmetry).
        """
        values, row = np.asarray(self.numbers(observation, name), dtype=np.float64), self._row(name)
        if name == "heading":
            symmetry = np.array([part.symmetry for part in self.parts])
            angle = np.arctan2(values[..., 1], values[..., 0]) / np.maximum(symmetry, 1)
            return np.where(symmetry > 0, angle, 0.0)[..., None]
        if row.coding == "place":
            values = values + 1.0
        elif row.coding == "tanh":
            values = np.arctanh(np.clip(values, -1.0 + 1e-7, 1.0 - 1e-7))
        return values * np.array(row.scale)

    def __contains__(self, name: object) -> bool:
        return name in self.features


class RowLayout(Layout):
    """The observation by parts of a scene: a row of the same features for each part, (slots, block).

    ``numbers`` and ``quantity`` take observations (..., slots, block). ``rows`` are those of one part.
    """

    TABLE = ROW

    @classmethod
    def of(cls, task: Task) -> RowLayout:
        """The layout of a task's parts, once its features are known."""
        return cls(task.surface, task.parts, row_features(task), task.slots)

    def _rows(self) -> tuple[Numbers, ...]:
        return self._block

    def _blocks(self, observation: np.ndarray) -> np.ndarray:
        return np.asarray(observation)


def row_features(task: Task) -> tuple[str, ...]:
    """Names of the features that a row of a task's parts has."""
    without = {name for name in OPTIONAL if name not in task.features}
    if not task.has_heading:
        without.update(TURNS)
    if task.zones is None:
        without.add("zone")
    if not task.goal_moves:
        without.update(MOTIONS)
    elif not task.has_heading:
        without.update(TURNING)
    if task.driven.all():
        without.update(f"neighbour_{k}_{name}" for k in range(1, NEIGHBOURS + 1) for name in PUSHED)
    if task.MOST_PARTS == 1:
        without.update(each.name for each in ROW[-NEIGHBOURS * len(NEIGHBOUR) :])
    return tuple(each.name for each in ROW if each.name not in without)
