"""Swap: two kinds of parts exchange the ends of the table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.physics.core.records import State
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.base import HOLD_PERIODS, Start, Task, looks_same_after
from vibgym.tasks.episode import Episode, Relations
from vibgym.tasks.exchange import FreeScoring
from vibgym.tasks.patterns import give_out
from vibgym.tasks.pose import PATIENT_TERMS, PoseTask
from vibgym.tasks.scoring import Scoring
from vibgym.tasks.starts import Starts

APART = 0.005
"""m, least distance between goals, and between starts."""

END_COLUMNS = 13
"""Elements along x of an end: room for fifteen of the shipped blocks at any heading."""


class Swap(Task):
    """Every part within 5 mm and 5 degrees of a pose at the other end, all of them at once for ten periods; none has fallen.

    Parts of the first kind start scattered over the left end, those of the second over the right end. Their goals, drawn in
    the same way, are at the other end, so all have to pass one another on the way. Headings count modulo a part's symmetry.

    Args:
        surface: the table.
        parts: of two kinds, by their names, in any order.
        free: parts of a kind are as good as one another: goals are given out at the start, so that the cubes of the ways add up
            to the least, and two parts exchange theirs at the end of a step where that makes their ways shorter. False: each
            part has the goal that was drawn for it.
        apart: m, least distance between goals, and between starts (5 mm); ``apart_mm`` in mm.
        columns: elements along x of each end.
        randomize: ``{"parts": [low, high]}``: so many of the parts, chosen at random, are there.
        slots: blocks of the state observation, at least the number of parts, which is the default.
        hold: see :class:`vibgym.tasks.Task`.

    Raises:
        ValueError: another number of kinds, ends that overlap or are too small, or another bad setting.
    """

    DEFAULT_PARTS = ("steel_block", "aluminium_block") * 8
    TERMS = PATIENT_TERMS
    FEATURES = ("present", "kind", *PoseTask.FEATURES, "gap", "neighbour")
    RANDOMIZED = ("parts",)
    has_goal = True
    position_tolerance = 0.005
    heading_tolerance = math.radians(5.0)

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        *,
        free: bool = True,
        apart: float | None = None,
        apart_mm: float | None = None,
        columns: int = END_COLUMNS,
        randomize: Any = None,
        slots: int | None = None,
        hold: int = HOLD_PERIODS,
    ) -> None:
        super().__init__(surface, parts, hold=hold)
        if len(self.kinds) != 2:
            raise checks.refuse(
                "parts", f"{len(self.kinds)} kinds: {', '.join(self.kinds)}", "parts of two kinds (names)"
            )
        self.free = self.exchanges = checks.flag("task_settings['free']", free)
        if apart is not None and apart_mm is not None:
            raise checks.conflict("task_settings: 'apart' and 'apart_mm' exclude each other")
        name, given = ("apart_mm", apart_mm) if apart is None else ("apart", apart)
        least = APART if given is None else checks.number(f"task_settings[{name!r}]", given, least=0.0)
        least *= 1.0 if apart_mm is None else 1e-3
        columns = checks.count("task_settings['columns']", columns, most=surface.columns // 2)
        self.slots = (
            len(self.parts) if slots is None else checks.count("slots", slots, least=len(self.parts), most=10_000)
        )
        everyone = Starts(surface, self.parts, "scattered", randomize)
        self._low, self._most = everyone.fewest, everyone.most
        end = replace(surface, columns=columns)
        self._own = [self.kind == k for k in range(2)]
        own = ([part for part, its in zip(self.parts, mine, strict=True) if its] for mine in self._own)
        self._ends = [Starts(end, of_kind, "scattered", apart=least, clear=least) for of_kind in own]
        self._far = surface.width - end.width
        self.draws = 1 + len(self.parts) + 2 * sum(each.draws for each in self._ends)

    def heading_period(self, part: Part) -> float:
        return looks_same_after(part)

    def start(self, uniform: np.ndarray, present: np.ndarray | None = None) -> Start:
        parts = len(self.parts)
        if present is None:
            count = np.minimum(self._low + (uniform[:, 0] * (self._most - self._low + 1)).astype(np.int64), self._most)
            rank = uniform[:, 1 : 1 + parts].argsort(axis=1, kind="stable").argsort(axis=1, kind="stable")
            present = rank < count[:, None]
        pose, goal = (np.zeros((len(uniform), parts, 3)) for _ in range(2))
        at = 1 + parts
        for k, (own, end) in enumerate(zip(self._own, self._ends, strict=True)):
            for places, side in ((pose, k), (goal, 1 - k)):
                drawn, _ = end.draw(uniform[:, at : at + end.draws], present[:, own])
                drawn[..., 0] += side * self._far
                places[:, own] = drawn
                at += end.draws
        beside = np.array([-self.surface.width, -self.surface.depth, 0.0])
        pose = np.where(present[..., None], pose, beside)
        goal = np.where(present[..., None], goal, 0.0)
        start = Start(pose, present, goal)
        return start._replace(goal=self.goal_from(start, pose))

    def goal_from(self, start: Start, pose: np.ndarray) -> np.ndarray:
        if not self.free:
            return start.goal
        goal = start.goal.copy()
        give_out(self.kind, start.present, np.ascontiguousarray(pose), goal)
        return goal

    def scoring(self, state: State, periods: int) -> Scoring:
        return FreeScoring(self, state, periods, self.free)

    def caption(self, relations: Relations, episode: Episode, world: int) -> str:
        error = 1e3 * float(episode.position_error[world])
        return f"{super().caption(relations, episode, world)}   error {error:.1f} mm"
