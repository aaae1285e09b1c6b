"""The planar model with fast contacts, for training, see :mod:`vibgym.physics.contacts.fast`."""

from __future__ import annotations

from functools import partial
from typing import ClassVar

from vibgym.kernels.reference import Pinned
from vibgym.physics.contacts.fast import (
    FAST_SCENE,
    ROWS,
    FastScene,
    Rows,
    drive_together,
    find_rows,
    new_fast_contacts,
    new_rows,
)
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import State
from vibgym.physics.planar.friction import slide_rows
from vibgym.physics.planar.workspace import FixedScene, new_workspace
from vibgym.scene.bodies import bodies_of
from vibgym.scene.hulls import hulls_of
from vibgym.simulation.alone import Alone
from vibgym.simulation.contact_parts import check_parts, impact_properties_of, slop_of
from vibgym.simulation.model import NO_PATHS, Setup
from vibgym.simulation.multibody import Multibody
from vibgym.simulation.schemes import PlanarSchemes
from vibgym.simulation.threads import Pool

SLOTS = 32
"""Parts of several worlds that friction moves together; more do not fit into the nearest cache."""


class FastMultibody(Multibody):
    """Advances worlds with several parts or walls, with fast contacts."""

    WHOLE: ClassVar[bool] = False
    """Whether all parts of a world advance with contacts where any of them are near, or those parts alone."""

    def __init__(self, setup: Setup, schemes: PlanarSchemes, buffers: type[FastBuffers] | None = None) -> None:
        check_parts(setup.parts)
        super().__init__(setup, schemes, Pool(partial(buffers or FastBuffers, setup, schemes)))

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        def work(buffers: FastBuffers) -> None:
            rows = buffers.rows(stop - start)
            deepest, together = buffers.contacts.deepest, buffers.together.address
            deepest[0] = self._smallest_gap[start]
            inputs = drive.address, state.address
            for _ in range(periods):
                find_rows(start, stop, together, state.address, rows.address, self.WHOLE)
                for alone, free in buffers.alone.split(rows.record.rows, rows.record.count):
                    slide_rows(free, alone.address, *inputs, 1, NO_PATHS, 0)
                self.drive(start, stop, buffers, drive, state, rows)  # not diverged worlds
            self._smallest_gap[start] = deepest[0]

        self._buffers.lend(work)

    def drive(
        self,
        start: int,
        stop: int,
        buffers: FastBuffers,
        drive: Pinned[Drive],
        state: Pinned[State],
        rows: Pinned[Rows],
    ) -> None:
        """Advance the parts with near pairs of worlds ``start`` to ``stop`` by a period."""
        together = buffers.together.address
        drive_together(start, stop, together, drive.address, state.address, rows.address, self.counts)


class FastBuffers:
    """Constants and working arrays of one thread.

    Attributes:
        together: constants for parts that may touch.
        contacts: working arrays of contacts.
        alone: the same for eight parts without contacts.
    """

    def __init__(self, setup: Setup, schemes: PlanarSchemes) -> None:
        table, bodies = setup.surface.table(setup.walls), bodies_of(setup.parts, setup.surface.element_size)
        self._shape, hulls = (len(setup.parts), len(schemes.alone)), hulls_of(setup.parts)
        finest = max(schemes.alone, key=lambda scheme: scheme.steps)
        most = max(schemes.alone, key=lambda scheme: scheme.substeps)  # for the size of the working arrays
        workspace = new_workspace(table, bodies, most, max(len(setup.parts), SLOTS))
        self.contacts = new_fast_contacts(len(setup.parts), len(workspace.away), hulls)
        together = FastScene(
            friction=FixedScene(table, bodies, finest, workspace),
            hulls=hulls,
            properties=impact_properties_of(setup.parts),
            contacts=self.contacts,
            couplings=-(-schemes.fewest // finest.steps),
            slop=min(slop_of(kind) for kind in setup.parts.every),
            walls=schemes.walls,
        )
        self.together = Pinned(FAST_SCENE, together)
        self.alone = Alone(table, bodies, schemes.alone)
        self._rows: dict[int, Pinned[Rows]] = {}

    def rows(self, worlds: int) -> Pinned[Rows]:
        """Return lists of parts for a block of ``worlds``."""
        if worlds not in self._rows:
            self._rows[worlds] = Pinned(ROWS, new_rows(worlds, *self._shape))
        return self._rows[worlds]
