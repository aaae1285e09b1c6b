"""What is written down of every world while a rollout goes on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.evaluation.touches import Touches
from vibgym.envs.core import Core
from vibgym.tasks import ManyTask

WATCHED_AMONG = 30
"""The world that is filmed is one of the first so many, which are also those of the trajectory plot."""

TURN_WEIGHT = 0.1  # m/rad: a turn of 1 rad counts as far as 100 mm when the farthest goal is chosen


@dataclass(frozen=True)
class Film:
    """One world of a rollout, frame by frame; frame 0 is the start, with all elements at rest."""

    seed: int
    poses: np.ndarray  # (frames, parts, 3) m, m, rad; nan of absent parts
    phasors: np.ndarray  # (frames, rows, columns, 2) float32, fractions of full scale, of the step that led to the pose
    goal: np.ndarray  # (3,) of one part
    done: np.ndarray  # (frames,) parts done; nan with one part
    clearance: np.ndarray  # (frames,) m, smallest distance between parts; nan with one part
    success: bool


def farthest_goal(core: Core) -> int:
    """World among the first ones whose goal is farthest: worth watching, and the same for every policy.

    With several parts it is the one where they are farthest from their zones in all, or where most pairs are in touch.
    """
    score = core.score
    if isinstance(core.task, ManyTask):
        way = np.hypot(score.way[..., 0], score.way[..., 1]).sum(axis=1)
        return int((way if core.task.ZONES else score.touching)[:WATCHED_AMONG].argmax())
    distance = score.distance + TURN_WEIGHT * np.abs(score.error[:, 2])
    return int(distance[:WATCHED_AMONG].argmax())


class Log:
    """What is written down of every world while a rollout goes on; all is of the worlds' first episodes."""

    def __init__(self, core: Core, limit: int) -> None:
        self.core, self.many = core, isinstance(core.task, ManyTask)
        worlds, parts = core.worlds, len(core.parts)
        pose = core.simulator.state.pose
        self.present = core.score.present.copy() if self.many else np.ones((worlds, parts), dtype=bool)
        self.several = self.present.sum(axis=1) > 1
        self.poses = np.full((worlds, limit + 1, parts, 3), np.nan, dtype=np.float32)
        self.done, self.clearances = (np.full((worlds, limit + 1), np.nan, dtype=np.float32) for _ in range(2))
        self.touches = Touches(core) if self.many else None
        self.last = pose[..., :2].copy()
        self.fields: dict[str, np.ndarray] = {
            "steps": np.zeros(worlds, dtype=np.int64),
            **{key: np.zeros(worlds, dtype=bool) for key in ("success", "fallen", "diverged")},
            **{key: np.zeros(worlds) for key in ("returns", "position_error")},
            "heading_error": np.full(worlds, np.nan),
            "path_lengths": np.zeros((worlds, parts)),
            "collisions": np.full(worlds, 0.0 if self.many else np.nan),
        }
        self.watched = farthest_goal(core)
        self.film_poses: list[np.ndarray] = []
        self.film_phasors: list[np.ndarray] = []
        self.write(0, np.ones(worlds, dtype=bool))
        self.start = self.poses[:, 0, :, :2].copy()
        self.goals = core.goal.copy()
        way = core.score.way if self.many else self.goals[:, None, :2] - self.start
        self.straight = np.hypot(way[..., 0], way[..., 1]).sum(axis=1)

    def write(self, step: int, alive: np.ndarray) -> None:
        """Write down what the worlds ``alive`` (bool) are like after ``step``."""
        core, score = self.core, self.core.score
        pose, there = core.simulator.state.pose, self.present & alive[:, None]
        self.poses[:, step][there] = pose[there]
        here = pose[..., :2].copy()
        self.fields["path_lengths"][there] += np.hypot(*(here - self.last)[there].T)
        self.last = here
        if self.touches is not None:
            self.done[alive, step] = score.done[alive]
            several = alive & self.several
            self.clearances[several, step] = score.clearance[several]
            new = self.touches.new()
            self.fields["collisions"][alive] += new[alive]
        if alive[self.watched]:
            self.film_poses.append(np.where(self.present[self.watched, :, None], pose[self.watched], np.nan))
            self.film_phasors.append(core.phasors(self.watched).astype(np.float32))

    def end(self, step: int, ended: np.ndarray, info: dict[str, Any]) -> None:
        """Write down how the worlds ``ended`` (bool) have ended."""
        fields = self.fields
        fields["steps"][ended] = step
        fields["success"][ended] = info["is_success"][ended]
        for key in ("fallen", "diverged", "position_error", "heading_error"):
            if key in info:
                fields[key][ended] = info[key][ended]
        if self.many and not self.core.task.ZONES:  # type: ignore[attr-defined]
            way = np.where(self.present[..., None], self.poses[:, step, :, :2] - self.start, 0.0)[ended]
            self.straight[ended] = np.hypot(way[..., 0], way[..., 1]).sum(axis=1)

    def film(self, seed: int) -> Film:
        """The watched world's."""
        world, frames = self.watched, len(self.film_poses)
        return Film(
            seed,
            np.array(self.film_poses),
            np.array(self.film_phasors),
            self.goals[world],
            self.done[world, :frames],
            self.clearances[world, :frames],
            bool(self.fields["success"][world]),
        )
