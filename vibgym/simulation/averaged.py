"""The averaged model of one part."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.physics.averaged import integrator
from vibgym.physics.averaged.integrator import AveragedScheme
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import Body, State, Table
from vibgym.scene.bodies import body_of
from vibgym.simulation.model import Conditions, Model, Setup
from vibgym.simulation.schemes import AveragedSettings, averaged_scheme, check_sliding
from vibgym.simulation.threads import Pool


class Averaged(Model):
    """The averaged model of one part in each world."""

    def __init__(self, setup: Setup, scheme: AveragedScheme) -> None:
        super().__init__(setup)
        self._table, self._scheme = setup.surface.table(), scheme
        self._bodies = [body_of(kind) for kind in setup.parts.every]
        self.cost = 1.5
        self._workspaces = Pool(partial(new_workspaces, self._table, self._bodies))

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        def work(workspaces: list[integrator.AveragedWorkspace]) -> None:
            constants, inputs, kinds = (self._table, self._scheme), (drive.record, state.record), self.setup.parts
            first = start
            while first < stop:
                kind = int(kinds.kind[first if kinds.vary else 0, 0])
                last = first + 1 if kinds.vary else stop
                scene = integrator.AveragedScene(
                    constants[0], self._bodies[kind], constants[1], *inputs, workspaces[kind]
                )
                integrator.advance_worlds(first, last, scene, periods)
                first = last

        self._workspaces.lend(work)

    def check_conditions(self, conditions: Conditions, where: str) -> None:
        """Raise ValueError for conditions under which the part may stick."""
        surface = self.setup.surface
        part = self.setup.parts.largest(lambda part: part.static_friction)[0]
        factors = conditions.strongest[:, 0]
        if len(factors):
            worst = int(np.argmax(factors * part.static_friction * 2.0 * surface.gravity + conditions.slope))
            factor, slope = float(factors[worst]), float(conditions.slope[worst])
            got = f"a factor {factor:g} on friction {part.static_friction:g} and an incline of {slope:.3g} m/s^2"
            name = conditions.stronger if factor > 1.0 else "incline"
            check_sliding(surface, factor * part.static_friction, slope, where.format(name), got)
        super().check_conditions(conditions, where)


def new_workspaces(table: Table, bodies: Sequence[Body]) -> list[integrator.AveragedWorkspace]:
    """Return working arrays of one thread for each kind of parts."""
    return [integrator.new_workspace(table, body) for body in bodies]


def averaged(setup: Setup, settings: AveragedSettings) -> Model:
    """Return the averaged model.

    Raises:
        ValueError: a scene that the model does not cover.
    """
    if setup.multibody:
        raise checks.conflict("model='averaged' requires one part and no walls: use 'planar', which resolves contacts")
    schemes = [averaged_scheme(setup.surface, kind, settings) for kind in setup.parts.every]
    return Averaged(setup, schemes[0])
