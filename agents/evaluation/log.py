"""What is written down of every world while a rollout goes on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.evaluation.bound import least_times
from agents.evaluation.touches import Touches
from vibgym.envs.shared import SharedInterface, Truth

WATCHED_AMONG = 30
"""The world that is filmed is one of the first so many, which are also those of the trajectory plot."""

TURN_WEIGHT = 0.1  # m/rad: a turn of 1 rad counts as far as 100 mm when the farthest goal is chosen

SERIES = ("position_error", "heading_error", "clearance", "parts_done")
"""What is written down of ``info`` after every step, where a task has it."""


@dataclass(frozen=True)
class Film:
    """One world of a rollout, frame by frame; frame 0 is the start, with all elements at rest."""

    seed: int
    poses: np.ndarray  # (frames, parts, 3) m, m, rad
    present: np.ndarray  # (parts,) bool
    phasors: np.ndarray  # (frames, rows, columns, 2) float32, fractions of full scale, of the step that led to the pose
    goals: np.ndarray  # (frames, parts, 3); zeros for tasks without goal poses
    paths: tuple[np.ndarray, ...]  # (n, 2) m, along which the goals of the parts move; empty where they stay
    captions: tuple[str, ...]  # of the frames
    done: float  # parts done at the end; nan where they are not counted
    success: bool


def farthest_goal(env: SharedInterface, touching: np.ndarray) -> int:
    """World among the first ones whose parts have farthest to go: worth watching, and the same for every policy.

    Without goals and zones it is the one where most pairs are in touch.

    Args:
        env: whose episodes have just begun.
        touching: (worlds,) pairs in touch.
    """
    error = env.truth.error
    far = (np.hypot(error[..., 0], error[..., 1]) + TURN_WEIGHT * np.abs(error[..., 2])).sum(axis=1)
    return int((far if _leads_somewhere(env) else touching)[:WATCHED_AMONG].argmax())


def _leads_somewhere(env: SharedInterface) -> bool:
    """Whether the task says where parts shall end."""
    return env.task.has_goal or env.task.zones is not None


class Ends:
    """How the worlds' first episodes end, and what they were rewarded with.

    Args:
        env: a vector environment whose episodes have just begun.
        info: what its reset said.
        limit: steps of the longest episode.

    Attributes:
        fields: arrays (worlds, ...), named as in :class:`agents.evaluation.rollout.Outcomes`.
    """

    def __init__(self, env: SharedInterface, info: dict[str, Any], limit: int) -> None:
        self.env, worlds = env, len(env.truth.present)
        self.fields: dict[str, np.ndarray] = {
            "steps": np.zeros(worlds, dtype=np.int64),
            **{key: np.zeros(worlds, dtype=bool) for key in ("success", "fallen", "diverged")},
            **{key: np.zeros(worlds) for key in ("returns", "position_error")},
            **{key: np.full(worlds, np.nan) for key in ("heading_error", "path_error")},
        }

    def write(self, step: int, alive: np.ndarray, info: dict[str, Any]) -> None:
        """Write down what the worlds ``alive`` (bool) are like after ``step``: nothing on the way."""

    def end(self, step: int, ended: np.ndarray, info: dict[str, Any]) -> None:
        """Write down how the worlds ``ended`` (bool) have ended."""
        fields = self.fields
        fields["steps"][ended] = step
        fields["success"][ended] = info["is_success"][ended]
        for key in ("fallen", "diverged", "position_error", "heading_error", "path_error"):
            if key in info:
                fields[key][ended] = info[key][ended]


class Measures(Ends):
    """The same, beside the least time that each episode needs and the collisions on its way; arguments as of :class:`Ends`.

    Attributes:
        fields: arrays (worlds, ...), named as in :class:`agents.evaluation.rollout.Measured`.
    """

    def __init__(self, env: SharedInterface, info: dict[str, Any], limit: int) -> None:
        super().__init__(env, info, limit)
        worlds = len(env.truth.present)
        self.touches = Touches(env.parts, worlds) if "touching" in info else None
        self.fields |= {
            "bound": least_times(env),
            "collisions": np.full(worlds, np.nan if self.touches is None else 0.0),
        }
        self._count(np.ones(worlds, dtype=bool), info)
        self.fields["collisions"] *= 0.0  # pairs in touch at the start do not count

    def write(self, step: int, alive: np.ndarray, info: dict[str, Any]) -> None:
        """Write down what the worlds ``alive`` (bool) are like after ``step``."""
        super().write(step, alive, info)
        self._count(alive, info)

    def _count(self, alive: np.ndarray, info: dict[str, Any]) -> None:
        if self.touches is not None:
            self.fields["collisions"] += self.touches.new(self.env.truth, alive & (info["touching"] > 0))


class Log(Measures):
    """What is written down of every world while a rollout goes on; all is of the worlds' first episodes.

    Args:
        env, info, limit: see :class:`Ends`.

    Attributes:
        fields: arrays (worlds, ...), named as in :class:`agents.evaluation.rollout.Rollout`.
        watched: the world that is filmed.
    """

    def __init__(self, env: SharedInterface, info: dict[str, Any], limit: int) -> None:
        super().__init__(env, info, limit)
        self.start = truth = env.truth
        worlds, parts = truth.present.shape
        self.several = truth.present.sum(axis=1) > 1
        way = np.where(truth.present[..., None], truth.error, 0.0)
        self.fields |= {
            "path_lengths": np.zeros((worlds, parts)),
            "straight": np.hypot(way[..., 0], way[..., 1]).sum(axis=1),
            "poses": np.full((worlds, limit + 1, parts, 3), np.nan, dtype=np.float32),
            "goals": truth.goal,
            "series": np.full((len(SERIES), worlds, limit + 1), np.nan, dtype=np.float32),
        }
        self.last = truth.pose[..., :2]
        self.watched = farthest_goal(env, info.get("touching", np.zeros(worlds)))
        self.paths = tuple(env.paths(self.watched))
        self.frames: list[tuple[np.ndarray, np.ndarray, np.ndarray, str]] = []
        self._keep(0, np.ones(worlds, dtype=bool), info)

    def write(self, step: int, alive: np.ndarray, info: dict[str, Any]) -> None:
        """Write down what the worlds ``alive`` (bool) are like after ``step``."""
        super().write(step, alive, info)
        self._keep(step, alive, info)

    def _keep(self, step: int, alive: np.ndarray, info: dict[str, Any]) -> None:
        fields, truth = self.fields, self.env.truth
        there = self.start.present & alive[:, None]
        fields["poses"][:, step][there] = truth.pose[there]
        fields["path_lengths"][there] += np.hypot(*(truth.pose[..., :2] - self.last)[there].T)
        self.last = truth.pose[..., :2]
        for name, values in zip(SERIES, fields["series"], strict=True):
            if name in info:
                which = alive & self.several if name == "clearance" else alive
                values[which, step] = info[name][which]
        if alive[self.watched]:
            self.frames.append(self._frame(truth, step))

    def _frame(self, truth: Truth, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
        said = self.env.caption(self.watched).removeprefix(self.env.task.name).strip()
        phasors = self.env.phasors(self.watched).astype(np.float32)
        return (
            truth.pose[self.watched],
            truth.goal[self.watched],
            phasors,
            f"{step * self.env.step_time:.2f} s   {said}",
        )

    def end(self, step: int, ended: np.ndarray, info: dict[str, Any]) -> None:
        """Write down how the worlds ``ended`` (bool) have ended."""
        super().end(step, ended, info)
        fields = self.fields
        if not _leads_somewhere(self.env):
            way = np.where(self.start.present[..., None], fields["poses"][:, step] - fields["poses"][:, 0], 0.0)[ended]
            fields["straight"][ended] = np.hypot(way[..., 0], way[..., 1]).sum(axis=1)

    def film(self, seed: int) -> Film:
        """The watched world's."""
        poses, goals, phasors, captions = zip(*self.frames, strict=True)
        world, fields = self.watched, self.fields
        return Film(
            seed,
            np.array(poses),
            self.start.present[world],
            np.array(phasors),
            np.array(goals),
            self.paths,
            captions,
            float(fields["series"][SERIES.index("parts_done"), world, len(poses) - 1]),
            bool(fields["success"][world]),
        )
