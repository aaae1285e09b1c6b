"""The registry of models; the planar model of one part, and ``"auto"``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import Scheme, State
from vibgym.physics.planar.friction import slide_rows
from vibgym.registry import Registry
from vibgym.settings import BaseSettings, Length
from vibgym.simulation.alone import Alone
from vibgym.simulation.averaged import averaged
from vibgym.simulation.choice import DEFAULT_TOLERANCE, choose, choose_for
from vibgym.simulation.model import NO_PATHS, Model, Setup
from vibgym.simulation.schemes import AveragedSettings, PlanarSettings, schemes_alone, varies
from vibgym.simulation.threads import Pool


class Planar(Model):
    """The planar model of one part in each world.

    Args:
        schemes: of the kinds.
    """

    def __init__(self, setup: Setup, schemes: Sequence[Scheme]) -> None:
        super().__init__(setup)
        self._setups, self._sorted = Pool(partial(Alone, setup, schemes)), len(schemes) > 1
        self._rows = np.arange(setup.worlds)
        area = max(kind.area for kind in setup.parts.every)
        self.cost = 1.5 + 0.09 * area / setup.surface.element_size**2  # of docs/performance.md

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        rows = self._rows  # a local, since another thread may replace the attribute
        if stop > len(rows):  # used without a simulator, for more worlds
            rows = self._rows = np.arange(stop)
        try:  # as Pool.lend does, without its calls
            setup = self._setups.free.pop()
        except IndexError:
            setup = self._setups.make()
        rows = rows[start:stop]
        for alone, chosen in setup.sort(rows) if self._sorted else ((setup.scenes[0], rows),):
            slide_rows(chosen, alone.address, drive.address, state.address, periods, NO_PATHS, 0)
        self._setups.free.append(setup)


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
