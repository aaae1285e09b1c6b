"""Classical policies of the machines: controllers and planner of the segmented surface with another last step.

    observation -> targets -> controller -> wanted pushes of all parts -> the machine's command with the smallest squared error

The last step also returns the resulting pushes, which controllers and estimators use.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from studies.rivals.fitting import FAR, Strokes, fit_cells, fit_strokes, plate_pushes, stroke_about
from studies.rivals.machines import MACHINES, Cells, Machine, PlainPlate, Plate
from vibgym import Surface
from vibgym.allocation import Allocator
from vibgym.allocation.cut import new_pieces
from vibgym.policies.classical.measured import Measured
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.simulation import threads as workers

DIRECTIONS = 16
"""Number of initial strokes without rotation, over half a turn; the others have the opposite sign."""

AROUND = 0.25
"""m, width of the margin around the table with further centres of rotation, at twice the spacing."""

TURNING = 0.1
"""Weight of errors of rotation relative to translation, for several parts without goal headings."""


def element_positions(surface: Surface) -> np.ndarray:
    """Return the centres of the elements (elements, 2), m from the middle of the table."""
    x, y = surface.element_centres()
    middle = 0.5 * np.array([surface.width, surface.depth])
    return np.ascontiguousarray(np.stack([x.ravel(), y.ravel()], axis=-1) - middle)


class RivalOutput(ABC):
    """Output (:class:`vibgym.policies.classical.outputs.PhasorOutput`) for the action of a machine.

    Args:
        info: task and scene.
        machine: the action.
    """

    learner = None

    def __init__(self, info: TaskInfo, machine: Machine) -> None:
        self.info, self.machine = info, machine
        self.allocator = Allocator(info.surface, info.parts, info.hardware)
        self.half = 0.5 * info.surface.period  # s
        self.weight = np.array([1.0, 1.0, 1.0 if info.has_heading or len(info.parts) == 1 else TURNING])
        self.threads = workers.available_threads()
        self.place = element_positions(info.surface)

    def begin(self, batch: int) -> Any:
        """Return the memory, which is empty."""
        return ()

    def give(
        self, measured: Measured, seen: np.ndarray, push: np.ndarray, memory: Any
    ) -> tuple[np.ndarray, np.ndarray, Any]:
        """See :meth:`vibgym.policies.classical.outputs.PhasorOutput.give`."""
        present, wanted = np.ascontiguousarray(measured.present), np.ascontiguousarray(push)
        # At the middle of the step, as in the output of the segmented surface.
        pose = np.ascontiguousarray(measured.pose + self.half * measured.rate)
        weight = np.ascontiguousarray(np.broadcast_to(self.weight, wanted.shape) * present[..., None])
        action = self.fit(pose, present, np.where(present[..., None], wanted, 0.0), weight).astype(np.float32)
        pushes = self.machine.pushes(action.astype(np.float64))
        return action, self.allocator.effect(pose, present, pushes), memory

    @abstractmethod
    def fit(self, pose: np.ndarray, present: np.ndarray, wanted: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Return the actions (worlds, size) with the smallest weighted squared error to ``wanted`` (worlds, parts, 3)."""


def initial_strokes(surface: Surface, plate: Plate, place: np.ndarray) -> Strokes:
    """Return strokes about centres of rotation on and around the table, and strokes without rotation.

    ``place``: (elements, 2) centres of the elements, m from the middle.
    """
    size = surface.element_size
    reach = 0.5 * np.array([surface.width, surface.depth])
    inner = [np.arange(-far + 0.5 * size, far, size) for far in reach]
    outer = [np.arange(-far - AROUND, far + AROUND + size, 2.0 * size) for far in reach]
    near, wide = (np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2) for axes in (inner, outer))
    wide = wide[(np.abs(wide) > reach).any(axis=1)]
    angles = math.pi / DIRECTIONS * np.arange(DIRECTIONS)
    centre = np.concatenate([near, wide, np.stack([np.full(DIRECTIONS, FAR), angles], axis=-1)])
    step = np.concatenate(
        [np.full(near.shape, size), np.full(wide.shape, 2.0 * size), np.full((DIRECTIONS, 2), math.pi / DIRECTIONS)]
    )
    stroke, push = np.empty((len(centre), 3)), np.empty((len(centre), len(place), 2))
    for k in range(len(centre)):
        stroke_about(*centre[k], plate.half, stroke[k])
        plate_pushes(stroke[k], place, plate.half, plate.core, push[k])
    return Strokes(stroke, centre, step, push)


