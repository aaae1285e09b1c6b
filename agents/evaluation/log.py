"""Everything that is kept of a policy's episodes for the report: outcomes, paths, and a film of one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym.envs import VibgymVectorEnv
from vibgym.envs.shared import SharedInterface, Truth
from vibgym.envs.viewer import side_of
from vibgym.policies.measures import Measured, Measures
from vibgym.policies.rollout import Step, Timing
from vibgym.rendering import Side

WATCHED_AMONG = 30
"""The world that is filmed is one of the first so many, which are also those of the trajectory plot."""

LEAST_WAY = 0.010
"""m: over shorter ways an efficiency says nothing."""

TURN_WEIGHT = 0.1  # m/rad: a turn of 1 rad counts as far as 100 mm when the farthest goal is chosen

SERIES = ("position_error", "heading_error", "clearance", "parts_done")
"""What is written down of ``info`` after every step, where a task has it."""


@dataclass(frozen=True)
class Film:
    """One world of a rollout, frame by frame; frame 0 is the start, with all elements at rest."""

    seed: int
    poses: np.ndarray  # (frames, parts, 3) m, m, rad
    present: np.ndarray  # (frames, parts) bool
    phasors: np.ndarray  # (frames, rows, columns, 2) float32, fractions of full scale, of the step that led to the pose
    goals: np.ndarray  # (frames, parts, 3); zeros for tasks without goal poses
    paths: tuple[np.ndarray, ...]  # (n, 2) m, along which the goals of the parts move; empty where they stay
    captions: tuple[str, ...]  # of the frames
    done: float  # parts done at the end; nan where they are not counted
    success: bool
    sides: tuple[Side | None, ...]  # views from the side, of frames whose parts may tilt


@dataclass(frozen=True)
class Rollout(Measured):
    """Records of one policy on one task. Arrays are (episodes,) unless said otherwise, in the order of the seeds."""

    path_lengths: np.ndarray  # (episodes, parts) m, of the centres, sampled once a step; 0 of absent parts
    straight: np.ndarray  # m, shortest way of all parts together, see below
    poses: np.ndarray  # (episodes, most steps + 1, parts, 3) float32; nan after the end, and of absent parts
    goals: np.ndarray  # (episodes, parts, 3); zeros for tasks without goal poses
    series: (
        np.ndarray
    )  # (SERIES, episodes, most steps + 1) float32; nan after the end, and where a task does not say it
    timing: Timing
    film: Film

    @property
    def path_length(self) -> np.ndarray:
        """Path travelled, of all parts together, m."""
        return self.path_lengths.sum(axis=1)

    @property
    def path_efficiency(self) -> np.ndarray:
        """Shortest way over path travelled, of successes; nan where there was hardly any way to go.

        The shortest way is the straight line from the start to the goal, in Sort to the nearest point of the part's zone. In
        Singulate, where parts have no goals of their own, it is the one from the start to where the part ended.
        """
        path = self.path_length
        sensible = self.success & (self.straight > LEAST_WAY) & (path > 0.0)
        return np.where(sensible, self.straight / np.maximum(path, 1e-12), np.nan)

    def over_time(self, name: str) -> np.ndarray | None:
        """One of :data:`SERIES`, (episodes, most steps + 1); None where the task does not say it."""
        values = self.series[SERIES.index(name)]
        return values if np.isfinite(values).any() else None

    @property
    def parts_done(self) -> np.ndarray:
        """Parts done at the end; nan where they are not counted."""
        done = self.series[SERIES.index("parts_done")]
        return done[np.arange(len(self.steps)), self.steps].astype(np.float64)

    @property
    def throughput(self) -> np.ndarray:
        """Parts done at the end over the episode's simulated time, 1/s; nan where they are not counted."""
        return self.parts_done / (self.steps * self.step_time)

    @property
    def clearance(self) -> np.ndarray:
        """Smallest distance between parts on the whole way, start included, m; nan without a second part."""
        clearances = self.series[SERIES.index("clearance")]
        least = np.where(np.isnan(clearances), np.inf, clearances).min(axis=1)
        return np.where(np.isfinite(least), least, np.nan).astype(np.float64)


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


