"""One network for all parts of a scene, in the frame of the part that is pushed.

Where parts push another one, actions depend on how all of them lie together, and that does not depend on where they are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from vibgym import Part, Surface, checks
from vibgym.envs.motions import Velocity
from vibgym.policies.trained.coding import Coding, Inputs, refuse_memory
from vibgym.policies.trained.networks import BASE
from vibgym.policies.trained.symmetry import VECTORS, Equivalent, Reflection, Symmetry, reflected

REACH = 0.1
"""Unit of displacements from the first part, m."""

WAVES = math.pi / 0.24 * np.array([1.0, 2.0, 4.0, 8.0])
"""Wave numbers of the sines and cosines of these displacements, 1/m, by which a network can resolve an outline (Tancik et al.,
"Fourier features let networks learn high frequency functions in low dimensional domains", NeurIPS 2020)."""

SAME = 1e-6
"""Largest distance of equal corners, m."""

MAX_EXCHANGED = 6
"""Most parts in a scene in which equal ones are exchanged."""


class JointCoding(Coding):
    """Conversion for networks that read one row for all parts and act for all driven parts, with velocities.

    The row begins with the part that is not driven (``Part.coupling`` 0), or else the first, its *anchor*. It has every part's
    own columns, without neighbours. If the anchor's heading is unique, vectors and the velocities of actions are in the
    anchor's frame, else in the table's. The position of other parts is replaced by their displacement from the anchor.

    Rows of a correction (:mod:`.residual`) also have the velocities and the plan of the base. Its outputs are velocities (x, y)
    that are added to those of the base, which turns the parts.

    Args: see :class:`.coding.Coding`; ``turned``, ``history`` and ``history_columns`` must be False or empty.

    Attributes:
        equivalents: transformations of rows and outputs to equivalent scenes; the first changes nothing. Equal driven parts are
            exchanged, and the scene is mirrored if its anchor is symmetric about an axis of its frame.

    Raises:
        ValueError: another action than ``"velocity"``, or missing columns.
    """

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        layout: Sequence[Any],
        action: str,
        columns: Sequence[Sequence[Any]] | None = None,
        **memory: Any,
    ) -> None:
        refuse_memory("joint", memory)
        checks.choice("action", action, ("velocity",))
        super().__init__(surface, parts, layout, action, columns)
        names, starts = [name for name, _ in self.columns], np.cumsum([0, *(width for _, width in self.columns)])
        for name in ("position", "heading"):
            if name not in names:
                raise checks.refuse("columns", names, f"the column {name!r} among them")
        self._position, self._heading = (int(starts[names.index(name)]) for name in ("position", "heading"))
        own = [(name, width, int(start)) for (name, width), start in zip(self.columns, starts, strict=False)]
        own = [column for column in own if not column[0].startswith("neighbour_")]
        self._own_columns = sum(width for _, width, _ in own)
        vectors = [
            range(start, start + width, 2) for name, width, start in own if name in VECTORS and name != "position"
        ]
        self._vectors = np.array([start for vector in vectors for start in vector], dtype=np.int64)
        self._base = next((start for name, _, start in own if name == BASE), None)
        self.adds_velocities = self._base is not None
        self.slots, self._nearest = 1, None
        anchor = next((k for k, part in enumerate(self.parts) if part.coupling == 0.0), 0)
        self._others = [k for k in range(len(self.parts)) if k != anchor]
        self._driven = [k for k, part in enumerate(self.parts) if part.coupling > 0.0]
        self.anchor, self._rotates = anchor, self.parts[anchor].symmetry == 1
        self._half = 0.5 * np.array([surface.width, surface.depth])
        block = self._own_columns + 4 * len(WAVES)
        values, numbers = 2 if self.adds_velocities else Velocity(surface, self.parts).shape[1], len(self._driven)
        self.shape = self.shape._replace(
            columns=self._own_columns + block * len(self._others),
            neighbours=0,
            width=0,
            action=values * numbers,
            place=-1,
        )
        exchanged, mirrored = self._exchanges(block, values), self._mirrored(own, values)
        self.equivalents = exchanged
        if mirrored is not None:
            self.equivalents = exchanged + [mirrored.after(exchange) for exchange in exchanged]
        self.symmetry = Symmetry.of(self.equivalents)

    def _exchanges(self, block: int, values: int) -> list[Equivalent]:
        """Return the exchanges of equal parts other than the anchor, first that which changes nothing."""
        numbers, exchanges = range(len(self.parts)), list[Equivalent]()
        for order in itertools.permutations(numbers) if len(numbers) <= MAX_EXCHANGED else [tuple(numbers)]:
            same = all(self.parts[k].same_as(self.parts[other]) for k, other in enumerate(order))
            if same and order[self.anchor] == self.anchor:
                rows = [np.arange(self._own_columns)]
                rows += [
                    self._own_columns + block * self._others.index(order[k]) + np.arange(block) for k in self._others
                ]
                acts = [values * self._driven.index(order[k]) + np.arange(values) for k in self._driven]
                signs = (np.ones(sum(map(len, indices)), dtype=np.float32) for indices in (rows, acts))
                exchanges.append(Equivalent(np.concatenate(rows), next(signs), np.concatenate(acts), next(signs)))
        return exchanges

    def _mirrored(self, own: Sequence[tuple[str, int, int]], values: int) -> Equivalent | None:
        """Return the reflection of the scene in the plane of symmetry of its anchor; None: it has none along its axes.

        Args:
            own: names, widths and starts of a part's own columns.
            values: of a part's action.
        """
        outline, mirrors = self.parts[self.anchor].outline, np.array([[-1.0, 1.0], [1.0, -1.0]])
        away = np.linalg.norm((mirrors[:, None] * outline)[:, :, None] - outline, axis=-1).min(axis=-1).max(axis=-1)
        if not self._rotates or away.min() > SAME:
            return None
        axis = int(np.argmin(away))  # of the coordinate that changes its sign
        sides = [1, 0, 2, 3] if axis == 0 else [0, 1, 3, 2]
        reflection = Reflection(([0, 1], mirrors[axis].tolist()), ([0, 1], [1.0, -1.0]), sides)
        order, sign = reflected([(name, width) for name, width, _ in own], reflection)
        waves = np.ones((2, 2, len(WAVES)), dtype=np.float32)  # sines and cosines, x and y
        waves[0, axis] = -1.0
        others, block = len(self._others), self._own_columns + waves.size
        orders = [order] + [
            self._own_columns + block * k + np.concatenate([order, np.arange(len(order), block)]) for k in range(others)
        ]
        signs = [sign] + others * [np.concatenate([sign, waves.reshape(-1)])]
        action = np.concatenate([mirrors[axis], -np.ones(values - 2)]).astype(np.float32)
        number = values * len(self._driven)
        return Equivalent(
            np.concatenate(orders), np.concatenate(signs), np.arange(number), np.tile(action, len(self._driven))
        )

    def encode(self, observation: Any, before: Any = None, start: np.ndarray | None = None) -> Inputs:
        """Return the inputs (worlds, 1, columns) for an observation or a batch; see :meth:`.coding.Coding.encode`."""
        inputs = super().encode(observation)
        rows = inputs.rows.copy()
        worlds, first = len(rows), self.anchor
        frame = np.broadcast_to(np.array([1.0, 0.0], dtype=np.float32), (worlds, 2))
        if self._rotates:
            heading = rows[:, first, self._heading : self._heading + 2]
            size = np.hypot(heading[:, :1], heading[:, 1:])
            frame = np.where(size > 0.0, heading / np.where(size > 0.0, size, 1.0), frame).astype(np.float32)
        cos, sin = frame[:, None, :1], frame[:, None, 1:]
        place = slice(self._position, self._position + 2)
        away = ((rows[..., place] - rows[:, first : first + 1, place]) * self._half).astype(np.float32)
        away = np.stack(rotated(away[..., 0], away[..., 1], frame[:, :1], -frame[:, 1:]), axis=-1)
        x, y = rows[..., self._vectors], rows[..., self._vectors + 1]
        rows[..., self._vectors], rows[..., self._vectors + 1] = rotated(x, y, cos, -sin)
        if self._base is not None:
            x, y = _velocity(rows[..., self._base : self._base + 2])
            rows[..., self._base], rows[..., self._base + 1] = rotated(x, y, cos[..., 0], -sin[..., 0])
        rows[:, self._others, place] = away[:, self._others] / np.float32(REACH)
        phase = (away[..., None] * WAVES).reshape(worlds, len(self.parts), -1).astype(np.float32)
        wide = np.concatenate([rows[..., : self._own_columns], np.sin(phase), np.cos(phase)], axis=-1)
        wide *= inputs.mask[..., None]
        joint = [rows[:, first, : self._own_columns], wide[:, self._others].reshape(worlds, -1)]
        ones = np.ones((worlds, 1), dtype=np.float32)
        return Inputs(np.concatenate(joint, axis=-1)[:, None], ones, frame=frame)

    def to_rows(self, inputs: Inputs, of_parts: np.ndarray) -> np.ndarray:
        """Return actions (worlds, parts, 3) of parts on the table as network outputs (worlds, 1, values)."""
        x, y = rotated(*_velocity(of_parts[:, self._driven]), inputs.frame[:, :1], -inputs.frame[:, 1:])
        size = np.sqrt(np.maximum(np.hypot(x, y), np.float32(1e-12)))
        spin = of_parts[:, self._driven, 2]
        return np.stack([x / size, y / size, spin], axis=-1).reshape(len(of_parts), 1, -1).astype(np.float32)

    def decode(self, inputs: Inputs, of_parts: np.ndarray) -> np.ndarray:
        """Return the environment's actions (worlds, n) float32 for network outputs (worlds, 1, values); velocities of a
        correction, as shares of the top speed.
        """
        if self.adds_velocities:
            own = of_parts.reshape(len(of_parts), len(self._driven), 2)
            added = np.zeros((len(own), len(self.parts), 3), dtype=np.float32)
            turned = rotated(own[..., 0], own[..., 1], inputs.frame[:, :1], inputs.frame[:, 1:])
            added[:, self._driven, 0], added[:, self._driven, 1] = turned
            return added.reshape(len(own), -1)
        polar = of_parts.reshape(len(of_parts), len(self._driven), 3)
        size = np.hypot(polar[..., 0], polar[..., 1])
        x, y = rotated(polar[..., 0] * size, polar[..., 1] * size, inputs.frame[:, :1], inputs.frame[:, 1:])
        actions = np.zeros((len(polar), len(self.parts), 3), dtype=np.float32)
        actions[:, self._driven] = np.stack([root_of(x), root_of(y), polar[..., 2]], axis=-1)
        return np.clip(actions, -1.0, 1.0).reshape(len(polar), -1)


def rotated(x: np.ndarray, y: np.ndarray, cos: np.ndarray, sin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y of vectors turned to the left by an angle."""
    return cos * x - sin * y, sin * x + cos * y


def _velocity(action: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y of the velocities of actions (..., 3), as shares of the top speed."""
    share = share_of(action[..., :2])
    return share[..., 0], share[..., 1]


def share_of(action: np.ndarray) -> np.ndarray:
    """Return the shares of the top speed that values of an action ``"velocity"`` command."""
    return action * np.abs(action)


def root_of(share: np.ndarray) -> np.ndarray:
    """Return the values of an action for shares of the top speed, the inverse of :func:`share_of`."""
    return np.sign(share) * np.sqrt(np.abs(share))
