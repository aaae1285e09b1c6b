"""The registry of models; the planar model of one part, the averaged model, and ``"auto"``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
from vibgym.physics.core.records import Scheme, State
from vibgym.physics.planar.friction import slide_rows
from vibgym.physics.planar.tipping import edge_fractions
from vibgym.physics.planar.workspace import FIXED_SCENE, FixedScene, new_workspace
from vibgym.registry import Registry
from vibgym.scene.bodies import bodies_of, body_of
from vibgym.scene.outlines import convex_hull
from vibgym.scene.parts import Part, kinds_of
from vibgym.settings import BaseSettings, Length
from vibgym.simulation.choice import DEFAULT_TOLERANCE, choose, choose_for
from vibgym.simulation.model import NO_PATHS, Conditions, Model, Setup
from vibgym.simulation.schemes import (
    AveragedSettings,
    PlanarSettings,
    averaged_scheme,
    check_sliding,
    planar_scheme,
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
    """The planar model of one part in each world."""

    def __init__(self, setup: Setup, scheme: Scheme) -> None:
        super().__init__(setup)
        self._setups = Pool(partial(planar_scene, setup, scheme))
        self._rows = np.arange(setup.worlds)
        self.cost = 1.5 + 0.09 * setup.parts[0].area / setup.surface.element_size**2  # of docs/performance.md

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        rows = self._rows  # a local, since another thread may replace the attribute
        if stop > len(rows):  # used without a simulator, for more worlds
            rows = self._rows = np.arange(stop)
        setup = self._setups.take()
        slide_rows(rows[start:stop], setup.address, drive.address, state.address, periods, NO_PATHS, 0)
        self._setups.give(setup)


def planar_scene(setup: Setup, scheme: Scheme) -> Pinned[FixedScene]:
    """Return the constants and working arrays of one thread."""
    table, bodies = setup.surface.table(setup.walls), bodies_of(setup.parts, setup.surface.element_size)
    return Pinned(FIXED_SCENE, FixedScene(table, bodies, scheme, new_workspace(table, bodies, scheme, LANES)))


class Averaged(Model):
    """The averaged model of one part in each world."""

    def __init__(self, setup: Setup, scheme: AveragedScheme) -> None:
        super().__init__(setup)
        self._table, self._body, self._scheme = setup.surface.table(), body_of(setup.parts[0]), scheme
        self.cost = 1.5
        self._workspaces = Pool(partial(integrator.new_workspace, self._table, self._body))

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        workspace = self._workspaces.take()
        scene = integrator.AveragedScene(self._table, self._body, self._scheme, drive.record, state.record, workspace)
        integrator.advance_worlds(start, stop, scene, periods)
        self._workspaces.give(workspace)

    def check_conditions(self, conditions: Conditions, where: str) -> None:
        """Raise ValueError for conditions under which the part may stick."""
        part, surface = self.setup.parts[0], self.setup.surface
        factors = conditions.strongest[:, 0]
        if len(factors):
            worst = int(np.argmax(factors * part.static_friction * 2.0 * surface.gravity + conditions.slope))
            factor, slope = float(factors[worst]), float(conditions.slope[worst])
            got = f"a factor {factor:g} on friction {part.static_friction:g} and an incline of {slope:.3g} m/s^2"
            name = conditions.stronger if factor > 1.0 else "incline"
            check_sliding(surface, factor * part.static_friction, slope, where.format(name), got)
        super().check_conditions(conditions, where)


class AutoSettings(BaseSettings):
    """Settings of ``"auto"``: the cheapest of the planar and the averaged model within a tolerance
    (:mod:`vibgym.simulation.choice`); :attr:`vibgym.Simulator.choice` reports it, with the reason."""

    tolerance: Length = Field(default=DEFAULT_TOLERANCE, gt=0.0)
    """Deviation of a part's outline from the converged model's in 25 periods, in the median over worlds with random fields."""

    periods_per_call: int = Field(default=1, ge=1, le=checks.MOST_PERIODS)
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
        part = setup.parts[0]
        return Planar(setup, planar_scheme(setup.surface, part, settings, by_points=varies(part)))
    from vibgym.simulation.multibody import Multibody

    return Multibody(setup, settings)


def averaged(setup: Setup, settings: AveragedSettings) -> Model:
    """Return the averaged model.

    Raises:
        ValueError: a scene that the model does not cover.
    """
    if setup.multibody:
        raise checks.conflict("model='averaged' requires one part and no walls: use 'planar', which resolves contacts")
    return Averaged(setup, averaged_scheme(setup.surface, setup.parts[0], settings))


def auto(setup: Setup, settings: AutoSettings) -> Model:
    """Return the cheapest model within a tolerance, see :mod:`vibgym.simulation.choice`.

    Raises:
        ValueError: no model is within the tolerance.
    """
    kinds, _ = kinds_of(setup.parts)
    if setup.multibody or varies(setup.parts[0]):
        choice = choose_for(setup.surface, kinds, ("planar",), **vars(settings))
    else:
        choice = choose(setup.surface, kinds[0], **vars(settings))
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
        kinds, self._kind = kinds_of(setup.parts, Part.same_as)
        hulls = [convex_hull(kind.outline) for kind in kinds]
        self._height = np.array([kind.centre_height for kind in kinds])
        self._hull, self._first = np.concatenate(hulls), np.cumsum([0, *(len(hull) for hull in hulls)])
        self._scene = planar_scene(setup, planar_scheme(setup.surface, setup.parts[0]))

    def __call__(self, drive: Pinned[Drive], state: Pinned[State]) -> np.ndarray:
        """Return (worlds, parts) one minus the worst share; minus infinity for parts that have fallen."""
        shares = np.empty(state.record.fallen.shape)
        hull, first, kind = self._hull, self._first, self._kind
        edge_fractions(self._scene.address, drive.address, state.address, self._height, hull, first, kind, shares)
        return 1.0 - shares
