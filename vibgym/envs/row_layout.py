"""The table of the observation by parts: what the numbers of a part's row mean, seen from that part.

Units do not depend on the size of the surface, so that a policy for one goes on another: what is far away is a tanh of its
distance. Only the place on the surface does. See :mod:`vibgym.envs.layout` for the form.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vibgym.envs.layout import (
    AGE_SCALE,
    COARSE,
    COARSE_TURN,
    FINE,
    FINE_TURN,
    LEAST_SPEED,
    MOST_KINDS,
    SIGMA_SCALE,
    TURN_SIGMA_SCALE,
    Feature,
    Layout,
    Numbers,
)  # fmt: skip
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks import Task
from vibgym.tasks.episode import PREVIEW

FAR, FINEST = 0.250, 0.0005  # m
FINEST_TURN = 0.005  # rad
SPIN = 25.0  # rad/s, a little more than a block reaches
TRAITS = (1.0, 0.1, 0.1, 0.2)  # 1, m, m, m
NEIGHBOURS = 5
"""The nearest other parts of which a row tells."""

SPEED = "table speed a_h w (at least 1 mm/s)"

OWN = (
    Feature("kind", MOST_KINDS, "1 for its kind: the first, second or third of the list of parts", "1", "flag"),
    Feature("friction", 1, "coefficient of sliding friction, as the part has it by itself", "1", "linear"),
    Feature("radius", 1, "of the smallest circle about the centre that holds the part", "0.1 m", "linear"),
    Feature("gyration", 1, "radius of gyration", "0.1 m", "linear"),
    Feature("extent", 1, "square root of the area", "0.2 m", "linear"),
    Feature(
        "position",
        2,
        "centre on the surface, x and y; -1 and 1 are the borders",
        "half the width, half the depth",
        "place",
    ),
    Feature(
        "element", 2, "centre within its element, x and y; -1 and 1 are the element's edges", "half an element", "place"
    ),
    Feature("heading", 2, "cos and sin of (symmetry x heading); 1, 0 for a disc", "1", "direction"),
    Feature(
        "way_far",
        2,
        "tanh of (goal, or nearest point of its zone, minus centre) in 250 mm, x and y; 0 without",
        "1",
        "tanh",
    ),
    Feature("way_coarse", 2, "tanh of the same in 50 mm", "1", "tanh"),
    Feature("way_fine", 2, "tanh of the same in 5 mm", "1", "tanh"),
    Feature("way_finest", 2, "tanh of the same in 0.5 mm", "1", "tanh"),
    Feature("turn", 1, "goal minus heading", "full turn", "linear"),
    Feature("turn_coarse", 1, "tanh of the same in 0.5 rad", "1", "tanh"),
    Feature("turn_fine", 1, "tanh of the same in 0.05 rad", "1", "tanh"),
    Feature("turn_finest", 1, "tanh of the same in 0.005 rad", "1", "tanh"),
    Feature("velocity", 2, "mean velocity over the last period, x and y", SPEED, "linear"),
    Feature("spin", 1, "mean angular velocity over the last period", "25 rad/s", "linear"),
    Feature("borders", 4, "tanh of the centre's distance to the left, right, bottom, top border in 50 mm", "1", "tanh"),
    Feature(
        "zone",
        4,
        "tanh of the same to the borders of its zone, in the same order; positive on the side where the zone is",
        "1",
        "tanh",
    ),
    Feature("goal_velocity", 2, "velocity of the goal, x and y", SPEED, "linear"),
    Feature("goal_spin", 1, "angular velocity of the goal", "25 rad/s", "linear"),
    Feature(
        "way_ahead",
        2 * PREVIEW,
        "goal 1, 2, 3 and 4 periods ahead minus present centre, x and y of each",
        "250 mm",
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
"""Features of the part itself."""

NEIGHBOUR = (
    Feature("there", 1, "1: there is such a part; all its other numbers are 0 where there is none", "1", "flag"),
    Feature("apart", 2, "tanh of (its centre minus own) in 50 mm, x and y", "1", "tanh"),
    Feature("apart_far", 2, "tanh of the same in 250 mm", "1", "tanh"),
    Feature("gap", 1, "tanh of (distance between the outlines / (sqrt(2) x element size))", "1", "tanh"),
    Feature("velocity", 2, "its mean velocity minus own, x and y", f"twice the {SPEED}", "linear"),
    Feature("heading", 2, "cos and sin of (its symmetry x its heading)", "1", "direction"),
    Feature("same_kind", 1, "1: it is of the same kind", "1", "flag"),
    Feature("way", 2, "tanh of its own way to its goal or zone in 50 mm, x and y", "1", "tanh"),
)
"""Features of a neighbour, each of which stands in a row as ``"neighbour_1_there"``, ..., the nearest first."""

ROW = (
    *OWN,
    *(each._replace(name=f"neighbour_{k}_{each.name}") for k in range(1, NEIGHBOURS + 1) for each in NEIGHBOUR),
)
"""All features, in the order in which they stand in a row."""

NEIGHBOUR_WIDTH = sum(each.width for each in NEIGHBOUR)

(
    KIND, FRICTION, RADIUS, GYRATION, EXTENT, POSITION, ELEMENT, HEADING, WAY_FAR, WAY_COARSE, WAY_FINE, WAY_FINEST,
    TURN, TURN_COARSE, TURN_FINE, TURN_FINEST, VELOCITY, SPIN_RATE, BORDERS, ZONE,
    GOAL_VELOCITY, GOAL_SPIN, WAY_AHEAD, TURN_AHEAD, AGE, SIGMA, FIRST_NEIGHBOUR,
) = range(len(OWN) + 1)  # fmt: skip
"""Rows of the table, for the kernel."""

NAMES = tuple(feature.name for feature in ROW)
OPTIONAL = ("kind", "age", "sigma")
"""In a row where they are in a block of the state observation."""

TURNS = ("turn", "turn_coarse", "turn_fine", "turn_finest")
MOTIONS = ("goal_velocity", "goal_spin", "way_ahead", "turn_ahead")


class RowLayout(Layout):
    """The observation by parts of a scene: a row of the same features for each part, (slots, block).

    ``numbers`` and ``quantity`` take observations (..., slots, block). ``rows`` are those of one part.
    """

    TABLE = ROW

    @classmethod
    def of(cls, task: Task) -> RowLayout:
        """The layout of a task's parts, once its features are known."""
        return cls(task.surface, task.parts, row_features(task), task.slots)

    @staticmethod
    def scales(surface: Surface) -> np.ndarray:
        return row_scales(surface)

    def _rows(self) -> tuple[Numbers, ...]:
        return tuple(self._block_rows(0, None))

    def _blocks(self, observation: np.ndarray) -> np.ndarray:
        return np.asarray(observation)


