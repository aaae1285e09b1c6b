"""``randomize=``: conditions drawn for every episode from the world's generator, and impulse disturbances during an episode.

``info["drawn"]`` reports the conditions, ``info["parts"]["disturbed"]`` the disturbances.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from vibgym import checks
from vibgym.actuators.stage import ActuatorStage
from vibgym.physics.core.noise import KEY_DRAWS, keys_from
from vibgym.physics.planar.impulse import begin_waiting, disturb_parts
from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.settings import Angle, BaseSettings, in_si, read, with_unit
from vibgym.simulation import Conditions, Simulator
from vibgym.simulation.model import MAX_FACTOR, MIN_FACTOR

STEEPEST = 0.2
"""rad, largest incline; the normal load, which is not changed, would be 2 % smaller."""

MAX_RATE, MAX_TILT = 100.0, math.radians(45.0)
"""Largest rate (1/s) and tilt (rad) of disturbances."""

EFFECTS = ("friction", "mass", "incline", "patches")
"""Conditions by their name in ``randomize=`` and in :meth:`vibgym.Simulator.set_conditions`, in the order of drawing."""


Factor = Annotated[float, Field(ge=MIN_FACTOR, le=MAX_FACTOR)]
Incline = Annotated[Angle, Field(ge=0.0, le=STEEPEST)]
Tilt = Annotated[Angle, Field(ge=0.0, le=MAX_TILT)]


class Ranges(BaseSettings):
    """Settings whose pairs of numbers are ranges [low, high]."""

    @model_validator(mode="after")
    def _ascending(self) -> Ranges:
        for name, value in self:
            if isinstance(value, tuple) and value[0] > value[1]:
                raise checks.refuse(name, list(value), "[low, high] with low <= high")
        return self


class Disturbance(Ranges):
    """Settings of impulse disturbances."""

    rate: float = Field(ge=0.0, le=MAX_RATE)
    """Mean number of disturbances of each part, 1/s."""

    tilt: Tilt | tuple[Tilt, Tilt]
    """Tilt of a part that is disturbed, or its range [low, high]."""

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest tilt, rad."""
        return self.tilt if isinstance(self.tilt, tuple) else (self.tilt, self.tilt)


