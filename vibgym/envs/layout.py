"""Tables of observations, and the one of the state observation: which number means what, in which unit, on which scale.

The kernel that writes observations, the decoder that reads them, the tables in the documentation and
``env.unwrapped.observation_layout`` all come from :data:`FEATURES`. A task says which features a part has, and every part has
a block of these. The table of the observation by parts is in :mod:`vibgym.envs.row_layout`, in the same form.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np

from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.episode import PREVIEW

COARSE, FINE = 0.050, 0.005  # m
COARSE_TURN, FINE_TURN = 0.5, 0.05  # rad
SPIN = 10.0  # rad/s
AGE_SCALE = 10.0  # periods
SIGMA_SCALE, TURN_SIGMA_SCALE = 0.001, math.pi / 180.0  # m, rad
LEAST_SPEED = 1e-3  # m/s, taken for the table's where that is slower
MOST_KINDS = 3
"""Kinds of parts that an observation tells apart."""


class Feature(NamedTuple):
    """A row of the table.

    Attributes:
        name: of the feature.
        width: how many numbers it has.
        meaning: in words.
        unit: of a number 1, in words.
        coding: how a quantity becomes a number: ``"linear"`` (over the scale, limited to the range), ``"tanh"`` (of the
            quantity over the scale), ``"place"`` (from the least to the largest place), ``"direction"`` or ``"flag"``.
    """

    name: str
    width: int
    meaning: str
    unit: str
    coding: str


FEATURES = (
    Feature("present", 1, "1: the part is there; all its other numbers are 0 where it is not", "1", "flag"),
    Feature("kind", MOST_KINDS, "1 for its kind: the first, second or third of the list of parts", "1", "flag"),
    Feature(
        "element", 2, "centre within its element, x and y; -1 and 1 are the element's edges", "half an element", "place"
    ),
    Feature("heading", 2, "cos and sin of (symmetry x heading); 1, 0 for a disc", "1", "direction"),
    Feature(
        "position",
        2,
        "centre on the surface, x and y; -1 and 1 are the borders",
        "half the width, half the depth",
        "place",
    ),
    Feature(
        "way",
        2,
        "goal (or nearest point of its zone) minus centre, x and y; 0 without",
        "longer side of the surface",
        "linear",
    ),
    Feature("way_coarse", 2, "tanh of the same in 50 mm", "1", "tanh"),
    Feature("way_fine", 2, "tanh of the same in 5 mm", "1", "tanh"),
    Feature("turn", 1, "goal minus heading, 0 where it does not count", "full turn", "linear"),
    Feature("turn_coarse", 1, "tanh of the same in 0.5 rad", "1", "tanh"),
    Feature("turn_fine", 1, "tanh of the same in 0.05 rad", "1", "tanh"),
    Feature(
        "velocity", 2, "mean velocity over the last period, x and y", "table speed a_h w (at least 1 mm/s)", "linear"
    ),
    Feature("spin", 1, "mean angular velocity over the last period", "10 rad/s", "linear"),
    Feature(
        "gap",
        1,
        "tanh of (distance to the nearest other part / (sqrt(2) x element size)); 1 without others",
        "1",
        "tanh",
    ),
    Feature(
        "neighbour", 2, "unit vector from its centre to that part's, x and y; 0, 0 without others", "1", "direction"
    ),
    Feature("goal_velocity", 2, "velocity of the goal, x and y", "table speed a_h w (at least 1 mm/s)", "linear"),
    Feature("goal_spin", 1, "angular velocity of the goal", "10 rad/s", "linear"),
    Feature(
        "way_ahead",
        2 * PREVIEW,
        "goal 1, 2, 3 and 4 periods ahead minus present centre, x and y of each",
        "longer side of the surface",
        "linear",
    ),
    Feature(
        "turn_ahead",
        PREVIEW,
        "goal 1, 2, 3 and 4 periods ahead minus present heading, on from that of turn",
        "full turn",
        "linear",
    ),
    Feature("age", 1, "tanh of (periods since the instant of its last reading / 10 periods)", "1", "tanh"),
    Feature(
        "sigma",
        2,
        "tanh of what the measurement may be off by (standard deviation): position in 1 mm, heading in 1 deg",
        "1",
        "tanh",
    ),
)
"""All features, in the order in which they stand in a part's block."""

(
    PRESENT, KIND, ELEMENT, HEADING, POSITION, WAY, WAY_COARSE, WAY_FINE,
    TURN, TURN_COARSE, TURN_FINE, VELOCITY, SPIN_RATE, GAP, NEIGHBOUR,
    GOAL_VELOCITY, GOAL_SPIN, WAY_AHEAD, TURN_AHEAD, AGE, SIGMA,
) = range(len(FEATURES))  # fmt: skip
"""Rows of :data:`FEATURES`, for the kernel."""

