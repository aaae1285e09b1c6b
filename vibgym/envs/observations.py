"""Observations of a measurement: flat, by parts, as a goal dictionary or as an image.

Kernels compute a list of quantities of each part in SI units; a :class:`Program`, made from a layout, encodes them value by
value. A new feature of a known quantity is a line of the table in :mod:`vibgym.envs.features`; a new quantity also needs a
kernel here.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym.envs.features import CODINGS, NEIGHBOUR, NEIGHBOURS, TABLE, Feature, Layout, RowLayout
from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout as MemoryLayout
from vibgym.kernels.reference import Pinned, bound
from vibgym.physics.contacts.hulls import Hulls, load_hulls, part_contact, part_gap, place_hulls
from vibgym.registry import Registry
from vibgym.rendering.raster import Marks, rasterise
from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing import Measurement, Sensor
from vibgym.settings import BaseSettings
from vibgym.tasks import PoseTask, Task
from vibgym.tasks.episode import PREVIEW, Episode, Relations

PIXELS = 6  # per side of an element
KIND_VALUES = (255, 170, 85)
"""Brightness of the first, second and third kind in an image."""

Writer = Callable[[np.ndarray, np.ndarray], None]


class Observation(ABC):
    """Base class of observations: the space of one world, and a batch from a measurement.

    A custom observation is a subclass, registered by ``vibgym.envs.OBSERVATIONS.register``.

    Args:
        task: with its surface and parts.

    Attributes:
        layout: of the state observation.

    Raises:
        ValueError: a task that does not support the observation.
    """

    goal_reward: bool = False
    """Whether the reward is that of a goal observation (GoalEnv)."""

    extra: bool = True
    """Whether it can be computed in addition to another observation; not if the sensor must record data for it."""

    class Settings(BaseSettings):
        """Settings of an observation."""

    settings: Settings

    def __init__(self, task: Task, settings: Settings | None = None) -> None:
        self.settings = type(self).Settings() if settings is None else settings
        self.task = task
        self.layout = Layout(task.surface, task.parts, task.features, task.slots)

    def watch(self, sensor: Sensor) -> None:  # noqa: B027 - optional
        """Configure the observation for a sensor; called once, first.

        Raises:
            ValueError: a sensor that does not support the observation.
        """

    @property
    @abstractmethod
    def space(self) -> spaces.Space:
        """Space of one world."""

    @abstractmethod
    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        """Return a new batch of observations, arrays (worlds, ...); views of the arguments are refused.

        Args:
            measurement: of the parts.
            relations: errors and gaps by the measured poses.
            episode: goals, and which parts are present.
        """


class RowObservation(Observation):
    """Base class of observations that kernels write block by block, on the thread that has advanced the worlds."""

    @abstractmethod
    def fresh(self, worlds: int) -> tuple[list[np.ndarray], Any]:
        """Return an uninitialised batch: the arrays that writers fill, and the batch made of them."""

    @abstractmethod
    def writers(self, measurement: Measurement, relations: Relations, episode: Episode) -> list[Writer]:
        """Return a function ``write(worlds, array)`` per array of a batch; ``worlds`` is an index array.

        Each call returns writers with separate scratch memory, for use on several threads. The arguments are those of
        :meth:`observe`; their arrays are live.
        """

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        worlds = len(measurement.pose)
        arrays, batch = self.fresh(worlds)
        for write, array in zip(self.writers(measurement, relations, episode), arrays, strict=True):
            write(np.arange(worlds), array)
        return batch


class StateObservation(RowObservation):
    """One flat float32 box in [-1, 1]: a block of numbers for each slot, part p in slot p; see the layout."""

    @property
    def space(self) -> spaces.Space:
        return spaces.Box(-1.0, 1.0, (self.layout.size,), np.float32)

    def fresh(self, worlds: int) -> tuple[list[np.ndarray], Any]:
        rows = np.empty((worlds, self.layout.slots, self.layout.block), dtype=np.float32)
        return [rows], rows.reshape(worlds, -1)

    def writers(self, measurement: Measurement, relations: Relations, episode: Episode) -> list[Writer]:
        return [row_writer(self.task, self.layout, measurement, relations, episode)]


class PartsObservation(RowObservation):
    """Dictionary of ``parts``, a row of numbers in [-1, 1] per slot, and ``mask``, 1 where a part is present.

    Part p has row p; rows of absent parts and empty slots are 0.

    Attributes:
        row_layout: features of a row.
    """

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self.row_layout = RowLayout.of(task)

    @property
    def space(self) -> spaces.Space:
        slots, size = self.task.slots, self.row_layout.block
        return spaces.Dict(
            {"parts": spaces.Box(-1.0, 1.0, (slots, size), np.float32), "mask": spaces.MultiBinary(slots)}
        )

    def fresh(self, worlds: int) -> tuple[list[np.ndarray], Any]:
        rows = np.empty((worlds, self.task.slots, self.row_layout.block), dtype=np.float32)
        mask = np.empty((worlds, self.task.slots), dtype=np.int8)
        return [rows, mask], {"parts": rows, "mask": mask}

    def writers(self, measurement: Measurement, relations: Relations, episode: Episode) -> list[Writer]:
        rows = row_writer(self.task, self.row_layout, measurement, relations, episode)
        return [rows, bound(write_mask, episode.present)]


class PartsAndState(RowObservation):
    """The dictionary of ``"parts"`` with a further key ``state``, for residual policies on a classical controller."""

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self._parts, self._state = PartsObservation(task), StateObservation(task)

    @property
    def space(self) -> spaces.Space:
        return spaces.Dict({**self._parts.space.spaces, "state": self._state.space})  # type: ignore[attr-defined]

    def fresh(self, worlds: int) -> tuple[list[np.ndarray], Any]:
        (arrays, parts), (more, state) = self._parts.fresh(worlds), self._state.fresh(worlds)
        return [*arrays, *more], {**parts, "state": state}

    def writers(self, measurement: Measurement, relations: Relations, episode: Episode) -> list[Writer]:
        return [writer for of in (self._parts, self._state) for writer in of.writers(measurement, relations, episode)]


class GoalObservation(StateObservation):
    """GoalEnv dictionary: ``observation`` (the flat state), ``achieved_goal`` and ``desired_goal`` in m and rad."""

    goal_reward = True
    TURN_LIMIT = 8.0 * math.pi

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        if not isinstance(task, PoseTask):
            have = ", ".join(repr(name) for name, cls in OBSERVATIONS.items() if cls.extra and not cls.goal_reward)
            raise checks.conflict(
                f"observation 'goal' requires a task with one part and a fixed goal pose; others: {have}"
            )
        n, surface = task.goal_size(), task.surface
        self.low = np.array([-0.1, -0.1, -self.TURN_LIMIT], dtype=np.float32)[:n]
        self.high = np.array([surface.width + 0.1, surface.depth + 0.1, self.TURN_LIMIT], dtype=np.float32)[:n]

    @property
    def space(self) -> spaces.Space:
        goals = (spaces.Box(self.low, self.high, dtype=np.float32) for _ in range(2))
        return spaces.Dict({"observation": super().space, "achieved_goal": next(goals), "desired_goal": next(goals)})

    def reached(self, pose: np.ndarray) -> np.ndarray:
        """Return goals (worlds, goal_size) of poses (worlds, parts, 3)."""
        goals = np.empty((len(pose), len(self.low)), dtype=np.float32)
        write_goals(self.low, self.high, pose, np.arange(len(pose)), goals)
        return goals

    def fresh(self, worlds: int) -> tuple[list[np.ndarray], Any]:
        arrays, state = super().fresh(worlds)
        achieved, desired = (np.empty((worlds, len(self.low)), dtype=np.float32) for _ in range(2))
        batch = {"observation": state, "achieved_goal": achieved, "desired_goal": desired}
        return [*arrays, achieved, desired], batch

    def writers(self, measurement: Measurement, relations: Relations, episode: Episode) -> list[Writer]:
        goals = (bound(write_goals, self.low, self.high, pose) for pose in (measurement.pose, episode.goal))
        return [*super().writers(measurement, relations, episode), *goals]


class ImageObservation(Observation):
    """uint8 image (rows x 6, columns x 6, 3), row 0 at the largest y.

    Channel 0: the parts, 255 for the first kind, 170 for the second and 85 for the third. Channel 1: the zones, with the
    values of their kinds, or the parts' outlines at their goal poses; their value is that of the kind, or for unwrapped
    headings 128 plus the heading error (128 levels to two full turns).
    Channel 2: checkerboard of the elements, and the parts' heading marks.
    """

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        values = np.array(KIND_VALUES, dtype=np.uint8)
        outlines = [np.array(kind.outline) for kind in task.part_kinds.every]
        zones = np.zeros((0, 4)) if task.zones is None else task.zones
        self.marks = Marks(
            outline=np.concatenate(outlines),
            first=np.cumsum([0, *(len(outline) for outline in outlines)]),
            kind=task.part_kinds.kind,
            value=values[task.kind],
            zone=zones,
            zone_value=values[: len(zones)],
        )
        self._unwrapped = task.has_heading and all(task.heading_period(kind) == 0.0 for kind in task.part_kinds.every)
        self.shape = (task.surface.rows * PIXELS, task.surface.columns * PIXELS, 3)

    @property
    def space(self) -> spaces.Space:
        return spaces.Box(0, 255, self.shape, np.uint8)

    def observe(self, measurement: Measurement, relations: Relations, episode: Episode) -> Any:
        surface, pose = self.task.surface, measurement.pose
        image = np.empty((len(pose), *self.shape), dtype=np.uint8)
        shown = np.zeros(pose.shape[:2], dtype=np.uint8)
        if self.task.has_goal:
            shown[:] = self.marks.value
            if self._unwrapped:
                level = np.rint(128.0 + relations.error[..., 2] * (127.0 / (4.0 * math.pi)))
                shown[:] = np.clip(level, 1.0, 255.0)
            shown[:, ~self.task.scored] = 0
        rasterise(
            pose, episode.present, episode.goal, shown, self.marks,
            surface.rows, surface.columns, surface.element_size, PIXELS, image,
        )  # fmt: skip
        return image


OBSERVATIONS: Registry[type[Observation]] = Registry(
    "observation",
    {
        "state": StateObservation,
        "parts": PartsObservation,
        "parts_and_state": PartsAndState,
        "goal": GoalObservation,
        "image": ImageObservation,
    },
    "vibgym.observations",
)
"""Observations by name; ``OBSERVATIONS.register(name, cls)`` or an entry point in group ``vibgym.observations`` adds one."""


def check_batch(name: str, space: spaces.Space, batch: Any, worlds: int, live: Sequence[np.ndarray]) -> None:
    """Check shapes, types and memory of a batch of observations.

    Args:
        name: of the observation, for errors.
        space: of one world.
        batch: array (worlds, ...), or a mapping of arrays for a ``Dict`` space.
        worlds: number of worlds.
        live: arrays that the next step overwrites.

    Raises:
        ValueError: a batch that does not fit, or shares memory with a live array.
    """
    if isinstance(space, spaces.Dict):
        if not isinstance(batch, Mapping) or set(batch) != set(space.spaces):
            got = sorted(map(str, batch)) if isinstance(batch, Mapping) else type(batch).__name__
            raise checks.refuse(name, got, f"a dictionary with the keys of its space: {', '.join(space.spaces)}")
        for key, inner in space.spaces.items():
            check_batch(f"{name}, {key!r},", inner, batch[key], worlds, live)
    elif space.shape is not None:
        shape = (worlds, *space.shape)
        if not isinstance(batch, np.ndarray) or batch.shape != shape or batch.dtype != space.dtype:
            got = type(batch).__name__
            if isinstance(batch, np.ndarray):
                got = f"an array of shape {batch.shape} and type {batch.dtype}"
            raise checks.refuse(name, got, f"an array of shape {shape} and type {space.dtype}: (worlds, *space.shape)")
        if any(np.may_share_memory(batch, array) for array in live):
            raise checks.refuse(
                name, "a view of an argument, which the next step overwrites", "a new array: return a copy"
            )


def _offsets(features: Sequence[Feature]) -> dict[str, int]:
    """Return the offset of each quantity in the list of all quantities; key ``""``: the length of the list."""
    widths = {feature.quantity: feature.width for feature in features}
    return dict(zip((*widths, ""), np.cumsum([0, *widths.values()]).tolist(), strict=True))


OF_PART, OF_NEIGHBOUR = _offsets(TABLE), _offsets(NEIGHBOUR)

# Offsets of quantities that change, as constants of the kernels.
POSITION, HEADING, WAY, TURN = (OF_PART[name] for name in ("position", "heading", "way", "turn"))
VELOCITY, SPIN, BORDERS, ZONE = (OF_PART[name] for name in ("velocity", "spin", "borders", "zone"))
GAP, TOWARDS, AGE, SIGMA = (OF_PART[name] for name in ("gap", "neighbour", "age", "sigma"))
NORMAL, PUSHED = OF_PART["normal"], OF_PART["pushed"]
GOAL_VELOCITY, GOAL_SPIN = OF_PART["goal_velocity"], OF_PART["goal_spin"]
WAY_AHEAD, TURN_AHEAD, ARRIVED = OF_PART["way_ahead"], OF_PART["turn_ahead"], OF_PART["arrived"]

APART, BETWEEN, FASTER = OF_NEIGHBOUR["apart"], OF_NEIGHBOUR["gap"], OF_NEIGHBOUR["velocity"]
THEIR_HEADING, SAME_KIND, THEIR_WAY = (OF_NEIGHBOUR[name] for name in ("heading", "same_kind", "way"))
THEIR_WAY_FAR, THEIR_TURN = OF_NEIGHBOUR["way_far"], OF_NEIGHBOUR["turn"]

FRICTION, RADIUS, GYRATION, EXTENT = (OF_PART[name] for name in ("friction", "radius", "gyration", "extent"))

LINEAR, TANH, PLACE, CELL = (CODINGS.index(name) for name in ("linear", "tanh", "place", "cell"))


class Program(NamedTuple):
    """Encoding of the values of a block, a row or a neighbour, arrays (values,)."""

    source: np.ndarray  # int64, index in the list of quantities
    coding: np.ndarray  # int64, of CODINGS
    scale: np.ndarray  # SI units at a value of 1


class Scene(NamedTuple):
    """Data of the kernels, pinned in memory."""

    measured: Measurement  # live
    relations: Relations  # of the measured poses
    present: np.ndarray  # (worlds, parts) bool
    arrived: np.ndarray  # (worlds, parts) bool
    motion: np.ndarray  # (worlds, parts, ...) of the goals, see vibgym.tasks.episode.Episode
    kind: np.ndarray  # (parts,) int64
    symmetry: np.ndarray  # (worlds, parts), or one row for all worlds, int64
    constant: np.ndarray  # (worlds, parts, 4) likewise: friction, radius, gyration and extent
    zone: np.ndarray  # (parts, 4) m, x_low, y_low, x_high, y_high
    size: np.ndarray  # (2,) m, of the surface
    hulls: Hulls
    program: Program  # of the part itself
    others: Program  # of a neighbour; empty if a row has none
    touch: int  # 1: with features of contacts
    coarse: int  # offset of "way_coarse" in a row, copied as "way" of a neighbour
    quantities: np.ndarray  # scratch: (parts, values) quantities of each part, with constant ones filled in
    neighbour: np.ndarray  # scratch: (values,) quantities of a neighbour
    placed: np.ndarray  # scratch: as hulls.corner
    nearest: np.ndarray  # scratch: (parts, NEIGHBOURS) int64, nearest first, -1: none
    gap: np.ndarray  # scratch: (parts, NEIGHBOURS) m, to these


SCENE: MemoryLayout[Scene] = MemoryLayout("SCENE", __name__)
"""Data of :func:`write_rows`."""

scene_at = SCENE.at


@jit
def _unit(value):
    return min(max(value, -1.0), 1.0)


@jit
def encode(program, quantities, row):
    """Write encoded quantities to a row (n,)."""
    source, codings, scales = program.source, program.coding, program.scale
    for k in range(source.shape[0]):
        value, coding = quantities[source[k]], codings[k]
        if coding == TANH:
            value = math.tanh(value / scales[k])
        elif coding == LINEAR:
            value = _unit(value / scales[k])
        elif coding == PLACE:
            value = _unit(value / scales[k] - 1.0)
        elif coding == CELL:
            cells = value / (2.0 * scales[k])
            value = 2.0 * (cells - math.floor(cells)) - 1.0
        row[k] = value


@jit
def compute_part(scene, w, p, out):
    """Compute the quantities (numbers,) of a part."""
    measured = scene.measured
    pose, velocity, age, sigma = measured.pose[w], measured.mean_velocity[w], measured.age[w], measured.sigma[w]
    relations, size, zones = scene.relations, scene.size, scene.zone[p]
    error, motion = relations.error[w, p], scene.motion[w, p]
    turned = scene.symmetry[min(w, scene.symmetry.shape[0] - 1), p] * pose[p, 2]
    constant = scene.constant[min(w, scene.constant.shape[0] - 1), p]
    out[FRICTION], out[RADIUS], out[GYRATION], out[EXTENT] = constant[0], constant[1], constant[2], constant[3]
    out[HEADING], out[HEADING + 1] = math.cos(turned), math.sin(turned)
    for axis in range(2):
        at, border, zone = pose[p, axis], BORDERS + 2 * axis, ZONE + 2 * axis
        out[POSITION + axis], out[VELOCITY + axis], out[WAY + axis] = at, velocity[p, axis], error[axis]
        out[border], out[border + 1] = at, size[axis] - at
        out[zone], out[zone + 1] = at - zones[axis], zones[2 + axis] - at
    out[SPIN], out[TURN], out[GAP], out[AGE] = velocity[p, 2], error[2], relations.gap[w, p], age[p]
    out[SIGMA] = math.sqrt(sigma[p, 0] * sigma[p, 0] + sigma[p, 1] * sigma[p, 1])
    out[SIGMA + 1] = sigma[p, 2]
    out[ARRIVED] = 1.0 if scene.arrived[w, p] else 0.0
    if motion.shape[0] > 0:
        out[GOAL_VELOCITY], out[GOAL_VELOCITY + 1], out[GOAL_SPIN] = motion[0], motion[1], motion[2]
        for ahead in range(PREVIEW):
            for axis in range(2):
                out[WAY_AHEAD + 2 * ahead + axis] = error[axis] + motion[3 + 3 * ahead + axis]
            out[TURN_AHEAD + ahead] = error[2] + motion[5 + 3 * ahead]
    out[TOWARDS] = out[TOWARDS + 1] = 0.0
    other = relations.neighbour[w, p]
    if other >= 0:
        dx, dy = pose[other, 0] - pose[p, 0], pose[other, 1] - pose[p, 1]
        apart = math.sqrt(dx * dx + dy * dy)
        if apart > 0.0:
            out[TOWARDS], out[TOWARDS + 1] = dx / apart, dy / apart


@jit
def compute_contact(scene, pose, pushed, w, p, out):
    """Compute the quantities of a part's contacts.

    Args:
        pose: (parts, 3) of the world.  pushed: (parts, 2) likewise.
        out: (numbers,) of the part.
    """
    out[PUSHED], out[PUSHED + 1] = pushed[p, 0], pushed[p, 1]
    out[NORMAL] = out[NORMAL + 1] = 0.0
    other = scene.relations.neighbour[w, p]
    if other >= 0:
        for part in (p, other):
            place_hulls(scene.hulls, part, pose[part, 0], pose[part, 1], pose[part, 2], scene.placed)
        _, out[NORMAL], out[NORMAL + 1] = part_contact(scene.hulls, scene.placed, p, other)


@jit
def insert_neighbour(gaps, nearest, gap, other):
    """Insert a part at a distance ``gap`` (m) into the sorted lists (NEIGHBOURS,) of the nearest, after equal ones."""
    place = NEIGHBOURS
    while place > 0 and gap < gaps[place - 1]:
        place -= 1
    for k in range(NEIGHBOURS - 1, place, -1):
        gaps[k], nearest[k] = gaps[k - 1], nearest[k - 1]
    if place < NEIGHBOURS:
        gaps[place], nearest[place] = gap, other


@jit
def rank_neighbours(scene, pose, gone, world):
    """List every part's nearest others by the distance between outlines; absent parts have none.

    Pairs whose bounding circles are farther apart than the last entries of both lists are skipped.
    """
    hulls, placed, here = scene.hulls, scene.placed, scene.present[world]
    load_hulls(hulls, world)
    for i in range(pose.shape[1]):
        for k in range(NEIGHBOURS):
            scene.gap[i, k], scene.nearest[i, k] = math.inf, -1
        if not here[i] or gone[world, i]:
            continue
        place_hulls(hulls, i, pose[world, i, 0], pose[world, i, 1], pose[world, i, 2], placed)
        for j in range(i):
            if not here[j] or gone[world, j]:
                continue
            dx, dy = pose[world, i, 0] - pose[world, j, 0], pose[world, i, 1] - pose[world, j, 1]
            least = math.sqrt(dx * dx + dy * dy) - hulls.radius[i] - hulls.radius[j]
            if least >= scene.gap[i, NEIGHBOURS - 1] and least >= scene.gap[j, NEIGHBOURS - 1]:
                continue
            between = part_gap(hulls, placed, i, j)
            insert_neighbour(scene.gap[i], scene.nearest[i], between, j)
            insert_neighbour(scene.gap[j], scene.nearest[j], between, i)


@jit
def write_neighbours(scene, pose, velocity, p, rows):
    """Write the neighbours of row ``p``, after the rows of the neighbours themselves.

    Args:
        pose, velocity: (parts, 3) of the world.  rows: (slots, size) of the world.
    """
    neighbour, quantities, kind = scene.neighbour, scene.quantities, scene.kind
    nearest, gap = scene.nearest[p], scene.gap[p]
    start, width = scene.program.source.shape[0], scene.others.source.shape[0]
    for k in range(NEIGHBOURS):
        other = nearest[k]
        if other < 0:
            break
        neighbour[BETWEEN] = gap[k]
        neighbour[THEIR_TURN] = quantities[other, TURN]
        neighbour[SAME_KIND] = 1.0 if kind[p] == kind[other] else 0.0
        for axis in range(2):
            neighbour[APART + axis] = pose[other, axis] - pose[p, axis]
            neighbour[FASTER + axis] = velocity[other, axis] - velocity[p, axis]
            neighbour[THEIR_HEADING + axis] = quantities[other, HEADING + axis]
            neighbour[THEIR_WAY_FAR + axis] = quantities[other, WAY + axis]
            neighbour[THEIR_WAY + axis] = rows[other, scene.coarse + axis]
        encode(scene.others, neighbour, rows[p, start + k * width : start + (k + 1) * width])


@jit
def write_world(scene, w, rows):
    """Write the blocks or rows (slots, size) of a world, without neighbours."""
    present = scene.present[w]
    for slot in range(rows.shape[0]):
        there = slot < present.shape[0] and present[slot]
        for number in range(scene.program.source.shape[0] if there else 0, rows.shape[1]):
            rows[slot, number] = 0.0
    for p in range(present.shape[0]):
        if present[p]:
            compute_part(scene, w, p, scene.quantities[p])
            encode(scene.program, scene.quantities[p], rows[p])


@jit
def write_rows(pinned, worlds, out):
    """Write the blocks or rows of some worlds.

    Args:
        pinned: address of a pinned :class:`Scene`.
        worlds: (n,) index.
        out: (worlds, slots, size) float32, overwritten; zeros for absent parts.
    """
    scene = scene_at(pinned)
    for k in range(worlds.shape[0]):
        write_world(scene, worlds[k], out[worlds[k]])


@jit
def write_rows_of_several(pinned, worlds, out):
    """Write rows as :func:`write_rows`, with contacts and neighbours where the layout has them."""
    scene = scene_at(pinned)
    measured = scene.measured
    for k in range(worlds.shape[0]):
        w = worlds[k]
        pose, velocity = measured.pose[w], measured.mean_velocity[w]
        load_hulls(scene.hulls, w)
        for p in range(pose.shape[0] if scene.touch == 1 else 0):
            if scene.present[w, p]:
                compute_contact(scene, pose, measured.pushed[w], w, p, scene.quantities[p])
        write_world(scene, w, out[w])
        if scene.others.source.shape[0] > 0:
            rank_neighbours(scene, measured.pose, measured.gone, w)
            for p in range(pose.shape[0]):
                write_neighbours(scene, pose, velocity, p, out[w])


@jit
def write_mask(present, worlds, mask):
    """Write the mask (worlds, slots) of present parts (worlds, parts) of some worlds."""
    for k in range(worlds.shape[0]):
        w = worlds[k]
        for slot in range(mask.shape[1]):
            mask[w, slot] = 1 if slot < present.shape[1] and present[w, slot] else 0


@jit
def write_goals(low, high, pose, worlds, goals):
    """Write poses (worlds, parts, 3) of the first parts of some worlds, clipped, as goals (worlds, values)."""
    for k in range(worlds.shape[0]):
        w = worlds[k]
        for number in range(goals.shape[1]):
            goals[w, number] = min(max(np.float32(pose[w, 0, number]), low[number]), high[number])


def row_writer(task: Task, layout: Layout, measurement: Measurement, relations: Relations, episode: Episode) -> Writer:
    """Return a function that writes a layout into (worlds, slots, block) float32; the arrays of the arguments are live."""
    surface, parts, hulls = task.surface, task.parts, hulls_of(task.part_kinds)
    own = tuple(feature for feature in layout.table if feature in TABLE)
    others = _program(tuple(row for row in NEIGHBOUR if f"neighbour_1_{row.name}" in layout), OF_NEIGHBOUR, surface)
    # The displacement of a neighbour is copied from its row, encoded.
    others.coding[others.source >= THEIR_WAY] = CODINGS.index("flag")
    coarse = next((row.start for row in layout.rows if row.name == "way_coarse"), -1)
    zones = np.zeros((len(parts), 4)) if task.zones is None else task.zones[task.kind]
    scene = Scene(
        measured=measurement,
        relations=relations,
        present=episode.present,
        arrived=episode.arrived,
        motion=episode.motion,
        kind=np.ascontiguousarray(task.kind),
        symmetry=task.part_kinds.values(lambda part: part.symmetry),
        constant=task.part_kinds.values(_constants),
        zone=np.ascontiguousarray(zones),
        size=np.array([surface.width, surface.depth]),
        hulls=hulls,
        program=_program(own, OF_PART, surface),
        others=others,
        touch=int("contact_normal" in layout),
        coarse=coarse,
        quantities=_constant_quantities(task.kind),
        neighbour=np.ones(OF_NEIGHBOUR[""]),
        placed=np.zeros(hulls.corner.shape),
        nearest=np.full((len(parts), NEIGHBOURS), -1, dtype=np.int64),
        gap=np.zeros((len(parts), NEIGHBOURS)),
    )
    pinned, write = Pinned(SCENE, scene), write_rows_of_several if scene.touch or len(others.source) else write_rows
    return bound(write, pinned)


def _program(features: Sequence[Feature], places: dict[str, int], surface: Surface) -> Program:
    """Return the encoding of features from quantities at these offsets."""
    numbers = [
        (places[feature.quantity] + k, CODINGS.index(feature.coding), scale)
        for feature in features
        for k, scale in enumerate(feature.scales(surface))
    ]
    source, coding, scale = zip(*numbers, strict=True) if numbers else ((), (), ())
    return Program(
        np.array(source, dtype=np.int64), np.array(coding, dtype=np.int64), np.array(scale, dtype=np.float64)
    )


def _constants(part: Part) -> list[float]:
    """Return friction, radius (m), radius of gyration (m) and extent (m) of a part."""
    return [part.friction, part.radius, math.sqrt(part.gyration), math.sqrt(part.area)]


def _constant_quantities(kind: np.ndarray) -> np.ndarray:
    """Return quantities (parts, values) with those filled in that depend on the part's kind (parts,) alone."""
    quantities = np.zeros((len(kind), OF_PART[""]))
    for row, number in zip(quantities, kind, strict=True):
        row[OF_PART["present"]] = row[OF_PART["kind"] + number] = 1.0
    return quantities