class Randomization:
    """Conditions that an environment draws for every episode.

    Args:
        setting: the keyword argument: None, or a mapping from names to ranges.
        of_task: further keys, drawn by the task.
        actuators: draw the settings in their ``VARIED``.
        surface: the table.
        parts: of a world.

    Attributes:
        task, actuators: settings of these keys.
        disturbance: settings of impulse disturbances, or None.
        ranges: lowest and highest value of every effect, in the order of :data:`EFFECTS`.
        draws: uniform numbers per episode.

    Raises:
        ValueError: an unknown key, an invalid range, or a tilt that topples a part.
    """

    class Settings(Ranges):
        """Conditions of every task; a setting that is not given is not drawn."""

        friction: tuple[Factor, Factor] | None = None
        """Range of the factor on each part's friction."""

        mass: tuple[Factor, Factor] | None = None
        """Range of the factor on each part's mass."""

        incline: Incline | tuple[Incline, Incline] | None = None
        """Range of the angle to the horizontal, in a random direction; one angle is the upper end."""

        patches: tuple[Factor, Factor] | None = None
        """Range of the factor on the friction of each element."""

        disturbance: Disturbance | None = None
        """Impulse disturbances during an episode."""

    def __init__(
        self, setting: Any, of_task: Sequence[str], actuators: ActuatorStage, surface: Surface, parts: Sequence[Part]
    ) -> None:
        known = (*self.Settings.model_fields, *actuators.VARIED, *of_task)
        setting = {} if setting is None else setting
        if not isinstance(setting, Mapping):
            raise checks.refuse("randomize", setting, f"None, or a mapping with keys among {', '.join(known)}")
        here = {*self.Settings.model_fields, *with_unit(self.Settings)}
        own = read(self.Settings, {name: value for name, value in setting.items() if name in here}, "randomize")
        with checks.within("randomize"):
            others = in_si(actuators.Settings, {name: value for name, value in setting.items() if name not in here})
        for name in others:
            if name not in known:
                raise checks.unknown("key", name, known, of="randomize")
        self._surface, self._parts = surface, len(parts)
        self.task = {name: others[name] for name in of_task if name in others}
        self.actuators = {name: others[name] for name in actuators.VARIED if name in others}
        ranges = {name: getattr(own, name) for name in EFFECTS}
        self.ranges: dict[str, tuple[float, float]] = {
            name: ends if isinstance(ends, tuple) else (0.0, ends) for name, ends in ranges.items() if ends is not None
        }
        self.disturbance = own.disturbance
        if own.disturbance is not None:
            check_tilt(own.disturbance.range[1], parts)
        draws = dict.fromkeys(EFFECTS, self._parts) | {"incline": 2, "patches": surface.rows * surface.columns}
        self._draws = {name: draws[name] for name in self.ranges}
        self.draws = sum(self._draws.values())

    def values(self, uniform: np.ndarray) -> dict[str, np.ndarray]:
        """Return values of n worlds, by name, from ``uniform`` (n, draws) in [0, 1)."""
        drawn, at, surface = {}, 0, self._surface
        for name, (low, high) in self.ranges.items():
            own = uniform[:, at : at + self._draws[name]]
            at += self._draws[name]
            if name == "incline":  # by a uniform angle in a uniform direction
                size, turn = surface.gravity * np.sin(low + (high - low) * own[:, 0]), 2.0 * math.pi * own[:, 1]
                drawn[name] = size[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            else:
                drawn[name] = low + (high - low) * own
        if "patches" in drawn:
            drawn["patches"] = drawn["patches"].reshape(-1, surface.rows, surface.columns)
        return drawn

    def extremes(self) -> Conditions:
        """Return the extremes of these ranges, a row per part: this part heaviest, all others lightest."""
        parts, lowest = self._parts, {name: low for name, (low, _) in self.ranges.items()}
        highest = {name: high for name, (_, high) in self.ranges.items()}
        incline = [self._surface.gravity * np.sin(highest.get("incline", 0.0)), 0.0]
        return Conditions(
            friction=np.full((parts, parts), highest.get("friction", 1.0)),
            mass=np.where(np.eye(parts, dtype=bool), highest.get("mass", 1.0), lowest.get("mass", 1.0)),
            incline=np.tile(incline, (parts, 1)),
            patches=np.full((parts, 1, 1), highest.get("patches", 1.0)),
        )


def check_tilt(tilt: float, parts: Sequence[Part]) -> None:
    """Check that a tilt of disturbances, rad, topples no part."""
    for part in Kinds.of(parts).every:
        steepest = math.atan(1.0 / part.slenderness) if part.slenderness > 0.0 else math.inf
        if tilt >= steepest:
            most = f"less than {math.degrees(steepest):.3g} deg, which topples {part.name!r}"
            raise checks.refuse("randomize.disturbance.tilt", f"{math.degrees(tilt):.3g} deg", most)


class Disturbances:
    """Impulse disturbances of parts at random times.

    Models with tilt release a disturbed part from a tilt. Others apply an impulse with the statistics of the tilt's effect
    (:mod:`vibgym.physics.planar.impulse`).

    Args:
        settings: rate and tilt.
        simulator: of the parts.
        span: s, of a step.

    Attributes:
        disturbed: (worlds, parts) rad, tilt of a part that was disturbed in the last step, else 0; live.
    """

    draws = KEY_DRAWS

    def __init__(self, settings: Disturbance, simulator: Simulator, span: float) -> None:
        self._settings, self._simulator, self._span = settings, simulator, span
        shape = simulator.worlds, len(simulator.kinds)
        self._key = np.zeros((shape[0], KEY_DRAWS), dtype=np.int64)
        self._count = np.zeros(shape, dtype=np.int64)
        self._wait = np.zeros(shape)
        self.disturbed = np.zeros(shape)
        self._lean, self._impulse = np.zeros((*shape, 2)), np.zeros((*shape, 3))

    def live(self) -> dict[str, np.ndarray]:
        """Return live arrays for snapshots."""
        live = {"key": self._key, "count": self._count, "wait": self._wait, "disturbed": self.disturbed}
        return {f"disturbance_{name}": values for name, values in live.items()}

    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Begin episodes in ``worlds`` (index array), with uniform numbers (n, draws) in [0, 1)."""
        self._key[worlds], self.disturbed[worlds] = keys_from(uniform), 0.0
        begin_waiting(worlds, self._key, self._settings.rate, self._wait, self._count)

    def disturb(self, present: np.ndarray) -> None:
        """Disturb the parts whose waiting time ends in this step; ``present``: (worlds, parts) bool."""
        state, settings = self._simulator.state, self._settings
        away = state.fallen | state.diverged[:, None] | ~present
        if disturb_parts(
            self._key, settings.rate, *settings.range, self._span, away, self._wait, self._count, self._lean,
            self._impulse,
        ):  # fmt: skip
            self._simulator.disturb(self._lean, self._impulse)
        np.hypot(self._lean[..., 0], self._lean[..., 1], out=self.disturbed)
