"""What a simulator tells of parts above the plane, and how they come there: all zero with planar models."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym import checks
from vibgym.physics.core.records import State
from vibgym.physics.tilting.records import FLAT
from vibgym.scene.outlines import rotation
from vibgym.scene.parts import Part
from vibgym.simulation.conditions import worlds_from
from vibgym.simulation.protocol import Model


class AboveThePlane:
    """Base of :class:`vibgym.Simulator`: attitudes of its parts."""

    worlds: int
    parts: tuple[Part, ...]
    model: str
    _model: Model
    _state: State

    @property
    def tilt(self) -> np.ndarray:
        """(worlds, parts) rad, angle between a part's axis and the vertical; 0 with planar models."""
        lean = self.lean
        return np.hypot(lean[..., 0], lean[..., 1])

    @property
    def lean(self) -> np.ndarray:
        """(worlds, parts, 2) rad, rotation vector, about the world's x and y, by which a part is turned after its heading; a
        copy.

        Noughts with planar models.
        """
        live = self._model.live()
        return live["lean"].copy() if live else np.zeros((self.worlds, len(self.parts), 2))

    def bottoms(self, world: int) -> list[np.ndarray]:
        """(n, 3) m, the corners of the bottom of each part of a world, z above plates in the middle of their way.

        Of parts that lie flat, z is 0: what they lie on, the model need not know.
        """
        live, found = self._model.live(), []
        for k, part in enumerate(self.parts):
            x, y, heading = self._state.pose[world, k]
            height, lean = 0.0, np.zeros(2)
            if live and live["mode"][world, k] != FLAT:
                height, lean = live["height"][world, k] - part.centre_height, live["lean"][world, k]
            corners = np.column_stack([part.outline, np.full(len(part.outline), -part.centre_height)])
            turned = corners @ (rotation(lean[0], lean[1], 0.0) @ rotation(0.0, 0.0, heading)).T
            found.append(turned + [x, y, height + part.centre_height])
        return found

    @property
    def time_tilted(self) -> np.ndarray:
        """(worlds, parts) s from when a part was tipped last until its tilt was last above 0.05 deg; 0 with planar models."""
        live = self._model.live()
        return live["landing"] * self._model.step if live else np.zeros(self._state.fallen.shape)  # type: ignore[attr-defined]

    @property
    def toppled(self) -> np.ndarray:
        """(worlds, parts) whether a part has tipped beyond its edge; it has then fallen, too. Never with planar models."""
        live = self._model.live()
        return live["toppled"].copy() if live else np.zeros_like(self._state.fallen)

    def tip(self, worlds: Any, lean: Any, *, rocking: Any = 0.0, which: Any = True) -> None:
        """Put parts of some worlds on an edge or a corner; only with ``model="tilting"``.

        Such a part keeps its place, heading and velocity in the plane. Its lowest point touches the plates as they stand when
        the next period begins.

        Args:
            worlds: mask (worlds,), indices, or a slice; n worlds.
            lean: rad, see :attr:`lean`, broadcastable to (n, parts, 2).
            rocking: rad/s, angular velocity about the world's x and y, likewise.
            which: (n, parts) or broadcastable, bool: the parts that are meant; those that have fallen stay where they are.

        Raises:
            ValueError: another model, a number that is not finite, or a part that would topple; nothing has changed.
        """
        rows = worlds_from(worlds, self.worlds)
        if self.model != "tilting":
            raise checks.refuse("tip", f"model={self.model!r}", "model='tilting', in which parts can tilt")
        shape = (len(rows), len(self.parts), 2)
        lean, rocking = checks.array("lean", lean, shape), checks.array("rocking", rocking, shape)
        meant = checks.array("which", which, shape[:2], dtype=np.bool_) & ~self._state.fallen[rows]
        self._model.tip(rows, meant, self._state.pose[rows, :, 2], lean, rocking)  # type: ignore[attr-defined]
