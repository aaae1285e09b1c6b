"""Parts without contacts: constants and working arrays for groups of eight, by the scheme of their kinds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from vibgym.kernels.reference import Pinned
from vibgym.kernels.vector import LANES
from vibgym.physics.core.records import Scheme
from vibgym.physics.planar.workspace import FIXED_SCENE, FixedScene, new_workspace
from vibgym.scene.bodies import bodies_of
from vibgym.simulation.model import Setup


class Alone:
    """Constants of one thread for each different scheme; working arrays are shared.

    Args:
        schemes: of the kinds.

    Attributes:
        scenes: the constants.
    """

    def __init__(self, setup: Setup, schemes: Sequence[Scheme]) -> None:
        table, bodies = setup.surface.table(setup.walls), bodies_of(setup.parts, setup.surface.element_size)
        most = max(schemes, key=lambda scheme: scheme.substeps)  # for the size of the working arrays
        workspace, different = new_workspace(table, bodies, most, LANES), {scheme[:3]: scheme for scheme in schemes}
        self.scenes = [
            Pinned(FIXED_SCENE, FixedScene(table, bodies, scheme, workspace)) for scheme in different.values()
        ]
        self._kinds = [[k for k, scheme in enumerate(schemes) if scheme[:3] == steps] for steps in different]
        self._of_kind = np.array([list(different).index(scheme[:3]) for scheme in schemes])
        # Parts in a group have the same elements more often if they are alike, and take as long as that with the most corners.
        corners = np.diff(bodies.first)
        self._rank = np.empty(len(corners), dtype=np.int64)
        self._rank[np.lexsort((bodies.radius, corners, self._of_kind))] = np.arange(len(corners))
        self._kind = bodies.kind

    def split(self, rows: np.ndarray, count: np.ndarray) -> Iterator[tuple[Pinned[FixedScene], np.ndarray]]:
        """Yield constants, and the rows of parts that they are for.

        Args:
            rows: (kinds, n) parts as ``world * parts + part``, of which the first ``count`` (kinds,) are used.
        """
        numbers = count.tolist()
        for scene, kinds in zip(self.scenes, self._kinds):
            worlds = [rows[kind, : numbers[kind]] for kind in kinds if numbers[kind]]
            if worlds:
                yield scene, worlds[0] if len(worlds) == 1 else np.concatenate(worlds)

    def sort(self, rows: np.ndarray) -> Sequence[tuple[Pinned[FixedScene], np.ndarray]]:
        """Return constants, and the rows of parts that they are for; ``rows``: (n,) of worlds with one part each."""
        if len(self._of_kind) == 1:
            return ((self.scenes[0], rows),)
        kind = self._kind[rows, 0]
        order = np.argsort(self._rank[kind], kind="stable")
        rows, scheme = rows[order], self._of_kind[kind[order]]
        return [(scene, rows[scheme == number]) for number, scene in enumerate(self.scenes)]
