"""Tasks with several parts a world: the common core of Sort and Singulate."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from vibgym import checks
from vibgym.physics.core.records import State
from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.arrange import CLEAR, START_NUMBERS, TRIES, Room, draw_starts, lattice
from vibgym.tasks.base import Start, Task
from vibgym.tasks.crowd import TERMS, CrowdRules, CrowdScore, begin_crowd, new_crowd_score, score_crowd
from vibgym.tasks.pose import HOLD_STEPS
from vibgym.tasks.zones import check_room, kinds_by_name, zones_from

STARTS = tuple(START_NUMBERS)


class ManyTask(Task):
    """Several parts, each done under conditions that all of them have to meet at once for 10 steps.

    Args:
        surface: the table.
        parts: the parts; those with the same name are of one kind, and there are at most three kinds.
        start: ``"scattered"`` (random poses at least 2 mm apart) or ``"crowded"`` (one cluster, in touch).
        zones: for tasks with zones, a mapping from kind to [x_low, y_low, x_high, y_high], m; None for end zones.
        randomize: ``{"parts": [low, high]}``: so many of the parts, chosen at random, are there in an episode.
        slots: blocks of the state observation, at least the number of parts, which is the default.

    Attributes:
        names: (kinds,) of the kinds.  kind: (parts,) of each part.
        zones: (kinds, 4) m, or None for tasks without.
        slots: as above.

    Raises:
        ValueError: a bad setting, or too little room on the surface or in a zone.
    """

    MANY = True
    TERMS = TERMS
    DEFAULT_PARTS = ("steel_block", "aluminium_block") * 3
    ZONES: ClassVar[bool]
    SPEED: ClassVar[float] = math.inf
    """Below which a part is done, m/s."""

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        *,
        start: str = "scattered",
        zones: Any = None,
        randomize: Any = None,
        slots: int | None = None,
    ) -> None:
        self.surface, self.parts = surface, tuple(parts)
        checks.choice("start", start, STARTS)
        self.names, self.kind = kinds_by_name(self.parts)
        self.fewest, self.most = _number_present(randomize, len(self.parts))
        self.slots = len(self.parts) if slots is None else checks.count("slots", slots, least=len(self.parts))
        apart = self.apart()
        cells = self._cells(max(CLEAR if start == "scattered" else 0.0, apart))
        self.zones = zones_from(zones, surface, self.names) if self.ZONES else None
        if self.zones is not None:
            check_room(self.zones, self.parts, self.names, self.kind, self.most)
        own = np.tile([-math.inf, -math.inf, math.inf, math.inf], (len(self.parts), 1))
        far = math.hypot(surface.width, surface.height)
        self.rules = CrowdRules(
            own if self.zones is None else self.zones[self.kind], self.SPEED, apart, far, HOLD_STEPS
        )
        self.hulls = hulls_of(self.parts)
        self.crowded = start == "crowded"
        self.draws = 1 + len(self.parts) * (1 + TRIES * START_NUMBERS[start])
        self._room = Room(surface.width, surface.height, cells, CLEAR)

    @classmethod
    def build(cls, surface: Surface, parts: Sequence[Part], settings: Mapping[str, Any]) -> ManyTask:
        return cls(surface, parts, **settings)

    def apart(self) -> float:
        """Distance to the nearest other part above which a part is done, m; -inf where it does not count."""
        return -math.inf

    def _cells(self, gap: float) -> np.ndarray:
        radius = max(part.radius for part in self.parts)
        cells = lattice(np.zeros(2), np.array([self.surface.width, self.surface.height]), radius, gap)
        if len(cells) < self.most:
            raise checks.refuse(
                "parts",
                f"{self.most} parts ({', '.join(self.names)}) of radius up to {radius:.4g} m, {1e3 * gap:.3g} mm apart",
                f"at most {len(cells)} on this surface, {self.surface.width:g} x {self.surface.height:g} m",
            )
        return cells

    def start(self, uniform: np.ndarray) -> Start:
        shape = (len(uniform), len(self.parts))
        pose, present = np.empty((*shape, 3)), np.empty(shape, dtype=bool)
        draw_starts(self.hulls, self._room, self.crowded, self.fewest, self.most, uniform, pose, present)
        return Start(pose, present, np.zeros((len(uniform), 3)))

    def new_score(self, worlds: int) -> CrowdScore:
        return new_crowd_score(worlds, len(self.parts))

    def begin(self, state: State, start: Start, goal: np.ndarray, worlds: np.ndarray, result: CrowdScore) -> None:
        begin_crowd(
            self.rules, self.hulls, state.pose, state.mean_velocity, state.fallen, worlds, start.present, result
        )

    def score(self, state: State, goal: np.ndarray, result: CrowdScore) -> None:
        score_crowd(self.rules, self.hulls, state.pose, state.mean_velocity, state.fallen, state.diverged, result)

    def facts(self, state: State, result: CrowdScore) -> dict[str, np.ndarray]:
        return {
            "is_success": result.success,
            "position_error": result.distance,
            "clearance": result.clearance,
            "touching": result.touching,
            "parts_done": result.done,
            "fallen": result.fallen,
            "diverged": state.diverged,
        }

    def caption(self, result: CrowdScore, world: int) -> str:
        done, present = result.done[world], result.present[world].sum()
        clearance = round(1e3 * float(result.clearance[world]), 1) + 0.0  # + 0.0: not "-0.0"
        return f"{type(self).__name__}   {done} of {present} parts done   smallest distance {clearance} mm"


def _number_present(randomize: Any, parts: int) -> tuple[int, int]:
    """Smallest and largest number of parts in an episode."""
    allowed = f"None, or {{'parts': [low, high]}} with whole numbers 1 <= low <= high <= {parts}"
    if randomize is None or randomize == {}:
        return parts, parts
    if not isinstance(randomize, Mapping) or set(randomize) != {"parts"}:
        raise checks.refuse("randomize", randomize, allowed)
    bounds = randomize["parts"]
    if isinstance(bounds, str) or not isinstance(bounds, Sequence) or len(bounds) != 2:
        raise checks.refuse("randomize['parts']", bounds, allowed)
    low = checks.count("randomize['parts'][0]", bounds[0], most=parts)
    return low, checks.count("randomize['parts'][1]", bounds[1], least=low, most=parts)
