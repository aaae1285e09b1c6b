"""Feed: a part feeder. Parts arrive at one end and leave through the gate of their kind at the other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.reference import Pinned, bound
from vibgym.physics.core.noise import KEY_DRAWS, keys_from
from vibgym.physics.core.records import State
from vibgym.scene import outlines
from vibgym.scene.part_settings import DrawingSettings
from vibgym.scene.parts import PROTOTYPE, Part, StablePose, drawn_part
from vibgym.scene.surface import Surface
from vibgym.settings import read
from vibgym.simulation.plant import MIN_SPEED, plant_of
from vibgym.tasks.base import HOLD_PERIODS, Task
from vibgym.tasks.episode import EVENTS, STAYS, Episode, Relations, Start
from vibgym.tasks.flow import (
    CHANGING,
    FLOW,
    INLET,
    MEAN_LOAD,
    MEAN_TRANSIT,
    STEPS,
    Flow,
    begin_flow,
    check_slots,
    new_inlet,
    score_flow,
)
from vibgym.tasks.scoring import Scoring, Stage
from vibgym.tasks.sort import Zones, zones_from
from vibgym.tasks.starts import pose_of_absent

GATE = 0.050
"""m along x that gates take at the right border."""

WARM_UP = 12.0
"""s that rates leave out."""

OTHER = "other"
"""Kind of the stable poses without a name."""

ENOUGH = 0.99
"""Probability with which a stable pose has slots for all its parts among as many as may be on the table."""

ALIKE = 1e-3
"""Over the size: largest deviation of two stable poses that are one part; facets of a round side are rounded."""


class Feed(Task):
    """Parts arrive at the left end at any heading, and leave when their centre enters a gate at the right end.

    A part is *good* if it leaves through the gate of its kind, within 5 degrees of straight (heading 0, modulo its symmetry),
    at least the largest dimension of an element (36.8 mm) from the others, and no sooner after the last one through that gate
    than such parts follow each other at full speed (0.28 s). Otherwise it is *wrong*, *tilted* or *close*, in this order.
    Fallen parts are *lost*. When a part has left, an equal one arrives as soon as there is room. Episodes end at the
    limit only and have no success; the measure is good parts a minute.

    ``info`` reports the numbers of parts that were ``good``, ``tilted``, ``close``, ``wrong``, ``lost``, their rates per minute
    (``good_per_minute``, ...), the mean time from arrival to leaving (``transit``, s), and the mean number of parts
    ``on_table``, all without the first 12 s. ``info["parts"]`` reports the parts that have ``arrived`` in this step, and the
    ``event`` of those that have left in it (index of :data:`vibgym.tasks.episode.EVENTS`).

    There is one part per slot.

    Raises:
        ValueError: a gate for no kind or none for a kind, gates that overlap, a heap of more parts than there are or than fit,
            probabilities whose sum is not 1.
    """

    class Settings(Task.Settings):
        """Settings of Feed."""

        hold: ClassVar[int] = HOLD_PERIODS
        slots: ClassVar[None] = None

        zones: Zones | None = None
        """Gate of each kind: [x_low, y_low, x_high, y_high], m; None: strips across the last 50 mm."""

        heap: int = Field(default=1, ge=1)
        """Parts that arrive at once, in a heap in which they touch, when the first 0.2 m of the table are free; 1: parts arrive
        one at a time, with centres 20 to 55 mm from the left border."""

        warm_up: float = Field(default=WARM_UP, ge=0.0, le=1e9)
        """Time that rates exclude, s."""

        probabilities: tuple[Annotated[float, Field(gt=0.0, le=1.0)], ...] | None = None
        """Probability of each different part (by name or properties), in order of appearance. The part that arrives next is
        drawn with them; it waits until a slot of an equal part is empty and there is room, and no other part arrives before it.
        The sequence of parts is therefore independent of slots and room. None: any empty slot may be next."""

        most: int | None = Field(default=None, ge=1)
        """Parts on the table at once; None: one per slot."""

    settings: Settings

    DEFAULT_PARTS = ("steel_block", "aluminium_block") * 6
    TERMS = {
        "progress": ("distance", 1.0),
        "turn": ("turn", 0.5),
        "alignment": ("alignment", 0.5),
        "good": ("good", 5.0),
        "faulty": ("faulty", 5.0),
        "fallen": ("fallen", 5.0),
    }
    FEATURES = (
        "present", "kind", "element", "heading", "position", "way", "way_coarse", "turn", "turn_coarse", "turn_fine",
        "velocity", "spin", "gap", "neighbour", "arrived",
    )  # fmt: skip
    continuous_feed = True
    heading_tolerance = math.radians(5.0)
    modulo_symmetry = True
    draws = KEY_DRAWS

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings | None = None) -> None:
        super().__init__(surface, parts, settings)
        own = self.settings
        gates = default_gates(surface, self.kinds) if own.zones is None else own.zones
        self.zones = zones_from(gates, surface, self.kinds)
        self.inlet = new_inlet(surface, self.parts, own.heap, own.probabilities, own.most)
        self.warm_up = round(own.warm_up / surface.period)
        self.spacing = math.sqrt(2.0) * surface.element_size
        shortest = min(float(np.ptp(part.outline[:, 0])) for part in self.parts)
        top = max(plant_of(surface, self.parts).top_speed, MIN_SPEED)
        self.headway = math.floor((shortest + self.spacing) / (top * surface.period))

    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        """Return starts without parts on the table; ``present``: the parts that arrive during the episode."""
        shape = len(uniform), len(self.parts)
        pose = np.tile(pose_of_absent(self.surface), (*shape, 1))
        there = np.ones(shape, dtype=bool) if present is None else present
        check_slots("options['parts']", self.inlet, there)
        return Start(pose, there, np.zeros_like(pose), key=keys_from(uniform))

    def scoring(self, state: State, periods: int) -> FlowScoring:
        return FlowScoring(self, state, periods)

    def caption(self, relations: Relations, episode: Episode, world: int) -> str:
        on_table = episode.present[world].sum()
        return f"{self.name}   {on_table} parts on the table, {episode.parts_done[world]} of them straight and apart"


def default_gates(surface: Surface, names: Sequence[str]) -> Zones:
    """Return strips of equal width across the last 50 mm, the first kind's at the bottom.

    Raises:
        ValueError: the surface is shorter than inlet and gates.
    """
    if surface.width < GATE + INLET[1]:
        allowed = f"at least {GATE + INLET[1]:g} m long, or gates of your own"
        raise checks.refuse("zones", f"the default on a surface {surface.width:g} m long", allowed)
    edges = np.linspace(0.0, surface.depth, len(names) + 1).tolist()
    low = surface.width - GATE
    return {name: (low, edges[k], surface.width, edges[k + 1]) for k, name in enumerate(names)}


class FlowScoring(Scoring):
    """Scores episodes in which parts arrive and leave; they end at the limit or if the simulation diverges."""

    def __init__(self, task: Feed, state: State, periods: int) -> None:
        super().__init__(task.rules(periods), task.part_kinds, state)
        worlds, parts = state.pose.shape[:2]
        gates = np.array(task.zones)
        self._flow = Flow(
            clock=np.zeros(worlds, dtype=np.int64),
            key=np.zeros((worlds, 2), dtype=np.int64),
            tried=np.zeros(worlds, dtype=np.int64),
            arrivals=np.zeros(worlds, dtype=np.int64),
            pool=np.zeros((worlds, parts), dtype=bool),
            there=np.zeros((worlds, parts), dtype=bool),
            changed=np.zeros((worlds, parts), dtype=bool),
            age=np.zeros((worlds, parts), dtype=np.int64),
            last=np.zeros((worlds, len(gates)), dtype=np.int64),
            tally=np.zeros((worlds, STEPS + 1), dtype=np.int64),
            rate=np.zeros((worlds, MEAN_LOAD + 1)),
            idle=np.zeros((worlds, parts, 3)),
            gate=gates,
            kind=task.kind,
            away=pose_of_absent(task.surface),
            spacing=task.spacing,
            headway=task.headway,
            warm_up=task.warm_up,
            period=task.surface.period,
            inlet=task.inlet,
            context=self._context.record,
        )
        self.players, self.rewarded, self.changed = self._flow.pool, self._flow.there, self._flow.changed
        self._pinned = self._with_scratch()

    def shares(self) -> np.ndarray:
        return np.minimum(self.players.sum(axis=1), self._flow.inlet.most)

    def custom_state(self) -> dict[str, np.ndarray]:
        return {f"flow_{name}": values for name, values in self._flow._asdict().items() if name in CHANGING}

    def info(self) -> dict[str, np.ndarray]:
        tally, rate = self._flow.tally, self._flow.rate
        counts = {name: tally[:, k] for k, name in enumerate(EVENTS) if k != STAYS}
        rates = {f"{name}_per_minute": rate[:, k] for k, name in enumerate(EVENTS) if k != STAYS}
        return {**counts, **rates, "transit": rate[:, MEAN_TRANSIT], "on_table": rate[:, MEAN_LOAD]}

    def part_info(self) -> dict[str, np.ndarray]:
        return {"arrived": self.episode.arrived, "event": self.episode.event}

    def begin(self, worlds: np.ndarray, start: Start) -> None:
        flow = self._flow
        for values in (*self.custom_state().values(), *self.episode):
            values[worlds] = 0
        flow.key[worlds], flow.pool[worlds], flow.last[worlds] = start.key, start.present, -flow.headway
        flow.idle[worlds] = self.state.velocity[worlds]  # of parts that slide in place
        begin_flow(self._state.address, self._pinned.address, worlds)

    def stages(self) -> list[Stage]:
        return [bound(score_flow, self._state, self._with_scratch(), self.rules.periods)]

    def _with_scratch(self) -> Pinned[Flow]:
        """Return the flow with scratch memory for one thread."""
        shared = self._flow.inlet
        scratch = {name: getattr(shared, name).copy() for name in ("numbers", "order", "chance", "pose")}
        inlet = shared._replace(**scratch)
        return Pinned(FLOW, self._flow._replace(inlet=inlet, context=self.context(self.relations).record))


def in_stable_poses(
    path: str | Path,
    *,
    names: Mapping[int, str] | None = None,
    without: Sequence[int] = (),
    most: int = 12,
    heap: int = 1,
    surface: Surface = PROTOTYPE,
    **properties: Any,
) -> dict[str, Any]:
    """Return the arguments of a Feed in which copies of a mesh arrive in its stable poses, each with its probability.

    ``gym.make("vibgym/Feed-v0", **in_stable_poses("cap.stl", friction=0.5, names={0: "up", 1: "down"}))``. Poses that differ
    by a turn on the table only are one part. It has the slots that ``most`` parts require with a probability of
    :data:`ENOUGH`, and at least ``heap``.

    Args:
        path: of an STL file.
        names: kinds, with a gate each, of stable poses by their numbers, as ``python -m vibgym part`` lists them; the kind of
            all others is ``"other"``. None: every pose is a kind, the number after the file's name.
        without: stable poses that do not arrive, such as those that friction tips over, and those that are alike. The
            probabilities are those of the others among themselves.
        most, heap: of the task.
        surface: of the environment.
        **properties: as for :meth:`vibgym.Part.from_file`.

    Returns:
        ``parts`` and ``task_settings``.

    Raises:
        ValueError: a file or property that :meth:`vibgym.Part.from_file` refuses, or the name of a pose that there is not.
    """

    def lying(pose: int, name: str | None) -> tuple[Part, tuple[StablePose, ...]]:
        settings = {"file": str(path), **properties, "stable_pose": pose, "name": name}
        return drawn_part(read(DrawingSettings, settings, ""), surface)

    poses = lying(0, None)[1]
    most, heap = checks.count("most", most, most=1000), checks.count("heap", heap)
    chosen = {} if names is None else dict(names)
    for argument, numbers in {"names": chosen, "without": without}.items():
        for k in numbers:
            checks.count(f"{argument}: number of a stable pose", k, least=0, most=len(poses) - 1)
    different: list[Part] = []
    probability: list[float] = []
    left_out = set()
    for k, pose in enumerate(poses):
        name = f"{Path(path).stem}-{k}" if names is None else chosen.get(k, OTHER)
        part = lying(k, name)[0]
        at = next((j for j, other in enumerate(different) if _alike(part, other)), len(different))
        if at == len(different):
            different.append(part)
            probability.append(0.0)
        elif chosen.get(k, different[at].name) != different[at].name:
            raise checks.conflict(
                f"names: stable pose {k} is, after a turn on the table, that of {different[at].name!r}"
            )
        probability[at] += pose.probability
        if k in without:
            left_out.add(at)
    kept = [k for k in range(len(different)) if k not in left_out]
    if not kept:
        raise checks.conflict("without: no stable pose is left")
    total = sum(probability[k] for k in kept)
    shares = [probability[k] / total for k in kept]
    parts = [different[k] for k, share in zip(kept, shares, strict=True) for _ in range(max(heap, enough(most, share)))]
    return {"parts": parts, "task_settings": {"probabilities": shares, "most": most, "heap": heap}}


def enough(draws: int, probability: float) -> int:
    """Return the number that a binomial variable of so many draws does not exceed with a probability of :data:`ENOUGH`."""
    terms = (math.comb(draws, k) * probability**k * (1.0 - probability) ** (draws - k) for k in range(draws))
    return next((k for k, total in enumerate(accumulate(terms)) if total >= ENOUGH), draws)


def _alike(one: Part, other: Part) -> bool:
    """Return whether a part has the heights of another one, and its outline after a turn, within :data:`ALIKE`."""
    near = ALIKE * one.radius
    same = abs(one.height - other.height) < near and abs(one.centre_height - other.centre_height) < near
    return same and len(outlines.turns_onto([one.rim, *one.holes], [other.rim, *other.holes], ALIKE)) > 0