NAMES = tuple(feature.name for feature in FEATURES)


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
        coding: see :class:`Feature`.
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
        features: names among :data:`NAMES`, in the table's order.
        slots: number of blocks.

    Attributes:
        block: numbers in a block.  size: of all blocks.
        column: (features of the table,) where each stands in a block; -1: not there.
        scale: (features of the table, 2) see :class:`Numbers`.
        rows: every number's meaning, in order.
    """

    TABLE: ClassVar[tuple[Feature, ...]] = FEATURES
    """All features that there are, in the order in which they stand in a block."""

    def __init__(self, surface: Surface, parts: Sequence[Part], features: Sequence[str], slots: int) -> None:
        self.surface, self.parts, self.features, self.slots = surface, tuple(parts), tuple(features), slots
        self.names = tuple(feature.name for feature in self.TABLE)
        self.scale = self.scales(surface)
        self.column = np.full(len(self.TABLE), -1, dtype=np.int64)
        self.block = 0
        for index, feature in enumerate(self.TABLE):
            if feature.name in self.features:
                self.column[index] = self.block
                self.block += feature.width
        self.size = slots * self.block
        self.rows = self._rows()

    @staticmethod
    def scales(surface: Surface) -> np.ndarray:
        """Scale of every feature, (features of the table, 2), SI units; see :class:`Numbers`."""
        return scales(surface)

    def _rows(self) -> tuple[Numbers, ...]:
        own = (slot if slot < len(self.parts) else None for slot in range(self.slots))
        return tuple(row for slot, part in enumerate(own) for row in self._block_rows(slot * self.block, part))

    def _block_rows(self, start: int, part: int | None) -> list[Numbers]:
        """The rows of a block that starts at this number."""
        rows = []
        for index, feature in enumerate(self.TABLE):
            if self.column[index] < 0:
                continue
            scale = tuple(np.resize(self.scale[index], feature.width).tolist())
            least = 0.0 if feature.coding == "flag" else -1.0
            rows.append(
                Numbers(
                    feature.name,
                    part,
                    start + int(self.column[index]),
                    feature.width,
                    feature.unit,
                    scale,
                    (least, 1.0),
                    feature.meaning,
                    feature.coding,
                )
            )
        return rows

    def numbers(self, observation: np.ndarray, name: str) -> np.ndarray:
        """The numbers of a feature, (..., parts, width), as they stand in observations (..., size)."""
        index = self.names.index(name)
        start = int(self.column[index])
        return self._blocks(observation)[..., : len(self.parts), start : start + self.TABLE[index].width]

    def _blocks(self, observation: np.ndarray) -> np.ndarray:
        """The blocks of observations, (..., slots, block)."""
        return observation.reshape(*observation.shape[:-1], self.slots, self.block)

    def quantity(self, observation: np.ndarray, name: str) -> np.ndarray:
        """The quantity behind a feature, (..., parts, width) in SI units: the coding undone.

        Args:
            observation: (..., size).
            name: of a linear or tanh feature, of ``"position"``, or of ``"heading"`` (rad, modulo the part's symmetry).
        """
        values = np.asarray(self.numbers(observation, name), dtype=np.float64)
        index = self.names.index(name)
        scale = np.resize(self.scale[index], self.TABLE[index].width)
        if name == "position":
            return (values + 1.0) * scale
        if name == "heading":
            symmetry = np.array([part.symmetry for part in self.parts])
            angle = np.arctan2(values[..., 1], values[..., 0]) / np.maximum(symmetry, 1)
            return np.where(symmetry > 0, angle, 0.0)[..., None]
        if self.TABLE[index].coding == "tanh":
            return np.arctanh(np.clip(values, -1.0 + 1e-7, 1.0 - 1e-7)) * scale
        return values * scale

    def __contains__(self, name: object) -> bool:
        return name in self.features


def scales(surface: Surface) -> np.ndarray:
    """Scale of every feature, (features of the table, 2), SI units; see :class:`Numbers`."""
    longer, half = max(surface.width, surface.depth), 0.5 * surface.element_size
    speed = max(surface.table_speed, LEAST_SPEED)
    by_name = {
        "element": (half, half),
        "position": (0.5 * surface.width, 0.5 * surface.depth),
        "way": (longer, longer),
        "way_coarse": (COARSE, COARSE),
        "way_fine": (FINE, FINE),
        "turn": (2.0 * math.pi,) * 2,
        "turn_coarse": (COARSE_TURN,) * 2,
        "turn_fine": (FINE_TURN,) * 2,
        "velocity": (speed, speed),
        "spin": (SPIN, SPIN),
        "goal_velocity": (speed, speed),
        "goal_spin": (SPIN, SPIN),
        "way_ahead": (longer, longer),
        "turn_ahead": (2.0 * math.pi,) * 2,
        "age": (AGE_SCALE,) * 2,
        "sigma": (SIGMA_SCALE, TURN_SIGMA_SCALE),
        "gap": (math.sqrt(2.0) * surface.element_size,) * 2,
    }
    return np.array([by_name.get(name, (1.0, 1.0)) for name in NAMES])


def table(features: Sequence[str]) -> str:
    """The table of a block with these features, in Markdown, for documentation."""
    lines, start = ["| index | feature | meaning | unit of 1 |", "|---|---|---|---|"], 0
    for feature in FEATURES:
        if feature.name in features:
            index = ", ".join(str(start + k) for k in range(feature.width))
            lines.append(f"| {index} | {feature.name} | {feature.meaning} | {feature.unit} |")
            start += feature.width
    return "\n".join(lines)
