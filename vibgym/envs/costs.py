"""Costs of a step for safe reinforcement learning: ``costs={"impulse": 1.0, "clearance": {"weight": 0.1, "below_mm": 5}}``.

Costs are computed beside the reward, by the true state, and reported in ``info["costs"]``, weighted and summed in
``info["cost"]``. Those that are not asked for are not computed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.physics.core.drive import Drive
from vibgym.registry import Registry
from vibgym.settings import BaseSettings, Length, read
from vibgym.simulation import Simulator
from vibgym.tasks.episode import Episode, Relations


@dataclass(frozen=True)
class CostStep:
    """What the costs of a step depend on. Arrays are live: do not change or keep them.

    Attributes:
        present: (worlds, parts) bool, parts of the episode.
        fallen: (worlds, parts) bool.
        gap: (worlds, parts) m, distance of each part to the nearest other one; the table's diagonal for a part alone.
        impulse: (worlds, parts) N s, magnitudes of the impulses of contacts with other parts and walls, summed over the periods
            of the step; zeros unless a cost needs them.
        periods: oscillation periods of the step.
    """

    present: np.ndarray
    fallen: np.ndarray
    gap: np.ndarray
    impulse: np.ndarray
    periods: int
    _elements: Callable[[], np.ndarray]

    @property
    def phasors(self) -> np.ndarray:
        """(worlds, rows, columns, 2) last phasors of the elements: amplitude x (cos, sin) of the phase, 1 at full scale."""
        return self._elements()


class Cost(ABC):
    """A cost, registered by ``COSTS.register(name, cls)``; settings are the fields of its ``Settings``.

    Attributes:
        by_part: whether :meth:`measure` returns a value for every part. If not, parts share the value of their world equally.
        needs_impulse: whether :attr:`CostStep.impulse` is computed; steps of several periods are then simulated one by one.
    """

    by_part: ClassVar[bool] = True
    needs_impulse: ClassVar[bool] = False

    class Settings(BaseSettings):
        """Settings of every cost."""

        weight: float = Field(default=1.0, ge=0.0)
        """Weight in the sum of the costs."""

    settings: Settings

    def __init__(self, settings: Settings | None = None) -> None:
        self.settings = type(self).Settings() if settings is None else settings

    @abstractmethod
    def measure(self, now: CostStep) -> np.ndarray:
        """Return the cost of the step, (worlds, parts), or (worlds,) unless :attr:`by_part`. Absent parts cost nothing."""


class Impulse(Cost):
    """Impulse of contacts, N s: the sum over the parts. A contact of two parts counts for both."""

    needs_impulse = True

    def measure(self, now: CostStep) -> np.ndarray:
        return now.impulse


class Fallen(Cost):
    """Number of parts that have fallen; a fall ends the episode."""

    def measure(self, now: CostStep) -> np.ndarray:
        return now.fallen.astype(np.float64)


class Clearance(Cost):
    """Number of parts nearer to another one than a limit, times the periods of the step."""

    class Settings(Cost.Settings):
        """Settings of the clearance."""

        below: Length = Field(default=0.005, gt=0.0)
        """Limit of the distance."""

    settings: Settings

    def measure(self, now: CostStep) -> np.ndarray:
        return now.periods * (now.gap < self.settings.below).astype(np.float64)


class Effort(Cost):
    """Mean square of the elements' amplitudes over full scale, times the periods of the step."""

    by_part = False

    def measure(self, now: CostStep) -> np.ndarray:
        phasors = now.phasors
        return now.periods * np.einsum("wrcx,wrcx->w", phasors, phasors) / (phasors.shape[1] * phasors.shape[2])


COSTS: Registry[type[Cost]] = Registry(
    "cost", {"impulse": Impulse, "fallen": Fallen, "clearance": Clearance, "effort": Effort}
)
"""Costs by name."""