class PlateOutput(RivalOutput):
    """Stroke with the smallest squared error. Parts take turns, since controllers request missing pushes again."""

    def __init__(self, info: TaskInfo, machine: Machine) -> None:
        super().__init__(info, machine)
        assert isinstance(machine, Plate)
        self.plate = machine
        self.strokes = initial_strokes(info.surface, machine, self.place)

    def fit(self, pose: np.ndarray, present: np.ndarray, wanted: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """See :meth:`RivalOutput.fit`."""
        result, info = np.zeros((len(pose), 3)), self.info

        def work(start: int, stop: int) -> None:
            pieces = new_pieces(info.surface, info.parts)
            effect, push = np.empty((len(info.parts), 3)), np.empty((len(self.place), 2))
            fit_strokes(
                start, stop, self.allocator.outlines, pose, present, wanted, weight, self.allocator.most, self.strokes,
                self.place, self.plate.half, self.plate.core, pieces, effect, push, result,
            )  # fmt: skip

        workers.share(work, len(pose), self.threads)
        return result


class PlainOutput(RivalOutput):
    """Stroke with the smallest squared error, by linear least squares; strokes that are too fast are scaled down."""

    def fit(self, pose: np.ndarray, present: np.ndarray, wanted: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """See :meth:`RivalOutput.fit`."""
        plate = self.machine
        assert isinstance(plate, PlainPlate)
        worlds, most = len(pose), self.allocator.most
        unit = 0.5 * np.eye(3)  # below the speed from which strokes are scaled down
        effects = [self.allocator.effect(pose, present, plate.pushes(np.tile(stroke, (worlds, 1)))) for stroke in unit]
        root = np.sqrt(weight)
        matrix = 2.0 * np.stack([(root * effect).reshape(worlds, -1) for effect in effects], axis=-1)
        normal = np.einsum("wik,wil->wkl", matrix, matrix) + 1e-9 * np.eye(3)
        right = np.einsum("wik,wi->wk", matrix, (root * wanted).reshape(worlds, -1))
        stroke = np.linalg.solve(normal, right[..., None])[..., 0]
        return most * stroke / np.maximum(plate.fastest(stroke), most)[:, None]


class CellsOutput(RivalOutput):
    """Pushes of all cells along their axes with the smallest squared error."""

    def fit(self, pose: np.ndarray, present: np.ndarray, wanted: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """See :meth:`RivalOutput.fit`."""
        cells, info = self.machine, self.info
        assert isinstance(cells, Cells)
        axis = np.ascontiguousarray(cells.axis.reshape(-1, 2))
        most, result = self.allocator.most, np.zeros((len(pose), len(axis)))

        def work(start: int, stop: int) -> None:
            pieces = new_pieces(info.surface, info.parts)
            following, first = np.empty(len(pieces.part), dtype=np.int64), np.empty(len(axis), dtype=np.int64)
            fit_cells(
                start, stop, self.allocator.outlines, pose, present, wanted, weight, axis, most * cells.least, most, pieces,
                following, first, np.empty((len(info.parts), 3)), result,
            )  # fmt: skip

        workers.share(work, len(pose), self.threads)
        return result


OUTPUTS = {"plate": PlateOutput, "plain-plate": PlainOutput, "conveyor": CellsOutput, "one-way": CellsOutput}
"""Name of the machine -> output."""


def rival_policy(info: TaskInfo, machine: str) -> Policy:
    """Return the classical policy of a machine (:data:`.machines.MACHINES`), with the planner for several parts."""
    straight = info.has_goal and len(info.parts) == 1
    policy: Any = make_policy({"kind": "local_field" if straight else "planner", "law": "pose", "learn": False}, info)
    policy.output = OUTPUTS[machine](info, MACHINES[machine](info.surface, info.parts))
    policy.action = machine
    return policy
