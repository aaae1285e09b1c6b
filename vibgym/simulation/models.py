"""The registry of models; the planar model of one part, the averaged model, and ``"auto"``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.kernels.vector import LANES
from vibgym.physics.averaged import integrator
from vibgym.physics.averaged.integrator import AveragedScheme
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import Body, Scheme, State, Table
from vibgym.physics.planar.friction import slide_rows
from vibgym.physics.planar.tipping import edge_fractions
from vibgym.physics.planar.workspace import FIXED_SCENE, FixedScene, new_workspace
from vibgym.registry import Registry
from vibgym.scene.bodies import bodies_of, body_of
from vibgym.scene.outlines import convex_hull
from vibgym.settings import BaseSettings, Length
from vibgym.simulation.alone import Alone
from vibgym.simulation.choice import DEFAULT_TOLERANCE, choose, choose_for
from vibgym.simulation.model import NO_PATHS, Conditions, Model, Setup
from vibgym.simulation.schemes import (
    AveragedSettings,
    PlanarSettings,
    averaged_scheme,
    check_sliding,
    planar_scheme,
    schemes_alone,
    varies,
)
from vibgym.simulation.threads import Pool


def has_fast_contacts(model: str | Mapping[str, Any]) -> bool:
    """Return whether the ``model`` argument of an environment selects fast contacts."""
    return not isinstance(model, str) and model.get("contacts") == "fast"


def with_certified_contacts(model: str | Mapping[str, Any]) -> str | Mapping[str, Any]:
    """Return the ``model`` argument of an environment without ``contacts``, whose default is certified."""
    return model if isinstance(model, str) else {name: value for name, value in model.items() if name != "contacts"}


class Planar(Model):
    """The planar model of one part in each world.

    Args:
        schemes: of the kinds.
    """

    def __init__(self, setup: Setup, schemes: Sequence[Scheme]) -> None:
        super().__init__(setup)
        self._setups, self._sorted = Pool(partial(alone_of, setup, schemes)), len(schemes) > 1
        self._rows = np.arange(setup.worlds)
        area = max(kind.area for kind in setup.parts.every)
        self.cost = 1.5 + 0.09 * area / setup.surface.element_size**2  # of docs/performance.md

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        rows = self._rows  # a local, since another thread may replace the attribute
        if stop > len(rows):  # used without a simulator, for more worlds
            rows = self._rows = np.arange(stop)
        setup = self._setups.take()
        rows = rows[start:stop]
        for alone, chosen in setup.sort(rows) if self._sorted else ((setup.scenes[0], rows),):
            slide_rows(chosen, alone.address, drive.address, state.address, periods, NO_PATHS, 0)
        self._setups.give(setup)


def alone_of(setup: Setup, schemes: Sequence[Scheme]) -> Alone:
    """Return the constants and working arrays of one thread."""
    return Alone(setup.surface.table(setup.walls), bodies_of(setup.parts, setup.surface.element_size), schemes)


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


class AutoSettings(BaseSettings):
    """Settings of ``"auto"``: the cheapest of the planar and the averaged model within a tolerance
    (:mod:`vibgym.simulation.choice`); :attr:`vibgym.Simulator.choice` reports it, with the reason."""

    tolerance: Length = Field(default=DEFAULT_TOLERANCE, gt=0.0)
    """Deviation of a part's outline from the converged model's in 25 periods, in the median over worlds with random fields."""

    periods_per_call: int = Field(default=1, ge=1, le=checks.MAX_PERIODS)
    """Periods of a typical call of :meth:`vibgym.Simulator.advance`."""


def planar(setup: Setup, settings: PlanarSettings) -> Model:
    """Return the planar model.

    Raises:
        ValueError: a setting or scene that the model does not cover.
    """
    if not setup.multibody:
        for name in ("contacts", "contact_steps", "contact_overlap"):
            if getattr(settings, name) not in ("auto", "certified"):
                raise checks.conflict(f"{name} requires several parts or walls")
        return Planar(setup, schemes_alone(setup.surface, setup.parts.every, settings))
    from vibgym.simulation.multibody import Multibody

    return Multibody(setup, settings)


def averaged(setup: Setup, settings: AveragedSettings) -> Model:
    """Return the averaged model.

    Raises:
        ValueError: a scene that the model does not cover.
    """
    if setup.multibody:
        raise checks.conflict("model='averaged' requires one part and no walls: use 'planar', which resolves contacts")
    schemes = [averaged_scheme(setup.surface, kind, settings) for kind in setup.parts.every]
    return Averaged(setup, schemes[0])


def auto(setup: Setup, settings: AutoSettings) -> Model:
    """Return the cheapest model within a tolerance, see :mod:`vibgym.simulation.choice`.

    Raises:
        ValueError: no model is within the tolerance.
    """
    one, *others = setup.parts.every
    if setup.multibody or others or varies(one):
        choice = choose_for(setup.surface, [one, *others], ("planar",), **vars(settings))
    else:
        choice = choose(setup.surface, one, **vars(settings))
    model: Model = MODELS.make("model", {"kind": choice.model, **choice.knobs}, replace(setup, model=choice.model))
    model.choice = choice
    return model


for _model, _settings in ((planar, PlanarSettings), (averaged, AveragedSettings), (auto, AutoSettings)):
    _model.Settings = _settings  # type: ignore[attr-defined]

MODELS: Registry[Callable[..., Model]] = Registry(
    "model", {"planar": planar, "averaged": averaged, "auto": auto}, "vibgym.models"
)
"""Models by name, called with a :class:`Setup` and their ``Settings``; ``MODELS.register(name, cls)`` adds one."""


class TippingMargin:
    """Function that computes :attr:`vibgym.Simulator.tipping_margin`."""

    def __init__(self, setup: Setup) -> None:
        kinds = setup.parts.every
        hulls = [convex_hull(kind.outline) for kind in kinds]
        self._height = np.array([kind.centre_height for kind in kinds])
        self._hull, self._first = np.concatenate(hulls), np.cumsum([0, *(len(hull) for hull in hulls)])
        table, bodies = setup.surface.table(setup.walls), bodies_of(setup.parts, setup.surface.element_size)
        scheme = planar_scheme(setup.surface, kinds[0])
        self._scene = Pinned(
            FIXED_SCENE, FixedScene(table, bodies, scheme, new_workspace(table, bodies, scheme, LANES))
        )

    def __call__(self, drive: Pinned[Drive], state: Pinned[State]) -> np.ndarray:
        """Return (worlds, parts) one minus the worst share; minus infinity for parts that have fallen."""
        shares = np.empty(state.record.fallen.shape)
        scene, parts = self._scene.address, (self._height, self._hull, self._first)
        edge_fractions(scene, drive.address, state.address, *parts, shares)
        return 1.0 - shares