def costs_from(value: Any) -> dict[str, Cost]:
    """Return costs by name from the option: a mapping from names to a weight, or to a mapping of settings.

    Raises:
        ValueError: another value, an unknown name, or a bad setting.
    """
    if not isinstance(value, Mapping) or not value:
        raise checks.refuse("costs", value, f"a mapping with names among {', '.join(COSTS)}")
    costs = {}
    for name, entry in value.items():
        cls = COSTS.choose("costs", name)
        settings = entry if isinstance(entry, Mapping) else {"weight": entry}
        costs[name] = cls(settings=read(cls.Settings, settings, f"costs[{name!r}]"))
    return costs


class Costs:
    """Costs of all worlds.

    Args:
        value: the setting, see :func:`costs_from`.
        simulator: of all worlds.
        episode, relations: of all worlds, live.
        periods: oscillation periods of a step.
        elements: computes :attr:`CostStep.phasors`.

    Attributes:
        needs_impulse: whether steps are simulated by :meth:`advance`.
        total: (worlds,) weighted sum.  part: (worlds, parts) shares of the parts.
        named: (worlds,) by name, before they are weighted.  All are live arrays.

    Raises:
        ValueError: an invalid setting.
    """

    def __init__(
        self,
        value: Any,
        simulator: Simulator,
        episode: Episode,
        relations: Relations,
        periods: int,
        elements: Callable[[], np.ndarray],
    ) -> None:
        self._costs, self._simulator = costs_from(value), simulator
        self._mass = simulator.kinds.values(lambda part: part.mass)
        touches = len(simulator.kinds) > 1 or bool(simulator.walls)
        self.needs_impulse = touches and any(cost.needs_impulse for cost in self._costs.values())
        worlds, parts = self._shape = episode.present.shape
        impulse = np.zeros(self._shape)
        self._step = CostStep(episode.present, episode.part_fallen, relations.gap, impulse, periods, elements)
        self.total, self.part = np.zeros(worlds), np.zeros(self._shape)
        self.named = {name: np.zeros(worlds) for name in self._costs}

    def live(self) -> dict[str, np.ndarray]:
        """Return live arrays for snapshots."""
        named = {f"cost_{name}": values for name, values in self.named.items()}
        return {"cost": self.total, "part_cost": self.part, **named}

    def begin(self, worlds: np.ndarray) -> None:
        """Begin episodes in ``worlds`` (index array)."""
        for values in self.live().values():
            values[worlds] = 0.0

    def advance(self, drive: Drive, periods: int, after: Any = ()) -> None:
        """Advance the simulator as its ``advance_drive`` does, and add up the impulses of the periods."""
        state = self._simulator.state
        for left in range(periods - 1, -1, -1):
            self._simulator.advance_drive(drive, 1, after if left == 0 else ())
            self._step.impulse[...] += state.mass * self._mass * np.hypot(state.pushed[..., 0], state.pushed[..., 1])

    def score(self) -> None:
        """Compute the costs of the step that has just been scored.

        Raises:
            ValueError: a cost of a wrong shape or type, or with values that are not finite.
        """
        step, parts = self._step, self._shape[1]
        self.total[:], self.part[:] = 0.0, 0.0
        for name, cost in self._costs.items():
            weight = cost.settings.weight
            shape = self._shape if cost.by_part else self._shape[:1]
            values = checks.shaped(f"cost {name!r}", cost.measure(step), (shape,), "an array of numbers", kinds="bfiu")
            if not np.isfinite(values).all():
                raise checks.refuse(f"cost {name!r}", values[~np.isfinite(values)][0], "finite numbers")
            if cost.by_part:
                values = np.where(step.present, values, 0.0)
                self.part += weight * values
                # Part by part, so that the sum does not depend on the number of worlds.
                self.named[name][:] = sum(values[:, part] for part in range(parts))
            else:
                self.part += weight * values[:, None] * step.present / np.maximum(step.present.sum(axis=1), 1)[:, None]
                self.named[name][:] = values
            self.total += weight * self.named[name]
        step.impulse[...] = 0.0
