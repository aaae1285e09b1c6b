"""The planar model of several parts in a world, or walls: by the ways of :mod:`vibgym.physics.collision.multibody`."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from vibgym.physics.collision.coupling import Contacts, Encounter, new_contacts
from vibgym.physics.collision.multibody import (
    CALLS,
    CONTACT,
    COUNTS,
    FREE,
    LOOKED,
    broad_phase,
    new_prospect,
    resolve,
)
from vibgym.physics.contact_area.pressure_moments import LANES
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import Bodies, State
from vibgym.physics.friction.planar import slide_rows
from vibgym.physics.friction.workspace import Scene, Workspace, new_workspace
from vibgym.scene.parts import bodies_of
from vibgym.simulation.contact_space import ContactSpace
from vibgym.simulation.protocol import NO_PATHS, Setup
from vibgym.simulation.schemes import PlanarSchemes
from vibgym.simulation.threads import Pool

STATISTICS = {"free": FREE, "near": LOOKED, "contact": CONTACT, "contact_steps": CALLS}


class Multibody:
    """Advances worlds with several parts or walls.

    Attributes:
        counts: (worlds, 4) periods and solver calls since the reset, see :data:`STATISTICS`.
    """

    def __init__(self, setup: Setup, schemes: PlanarSchemes) -> None:
        self._schemes, self._hulls = schemes, setup.hulls
        self._table, self._bodies = setup.surface.table(), bodies_of(setup.parts)
        self._steps = np.array([scheme.steps for scheme in schemes.alone])
        self._tools = Pool(partial(_make_tools, setup, self._bodies, schemes))
        self.counts = np.zeros((setup.worlds, COUNTS), dtype=np.int64)

    def advance(self, start: int, stop: int, drive: Drive, state: State, periods: int) -> None:
        """Advance worlds ``start`` to ``stop`` by whole periods under a held drive, changing ``state`` in place."""
        table, bodies, schemes = self._table, self._bodies, self._schemes
        parts = state.pose.shape[1]
        prospect = new_prospect(stop - start, parts, self._steps)
        tools = self._tools.borrow()
        alone = [Scene(table, bodies, scheme, drive, state, tools.one) for scheme in schemes.alone]
        encounter = Encounter(
            Scene(table, bodies, schemes.together, drive, state, tools.all), self._hulls, tools.space.solver, tools.contacts,
            schemes.couplings, schemes.overlap, schemes.walls,
        )  # fmt: skip
        try:
            for _ in range(periods):
                near, touching = broad_phase(start, stop, encounter, prospect)
                paths = prospect.paths if near else NO_PATHS
                for kind, scene in enumerate(alone):
                    rows = prospect.rows[kind, : prospect.count[kind]]
                    if len(rows):
                        slide_rows(rows, scene, 1, paths, start * parts)
                if near or touching:
                    resolve(start, stop, encounter, prospect, self.counts)
                else:
                    self.counts[start:stop, FREE] += 1
        finally:
            self._tools.give_back(tools)

    def reset(self) -> None:
        """Begin counting anew."""
        self.counts[:] = 0

    def statistics(self, periods: int) -> dict[str, int]:
        """See :attr:`vibgym.Simulator.statistics`."""
        return {name: int(self.counts[:, column].sum()) for name, column in STATISTICS.items()}


class Tools(NamedTuple):
    """What one thread needs."""

    space: ContactSpace
    contacts: Contacts
    all: Workspace  # of a world's parts together
    one: Workspace  # of any eight parts of one kind


def _make_tools(setup: Setup, bodies: Bodies, schemes: PlanarSchemes) -> Tools:
    table, parts = setup.surface.table(), len(setup.parts)
    return Tools(
        ContactSpace(setup.surface, setup.parts, setup.walls),
        new_contacts(parts, setup.hulls),
        new_workspace(table, bodies, schemes.together, parts),
        new_workspace(table, bodies, schemes.together, LANES),
    )
