"""Several parts in a world, or walls: a period at a time, by the ways of :mod:`vibgym.physics.collision.multibody`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vibgym.physics.collision.hulls import Hulls
from vibgym.physics.collision.multibody import CALLS, CONTACT, COUNTS, FREE, LOOKED, follow_up, new_survey, survey
from vibgym.physics.core.records import State
from vibgym.physics.friction.planar import slide_rows
from vibgym.scene.parts import Part, bodies_of, kinds_of
from vibgym.scene.surface import Surface
from vibgym.simulation.contact_space import ContactSpaces
from vibgym.simulation.crowd_schemes import build_crowd

STATISTICS = {"free": FREE, "near": LOOKED, "contact": CONTACT, "contact_steps": CALLS}


class Crowd:
    """Advances worlds with several parts or walls.

    Args:
        surface, parts, walls: of every world.
        hulls: of the parts.
        worlds: their number.
        model, knobs: of the planar model.

    Attributes:
        counts: (worlds, 4) periods and solver calls since they were last set to zero, see :data:`STATISTICS`.

    Raises:
        ValueError: a bad model or knob.
    """

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        walls: Sequence[str],
        hulls: Hulls,
        worlds: int,
        model: str,
        knobs: Mapping[str, Any],
    ) -> None:
        kinds, _ = kinds_of(parts)
        self._method = build_crowd(model, surface, kinds, walls, knobs)
        self._kinds = [kind.body() for kind in kinds]
        self._table, self._bodies, self._hulls = surface.table(), bodies_of(parts), hulls
        self._spaces = ContactSpaces(surface, parts, walls)
        self.counts = np.zeros((worlds, COUNTS), dtype=np.int64)

    def advance(self, start: int, stop: int, drive: Any, state: State, periods: int) -> None:
        """Advance worlds ``start`` to ``stop`` by whole periods under a held drive, changing ``state`` in place."""
        table, bodies, hulls, crowd = self._table, self._bodies, self._hulls, self._method.crowd
        parts = state.pose.shape[1]
        seen = new_survey(stop - start, len(self._kinds), parts, int(crowd.steps.max()))
        space = self._spaces.borrow()
        try:
            for _ in range(periods):
                near, touching = survey(start, stop, table, bodies, hulls, crowd.walls, state, seen)
                for kind, (body, scheme) in enumerate(zip(self._kinds, self._method.alone)):
                    rows = seen.rows[kind, : seen.count[kind]]
                    if len(rows):
                        slide_rows(rows, drive, table, body, scheme, state, 1, near, seen.paths, start * parts)
                if near or touching:
                    follow_up(start, stop, drive, table, bodies, hulls, crowd, space.solver, state, seen, self.counts)
                else:
                    self.counts[start:stop, FREE] += 1
        finally:
            self._spaces.give_back(space)

    def statistics(self) -> dict[str, int]:
        """The counts of all worlds together, by name."""
        return {name: int(self.counts[:, column].sum()) for name, column in STATISTICS.items()}
