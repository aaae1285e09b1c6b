"""The models: what :class:`vibgym.Simulator` advances worlds with, one protocol for all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.kernels.vector import LANES
from vibgym.physics.averaged import contact, integrator
from vibgym.physics.averaged.contact import AveragedScheme
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import Scheme, State
from vibgym.physics.planar.friction import slide_rows
from vibgym.physics.planar.workspace import FIXED_SCENE, FixedScene, new_workspace
from vibgym.scene.parts import bodies_of, kinds_of
from vibgym.simulation.conditions import Conditions
from vibgym.simulation.protocol import NO_PATHS, InPlane, Model, NoContacts, Setup
from vibgym.simulation.schemes import averaged_scheme, check_knobs, check_sliding, planar_scheme, planar_schemes
from vibgym.simulation.threads import Pool


class Planar(InPlane, NoContacts):
    """The planar model of one part a world."""

    def __init__(self, setup: Setup, scheme: Scheme) -> None:
        self._setups = Pool(partial(_planar_setup, setup, scheme))
        self._rows = np.arange(setup.worlds)

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        """See :class:`Model`. The compiled code is that of worlds with several parts, to the last bit."""
        rows = self._rows  # its own: another thread may change the attribute, to shorter ones as well
        if stop > len(rows):  # of somebody who takes a model alone, for as many worlds as there are
            rows = self._rows = np.arange(stop)
        setup = self._setups.take()
        slide_rows(rows[start:stop], setup.address, drive.address, state.address, periods, NO_PATHS, 0)
        self._setups.give(setup)

    def check_conditions(self, conditions: Conditions, where: str) -> None:
        """It covers all."""


def _planar_setup(setup: Setup, scheme: Scheme) -> Pinned[FixedScene]:
    """What one thread needs."""
    table, bodies = setup.surface.table(), bodies_of(setup.parts, setup.surface.element_size)
    return Pinned(FIXED_SCENE, FixedScene(table, bodies, scheme, new_workspace(table, bodies, scheme, LANES)))


class Averaged(InPlane, NoContacts):
    """The averaged model, of one part a world."""

    def __init__(self, setup: Setup, scheme: AveragedScheme) -> None:
        self._setup = setup
        self._table, self._body, self._scheme = setup.surface.table(), setup.parts[0].body(), scheme
        self._workspaces = Pool(partial(contact.new_workspace, self._table, self._body))

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        """See :class:`Model`."""
        workspace = self._workspaces.take()
        scene = integrator.AveragedScene(self._table, self._body, self._scheme, drive.record, state.record, workspace)
        integrator.advance_worlds(start, stop, scene, periods)
        self._workspaces.give(workspace)

    def check_conditions(self, conditions: Conditions, where: str) -> None:
        """Refuse those under which the part may stick."""
        part = self._setup.parts[0]
        factors = conditions.strongest[:, 0]
        if not len(factors):
            return
        worst = int(np.argmax(factors * part.static_friction * 2.0 * self._setup.surface.gravity + conditions.slope))
        factor, slope = float(factors[worst]), float(conditions.slope[worst])
        got = f"a factor {factor:g} on friction {part.static_friction:g} and an incline of {slope:.3g} m/s^2"
        name = conditions.stronger if factor > 1.0 else "incline"
        check_sliding(self._setup.surface, factor * part.static_friction, slope, where.format(name), got)


def planar(setup: Setup, knobs: Mapping[str, Any]) -> Model:
    """The planar model, for one part or for several."""
    if not setup.multibody:
        check_knobs("planar", planar_scheme, knobs)
        return Planar(setup, planar_scheme(setup.surface, setup.parts[0], **knobs))
    from vibgym.simulation.multibody import Multibody  # pymunk is loaded where there are contacts

    check_knobs("planar", planar_schemes, knobs)
    return Multibody(setup, planar_schemes(setup.surface, kinds_of(setup.parts)[0], setup.walls, **knobs))


def averaged(setup: Setup, knobs: Mapping[str, Any]) -> Model:
    """The averaged model."""
    if setup.multibody:
        raise checks.refuse("model", "averaged", "'planar' with several parts or walls: contacts are resolved in time")
    check_knobs("averaged", averaged_scheme, knobs)
    return Averaged(setup, averaged_scheme(setup.surface, setup.parts[0], **knobs))


def tilting(setup: Setup, knobs: Mapping[str, Any]) -> Model:
    """The model above the plane, for one part or for several."""
    from vibgym.simulation.tilting import Tilting, scheme_of  # its kernels are loaded where they are needed

    check_knobs("tilting", scheme_of, knobs)
    scheme = scheme_of(setup.surface, **knobs)
    if not setup.multibody:
        return Tilting(setup, planar_scheme(setup.surface, setup.parts[0]), scheme)
    from vibgym.simulation.tilting_multibody import TiltingMultibody

    return TiltingMultibody(setup, planar_schemes(setup.surface, kinds_of(setup.parts)[0], setup.walls), scheme)


MODELS: Mapping[str, Callable[[Setup, Mapping[str, Any]], Model]] = {
    "planar": planar,
    "averaged": averaged,
    "tilting": tilting,
}
"""By name. Each raises ValueError for a knob that the model does not have, a bad value, or a scene that it does not cover."""