def row_features(task: Task) -> tuple[str, ...]:
    """Names of the features that a part of a task has."""
    without = {name for name in OPTIONAL if name not in task.features}
    if not task.has_heading:
        without.update(TURNS)
    if task.zones is None:
        without.add("zone")
    if not task.goal_moves:
        without.update(MOTIONS)
    elif not task.has_heading:
        without.update(("goal_spin", "turn_ahead"))
    if task.MOST_PARTS == 1:
        without.update(NAMES[FIRST_NEIGHBOUR:])
    return tuple(name for name in NAMES if name not in without)


def row_scales(surface: Surface) -> np.ndarray:
    """Scale of every feature, (features of the table, 2), SI units; see :class:`vibgym.envs.layout.Numbers`."""
    half, speed, turn = 0.5 * surface.element_size, max(surface.table_speed, LEAST_SPEED), 2.0 * math.pi
    gap = math.sqrt(2.0) * surface.element_size
    own = {
        **dict(zip(("friction", "radius", "gyration", "extent"), zip(TRAITS, TRAITS, strict=True), strict=True)),
        "position": (0.5 * surface.width, 0.5 * surface.depth),
        "element": (half, half),
        "way_far": (FAR, FAR),
        "way_coarse": (COARSE, COARSE),
        "way_fine": (FINE, FINE),
        "way_finest": (FINEST, FINEST),
        "turn": (turn, turn),
        "turn_coarse": (COARSE_TURN, COARSE_TURN),
        "turn_fine": (FINE_TURN, FINE_TURN),
        "turn_finest": (FINEST_TURN, FINEST_TURN),
        "velocity": (speed, speed),
        "spin": (SPIN, SPIN),
        "borders": (COARSE, COARSE),
        "zone": (COARSE, COARSE),
        "goal_velocity": (speed, speed),
        "goal_spin": (SPIN, SPIN),
        "way_ahead": (FAR, FAR),
        "turn_ahead": (turn, turn),
        "age": (AGE_SCALE, AGE_SCALE),
        "sigma": (SIGMA_SCALE, TURN_SIGMA_SCALE),
    }
    other = {
        "apart": (COARSE, COARSE),
        "apart_far": (FAR, FAR),
        "gap": (gap, gap),
        "velocity": (2.0 * speed, 2.0 * speed),
        "way": (COARSE, COARSE),
    }
    rows = [own.get(each.name, (1.0, 1.0)) for each in OWN]
    rows += [other.get(each.name, (1.0, 1.0)) for each in NEIGHBOUR] * NEIGHBOURS
    return np.array(rows)


def traits_of(parts: Sequence[Part]) -> np.ndarray:
    """(parts, 4) what a row says of friction, radius, radius of gyration and extent, at most 1."""
    values = [(part.friction, part.radius, math.sqrt(part.gyration), math.sqrt(part.area)) for part in parts]
    return np.minimum(np.array(values) / np.array(TRAITS), 1.0)


def table(features: Sequence[Feature]) -> str:
    """The table of these features, in Markdown, for documentation; how many numbers each has, since places vary."""
    lines = ["| numbers | feature | meaning | unit of 1 |", "|---|---|---|---|"]
    lines += [f"| {each.width} | {each.name} | {each.meaning} | {each.unit} |" for each in features]
    return "\n".join(lines)
