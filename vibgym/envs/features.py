"""Features of observations: one table of quantities, scales and codings, and layouts that locate and decode them.

The kernels of :mod:`vibgym.envs.observations`, the layouts and the documentation use the same table. The form ``"state"`` is
flat, with a block of numbers per part. The form ``"parts"`` has a row per part, relative to that part, in units that do not
depend on the size of the surface (except ``position``), so that policies transfer between surfaces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np

from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.plant import MIN_SPEED
from vibgym.tasks import Task
from vibgym.tasks.base import MAX_KINDS
from vibgym.tasks.episode import PREVIEW

FAR, COARSE, FINE, FINEST = 0.250, 0.050, 0.005, 0.0005  # m
TURN, COARSE_TURN, FINE_TURN, FINEST_TURN = 2.0 * math.pi, 0.5, 0.05, 0.005  # rad
SPIN, ROW_SPIN = 10.0, 25.0  # rad/s, in the state observation and in rows; 25 exceeds the spin of the blocks
AGE_SCALE = 10.0  # periods
SIGMA_SCALES = (0.001, math.pi / 180.0)  # m, rad
NEIGHBOURS = 5
"""Number of nearest other parts in a row."""

CODINGS = ("linear", "tanh", "place", "cell", "direction", "flag")
"""Codings of quantities, see :class:`Feature`."""


def scales_of(surface: Surface) -> dict[str, float | tuple[float, ...]]:
    """Return named scales that depend on the surface, m and m/s."""
    speed = max(surface.table_speed, MIN_SPEED)
    return {
        "table speed": speed,
        "twice the table speed": 2.0 * speed,
        "longer side": max(surface.width, surface.depth),
        "half the sides": (0.5 * surface.width, 0.5 * surface.depth),
        "half an element": 0.5 * surface.element_size,
        "diagonal of an element": math.sqrt(2.0) * surface.element_size,
    }


class Feature(NamedTuple):
    """A row of the table.

    Attributes:
        name: of the feature.
        quantity: of the part, see :mod:`vibgym.envs.observations`.
        width: number of values.
        meaning: in words.
        unit: of a value of 1, in words.
        scale: quantity in SI units at a value of 1 (for tanh, of its argument): one, one per value, or a name in
            :func:`scales_of`.
        coding: ``"linear"`` (quantity / scale, clipped), ``"tanh"`` (of quantity / scale), ``"place"`` (-1 to 1 over the
            surface), ``"cell"`` (-1 to 1 over an element), ``"direction"`` or ``"flag"`` (unchanged).
        forms: observations with this feature, ``"state"``, ``"parts"`` or both.
    """

    name: str
    quantity: str
    width: int
    meaning: str
    unit: str
    scale: float | tuple[float, ...] | str
    coding: str
    forms: tuple[str, ...] = ("state", "parts")

    def scales(self, surface: Surface) -> tuple[float, ...]:
        """Return the scales (width,)."""
        scale = scales_of(surface)[self.scale] if isinstance(self.scale, str) else self.scale
        return scale if isinstance(scale, tuple) else (scale,) * self.width


STATE, PARTS = ("state",), ("parts",)
SPEED_UNIT = "table speed a_h w (at least 1 mm/s)"
PLACE = ("centre on the surface, x and y; -1 and 1 are the borders", "half the width, half the depth", "half the sides",
         "place")  # fmt: skip
AHEAD = "goal 1, 2, 3 and 4 periods ahead minus present"

TABLE = (
    Feature("present", "present", 1, "1: the part is present; otherwise all its other values are 0",
            "1", 1.0, "flag", STATE),
    Feature("kind", "kind", MAX_KINDS, "1 for its kind: the first, second or third of the list of parts", "1", 1.0, "flag"),
    Feature("friction", "friction", 1, "nominal coefficient of sliding friction",
            "1", 1.0, "linear", PARTS),
    Feature("radius", "radius", 1, "of the smallest circle about the centre that contains the part",
            "0.1 m", 0.1, "linear", PARTS),
    Feature("gyration", "gyration", 1, "radius of gyration", "0.1 m", 0.1, "linear", PARTS),
    Feature("extent", "extent", 1, "square root of the area", "0.2 m", 0.2, "linear", PARTS),
    Feature("position", "position", 2, *PLACE, PARTS),
    Feature("element", "position", 2, "centre within its element, x and y; -1 and 1 are the element's edges",
            "half an element", "half an element", "cell"),
    Feature("heading", "heading", 2, "cos and sin of (symmetry x heading); 1, 0 for a disc", "1", 1.0, "direction"),
    Feature("position", "position", 2, *PLACE, STATE),
    Feature("way", "way", 2, "goal (or nearest point of its zone) minus centre, x and y; 0 without",
            "longer side of the surface", "longer side", "linear", STATE),
    Feature("way_far", "way", 2, "tanh of (goal, or nearest point of its zone, minus centre) in 250 mm, x and y; 0 without",
            "1", FAR, "tanh", PARTS),
    Feature("way_coarse", "way", 2, "tanh of the same in 50 mm", "1", COARSE, "tanh"),
    Feature("way_fine", "way", 2, "tanh of the same in 5 mm", "1", FINE, "tanh"),
    Feature("way_finest", "way", 2, "tanh of the same in 0.5 mm", "1", FINEST, "tanh", PARTS),
    Feature("turn", "turn", 1, "goal minus heading, 0 where it does not count", "full turn", TURN, "linear"),
    Feature("turn_coarse", "turn", 1, "tanh of the same in 0.5 rad", "1", COARSE_TURN, "tanh"),
    Feature("turn_fine", "turn", 1, "tanh of the same in 0.05 rad", "1", FINE_TURN, "tanh"),
    Feature("turn_finest", "turn", 1, "tanh of the same in 0.005 rad", "1", FINEST_TURN, "tanh", PARTS),
    Feature("velocity", "velocity", 2, "mean velocity over the last period, x and y", SPEED_UNIT, "table speed", "linear"),
    Feature("spin", "spin", 1, "mean angular velocity over the last period", "10 rad/s", SPIN, "linear", STATE),
    Feature("spin", "spin", 1, "mean angular velocity over the last period", "25 rad/s", ROW_SPIN, "linear", PARTS),
    Feature("borders", "borders", 4, "tanh of the centre's distance to the left, right, bottom, top border in 50 mm",
            "1", COARSE, "tanh", PARTS),
    Feature("zone", "zone", 4, "tanh of the same to the borders of its zone, in the same order; positive on the side where the "
            "zone is", "1", COARSE, "tanh", PARTS),
    Feature("gap", "gap", 1, "tanh of (distance to the nearest other part / (sqrt(2) x element size)); 1 without others",
            "1", "diagonal of an element", "tanh", STATE),
    Feature("neighbour", "neighbour", 2, "unit vector from its centre to that part's, x and y; 0, 0 without others",
            "1", 1.0, "direction", STATE),
    Feature("goal_velocity", "goal_velocity", 2, "velocity of the goal, x and y", SPEED_UNIT, "table speed", "linear"),
    Feature("goal_spin", "goal_spin", 1, "angular velocity of the goal", "10 rad/s", SPIN, "linear", STATE),
    Feature("goal_spin", "goal_spin", 1, "angular velocity of the goal", "25 rad/s", ROW_SPIN, "linear", PARTS),
    Feature("way_ahead", "way_ahead", 2 * PREVIEW, f"{AHEAD} centre, x and y of each",
            "longer side of the surface", "longer side", "linear", STATE),
    Feature("way_ahead", "way_ahead", 2 * PREVIEW, f"{AHEAD} centre, x and y of each", "250 mm", FAR, "linear", PARTS),
    Feature("turn_ahead", "turn_ahead", PREVIEW, f"{AHEAD} heading, on from that of turn", "full turn", TURN, "linear"),
    Feature("arrived", "arrived", 1, "1: it has arrived in this step, where parts come and go", "1", 1.0, "flag"),
    Feature("age", "age", 1, "tanh of (periods since the instant of its last reading / 10 periods)", "1", AGE_SCALE, "tanh"),
    Feature("sigma", "sigma", 2, "tanh of the standard deviation of the measured pose: position in 1 mm, heading "
            "in 1 deg", "1", SIGMA_SCALES, "tanh"),
    Feature("contact_normal", "normal", 2, "unit vector from its outline to the nearest other part's, x and y: the normal "
            "where they touch; 0, 0 without others", "1", 1.0, "direction"),
    Feature("contact_impulse", "pushed", 2, "tanh of (impulse of its contacts with parts and walls over the last period / "
            "(its mass x table speed)), x and y", "1", "table speed", "tanh"),
)  # fmt: skip
"""All features of a single part, in the order of a block or row."""

FEATURES = tuple(feature for feature in TABLE if "state" in feature.forms)
"""Features of a block of the state observation."""

OWN = tuple(feature for feature in TABLE if "parts" in feature.forms)
"""Features of a row about the part itself."""

NEIGHBOUR = (
    Feature("there", "there", 1, "1: there is such a part; otherwise all its other values are 0", "1", 1.0, "flag"),
    Feature("apart", "apart", 2, "tanh of (its centre minus own) in 50 mm, x and y", "1", COARSE, "tanh"),
    Feature("apart_far", "apart", 2, "tanh of the same in 250 mm", "1", FAR, "tanh"),
    Feature("gap", "gap", 1, "tanh of (distance between the outlines / (sqrt(2) x element size))",
            "1", "diagonal of an element", "tanh"),
    Feature("velocity", "velocity", 2, "its mean velocity minus own, x and y", f"twice the {SPEED_UNIT}",
            "twice the table speed", "linear"),
    Feature("heading", "heading", 2, "cos and sin of (its symmetry x its heading)", "1", 1.0, "direction"),
    Feature("same_kind", "same_kind", 1, "1: it is of the same kind", "1", 1.0, "flag"),
    Feature("way_far", "way_far", 2, "tanh of its displacement to its goal in 250 mm, x and y", "1", FAR, "tanh"),
    Feature("turn", "turn", 1, "tanh of its goal minus heading in 0.5 rad", "1", COARSE_TURN, "tanh"),
    Feature("way", "way", 2, "tanh of its displacement to its goal or zone in 50 mm, x and y", "1", COARSE, "tanh"),
)  # fmt: skip
"""Features of a neighbour; their names in a row are ``"neighbour_1_there"``, ..., the nearest first."""

PUSHED = ("way_far", "turn")
"""Features of neighbours in tasks with undriven parts."""

ROW = (
    *OWN,
    *(row._replace(name=f"neighbour_{k}_{row.name}") for k in range(1, NEIGHBOURS + 1) for row in NEIGHBOUR),
)
"""All features of a row, in order."""

OPTIONAL = ("kind", "arrived", "age", "sigma", "contact_normal", "contact_impulse")
"""Features of a row only if the state observation has them."""

TURNS = ("turn", "turn_coarse", "turn_fine", "turn_finest")
MOTIONS = ("goal_velocity", "goal_spin", "way_ahead", "turn_ahead")
TURNING = ("goal_spin", "turn_ahead")


class LayoutEntry(NamedTuple):
    """A feature in an observation: an entry of ``env.unwrapped.observation_layout``, or of ``parts_layout``.

    Attributes:
        name: of the feature.
        part: index of the part; None for empty slots, whose values are 0, and in ``parts_layout``.
        start, width: first value and number of values.
        unit: of a value of 1, in words.
        scale: (width,) quantity in SI units at a value of 1; for tanh, of its argument.
        range: least and largest value.
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
        features: names, see :data:`TABLE`.
        slots: number of blocks.

    Attributes:
        table: these features, in order.
        block: values of a block.  size: of all blocks.
        rows: features of all blocks, in order.
    """

    TABLE: ClassVar[tuple[Feature, ...]] = FEATURES
    """All features, in the order of a block."""

    def __init__(self, surface: Surface, parts: Sequence[Part], features: Sequence[str], slots: int) -> None:
        self.surface, self.parts, self.features, self.slots = surface, tuple(parts), tuple(features), slots
        self.table = tuple(feature for feature in self.TABLE if feature.name in self.features)
        starts = np.cumsum([0, *(feature.width for feature in self.table)]).tolist()
        self.block = starts[-1]
        self.size = slots * self.block
        self._block = tuple(
            LayoutEntry(
                name=feature.name,
                part=None,
                start=start,
                width=feature.width,
                unit=feature.unit,
                scale=feature.scales(surface),
                range=(0.0 if feature.coding == "flag" else -1.0, 1.0),
                meaning=feature.meaning,
                coding=feature.coding,
            )
            for feature, start in zip(self.table, starts, strict=False)
        )
        self.rows = self._rows()

    def _rows(self) -> tuple[LayoutEntry, ...]:
        own = (slot if slot < len(self.parts) else None for slot in range(self.slots))
        return tuple(
            feature._replace(part=part, start=slot * self.block + feature.start)
            for slot, part in enumerate(own)
            for feature in self._block
        )

    def numbers(self, observation: np.ndarray, name: str) -> np.ndarray:
        """Return the values of a feature, (..., parts, width), in observations (..., size)."""
        row = self._row(name)
        return self._blocks(observation)[..., : len(self.parts), row.start : row.start + row.width]

    def _row(self, name: str) -> LayoutEntry:
        return next(feature for feature in self._block if feature.name == name)

    def _blocks(self, observation: np.ndarray) -> np.ndarray:
        """Return the blocks of observations, (..., slots, block)."""
        return observation.reshape(*observation.shape[:-1], self.slots, self.block)

    def quantity(self, observation: np.ndarray, name: str) -> np.ndarray:
        """Decode a feature to quantities (..., parts, width) in SI units.

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
    """The observation by parts of a scene: a row of the same features per part, (slots, block).

    ``numbers`` and ``quantity`` take observations (..., slots, block). ``rows`` are those of one part.
    """

    TABLE = ROW

    @classmethod
    def of(cls, task: Task) -> RowLayout:
        """Return the layout of a task's parts."""
        return cls(task.surface, task.parts, row_features(task), task.slots)

    def _rows(self) -> tuple[LayoutEntry, ...]:
        return self._block

    def _blocks(self, observation: np.ndarray) -> np.ndarray:
        return np.asarray(observation)


def row_features(task: Task) -> tuple[str, ...]:
    """Return the names of the features of a task's rows."""
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
    if task.MAX_PARTS == 1:
        without.update(feature.name for feature in ROW[-NEIGHBOURS * len(NEIGHBOUR) :])
    return tuple(feature.name for feature in ROW if feature.name not in without)