class Log(Measures):
    """Keeps all that the report shows of the episodes, each of which has a world of its own.

    Args:
        env, info, seeds: see :class:`vibgym.policies.rollout.Ends`.

    Attributes:
        fields: arrays (episodes, ...), named as in :class:`Rollout`.
        watched: the world that is filmed.
    """

    def __init__(self, env: VibgymVectorEnv, info: dict[str, Any], seeds: Sequence[int]) -> None:
        super().__init__(env, info, seeds)
        self.start = truth = env.truth
        worlds, parts = truth.present.shape
        limit = env.max_episode_steps
        assert limit is not None  # else nobody could play
        self.several = (truth.present.sum(axis=1) > 1) | (env.task.flows and parts > 1)
        way = np.where(truth.present[..., None], truth.error, 0.0)
        self.fields |= {
            "path_lengths": np.zeros((worlds, parts)),
            "straight": np.hypot(way[..., 0], way[..., 1]).sum(axis=1),
            "poses": np.full((worlds, limit + 1, parts, 3), np.nan, dtype=np.float32),
            "goals": truth.goal,
            "series": np.full((len(SERIES), worlds, limit + 1), np.nan, dtype=np.float32),
        }
        self.last = np.full((worlds, parts, 2), np.nan)
        self.watched = farthest_goal(env, info.get("touching", np.zeros(worlds)))
        self.paths = tuple(env.paths(self.watched))
        self.frames: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, str, Side | None]] = []
        self._keep(0, np.ones(worlds, dtype=bool), info)

    def add(self, step: Step) -> None:
        """What a step has brought."""
        super().add(step)
        now = int(step.age[step.playing][0])  # all that play have begun together
        self._keep(now, step.playing, step.info)
        if step.ended.any() and not _leads_somewhere(self.env):
            poses, present = self.fields["poses"][step.ended], self.start.present[step.ended]
            way = np.where(present[..., None], poses[:, now] - poses[:, 0], 0.0)
            self.fields["straight"][step.ended] = np.hypot(way[..., 0], way[..., 1]).sum(axis=1)

    def _keep(self, step: int, playing: np.ndarray, info: dict[str, Any]) -> None:
        fields, truth = self.fields, self.env.truth
        there = truth.present & playing[:, None]
        fields["poses"][:, step][there] = truth.pose[there]
        place = np.where(there[..., None], truth.pose[..., :2], np.nan)
        moved = np.hypot(*np.moveaxis(place - self.last, -1, 0))
        fields["path_lengths"] += np.where(np.isfinite(moved), moved, 0.0)  # who arrives begins a way of its own
        self.last = place
        for name, values in zip(SERIES, fields["series"], strict=True):
            if name in info:
                which = playing & self.several if name == "clearance" else playing
                values[which, step] = info[name][which]
        if playing[self.watched]:
            self.frames.append(self._frame(truth, step))

    def _frame(
        self, truth: Truth, step: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, str, Side | None]:
        said = self.env.caption(self.watched).removeprefix(self.env.task.name).strip()
        phasors = self.env.phasors(self.watched).astype(np.float32)
        return (
            truth.pose[self.watched],
            truth.present[self.watched],
            truth.goal[self.watched],
            phasors,
            f"{step * self.env.step_time:.2f} s   {said}",
            side_of(self.env, self.watched),
        )

    def result(self, task: str, timing: Timing) -> Rollout:
        """All of it, when all episodes have ended."""
        return Rollout(task, self.seeds, self.env.step_time, timing=timing, film=self._film(), **self.fields)

    def _film(self) -> Film:
        """The watched world's."""
        poses, present, goals, phasors, captions, sides = zip(*self.frames, strict=True)
        world, fields = self.watched, self.fields
        return Film(
            self.seeds[world],
            np.array(poses),
            np.array(present),
            np.array(phasors),
            np.array(goals),
            self.paths,
            captions,
            float(fields["series"][SERIES.index("parts_done"), world, len(poses) - 1]),
            bool(fields["success"][world]),
            sides,
        )
